"""Uncertainty of estimates: expanded, its degrees of freedom, errors that all readings share."""
