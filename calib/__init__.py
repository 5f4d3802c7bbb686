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

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from calib.api import observation, parameters, predict, readings, simulate
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

_HOMES = {  # imported when first asked for: a part of the package does not wait for all of it
    "AskedLevels": "calib.cell.planned",
    "CalibError": "calib.errors",
    "Cell": "calib.cell",
    "Compensation": "calib.compensation.commands",
    "Diagnosis": "calib.diagnosis",
    "Identification": "calib.identification",
    "Measurements": "calib.poses",
    "Poses": "calib.poses",
    "compensate": "calib.compensation.commands",
    "diagnose": "calib.diagnosis.diagnose",
    "identify": "calib.identification.identify",
    "in_one_session": "calib.poses.moves",
    "load_cell": "calib.files.cell",
    "load_measurements": "calib.files.tables",
    "load_plan": "calib.files.tables",
    "load_targets": "calib.files.tables",
    "observation": "calib.api",
    "parameters": "calib.api",
    "predict": "calib.api",
    "readings": "calib.api",
    "simulate": "calib.api",
}


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    found = getattr(import_module(_HOMES[name]), name)
    globals()[name] = found
    return found


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
