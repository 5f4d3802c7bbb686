"""A corner that a detector took for another is a bad reading by its name, and no cause of anything."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("cv2", exc_type=ImportError)

from tests.camera_days import SETUPS, Truth, kr270_day
from tests.studies.command_line import run

OFF = np.array([0.0, 8e-4, -6e-4, 0.0, 1.1e-3, 0.0])


def spoilt(path: Path, swapped: bool) -> None:
    """Corners 11 and 12 of the image at p07 swapped, or the first of them 4 px aside."""
    lines = path.read_text().splitlines()
    u = lines[0].split(",").index("u_px")
    a, b = (
        next(i for i, line in enumerate(lines) if line.startswith(f"p07,cam,table:{k},"))
        for k in (11, 12)
    )
    first, second = lines[a].split(","), lines[b].split(",")
    if swapped:
        first[u : u + 2], second[u : u + 2] = second[u : u + 2], first[u : u + 2]
    else:
        first[u] = f"{float(first[u]) + 4.0:.4f}"
    lines[a], lines[b] = ",".join(first), ",".join(second)
    path.write_text("\n".join(lines) + "\n")


@pytest.mark.parametrize("setup", ["kr270, hand", pytest.param("kr270", marks=pytest.mark.long)])
@pytest.mark.parametrize("swapped", [True, False])
@pytest.mark.parametrize("command", ["identify", "diagnose"])
def test_a_false_corner_is_named(tmp_path: Path, setup: str, swapped: bool, command: str) -> None:
    kr270_day(tmp_path, SETUPS[setup], Truth(OFF, seed=2), 24)
    table, out = tmp_path / "measurements.csv", tmp_path / "r.json"
    spoilt(table, swapped)
    assert run(command, tmp_path / "cell.toml", table, "--json", out).exit_code == 0
    fields = json.loads(out.read_text())
    (own,) = fields["outliers"]
    assert own["pose"] == "p07"
    corners = "table:11, table:12" if swapped else "table:11"
    assert own["reason"].startswith(f"{corners} of cam off by ")
    assert own["reason"].endswith("px, the rest is right: a bad reading")
    if command == "diagnose":
        assert (fields["verdict"], fields["effects"]) == ("no_gap", [])


def test_an_image_of_another_pose_is_no_false_corner(tmp_path: Path) -> None:
    kr270_day(tmp_path, SETUPS["kr270, hand"], Truth(OFF, seed=2), 24)
    table, out = tmp_path / "measurements.csv", tmp_path / "r.json"
    head, *rows = table.read_text().splitlines()
    at = head.split(",").index("u_px")
    moved = [row.split(",") for row in rows]
    for row in moved:
        if row[0] == "p07":
            row[at] = f"{float(row[at]) + 5.0:.4f}"
    table.write_text("\n".join([head, *map(",".join, moved)]) + "\n")
    assert run("identify", tmp_path / "cell.toml", table, "--json", out).exit_code == 0
    (own,) = json.loads(out.read_text())["outliers"]
    assert own["pose"] == "p07"
    assert "times what the other poses allow" in own["reason"]
