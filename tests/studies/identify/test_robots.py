"""Days on an arm whose file takes what was found; a flange that only markers know."""

from __future__ import annotations

import contextlib
import csv
import re
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest

from calib.arm.kinematics import forward
from calib.arrays import Array
from calib.files.urdf import load_urdf
from studies.research.truth.day import Setting, draw_day, write_day
from studies.research.truth.mechanism import Action
from tests.bad_inputs.run import posecal
from tests.helpers import cell_text
from tests.plain_arm import rpy_pose, turn
from tests.studies.command_line import run

SIGMA = 1e-5  # m
MARKERS = np.array([[0.08, 0.0, 0.04], [-0.04, 0.07, 0.05], [-0.04, -0.07, 0.03]])
CELL = cell_text('urdf = "arm.urdf"\nbase = "base"\ntip = "tool0"', "{marks}")
PI = np.pi
UR = {  # a UR5e by its published lengths
    "shoulder": [0, 0, 0.1625, 0, 0, 0],
    "upper_arm": [0, 0, 0, PI / 2, 0, 0],
    "forearm": [-0.425, 0, 0, 0, 0, 0],
    "wrist_1": [-0.3922, 0, 0.1333, 0, 0, 0],
    "wrist_2": [0, -0.0997, 0, PI / 2, 0, 0],
    "wrist_3": [0, 0.0996, 0, PI / 2, PI, PI],
}
NAMES = ("shoulder_pan", "shoulder_lift", "elbow", "wrist_1", "wrist_2", "wrist_3")


def ur_urdf() -> str:
    """A UR5e whose joints turn about z, as its maker's file has them."""
    text, parent = '<robot name="UR5e"><link name="base"/>', "base"
    for name, own in zip(NAMES, UR.values(), strict=True):
        xyz, rpy = (" ".join(map(repr, map(float, part))) for part in (own[:3], own[3:]))
        text += (
            f'<link name="{name}"/><joint name="{name}_joint" type="revolute">'
            f'<parent link="{parent}"/><child link="{name}"/><origin xyz="{xyz}" rpy="{rpy}"/>'
            '<axis xyz="0 0 1"/><limit lower="-6" upper="6" effort="0" velocity="1"/></joint>'
        )
        parent = name
    return text + (
        f'<link name="tool0"/><joint name="flange" type="fixed"><parent link="{parent}"/>'
        '<child link="tool0"/></joint></robot>'
    )


def origins_of(path: Path) -> list[list[float]]:
    """x y z roll pitch yaw of every joint that turns."""
    root = ElementTree.parse(path).getroot()
    origins = [j.find("origin") for j in root.findall("joint[@type='revolute']")]
    return [[float(v) for key in ("xyz", "rpy") for v in o.get(key, "").split()]
            for o in origins if o is not None]  # fmt: skip


def fitted(true: Array, points: Array) -> float:
    """RMS distance after the best rigid motion (Kabsch)."""
    a, b = true.reshape(-1, 3), points.reshape(-1, 3)
    U, _, Vt = np.linalg.svd((a - a.mean(0)).T @ (b - b.mean(0)))
    R = U @ np.diag([1, 1, np.linalg.det(U @ Vt)]) @ Vt
    missed = a - a.mean(0) - (b - b.mean(0)) @ R.T
    return float(np.sqrt(np.mean(np.sum(missed**2, axis=1))))


def best_tool(day: Day, origins: list[list[float]]) -> float:
    """RMS at the new poses, base and markers fitted in turn: the file holds neither."""
    T = np.array([rpy_pose(origins, p) for p in day.q])
    tool = MARKERS
    for _ in range(200):
        points = np.einsum("pik,mk->pmi", T[:, :3, :3], tool) + T[:, None, :3, 3]
        a, b = day.true.reshape(-1, 3), points.reshape(-1, 3)
        U, _, Vt = np.linalg.svd((b - b.mean(0)).T @ (a - a.mean(0)))
        R = U @ np.diag([1, 1, np.linalg.det(U @ Vt)]) @ Vt
        seen = (day.true - a.mean(0)) @ R.T + b.mean(0)
        tool = np.einsum("pki,pmk->pmi", T[:, :3, :3], seen - T[:, None, :3, 3]).mean(axis=0)
    return fitted(day.true, points)


