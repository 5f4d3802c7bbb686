"""What scatters runs smoothly with nothing; a joint that walks does, with time."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from calib.arrays import Array
from calib.diagnosis.serial import chance_of_run, scattered, smooth_run
from calib.diagnosis.stage import Fit, Stage
from calib.scatter import Variances
from tests.calib.diagnosis.test_diagnose import measured
from tests.helpers import stage_of

SIZE, JOINT = 1e-4, 1


def test_independent_values_come_by_chance_as_often_as_said(rng: np.random.Generator) -> None:
    found = np.array([chance_of_run(rng.normal(size=30)) for _ in range(2000)])
    assert np.mean(found < 0.05) == pytest.approx(0.05, abs=0.02)
    assert chance_of_run(np.cumsum(rng.normal(size=40))) < 1e-4


def moved(off: Array) -> tuple[Stage, Fit]:
    """A day on which a joint is off by so much in each configuration, under that scatter."""
    cell, data, _ = measured("", [], seed=3)
    stage = stage_of(cell, data)
    levers = stage.scatter.levers[..., JOINT]
    readings = data.readings + levers * off[data.poses.configuration][:, None, None]
    stage = replace(stage, data=replace(data, readings=readings))
    variances = Variances.none(cell.robot.dof)
    variances.configuration[JOINT] = SIZE**2
    return stage, stage.fit((), variances=variances)


def test_what_a_joint_was_off_by_is_predicted_and_runs_with_time(rng: np.random.Generator) -> None:
    cell, data, _ = measured("", [], seed=3)
    count = int(data.poses.configuration.max()) + 1
    order = np.argsort(
        [data.poses.clock[data.poses.configuration == c].min() for c in range(count)]
    )
    walk = np.empty(count)
    walk[order] = np.cumsum(rng.normal(size=count))
    for off, smooth in ((rng.normal(size=count), False), (walk / walk.std(), True)):
        stage, fit = moved(SIZE * (off - off.mean()))
        found = scattered(stage, fit)[0][:, JOINT]
        expected = SIZE * (off - off.mean())[data.poses.configuration]
        assert np.corrcoef(found, expected)[0, 1] > 0.7
        run = smooth_run(stage, fit)
        assert (run is not None) == smooth
        if run is not None:
            assert (run.where, run.depends_on) == (cell.robot.joints[JOINT], "time")
