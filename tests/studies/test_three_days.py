"""Three robots from their makers' dimensions to the report, by commands of the README alone.

Each real arm errs at every frame and has one cause that the user's model lacks: an eccentric gear, lost
motion, a soft joint. None has a line of posecal: URDF and DH in numpy, seven axes in MuJoCo.
"""

from __future__ import annotations

import csv
import json
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from calib.arrays import Array
from tests.studies.command_line import run as command

_H = np.pi / 2

_UR = (
    ("shoulder_pan", (0, 0, 0.1625), (0, 0, 0)),
    ("shoulder_lift", (0, 0, 0), (_H, 0, 0)),
    ("elbow", (-0.425, 0, 0), (0, 0, 0)),
    ("wrist_1", (-0.3922, 0, 0.1333), (0, 0, 0)),
    ("wrist_2", (0, -0.0997, 0), (_H, 0, 0)),
    ("wrist_3", (0, 0.0996, 0), (_H, np.pi, np.pi)),
)

_UR_SHAPES = (  # of the base and each link: what, where, turned
    ('<cylinder radius="0.075" length="0.1"/>', "0 0 0.05", "0 0 0"),
    ('<cylinder radius="0.06" length="0.16"/>', "0 0 0", "0 0 0"),
    ('<cylinder radius="0.055" length="0.5"/>', "-0.2125 0 0.136", "0 1.5708 0"),
    ('<cylinder radius="0.045" length="0.45"/>', "-0.1961 0 0.01", "0 1.5708 0"),
    ('<box size="0.08 0.08 0.11"/>', "0 0 -0.01", "0 0 0"),
    ('<cylinder radius="0.04" length="0.1"/>', "0 0 0", "0 0 0"),
    ('<sphere radius="0.04"/>', "0 0 -0.03", "0 0 0"),
)

_DH = ((0.0, 0.325, 0.342), (np.pi, 0.275, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0))  # alpha, a, d

_SEVEN = (  # where each body stands, its turn (w, x, y, z), mass, centre of mass, range
    ((0, 0, 0.1575), "1 0 0 0", 5.76, "0 -0.03 0.12", 2.97),
    ((0, 0, 0.2025), "0 0 1 1", 6.35, "0 0.059 0.042", 2.09),
    ((0, 0.2045, 0), "0 0 1 1", 3.5, "0 0.03 0.13", 2.97),
    ((0, 0, 0.2155), "1 1 0 0", 3.5, "0 0.067 0.034", 2.09),
    ((0, 0.1845, 0), "0 0 -1 1", 3.5, "0 0.021 0.076", 2.97),
    ((0, 0, 0.2155), "1 1 0 0", 1.8, "0 0 0", 2.09),
    ((0, 0.081, 0), "0 0 1 1", 1.2, "0 0 0.02", 3.05),
)


def moved(xyz: Sequence[float], turn: Rotation) -> Array:
    """A frame, shape (4, 4)."""
    frame = np.eye(4)
    frame[:3, :3], frame[:3, 3] = turn.as_matrix(), xyz
    return frame


def _erring(error: Array) -> Array:
    return moved(error[:3], Rotation.from_rotvec(error[3:]))


def ur5e_urdf() -> str:
    links = [
        f'<link name="l{k}"><collision><origin xyz="{xyz}" rpy="{rpy}"/><geometry>{shape}</geometry>'
        "</collision></link>"
        for k, (shape, xyz, rpy) in enumerate(_UR_SHAPES)
    ]
    joints = [
        f'<joint name="{name}" type="revolute"><parent link="l{k}"/><child link="l{k + 1}"/>'
        f'<origin xyz="{" ".join(map(str, xyz))}" rpy="{" ".join(map(repr, rpy))}"/>'
        '<axis xyz="0 0 1"/><limit lower="-3.1416" upper="3.1416" effort="150" velocity="3"/></joint>'
        for k, (name, xyz, rpy) in enumerate(_UR)
    ]
    return "\n".join(['<robot name="ur5e">', *links, *joints, "</robot>"])


def scara_dh() -> str:
    kinds = ("revolute", "revolute", "prismatic", "revolute")
    rows = (
        f"J{k},{kind},{np.degrees(alpha)},{a * 1e3},0,{d * 1e3}"
        for k, (kind, (alpha, a, d)) in enumerate(zip(kinds, _DH, strict=True), 1)
    )
    return "\n".join(["joint,kind,alpha_deg,a_mm,theta_deg,d_mm", *rows, ""])


