"""The forward model: built from a cell, its derivatives, its parameters, and how sure they are."""

from calib.model.model import Model

__all__ = ["Model"]
