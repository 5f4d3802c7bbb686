"""Sim-to-real diagnosis: where the gap lies, what causes it, how far it shrinks."""

from calib.diagnosis.diagnosis import Diagnosis

__all__ = ["Diagnosis"]
