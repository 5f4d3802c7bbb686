"""calib: the robot model, the measured data and the estimate.

A cell is read from a file, or made of objects: ``Cell(Robot.from_urdf("arm.urdf"), markers, ..)``.

    import calib

    cell = calib.load_cell("cell.toml")
    data = calib.load_measurements(cell, "measurements.csv")
    result = calib.identify(cell, data)
    result.values, result.std, result["geometry:A2.x"], result.summary()
    commands = calib.compensate(cell, result, "plan.csv").q

Values are SI and radians, in the order of ``result.model.parameters``, whose ``id``, ``scale`` and
``unit`` make them readable. What the model lacks is asked by ``calib.diagnose(cell, data)``;
``calib.simulate`` makes measurements of a robot that is known. ``posecal explain python`` has an
example without files, and all public names. Every fault of a file or a call is a :class:`CalibError`
of one line.
"""

from __future__ import annotations

import importlib
import typing

if typing.TYPE_CHECKING:
    from calib.api import diagnose, identify, observation, parameters, predict, readings, simulate
    from calib.arm.robot import Robot
    from calib.cell import Cell, Load, Repeatability
    from calib.cell.planned import AskedLevels
    from calib.diagnosis import Diagnosis
    from calib.errors import CalibError
    from calib.files.cell import load_cell
    from calib.files.tables import load_measurements, load_plan, load_targets
    from calib.identification import Identification
    from calib.instruments import (
        ArmCamera,
        Distance,
        FixedCamera,
        Plane,
        Pose,
        Socket,
        Tracker,
    )
    from calib.noise import Noise
    from calib.poses import Measurements, Poses, poses_at
    from calib.poses.moves import in_one_session
    from calib.prediction.compensate import Compensation, compensate

_HOMES = {  # imported when first asked for: a part of the package does not wait for all of it
    "calib.api": "diagnose identify observation parameters predict readings simulate",
    "calib.arm.robot": "Robot",
    "calib.cell": "Cell Load Repeatability",
    "calib.cell.planned": "AskedLevels",
    "calib.prediction.compensate": "Compensation compensate",
    "calib.diagnosis": "Diagnosis",
    "calib.errors": "CalibError",
    "calib.files.cell": "load_cell",
    "calib.files.tables": "load_measurements load_plan load_targets",
    "calib.identification": "Identification",
    "calib.instruments": "ArmCamera Distance FixedCamera Plane Pose Socket Tracker",
    "calib.noise": "Noise",
    "calib.poses": "Measurements Poses poses_at",
    "calib.poses.moves": "in_one_session",
}
_HOME_OF = {name: home for home, names in _HOMES.items() for name in names.split()}

__all__ = [
    "ArmCamera",
    "AskedLevels",
    "CalibError",
    "Cell",
    "Compensation",
    "Diagnosis",
    "Distance",
    "FixedCamera",
    "Identification",
    "Load",
    "Measurements",
    "Noise",
    "Plane",
    "Pose",
    "Poses",
    "Repeatability",
    "Robot",
    "Socket",
    "Tracker",
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
    "poses_at",
    "predict",
    "readings",
    "simulate",
]


def __getattr__(name: str) -> typing.Any:
    if name == "__version__":
        return importlib.import_module("importlib.metadata").version("posecal")
    if name not in _HOME_OF:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    found = getattr(importlib.import_module(_HOME_OF[name]), name)
    globals()[name] = found
    return found


def __dir__() -> list[str]:
    return sorted(__all__)