def seven_mjcf() -> str:
    bodies = "".join(
        f'<body name="link{k}" pos="{" ".join(map(str, pos))}" quat="{quat}">'
        f'<inertial mass="{mass}" pos="{com}" diaginertia="0.02 0.02 0.01"/>'
        f'<joint name="A{k}" axis="0 0 1" range="-{reach} {reach}"/>'
        for k, (pos, quat, mass, com, reach) in enumerate(_SEVEN, 1)
    )
    return (
        '<mujoco model="seven"><compiler angle="radian"/><option gravity="0 0 -9.80665"/><worldbody>'
        f'<body name="base">{bodies}<site name="flange" pos="0 0 0.045"/>{"</body>" * 8}'
        "</worldbody></mujoco>"
    )


def ur5e(q: Array, errors: Array, sides: Array) -> Array:
    """Elbow on an eccentric gear: 250 cos q + 150 sin q, urad."""
    frame = _erring(errors[0])
    for k, (_, xyz, rpy) in enumerate(_UR):
        turn = q[k] + (k == 2) * (250e-6 * np.cos(q[k]) + 150e-6 * np.sin(q[k])) * errors.any()
        frame = frame @ moved(xyz, Rotation.from_euler("xyz", rpy)) @ _erring(errors[k + 1])
        frame = frame @ moved((0, 0, 0), Rotation.from_rotvec((0, 0, turn)))
    return frame


def scara(q: Array, errors: Array, sides: Array) -> Array:
    """J2 with a lost motion of 200 urad."""
    frame = np.eye(4)
    for k, (alpha, a, d) in enumerate(_DH):
        turn = (k != 2) * q[k] + (k == 1) * 100e-6 * sides[k] * errors.any()
        frame = frame @ _erring(errors[k])
        frame = frame @ moved((0, 0, d + (k == 2) * q[k]), Rotation.from_rotvec((0, 0, turn)))
        frame = frame @ moved((a, 0, 0), Rotation.from_rotvec((alpha, 0, 0)))
    return frame @ _erring(errors[4])


def seven(q: Array, errors: Array, sides: Array) -> Array:
    """A2 bends by 4 urad/(N m) under the weights of the arm."""
    import mujoco

    model = mujoco.MjModel.from_xml_string(seven_mjcf())
    for k in range(7):
        at = model.body(f"link{k + 1}").id
        own = Rotation.from_quat(model.body_quat[at], scalar_first=True)
        model.body_pos[at] += own.apply(errors[k + 1, :3])
        turn = own * Rotation.from_rotvec(errors[k + 1, 3:])
        model.body_quat[at] = turn.as_quat(scalar_first=True)
    data = mujoco.MjData(model)
    data.qpos[:] = q
    mujoco.mj_forward(model, data)
    data.qpos[1] -= 4e-6 * data.qfrc_bias[1] * errors.any()
    mujoco.mj_forward(model, data)
    flange = data.site("flange")
    return moved(flange.xpos, Rotation.from_matrix(flange.xmat.reshape(3, 3)))


@dataclass(frozen=True, eq=False)
class Real:
    """An arm as it is: errors of its frames, its markers (M, 3), m, and where its base stands."""

    tip: Callable[[Array, Array, Array], Array]
    errors: Array
    markers: Array
    base: Array

    def points(self, q: Array) -> Array:
        """Markers in the instrument's frame, shape (m, M, 3), m; poses are visited in this order."""
        side, before, found = np.zeros(q.shape[1]), q[0], []
        for row in q:
            side = np.where(row == before, side, np.sign(row - before))
            before = row
            frame = self.base @ self.tip(row, self.errors, side)
            found.append(self.markers @ frame[:3, :3].T + frame[:3, 3])
        return np.array(found)

    def slipped(self, joint: int, by: float) -> Real:
        """The same with the zero of a joint off, rad or m."""
        off = np.eye(self.errors.shape[0])[joint] * by
        return replace(self, tip=lambda q, *rest: self.tip(q + off[: len(q)], *rest))

    def nominal(self, markers: Array, base: Array) -> Real:
        """The arm of its file, with markers and base as somebody found them."""
        return replace(self, errors=np.zeros_like(self.errors), markers=markers, base=base)


def real_arm(tip: Callable[[Array, Array, Array], Array], seed: int) -> Real:
    """0.3 mm and 0.4 mrad at every frame, markers off by 2 mm, the instrument anywhere."""
    rng = np.random.default_rng(seed)
    errors = rng.normal(size=(8, 6)) * np.repeat([3e-4, 4e-4], 3)
    markers = np.array([[0.05, 0, 0.03], [-0.025, 0.045, 0.03], [-0.025, -0.045, 0.03]])
    base = moved(rng.uniform(-3, 3, 3), Rotation.random(random_state=rng))
    return Real(tip, errors, markers + rng.normal(size=(3, 3)) * 2e-3, base)


