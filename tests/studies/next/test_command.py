"""``posecal next`` in a loop with arms of plain numpy."""

from __future__ import annotations

import csv
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from calib.arrays import Array
from tests.studies.command_line import result
from tests.studies.fleet.robots import MARKERS, SIGMA, points, put, table

OFFSETS = (1e-3, -5e-4)


@pytest.fixture
def cell(tmp_path: Path) -> Path:
    put(tmp_path, table(OFFSETS, 3, 4))
    return tmp_path / "cell.toml"


def proposed(cell: Path, *more: object) -> tuple[dict[str, Any], str]:
    call = ("next", cell, cell.with_name("measurements.csv"), *more)
    return result(cell.with_name("next.json"), *call, kind="next")


def read(cell: Path, q: Array, first: int, rng: np.random.Generator) -> None:
    """Put the readings of poses into the table."""
    from tests.plain_arm import turn

    placed = turn("z", 0.7) @ turn("x", 0.3)
    stands = q + np.array([0.0, *OFFSETS, 0.0])
    measured = points(stands) @ placed[:3, :3].T + [1.0, -2.0, 0.5]
    measured += rng.normal(size=measured.shape) * SIGMA
    rows = []
    for i, (own, three) in enumerate(zip(np.degrees(q), measured * 1e3, strict=True), first):
        joints = ",".join(f"{angle:.4f}" for angle in own)
        rows += [f"p{i},m{j},{joints},{x:.6f},{y:.6f},{z:.6f}"
                 for j, (x, y, z) in enumerate(three, 1)]  # fmt: skip
    data = cell.with_name("measurements.csv")
    data.write_text(data.read_text() + "\n".join([*rows, ""]))
    assert len(MARKERS) == 3


@pytest.mark.long
def test_a_loop_with_the_robot_ends_at_its_goal(cell: Path) -> None:
    rng, poses, expected = np.random.default_rng(0), 4, list[float]()
    plan = cell.with_name("plan.csv")
    for _ in range(12):
        plan.unlink(missing_ok=True)
        fields, said = proposed(cell, "--goal-mm", 0.009, "--poses", 2, "-o", plan)
        expected.append(fields["now"]["task_rms_mm"])
        if fields["done"]:
            break
        assert [p["serves"] for p in fields["poses"]] == ["task", "task"]
        head, *rows = csv.reader(plan.read_text().splitlines())
        joints = [k for k, name in enumerate(head) if name.endswith("_deg")]
        q = np.radians(np.array([[row[k] for k in joints] for row in rows], dtype=float))
        assert (np.abs(q) <= 2.0).all()
        read(cell, q, poses, rng)
        poses += 2
    assert fields["stops"] == ["goal"]
    assert fields["now"]["task_most_mm"] <= 0.009
    assert "Stop: the goal is reached" in said
    assert not plan.exists()
    assert expected[-1] < 0.7 * expected[0]


def test_without_a_goal_it_stops_where_poses_only_average(cell: Path) -> None:
    cell.with_name("measurements.csv").write_text(table(OFFSETS, 3, 60))
    fields, said = proposed(cell)
    assert fields["stops"] == ["averages"]
    assert "more poses would only average noise" in said


def test_where_nothing_looks_alike_no_pose_is_for_causes(cell: Path) -> None:
    cell.with_name("measurements.csv").write_text(table(OFFSETS, 3, 20))
    fields, said = proposed(cell, "--for", "causes")
    assert fields["done"]
    assert fields["stops"] == ["settled"]
    assert fields["now"] is None
    assert "The diagnosis finds no unmodelled error so far." in said


def test_what_is_near_a_missed_pose_is_not_proposed_again(cell: Path) -> None:
    plan, missed = cell.with_name("plan.csv"), cell.with_name("missed.csv")
    before, _ = proposed(cell, "--poses", 3, "-o", plan)
    plan.rename(missed)
    after, _ = proposed(cell, "--poses", 3, "--missed", missed, "--ahead", 6)
    first, second = (
        np.array([list(p["joints_deg"].values()) for p in fields["poses"]])
        for fields in (before, after)
    )
    rows = cell.with_name("measurements.csv").read_text().splitlines()
    names = rows[0].split(",")
    at = [names.index(f"{name}_deg") for name in before["poses"][0]["joints_deg"]]
    read = np.array([[float(row.split(",")[k]) for k in at] for row in rows[1:]])
    for one in second:  # all joints have one range
        barred = np.linalg.norm(one - first, axis=1).min()
        assert np.linalg.norm(one - read, axis=1).min() < barred
    assert after["missed"] == 3
    assert [entry["file"] for entry in after["inputs"]][-1].endswith("missed.csv")
