"""Sealed cases that cameras, wires, motion capture and sockets read, and faults of these.

The arms are the first families' in MuJoCo; projection, distances and frames are numpy's here.
"""