def joints_of(table: Path) -> tuple[list[str], list[str], Array]:
    """Names of poses and of the joints' columns, and the joints, rad and m."""
    rows = list(csv.DictReader(table.read_text().splitlines()))
    ends = ("_mdeg", "_um", "before_mm", "left_mm", "expected_mm")
    columns = [c for c in rows[0] if c.endswith(("_deg", "_mm")) and not c.endswith(ends)]
    scale = [np.pi / 180 if c.endswith("_deg") else 1e-3 for c in columns]
    q = np.array([[float(row[c]) for c in columns] for row in rows]) * scale
    return [row["pose"] for row in rows], columns, q


def exported(names: Sequence[str], points: Array) -> str:
    """Points (m, M, 3), m, as a table of poses and markers."""
    rows = (
        f"{name},m{j}," + ",".join(f"{v:.6f}" for v in point)
        for name, markers in zip(names, points * 1e3, strict=True)
        for j, point in enumerate(markers, 1)
    )
    return "\n".join(["pose,marker,x_mm,y_mm,z_mm", *rows, ""])


def read(points: Array, seed: int) -> Array:
    """Read to 0.01 mm in each coordinate."""
    return np.asarray(points + np.random.default_rng(seed).normal(size=points.shape) * 1e-5)


SLIP = 60e-6  # rad, of the second joint's zero, a month later
GOAL = 0.05  # mm
MARKERS = ("m1", "m2", "m3")


@dataclass(frozen=True)
class Robot:
    """Its file, what a user writes into the cell, its truth and the cause that the model lacks.

    span : rad and m, of the joints at the targets
    """

    file: str
    text: Callable[[], str]
    tip: Callable[..., Array]
    cause: str
    span: tuple[tuple[float, float], ...]
    limits: str = ""
    options: tuple[str, ...] = ()


ROBOTS = {
    "UR5e": Robot("ur5e.urdf", ur5e_urdf, ur5e, "transmission_harmonic:elbow", ((-1.5, 1.5),) * 6),
    "SCARA": Robot(
        "scara.csv",
        scara_dh,
        scara,
        "backlash:J2",
        ((-2, 2), (-2, 2), (0, 0.15), (-2, 2)),
        "[robot.limits_deg]\nJ1 = [-132, 132]\nJ2 = [-141, 141]\n[robot.limits_mm]\nJ3 = [0, 200]\n",
        ("--dh", "classic"),
    ),
    "seven axes": Robot("seven.xml", seven_mjcf, seven, "joint_compliance:A2", ((-1.5, 1.5),) * 7),
}


@dataclass(frozen=True)
class Desk:
    """A folder in which commands are run."""

    folder: Path

    def run(self, *arguments: object) -> str:
        """A command; names of files stand for those of the folder."""
        words = [
            str(self.folder / a) if isinstance(a, str) and "." in a else str(a) for a in arguments
        ]
        done = command(*words)
        assert done.exit_code == 0, done.output
        return done.output

    def result(self, name: str, *arguments: object) -> Any:
        """What a command writes as JSON."""
        self.run(*arguments, "--json", f"{name}.json")
        return json.loads((self.folder / f"{name}.json").read_text())

    def write(self, name: str, text: str) -> None:
        (self.folder / name).write_text(text)


def job(columns: list[str], span: tuple[tuple[float, float], ...]) -> str:
    """Twenty targets within a box, as the table of a job."""
    low, high = np.array(span).T
    q = np.random.default_rng(9).uniform(low, high, (20, len(low)))
    shown = q / [np.pi / 180 if c.endswith("_deg") else 1e-3 for c in columns]
    rows = (f"t{k}," + ",".join(f"{v:.6f}" for v in row) for k, row in enumerate(shown))
    return "\n".join([",".join(["pose", *columns]), *rows, ""])


def rms(difference: Array) -> float:
    """3-D per point, mm."""
    return 1e3 * float(np.sqrt(np.mean(np.sum(difference**2, axis=-1))))


def planned(desk: Desk, robot: Robot) -> None:
    """From the robot's file to targets and a plan of 24 poses."""
    desk.write(robot.file, robot.text())
    desk.run("init", robot.file, "-o", desk.folder / ".", *robot.options)
    cell = desk.folder / "cell.toml"
    table = next(iter((desk.folder / "measurements.csv").read_text().splitlines())).split(",")
    columns = [
        c for c in table[2:] if c.endswith(("_deg", "_mm")) and c[:2] not in ("x_", "y_", "z_")
    ]
    desk.write("targets.csv", job(columns, robot.span))
    text = cell.read_text().replace("poses = 30", 'poses = 24\ntargets = "targets.csv"')
    text = re.sub(
        "^repeatability_.*\n", "", text, flags=re.M
    )  # this arm has none, and no data sheet
    cell.write_text(text.replace("[markers_mm]", f"{robot.limits}[markers_mm]", 1))
    desk.run("design", "cell.toml", "--criterion", "D", "--candidates", 100, "-o", "plan.csv")
    assert "-0" not in (desk.folder / "plan.csv").read_text().replace("\n", ",").split(",")


