"""Chains of one to nine joints, written, read, moved and identified as a user would."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import calib
from calib.arrays import Array
from calib.files.write_tables import measurements_csv, plan_csv
from calib.model.build import build
from calib.poses import Measurements, poses_at
from tests.bad_inputs.run import posecal

KINDS = ("revolute", "continuous", "prismatic")
ELEMENT = """\
  <link name="l{k}"><inertial><mass value="{mass}"/></inertial></link>
  <joint name="j{k}" type="{kind}">
    <origin xyz="{xyz}" rpy="{rpy}"/><parent link="l{before}"/><child link="l{k}"/>
    <axis xyz="{axis}"/><limit lower="{low}" upper="{high}" effort="0"/>
  </joint>
"""
CELL = """\
schema = 1
[robot]
urdf = "arm.urdf"
base = "l0"
tip = "l{n}"
[markers_mm]
a = [120.5, 0, 3]
b = [-40, 90, 0]
c = [0, 0, 150]
[instrument]
sigma_mm = 0.01
[model]
effects = ["base", "tool", "geometry"]
"""


def words(values: Array) -> str:
    return " ".join(f"{value:.17g}" for value in values)


class Chain:
    """A chain that this file moves by its own arithmetic, with the files that describe it."""

    def __init__(self, n: int, folder: Path) -> None:
        rng = np.random.default_rng(n)
        self.kinds = ["fixed" if rng.random() < 0.2 else str(rng.choice(KINDS)) for _ in range(n)]
        self.kinds[rng.integers(n)] = "revolute"
        xyz, rpy = rng.uniform(-0.6, 0.6, (n, 3)), rng.uniform(-3, 3, (n, 3))
        axes = rng.normal(size=(n, 3))
        slides = np.array(self.kinds) == "prismatic"
        self.high = np.where(slides, 0.7, 2.5)
        text = '<?xml version="1.0"?>\n<robot name="chain">\n  <link name="l0"/>\n'
        for k, kind in enumerate(self.kinds):
            text += ELEMENT.format(
                k=k + 1, before=k, kind=kind, mass=3.5, xyz=words(xyz[k]),
                rpy=words(rpy[k]), axis=words(axes[k]), low=-self.high[k], high=self.high[k],
            )  # fmt: skip
        (folder / "arm.urdf").write_text(text + "</robot>\n")
        (folder / "cell.toml").write_text(CELL.format(n=n))
        self.moving = [k for k, kind in enumerate(self.kinds) if kind != "fixed"]

    def configurations(self, count: int) -> Array:
        rng = np.random.default_rng(count)
        return rng.uniform(-1, 1, (count, len(self.moving))) * self.high[self.moving]


@pytest.fixture(params=range(1, 10))
def chain(request: pytest.FixtureRequest, tmp_path: Path) -> tuple[Chain, Path]:
    return Chain(request.param, tmp_path), tmp_path


def measured(cell: calib.Cell, q: Array) -> Measurements:
    """Readings without noise of an arm with errors of half a millimetre, its base anywhere."""
    poses = poses_at(q)
    model = build(cell, poses).model
    rng = np.random.default_rng(len(q))
    values = np.array(
        [
            rng.uniform(-1.7, 1.7) if p.effect == "base" else rng.normal() * 5e-4
            for p in model.parameters
        ]
    )
    points = model.predict(values, poses)
    seen = rng.random(points.shape[:2]) < 0.9
    seen[0] = True
    return Measurements(poses, points, seen, np.full(seen.shape, np.nan))


def test_tables_are_read_as_they_were_written(chain: tuple[Chain, Path]) -> None:
    arm, folder = chain
    cell = calib.load_cell(folder / "cell.toml")
    rng = np.random.default_rng(0)
    data = measured(cell, arm.configurations(12))
    session = {
        "time": np.arange(12.0) * 7.5,
        "temperature": rng.uniform(15, 30, 12).round(2),
        "approach": rng.choice([-1.0, 0.0, 1.0], data.poses.q.shape),
        "wrench": rng.normal(size=(12, 6)).round(4) * 100,
    }
    shown = data.seen.any(axis=1)
    data = replace(data, poses=replace(data.poses, **session)).take(shown)
    (folder / "data.csv").write_text(measurements_csv(cell, data))
    back = calib.load_measurements(cell, folder / "data.csv")
    assert back.poses.names == data.poses.names
    np.testing.assert_array_equal(back.seen, data.seen)
    np.testing.assert_allclose(back.points[data.seen], data.points[data.seen], atol=5.1e-9)
    for name in ("q", "time", "temperature", "approach", "wrench"):
        np.testing.assert_allclose(getattr(back.poses, name), getattr(data.poses, name), rtol=1e-8)
    (folder / "plan.csv").write_text(plan_csv(cell, data.poses))
    again = calib.load_plan(cell, folder / "plan.csv")
    np.testing.assert_allclose(again.q, data.poses.q, rtol=1e-8)
    (folder / "again.csv").write_text(measurements_csv(cell, back))
    assert (folder / "again.csv").read_text() == (folder / "data.csv").read_text()


def test_identified_without_noise(chain: tuple[Chain, Path]) -> None:
    """Every chain is solved to the digits of the table, and the same call gives the same bytes."""
    arm, folder = chain
    cell = calib.load_cell(folder / "cell.toml")
    data = measured(cell, arm.configurations(20 + 4 * len(arm.moving)))
    (folder / "data.csv").write_text(measurements_csv(cell, data))
    texts = []
    for name in ("one.json", "two.json"):
        call = ("identify", str(folder / "cell.toml"), str(folder / "data.csv"), "--json")
        heard = posecal(*call, str(folder / name))
        assert not heard.status, heard.err
        texts.append((folder / name).read_text())
    assert texts[0] == texts[1]
    found = json.loads(texts[0])
    assert found["status"] == "converged"
    assert found["rms_mm"]["fitted"] < 2e-5
    assert found["rank"] == len(found["parameters"])
