"""Table I of the paper reproduced: ``python -m studies.research.paper.table_one [--trials N]``.

The paper gives neither its three configurations nor its marker triangle nor the normalisation of
approach #1. ``table_one.json`` holds a set that reproduces its twelve standard deviations (found by a
search from random starts).
"""

from __future__ import annotations

import json
from dataclasses import dataclass, replace
from importlib.resources import files
from typing import Any

import numpy as np

from calib.arm.robot import Robot
from calib.arm.se3 import transform
from calib.arm.statics import Payload
from calib.arrays import Array
from calib.effects.context import Context
from calib.effects.geometry import LinkGeometry
from calib.effects.joint import JointOffset
from calib.instruments import Tracker
from calib.model import Model
from calib.noise import Noise
from calib.poses import poses_at
from studies.compare.experiment import (
    PLAIN,
    POINTS,
    WAYS,
    Prediction,
    SimulatedExperiment,
    noise_weights,
    predict,
)
from studies.compare.simulate import Refits, agreement, refits
from studies.research.bench import Output, Row, bench, count, table

PARAMETERS = ("l1", "l2", "l3", "q1", "q2", "q3")
UNITS = ("mm",) * 3 + ("mdeg",) * 3
SCALES = np.array([1e-3] * 3 + [np.radians(1e-3)] * 3)
TRUTH = np.array([3e-3, 2e-3, 5e-3, *np.radians([1.0, 0.5, 2.0])])
"""Errors of the link lengths [m] and joint offsets [rad] in the paper's simulation study."""
SIGMA = 1e-5
_LINKS = (("q2", 2), ("q3", 0), ("tip", 0))  # l_1 along z to joint 2, l_2 and l_3 along x


@dataclass(frozen=True, eq=False)
class Setting:
    """What the paper does not print.

    q : ndarray, shape (3, 3), rad, joint readings of the three configurations
    markers : ndarray, shape (3, 3), m, tip frame, x along the last link
    length : float, m, by which approach #1 multiplies its rotations
    """

    q: Array
    markers: Array
    length: float


def embedded() -> dict[str, Any]:
    """The content of ``table_one.json``: the printed table, and the set that reproduces it."""
    text = (files("studies.research.paper") / "table_one.json").read_text(encoding="utf-8")
    found: dict[str, Any] = json.loads(text)
    return found


def embedded_setting() -> Setting:
    """The set that reproduces Table I."""
    found = embedded()
    return Setting(
        np.radians(found["configurations_deg"]),
        np.array(list(found["markers_mm"].values())) * 1e-3,
        found["length_mm"] * 1e-3,
    )


LENGTHS_M = (1.0, 0.8, 0.6)
"""l_1, l_2, l_3 of the paper's simulation study [m]."""


def arm_of_equation_21() -> Robot:
    """The weightless arm of equation (21), its tip at the end of link 3 with x along the link.

    Joint 1 turns about +z; joints 2 and 3 about -y, so that positive angles lift the links as in
    ``z = l_1 + l_2 sin q_2 + l_3 sin(q_2 + q_3)``. At q = 0 all frames are parallel to the base.

    >>> from calib.arm.kinematics import forward
    >>> frames = forward(arm_of_equation_21(), np.array([[0.0, 0.0, np.pi / 2]]))
    >>> [float(x) for x in frames.o[0, -1].round(9)]
    [0.8, 0.0, 1.6]
    """
    rise, upper, fore = LENGTHS_M
    shifts = np.array([[0.0, 0.0, 0.0], [0.0, 0.0, rise], [upper, 0.0, 0.0], [fore, 0.0, 0.0]])
    return Robot(
        name="arm of equation (21)",
        base="base",
        tip="tip",
        joints=("q1", "q2", "q3"),
        prismatic=np.zeros(3, dtype=bool),
        origins=transform(np.broadcast_to(np.eye(3), (4, 3, 3)), shifts),
        axes=np.array([[0.0, 0.0, 1.0], [0.0, -1.0, 0.0], [0.0, -1.0, 0.0]]),
        limits=np.full((3, 2), [-np.pi, np.pi]),
        efforts=np.full(3, np.nan),
        masses=np.zeros(3),
        coms=np.zeros((3, 3)),
    )