class Day:
    """A UR5e whose origins are off by up to a millimetre and a milliradian, measured at 40 poses."""

    def __init__(self, folder: Path) -> None:
        rng = np.random.default_rng(5)
        self.folder = folder
        true = [list(np.array(own) + 4e-4 * rng.normal(size=6)) for own in UR.values()]
        placed = turn("x", 0.2) @ turn("z", 1.3)
        q = rng.uniform(-2.5, 2.5, (60, 6))
        points = np.array([(placed @ rpy_pose(true, p))[:3] for p in q])
        tool = np.column_stack([MARKERS + 1e-3 * rng.normal(size=(3, 3)), np.ones(3)])
        points = np.einsum("pik,mk->pmi", points, tool)
        self.q, self.true = q[40:], points[40:]
        noisy = points[:40] + SIGMA * rng.normal(size=(40, 3, 3))
        (folder / "arm.urdf").write_text(ur_urdf())
        marks = "\n".join(f"m{j + 1} = {(1e3 * m).tolist()}" for j, m in enumerate(MARKERS))
        (folder / "cell.toml").write_text(CELL.format(marks=marks))
        with (folder / "data.csv").open("w", newline="") as file:
            writer = csv.writer(file)
            writer.writerow(
                ["pose", "marker", *(f"{n}_joint_rad" for n in NAMES), "x_m", "y_m", "z_m"]
            )
            for i, j in np.ndindex(40, 3):
                writer.writerow([f"p{i}", f"m{j + 1}", *q[i], *noisy[i, j]])
        self.said = run(
            *("identify", folder / "cell.toml", folder / "data.csv"),
            *("--zero-offsets", folder / "zeros.csv"),
            *("--urdf", folder / "better.urdf"),
        )
        assert self.said.exit_code == 0, self.said.output


@pytest.fixture(scope="module")
def day(tmp_path_factory: pytest.TempPathFactory) -> Day:
    return Day(tmp_path_factory.mktemp("day"))


def test_the_file_predicts_poses_never_measured(day: Day) -> None:
    found = origins_of(day.folder / "better.urdf")
    before, after = (best_tool(day, origins) for origins in (list(UR.values()), found))
    print(f"UR: {before * 1e3:.4f} -> {after * 1e3:.4f} mm")
    assert before > 1e-3 > 30 * after


def test_zero_offsets_are_the_part_along_the_axes(day: Day) -> None:
    rows = [*csv.DictReader((day.folder / "zeros.csv").read_text().splitlines())]
    assert [row["joint"] for row in rows] == [f"{n}_joint" for n in NAMES]
    assert [row["unit"] for row in rows] == ["deg"] * 6
    for row in rows:
        assert float(row["reads_at_zero"]) == -float(row["offset"])
    said = re.search(
        r"geometry found, ([\d.]+) mm at the markers, ([\d.]+) mm stay", day.said.output
    )
    assert said is not None
    assert 0.0 < float(said[2]) < float(said[1])
    nominal = [[*own[:3], *own[3:]] for own in UR.values()]
    shifted = day.q + np.radians([float(row["offset"]) for row in rows])
    true = origins_of(day.folder / "better.urdf")

    def points(origins: list[list[float]], q: Array) -> Array:
        T = np.array([rpy_pose(origins, p) for p in q])
        tool = np.column_stack([MARKERS, np.ones(3)])
        return np.einsum("pik,mk->pmi", T[:, :3], tool)

    goal = points(true, day.q)
    before, after = fitted(goal, points(nominal, day.q)), fitted(goal, points(nominal, shifted))
    assert float(said[1]) == pytest.approx(before * 1e3, rel=0.3), "other poses, other markers"
    assert float(said[2]) == pytest.approx(after * 1e3, rel=0.3)


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
    assert not heard.status, heard.err
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
    assert not heard.status, heard.err
    assert "only the markers" not in heard.out + (tmp_path / "found.urdf").read_text()
