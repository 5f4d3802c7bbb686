"""Three robots from their makers' dimensions to the report, by commands of the README alone.

The arms are simulated without a line of posecal: what each command promises is held against them.
"""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner
from scipy.spatial.transform import Rotation

from calib.arrays import Array
from studies.cli import main
from tests.studies.three_arms import (
    Real,
    exported,
    joints_of,
    moved,
    read,
    real_arm,
    scara,
    scara_dh,
    seven,
    seven_mjcf,
    ur5e,
    ur5e_urdf,
)

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
        done = CliRunner().invoke(main, words)
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