def experiment_at(setting: Setting) -> SimulatedExperiment:
    """The simulation study of section IV: fits start at the nominal arm, the truth is off by TRUTH."""
    robot = arm_of_equation_21()
    names = ("m1", "m2", "m3")
    context = Context(robot, setting.markers)
    lengths = [LinkGeometry.at(context, where).only((axis,)) for where, axis in _LINKS]
    offsets = [JointOffset.at(context, joint) for joint in robot.joints]
    model = Model(
        robot,
        names,
        setting.markers,
        (*lengths, *offsets),
        Payload(),
        np.array([0.0, 0.0, -9.80665]),
        (Tracker(noise=Noise.isotropic(SIGMA)),),
    )
    poses, seen = poses_at(setting.q), np.ones((3, 3), dtype=bool)
    weights = noise_weights(model, TRUTH, poses, seen)
    return SimulatedExperiment(model, poses, seen, weights, np.zeros(6), TRUTH, setting.length)


def predictions_at(experiment: SimulatedExperiment) -> dict[str, Prediction]:
    """Predicted covariance of every way, at the truth."""
    there = replace(experiment, nominal=experiment.truth)
    return {way.key: predict(there, way) for way in WAYS}


def simulated(experiment: SimulatedExperiment, trials: int, seed: int = 0) -> dict[str, Refits]:
    """The paper's repeated calibration experiments, by the two approaches of Table I."""
    found = predictions_at(experiment)
    return refits(experiment, [found[PLAIN.key], found[POINTS.key]], trials, seed=seed)


@bench(count("--trials", 1000, help="Simulated calibrations."))
def main(trials: int, seed: int) -> Output:
    """Table I beside its reproduction and the simulation."""
    setting, printed = embedded_setting(), embedded()["printed"]
    experiment = experiment_at(setting)
    found = predictions_at(experiment)
    done = simulated(experiment, trials, seed)
    columns: dict[str, Array] = {}
    for name, way, key in (("#1", PLAIN, "approach_1"), ("#2", POINTS, "approach_2")):
        fits = done[way.key]
        own = agreement(fits.errors[fits.settled], found[way.key].covariance)
        assert own is not None  # noqa: S101
        columns[f"{name}\npaper"] = np.array(printed[key])
        columns[f"{name}\nours"] = found[way.key].std / SCALES
        columns[f"{name}\nsimulated"] = own.std / SCALES
    factors = {"#1 / #2\npaper": printed["improvement"], "#1 / #2\nours": _factors(found)}
    rows: list[Row] = [
        {
            "": f"d{name}",
            "unit": UNITS[i],
            **{key: f"{column[i]:.3f}" for key, column in columns.items()},
            **{key: f"{column[i]:.2f}" for key, column in factors.items()},
        }
        for i, name in enumerate(PARAMETERS)
    ]
    above = f"Table I: standard deviations, {trials} simulated calibrations\n"
    shown = [above, table(rows), _told(setting)]
    return shown, {"table": rows}


def _factors(found: dict[str, Prediction]) -> Array:
    return np.asarray(found[PLAIN.key].std / found[POINTS.key].std)


def _told(setting: Setting) -> str:
    angles = ", ".join(str(tuple(round(float(v), 1) for v in row)) for row in np.degrees(setting.q))
    points = ", ".join(str(tuple(round(float(v), 1) for v in row)) for row in setting.markers * 1e3)
    return (
        f"\nfor the configurations {angles} deg,\nmarkers {points} mm from the tip, length "
        f"{setting.length * 1e3:.4g} mm: one set of many that print the same table"
    )


if __name__ == "__main__":
    main()
