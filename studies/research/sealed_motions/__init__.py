"""Sealed motions: an independent truth of torques, and how often the diagnosis names what is there."""
