"""Targets as poses of the tip, against arms in MuJoCo that share no code with the inverse."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import calib
from calib.arm.inverse import solutions
from calib.arrays import Array
from calib.errors import InputError
from calib.files.cartesian import solution_said
from studies.research.truth.arms import HEAVY, LIGHT, Arm
from studies.research.truth.day import SEVEN as LIMITED_SEVEN
from studies.research.truth.mechanism import Mechanism
from tests.calib.arm_days import MARKERS, SCARA, Day

_CROSS = np.concatenate([np.zeros((1, 3)), np.eye(3)])  # origin and ends of the tip's axes


def tips(arm: Arm, q: Array) -> tuple[Array, Array]:
    """Axes (m, 3, 3) and origins (m, 3), m, of the nominal tip, by MuJoCo."""
    points = Mechanism(arm, np.zeros((arm.dof + 2, 6)), _CROSS, weighs=False).posed(q).points
    return np.swapaxes(points[:, 1:] - points[:, :1], 1, 2), points[:, 0]


def written(folder: Path, arm: Arm, R: Array, o: Array, unit: str = "mm") -> tuple[Path, Path]:
    """Cell and table of targets."""
    q = np.tile(arm.limits.mean(axis=1), (2, 1))
    Day(arm, q, np.zeros((2, len(MARKERS), 3))).written(folder)
    x, y, z, w = Rotation.from_matrix(R).as_quat().T
    rows = np.column_stack([o * (1e3 if unit == "mm" else 1.0), w, x, y, z])
    head = f"pose,x_{unit},y_{unit},z_{unit},qw,qx,qy,qz"
    lines = [f"t{i}," + ",".join(f"{v:.12g}" for v in row) for i, row in enumerate(rows, 1)]
    (folder / "targets.csv").write_text("\n".join([head, *lines, ""]))
    return folder / "cell.toml", folder / "targets.csv"


def drawn(arm: Arm, count: int, seed: int = 0) -> Array:
    low, high = arm.limits.T
    share = np.random.default_rng(seed).uniform(0.15, 0.85, (count, arm.dof))
    return np.asarray(low + share * (high - low))


@pytest.mark.parametrize("unit", ["mm", "m"])
@pytest.mark.parametrize("arm", [HEAVY, LIGHT, LIMITED_SEVEN, SCARA], ids=lambda arm: arm.name)
def test_joints_put_the_tip_where_it_is_wanted(tmp_path: Path, arm: Arm, unit: str) -> None:
    R, o = tips(arm, drawn(arm, 12))
    cell_path, path = written(tmp_path, arm, R, o, unit)
    cell = calib.load_cell(cell_path)
    targets, weights = calib.load_targets(cell, path)
    assert targets.names == tuple(f"t{i}" for i in range(1, 13))
    assert (weights == 1.0).all()
    R_found, o_found = tips(arm, targets.q)
    np.testing.assert_allclose(o_found, o, atol=2e-8)
    np.testing.assert_allclose(R_found, R, atol=2e-8)
    low, high = arm.limits.T
    assert ((targets.q >= low - 1e-9) & (targets.q <= high + 1e-9)).all()


def test_the_solution_is_the_nearest_and_is_said(tmp_path: Path) -> None:
    R, o = tips(LIGHT, drawn(LIGHT, 6, 1))
    cell_path, path = written(tmp_path, LIGHT, R, o)
    cell = calib.load_cell(cell_path)
    targets, _ = calib.load_targets(cell, path)
    low, high = LIGHT.limits.T
    reference = (low + high) / 2.0
    for own, taken in zip(solutions(cell.robot, R, o), targets.q, strict=True):
        assert len(own.q) > 1
        tip_R, tip_o = tips(LIGHT, own.q)
        np.testing.assert_allclose(tip_o, np.broadcast_to(tip_o[:1], tip_o.shape), atol=2e-8)
        np.testing.assert_allclose(tip_R, np.broadcast_to(tip_R[:1], tip_R.shape), atol=2e-8)
        inside = [
            turned
            for q in own.q
            for turns in np.ndindex(*([3] * 6))
            if ((turned := q + (np.array(turns) - 1) * 2.0 * np.pi) >= low).all()
            and (turned <= high).all()
        ]
        best = min(np.linalg.norm(q - reference) for q in inside)
        assert np.linalg.norm(taken - reference) == pytest.approx(best, abs=1e-6)
        reference = taken
    said = " ".join(solution_said(cell.robot, targets.names, targets.q))
    assert (
        f"at t1 the solution nearest to the middle of the joint ranges, {LIGHT.joints[0].name}_deg "
        in said
    )


def test_what_is_out_of_reach_is_refused_by_its_line(tmp_path: Path) -> None:
    R, o = tips(LIGHT, drawn(LIGHT, 3))
    far = o.copy()
    far[1] += [9.0, 0.0, 0.0]
    cell_path, path = written(tmp_path, LIGHT, R, far)
    cell = calib.load_cell(cell_path)
    with pytest.raises(
        InputError, match=r"line 3.*does not reach this tip within its limits: \d+\.\d mm"
    ) as failed:
        calib.load_targets(cell, path)
    assert "\n" not in str(failed.value)
    first = LIGHT.joints[0].name
    text = cell_path.read_text()
    narrow = f"[robot.limits_deg]\n{first} = [179.0, 179.5]\n[markers_mm]"
    cell_path.write_text(text.replace("[markers_mm]", narrow))
    lines = path.read_text().splitlines()
    path.write_text("\n".join([*lines[:2], lines[3], ""]))
    with pytest.raises(InputError, match="within its limits: "):
        calib.load_targets(calib.load_cell(cell_path), path)


def test_bad_orientations_are_refused(tmp_path: Path) -> None:
    R, o = tips(LIGHT, drawn(LIGHT, 2))
    cell_path, path = written(tmp_path, LIGHT, R, o)
    cell, text = calib.load_cell(cell_path), path.read_text()
    path.write_text(text.replace(",qz", ",q_z"))
    with pytest.raises(InputError, match="lack column qz"):
        calib.load_targets(cell, path)
    rows = text.splitlines()
    cut = rows[2].rsplit(",", 1)[0] + ",5"
    path.write_text("\n".join([rows[0], rows[1], cut, ""]))
    with pytest.raises(InputError, match=r"line 3, column qw: the quaternion's length"):
        calib.load_targets(cell, path)
