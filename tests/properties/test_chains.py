"""Chains of one to nine joints, written, read, moved and identified as a user would."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import calib
from calib.files.write_tables import measurements_csv, plan_csv
from calib.model.build import build
from calib.poses import Measurements
from tests import trees
from tests.bad_inputs.run import posecal
from tests.day import anywhere
from tests.helpers import cell_text

MARKERS = "a = [120.5, 0, 3]\nb = [-40, 90, 0]\nc = [0, 0, 150]"


KINDS = ("revolute", "continuous", "prismatic")


def written(n: int, folder: Path) -> calib.Cell:
    """A random chain as files."""
    rng = np.random.default_rng(n)
    kinds = ["fixed" if rng.random() < 0.2 else str(rng.choice(KINDS)) for _ in range(n)]
    kinds[rng.integers(n)] = "revolute"
    joints = trees.chain(rng, {f"j{k}": kind for k, kind in enumerate(kinds, 1)})
    (folder / "arm.urdf").write_text(trees.urdf(joints))
    robot = f'urdf = "arm.urdf"\nbase = "root"\ntip = "l_j{n}"'
    (folder / "cell.toml").write_text(cell_text(robot, MARKERS))
    return calib.load_cell(folder / "cell.toml")


def measured(cell: calib.Cell, count: int) -> Measurements:
    """Readings without noise of an arm with errors of half a millimetre, its base anywhere."""
    rng = np.random.default_rng(count)
    poses = anywhere(cell, rng, count)
    model = build(cell, poses).model
    base = np.array([p.effect == "base" for p in model.parameters])
    values = np.where(base, rng.uniform(-1.7, 1.7, len(base)), 5e-4 * rng.normal(size=len(base)))
    points = model.predict(values, poses)
    seen = rng.random(points.shape[:2]) < 0.9
    seen[0] = True
    return Measurements(poses, points, seen, np.full(seen.shape, np.nan))


@pytest.mark.parametrize("n", range(1, 10))
def test_tables_are_read_as_they_were_written(n: int, tmp_path: Path) -> None:
    cell = written(n, tmp_path)
    rng, data = np.random.default_rng(0), measured(cell, 12)
    session = {
        "time": np.arange(12.0) * 7.5,
        "temperature": rng.uniform(15, 30, 12).round(2),
        "approach": rng.choice([-1.0, 0.0, 1.0], data.poses.q.shape),
        "wrench": rng.normal(size=(12, 6)).round(4) * 100,
    }
    data = replace(data, poses=replace(data.poses, **session)).take(data.seen.any(axis=1))
    (tmp_path / "data.csv").write_text(measurements_csv(cell, data))
    back = calib.load_measurements(cell, tmp_path / "data.csv")
    assert back.poses.names == data.poses.names
    np.testing.assert_array_equal(back.seen, data.seen)
    np.testing.assert_allclose(back.points[data.seen], data.points[data.seen], atol=5.1e-9)
    for name in ("q", *session):
        np.testing.assert_allclose(getattr(back.poses, name), getattr(data.poses, name), rtol=1e-8)
    (tmp_path / "plan.csv").write_text(plan_csv(cell, data.poses))
    again = calib.load_plan(cell, tmp_path / "plan.csv")
    np.testing.assert_allclose(again.q, data.poses.q, rtol=1e-8)
    assert measurements_csv(cell, back) == (tmp_path / "data.csv").read_text()


@pytest.mark.parametrize(
    "n",
    [pytest.param(n, marks=() if n in (1, 4, 7) else pytest.mark.long) for n in (1, 2, 4, 6, 7, 9)],
)
def test_identified_without_noise(n: int, tmp_path: Path) -> None:
    """Every chain is solved to the digits of the table, and the same call gives the same bytes."""
    cell = written(n, tmp_path)
    data = measured(cell, 20 + 4 * cell.robot.dof)
    (tmp_path / "data.csv").write_text(measurements_csv(cell, data))
    texts = []
    for name in ("one.json", "two.json"):
        files = (str(tmp_path / file) for file in ("cell.toml", "data.csv"))
        heard = posecal("identify", *files, "--json", str(tmp_path / name))
        assert not heard.status, heard.err
        texts.append((tmp_path / name).read_text())
    assert texts[0] == texts[1]
    found = json.loads(texts[0])
    assert found["status"] == "converged"
    assert found["rms_mm"]["fitted"] < 2e-5
    assert found["rank"] == len(found["parameters"])
