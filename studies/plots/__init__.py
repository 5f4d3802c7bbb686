"""Figures with their numbers: plain arrays, names and units in, a ``Picture`` out."""
