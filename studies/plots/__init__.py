"""Figures with their numbers: plain arrays, names and units in, a ``Picture`` out."""

from studies.plots.style import Picture, files

__all__ = ["Picture", "files"]
