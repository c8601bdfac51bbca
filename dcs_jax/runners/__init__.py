"""Tracks through videos: the tracker's `init`, `score` and `step`, compiled and scanned.

sequence.py  one track through one video in memory
batch.py     many tracks through one video or many, in memory
stream.py    many tracks that come and go, through frames as they arrive
slots.py     what batch and stream run on: a fixed number of tracks, present or not
programs.py  the two compiled programs of the slots
sharding.py  the slots on the cores of a CPU or the devices of a mesh
"""
