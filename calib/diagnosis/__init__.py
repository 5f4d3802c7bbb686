"""Sim-to-real diagnosis: where the gap lies, what causes it, how far it shrinks."""

from calib.diagnosis.diagnose import Diagnosis

__all__ = ["Diagnosis"]
