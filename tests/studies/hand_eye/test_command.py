"""``posecal hand-eye`` on days of a KR 270 that other code simulates."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import calib
from calib.arrays import Array
from calib.files.write_tables import measurements_csv
from tests.calib.handeye.days import LENS, OFF, Arm, Kind
from tests.plain_arm import turn
from tests.studies.command_line import result, run


def written(folder: Path, kind: Kind, off: Array | float, count: int) -> Arm:
    arm = Arm.of(folder, kind, off)
    day = arm.day(count, 21)
    (folder / "day.csv").write_text(measurements_csv(day.cell, day.data))
    return arm


def found(folder: Path, *more: object) -> tuple[dict[str, Any], str]:
    call = ("hand-eye", folder / "cell.toml", folder / "day.csv", *more)
    return result(folder / "r.json", *call, kind="hand-eye")


def test_poses_of_a_good_arm(tmp_path: Path) -> None:
    arm = written(tmp_path, "poses", 0.0, 20)
    fields, said = found(tmp_path, "--goal-mm", 50)
    assert "Use the camera's place below, with the arm as its file has it." in said
    assert "The goal of 50 mm is reached, 19 times in 20." in said
    assert not fields["arm_calibrated"]
    (camera,) = fields["cameras"]
    off = np.array(camera["position_mm"]) - 1e3 * arm.places[0][:3, 3]
    assert (np.abs(off) < 4.0 * np.array(camera["std_mm"])).all()
    roll, pitch, yaw = np.radians(camera["rpy_deg"])
    R = (turn("z", yaw) @ turn("y", pitch) @ turn("x", roll))[:3, :3]
    np.testing.assert_allclose(R, arm.places[0][:3, :3], atol=5e-3)
    x, y, z, w = camera["quaternion_xyzw"]
    assert R[2, 1] - R[1, 2] == pytest.approx(4.0 * w * x)
    assert R[1, 0] + R[0, 1] == pytest.approx(4.0 * x * y)
    assert f"--qz {z:.8f} --qw {w:.8f} --frame-id tool0 --child-frame-id cam" in said


def test_next_poses_are_a_plan(tmp_path: Path) -> None:
    written(tmp_path, "poses", 0.0, 15)
    fields, _ = found(tmp_path, "-o", tmp_path / "next.csv")
    plan = calib.load_plan(calib.load_cell(tmp_path / "cell.toml"), tmp_path / "next.csv")
    assert len(plan) == 10
    assert len(fields["ahead"]) == 11
    first = [fields["next_poses"][0]["joints_deg"][f"A{k}"] for k in range(1, 7)]
    np.testing.assert_allclose(np.degrees(plan.q[0]), first)


@pytest.mark.long
def test_an_arm_that_limits_a_camera_in_hand(tmp_path: Path) -> None:
    written(tmp_path, "camera in hand", 4.0 * OFF, 30)
    fields, said = found(tmp_path, "--holdout", 0.3)
    assert fields["arm_calibrated"]
    assert "The arm limits this hand-eye. Calibrate the arm as well" in said
    assert "the images limit the result" in said
    assert not fields["unfit_lenses"]
    assert not fields["crossed"]
    assert {own["images"] for own in fields["methods"]} == {9}


@pytest.mark.parametrize(
    ("kind", "off"),
    [
        ("camera on base", 0.0),  # whose free geometry takes half of the misfit
        pytest.param("camera in hand", OFF, marks=pytest.mark.long),
    ],
)
def test_a_lens_that_is_off_is_named_before_the_arm(
    tmp_path: Path, kind: Kind, off: Array | float
) -> None:
    """By 3 % of its focal length."""
    written(tmp_path, kind, off, 30)
    cell = tmp_path / "cell.toml"
    right = f"focal_px = [{LENS[0]}, {LENS[1]}]"
    assert right in cell.read_text()
    wrong = f"focal_px = [{LENS[0] / 1.03}, {LENS[1] / 1.03}]"
    cell.write_text(cell.read_text().replace(right, wrong))
    fields, said = found(tmp_path)
    assert said.startswith("cell: The readings do not fit the lens of cam:")
    assert [own["camera"] for own in fields["unfit_lenses"]] == ["cam"]
    assert "The arm" not in said
    assert not fields["arm_calibrated"]
    free = 'sigma_px = 0.2\nfree = ["focal", "center", "distortion"]'
    cell.write_text(cell.read_text().replace("sigma_px = 0.2", free))
    fields, said = found(tmp_path)
    assert not fields["unfit_lenses"]
    assert fields["arm_calibrated"] == bool(np.any(off))


def test_what_is_no_hand_eye_is_one_line(tmp_path: Path) -> None:
    written(tmp_path, "camera in hand", 0.0, 6)
    arguments = ("hand-eye", tmp_path / "cell.toml", tmp_path / "day.csv", "--eye", "on-base")
    done = run(*arguments)
    assert done.exit_code == 2
    assert done.output.count("\n") == 1
    assert 'camera cam is not on-base: the cell has it on = "tip"' in done.output
