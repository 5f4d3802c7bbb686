"""calib: the robot model, the measured data and the estimate.

A cell file names the robot, the markers, the instrument and what the model contains:

    cell = load_cell("cell.toml")
    data = load_measurements(cell, "measurements.csv")
    result = identify(cell, data)
    commands = compensate(cell, result, "targets.csv").q
"""

from calib.api import observation, parameters, predict, readings
from calib.cell import Cell
from calib.compensation.commands import Compensation, compensate
from calib.diagnosis import Diagnosis, diagnose
from calib.errors import CalibError
from calib.files.cell import load_cell
from calib.files.tables import load_measurements, load_plan, load_targets
from calib.identify import Identification, identify
from calib.poses import Measurements, Poses
from calib.poses.moves import in_one_session
from calib.simulate import simulate

__all__ = [
    "CalibError",
    "Cell",
    "Compensation",
    "Diagnosis",
    "Identification",
    "Measurements",
    "Poses",
    "compensate",
    "diagnose",
    "identify",
    "in_one_session",
    "load_cell",
    "load_measurements",
    "load_plan",
    "load_targets",
    "observation",
    "parameters",
    "predict",
    "readings",
    "simulate",
]