def measured(desk: Desk, real: Real, seed: int, table: str) -> None:
    """The plan, then the targets, which are read without an error: what they miss by is the truth."""
    both = [joints_of(desk.folder / name) for name in ("plan.csv", "targets.csv")]
    points = real.points(np.concatenate([q for _, _, q in both]))
    count = len(both[0][0])
    desk.write("points.csv", exported(both[0][0], read(points[:count], seed)))
    desk.write("exact.csv", exported(both[1][0], points[count:]))
    for points_file, joints, name in (
        ("points.csv", "plan.csv", table),
        ("exact.csv", "targets.csv", "truth.csv"),
    ):
        desk.run("import", points_file, "--joints", joints, "-o", name)


@pytest.mark.long
@pytest.mark.parametrize("robot", ROBOTS.values(), ids=list(ROBOTS))
def test_a_day(robot: Robot, tmp_path: Path) -> None:
    if robot.file.endswith("xml"):
        pytest.importorskip("mujoco")
    desk, real = Desk(tmp_path), real_arm(robot.tip, seed=2)
    planned(desk, robot)
    measured(desk, real, 2, "measurements.csv")

    by_truth = ("--holdout", "truth.csv")
    lacking = desk.result("lacking", "identify", "cell.toml", "measurements.csv", *by_truth)
    found = desk.result("diagnosed", "diagnose", "cell.toml", "measurements.csv",
                        "--holdout", 0.25, "--cell-out", "whole.toml")  # fmt: skip
    assert [f"{e['effect']}:{e['where']}" for e in found["effects"]] == [robot.cause]

    day = ("whole.toml", "measurements.csv")
    identified = desk.result("found", "identify", *day, *by_truth)
    true = identified["rms_mm"]["heldout"]
    assert lacking["rms_mm"]["heldout"] > 2.0 * true, "the cause shows where it was not fitted"
    foreseen = desk.result("compared", "compare", "whole.toml", "plan.csv", "--monte-carlo", 0)
    (plan,) = foreseen["plans"]
    points = next(own for own in plan["approaches"] if own["approach"] == "points")
    for expected in (points["task_rms_mm"], identified["task_rms_mm"]):
        assert 0.4 * expected < true < 2.0 * expected
    reached = desk.result("enough", "enough", *day, "--plan", "plan.csv", "--goal-mm", GOAL)
    assert (reached["poses_to_goal"] == 0) == (reached["now"]["task_most_mm"] <= GOAL)
    assert true < reached["now"]["task_most_mm"]

    compensated(desk, real, identified)
    a_month_later(desk, real)
    desk.run("report", "diagnosed.json", "changed.json",
             "-o", "report.html")  # fmt: skip
    assert robot.cause in (tmp_path / "report.html").read_text()


def compensated(desk: Desk, real: Real, identified: Any) -> None:
    """Corrected commands bring the true arm where its file says, as closely as is promised."""
    told = desk.result("told", "compensate", "whole.toml", "found.json", "targets.csv",
                       "-o", "better.csv")["rms_mm"]  # fmt: skip
    base = identified["base"]
    placed = moved(
        [v * 1e-3 for v in base["translation_mm"]],
        Rotation.from_rotvec(base["rotation_vector_rad"]),
    )
    markers = np.array([identified["markers_mm"][m] for m in MARKERS]) * 1e-3
    nominal, better = (joints_of(desk.folder / name)[2] for name in ("targets.csv", "better.csv"))
    wanted = real.nominal(markers, placed).points(nominal)
    before, after = (rms(real.points(q) - wanted) for q in (nominal, better))
    assert before == pytest.approx(told["before"], rel=0.05)
    assert after < min(0.1 * before, 2.0 * told["expected"])


def a_month_later(desk: Desk, real: Real) -> None:
    """The second joint's zero slipped: it is seen, as large as it is, and judged rightly."""
    later = real.slipped(1, SLIP)
    measured(desk, later, 3, "later.csv")
    desk.run("identify", "whole.toml", "later.csv", "--json", "later.json")
    targets = joints_of(desk.folder / "targets.csv")[2]
    change = later.points(targets) - real.points(targets)
    worst = max(map(rms, change))
    for times, verdict in ((0.3, "does_not"), (3.0, "holds")):
        found = desk.result("changed", "changes", "found.json", "later.json",
                            "--tolerance-mm", round(times * worst, 4))  # fmt: skip
        assert found["verdict"] == verdict
    assert found["status"] == "changed"
    size = found["change_rms_mm"]
    assert 0.8 * size["low"] <= rms(change) <= 1.2 * size["high"]
