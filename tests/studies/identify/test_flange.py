"""An exported robot whose flange only markers know: what is said, against the arm in MuJoCo."""

from __future__ import annotations

import contextlib
import re
from pathlib import Path

import numpy as np

from calib.arm.kinematics import forward
from calib.arrays import Array
from calib.files.urdf import load_urdf
from studies.research.benchmarks.day import Setting, draw_day, write_day
from studies.research.withheld.truth import Action
from tests.bad_inputs.run import posecal


def placed(points: Array, true: Array) -> tuple[Array, Array]:
    """R (3, 3) and p (3,) that bring points (N, 3) nearest to true ones."""
    a, b = points - points.mean(0), true - true.mean(0)
    U, _, Vt = np.linalg.svd(a.T @ b)
    R = (U @ np.diag([1.0, 1.0, np.linalg.det(U @ Vt)]) @ Vt).T
    return R, true.mean(0) - points.mean(0) @ R.T


def at_link(urdf: Path, link: str, q: Array) -> Array:
    """The origin of a link at joints (N, n), shape (N, 3), m."""
    robot = load_urdf(urdf, "base", link)
    frames = forward(robot, q)
    return np.asarray(frames.o[:, robot.tip_frame])


def test_the_markers_are_known_and_the_flange_is_not(tmp_path: Path) -> None:
    day = draw_day(Setting("6R", 1e-9, 1, 60, 3), 0, 5)
    write_day(tmp_path, day)
    with contextlib.chdir(tmp_path):
        heard = posecal("identify", "cell.toml", "measurements.csv", "--urdf", "found.urdf")
    assert heard.status is None, heard.err
    said = " ".join(heard.out.split())
    assert (
        "only the markers (m1, m2, m3) are calibrated. The readings do not show where flange sits"
        in said
    )
    text = (tmp_path / "found.urdf").read_text()
    assert re.search(r"<!-- only the markers .* are calibrated\. .* where flange sits", text)
    q, urdf = day.targets, tmp_path / "found.urdf"
    ours = np.stack([at_link(urdf, f"marker_m{j}", q) for j in (1, 2, 3)], axis=1)
    R, p = placed(ours.reshape(-1, 3), day.reached.reshape(-1, 3))
    missed = ours @ R.T + p - day.reached
    assert np.sqrt((missed**2).sum(-1).mean()) < 0.03e-3
    still = Action.none(day.arm, len(q), 3)
    true = day.mechanism.rest(q, lambda _: still, (day.R, day.p)).o[:, -1] @ day.R.T + day.p
    flange = at_link(urdf, "flange", q) @ R.T + p - true
    assert np.sqrt((flange**2).sum(-1).mean()) > 0.3e-3


def test_known_markers_leave_nothing_to_say(tmp_path: Path) -> None:
    write_day(tmp_path, draw_day(Setting("6R", 1e-9, 1, 60, 3), 0, 5))
    cell = tmp_path / "cell.toml"
    cell.write_text(cell.read_text().replace('"base", "tool"', '"base"'))
    with contextlib.chdir(tmp_path):
        heard = posecal("identify", "cell.toml", "measurements.csv", "--urdf", "found.urdf")
    assert heard.status is None, heard.err
    assert "NOT KNOWN" not in heard.out + (tmp_path / "found.urdf").read_text()
