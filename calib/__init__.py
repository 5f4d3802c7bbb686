"""calib: the robot model, the measured data and the estimate.

A cell file names the robot, the markers, the instrument and what the model contains:

    import calib

    cell = calib.load_cell("cell.toml")
    data = calib.load_measurements(cell, "measurements.csv")
    result = calib.identify(cell, data)
    result.values, result.std
    commands = calib.compensate(cell, result, "plan.csv").q

Values are SI and radians, in the order of ``result.model.parameters``, whose ``id``, ``scale`` and
``unit`` make them readable. What the model lacks is asked by ``calib.diagnose(cell, data)``;
``calib.simulate`` makes measurements of a robot that is known. Every fault of a file or a call is a
:class:`CalibError` of one line.
"""

from calib.api import observation, parameters, predict, readings
from calib.cell import Cell
from calib.cell.planned import AskedLevels
from calib.compensation.commands import Compensation, compensate
from calib.diagnosis import Diagnosis
from calib.diagnosis.diagnose import diagnose
from calib.errors import CalibError
from calib.files.cell import load_cell
from calib.files.tables import load_measurements, load_plan, load_targets
from calib.identification import Identification
from calib.identification.identify import identify
from calib.poses import Measurements, Poses
from calib.poses.moves import in_one_session
from calib.simulation import simulate

__all__ = [
    "AskedLevels",
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
