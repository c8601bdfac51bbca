"""Frames in, boxes and images out. Nothing here knows about the tracker."""
