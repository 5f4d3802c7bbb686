"""Designs of motions: within limits, certified, better than chance, and what tells terms apart."""

from __future__ import annotations

import itertools
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from calib.arrays import Array
from calib.cell import Cell
from calib.cell.planned import Load, MotionKeys
from calib.errors import CalibError, UnknownEffect
from doe import design_motions
from doe.motions.draw import drawn
from doe.motions.information import information
from tests.calib.test_motion import arm, cell_of

USUAL = ("coulomb_friction", "viscous_friction", "armature")


def planned(folder: Path, *effects: str, **more: object) -> Cell:
    """A cell of four joints with limits of speed and torque, whose model is of these terms."""
    cell = cell_of(arm(folder))
    robot = replace(
        cell.robot,
        limits=np.tile([-1.0, 1.2], (4, 1)),
        speeds=np.array([1.0, 0.8, 0.5, 1.5]),
        accelerations=np.array([4.0, 3.0, 2.0, 5.0]),
        efforts=np.array([np.nan, 250.0, np.nan, np.nan]),
    )
    return replace(cell, robot=robot, motion=MotionKeys(effects=effects or USUAL), **more)


def test_motions_keep_the_limits(tmp_path: Path) -> None:
    cell = planned(tmp_path)
    motions, _, granted = drawn(cell, 20, 10.0, np.random.default_rng(0))
    assert not granted
    for own in motions:
        q, v, a = own.at(own.time)
        assert (q >= -1.0).all()
        assert (q <= 1.2).all()
        assert (np.abs(v) <= cell.robot.speeds).all()
        assert (np.abs(a) <= cell.robot.accelerations).all()
        assert np.abs(own.torque(cell, q, v, a)[:, 1]).max() < 250.0
        assert np.abs(v[[0, -1]]).max() < 1e-9
        assert np.abs(a[[0, -1]]).max() < 1e-9
        assert np.abs(np.gradient(q, own.time, axis=0)[5:-5] - v[5:-5]).max() < 1e-3


def test_torques_beyond_the_limit_remove_motions(tmp_path: Path) -> None:
    cell = planned(tmp_path)
    weak = replace(cell, robot=replace(cell.robot, efforts=np.array([np.nan, 1.0, np.nan, np.nan])))
    with pytest.raises(CalibError, match="joint_torque"):
        drawn(weak, 10, 10.0, np.random.default_rng(0))


@pytest.mark.parametrize("criterion", ["D", pytest.param("A", marks=pytest.mark.long), "E"])
def test_no_choice_beats_the_bound(tmp_path: Path, criterion: str) -> None:
    """Against every choice of two from ten."""
    found = design_motions(planned(tmp_path), 2, criterion=criterion, candidates=10, seconds=10.0)
    pool, _, _ = drawn(found.cell, 10, 10.0, np.random.default_rng(0))
    M = information(found.cell, pool, USUAL, ()).M
    every = [
        value_of(criterion, M[list(own)].sum(axis=0))
        for own in itertools.combinations(range(len(pool)), 2)
    ]
    sign = 1.0 if found.criterion.larger_is_better else -1.0
    assert found.value == pytest.approx(sign * max(sign * v for v in every), rel=1e-5)
    assert sign * found.bound >= sign * found.value * (1.0 - 1e-9)
    assert 0.5 < found.efficiency <= 1.0
    assert found.random < found.efficiency


def value_of(criterion: str, M: Array) -> float:
    if criterion == "D":
        return float(np.linalg.det(M) ** (1.0 / len(M)))
    return float(np.trace(np.linalg.inv(M)) if criterion == "A" else np.linalg.eigvalsh(M)[0])


@pytest.mark.parametrize(
    ("rivals", "loaded"),
    [
        (("torque_scale:j2", "payload"), True),
        pytest.param(("spring:j2", "inertials"), None, marks=pytest.mark.long),
    ],
)
def test_rivals_are_told_apart(
    tmp_path: Path, rivals: tuple[str, str], loaded: bool | None
) -> None:
    """A torque's scale is no mass once a known load is carried."""
    cell = planned(tmp_path, load=Load(3.0, (0.0, 0.0, 0.05)))
    found = design_motions(cell, 3, discriminate=rivals, candidates=30, seconds=10.0)
    assert found.criterion.name == "discriminate"
    assert found.efficiency > found.random
    if loaded:
        assert any(own.payload.mass == pytest.approx(3.0) for own in found.motions)


@pytest.mark.parametrize(
    ("asked", "error", "text"),
    [
        ({"discriminate": ("payload", "inertials")}, CalibError, "share parameters"),
        ({"discriminate": ("wear:j1", "inertials")}, UnknownEffect, "no term of a torque"),
        ({"discriminate": ("spring:j9", "inertials")}, UnknownEffect, "cannot act at 'j9'"),
        ({"criterion": "G"}, CalibError, "known are D, A, E, c"),
        ({"criterion": "c"}, CalibError, "names 12 parameters"),
        ({"motions": 40}, CalibError, "40 motions of 10 candidates"),
    ],
)  # fmt: skip
def test_what_cannot_be_planned_is_said(
    tmp_path: Path, asked: dict[str, object], error: type[CalibError], text: str
) -> None:
    call = {"motions": 2, "candidates": 10, "seconds": 8.0} | asked
    with pytest.raises(error, match=text):
        design_motions(planned(tmp_path), **call)  # type: ignore[arg-type]
