"""Frames in, boxes and pictures out. Nothing here knows of the tracker."""
