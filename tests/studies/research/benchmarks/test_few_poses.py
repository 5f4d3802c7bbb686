"""Few poses: the plain truth is posecal's arm, and the benchmark runs and counts."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from scipy.spatial.transform import Rotation

import calib
from calib.arrays import Array
from calib.effects.base import Base
from calib.effects.tool import Tool
from calib.model import Model
from calib.model.build import build
from calib.model.reduction import carried_over
from calib.poses import poses_at
from studies.research.benchmarks.few_poses.__main__ import ARMS, main
from studies.research.benchmarks.few_poses.day import (
    SIGMA,
    Day,
    Setting,
    draw_day,
    read_cell,
    ridge,
    table_of,
)
from studies.research.benchmarks.few_poses.tables import errors_of, true_values

PLACES = ("x", "y", "z", "rx", "ry", "rz")


def a_day(arm: str, times: float = 1.0) -> Day:
    """Three markers where the cell has them."""
    day = draw_day(ARMS[arm], Setting(times, 3, False), 0, 0)
    return replace(day, markers=day.guesses)


def placed(model: Model, day: Day) -> Array:
    """Values of an arm without errors where the day's stands."""
    values = model.initial
    values[model.where(Base)] = [*day.p, *Rotation.from_matrix(day.R).as_rotvec()]
    return values


@pytest.mark.parametrize("arm", ARMS)
def test_truth_with_all_constants_to_second_order(arm: str) -> None:
    """What is left falls by a hundred where the constants, carried over, fall by ten."""
    left = []
    for times in (1.0, 0.1):
        day = a_day(arm, times)
        cell, poses = read_cell(day), poses_at(day.q)
        built = build(cell, poses)
        model, points = built.model, day.points(day.q)
        keys = [("geometry", s, c) for s in (*day.arm.names, day.arm.tip) for c in PLACES]
        values, free = placed(model, day), model.where(Base, Tool)
        own = np.setdiff1d(np.arange(len(values)), free)
        values[own] = carried_over(built.full, model, keys) @ day.constants[1:].ravel()
        for _ in range(4):  # base and markers take up the rest
            predicted, J = model.jacobian(values, poses)
            rows = J.reshape(-1, J.shape[-1])[:, free]
            values[free] += np.linalg.lstsq(rows, (points - predicted).ravel(), rcond=None)[0]
        left.append(np.abs(points - calib.predict(cell, poses, values)).max())
    assert left[0] < 1e-4
    assert left[1] == pytest.approx(left[0] / 100, rel=0.3)


def test_ridge_finds_the_parameters() -> None:
    """Many readings leave the penalty little to do: within a few standard deviations of the truth."""
    day = draw_day(ARMS["6R"], Setting(10.0, 3, False), 0, 0)
    cell, data = read_cell(day), table_of(day.q, day.read)
    found = calib.identify(cell, data)
    values = ridge(found.model, data, SIGMA, np.random.default_rng(0))
    assert np.abs((values - true_values(cell, day)) / found.std).max() < 5.0


def test_errors_by_hand() -> None:
    own = [(1.0, 2.0), (2.0, 1.0), (None, 1.0), (1.0, 1.01)]
    found = errors_of([{"errors_m": {"posecal": a, "other": b}} for a, b in own])
    assert (found["posecal"]["silent"], found["other"]["silent"]) == (1, 0)
    assert found["other"]["mean_ratio"] == pytest.approx(4.01 / 4)


@pytest.mark.long
def test_command(tmp_path: Path) -> None:
    path = tmp_path / "few.json"
    done = CliRunner().invoke(
        main, ["--days", "1", "--arm", "6R", "--poses", "8", "--poses", "15", "--json", str(path)]
    )
    assert done.exit_code == 0, done.output
    tables = json.loads(path.read_text())["tables"]
    assert [t["poses"] for t in tables] == [8, 15] * 2
    assert all(t["errors_m"]["ridge by CV"] > 0.0 for t in tables)
    assert all(t["errors_m"]["posecal"] < 1e-4 for t in tables if t["poses"] == 15)
    assert all(t["intervals"]["posecal"]["of"] > 20 for t in tables if t["poses"] == 15)
