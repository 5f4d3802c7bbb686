"""Uncertainty: expanded, by source, of errors that all readings share, and against a tolerance."""
