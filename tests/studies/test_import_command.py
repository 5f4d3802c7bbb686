"""``posecal import`` as a user and an outside check see it."""

from __future__ import annotations

import json
from functools import partial
from pathlib import Path

import numpy as np
import pytest

import calib
from calib.files.write_tables import measurements_csv
from studies.demo.embedded import embedded_text
from tests.camera_cells import PINHOLE, camera_cell
from tests.helpers import simulated
from tests.studies.command_line import paper_cell
from tests.studies.command_line import run as posecal
from tests.studies.test_readme import blocks

run = partial(posecal, "import")


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A cell, simulated measurements, and the same as a table of points and one of joints."""
    path = tmp_path_factory.mktemp("import")
    cell = calib.load_cell(paper_cell(path))
    data, _, _ = simulated(cell, calib.load_plan(cell, path / "plan.csv"), 3)
    text = measurements_csv(cell, data)
    (path / "measured.csv").write_text(text)
    header, *rows = (line.split(",") for line in text.splitlines())
    x = header.index("x_mm")
    points = [[*row[:2], *row[x : x + 3]] for row in (header, *rows[::-1])]
    joints = dict.fromkeys(",".join([row[0], *row[2:x], *row[x + 3 :]]) for row in (header, *rows))
    (path / "points.csv").write_text("\n".join(map(",".join, points)))
    (path / "joints.csv").write_text("\n".join(joints))
    return path


def test_joined_table_is_the_measured_one(folder: Path) -> None:
    """The order is that of the joints."""
    out, result = folder / "joined.csv", folder / "joined.json"
    done = run(
        folder / "points.csv", "--joints", folder / "joints.csv",
        "-o", out, "--json", result,
    )  # fmt: skip
    assert done.exit_code == 0, done.output
    assert "30 poses, 90 points" in done.output
    cell = calib.load_cell(folder / "cell.toml")
    ours, truth = (calib.load_measurements(cell, p) for p in (out, folder / "measured.csv"))
    assert ours.poses.names == truth.poses.names
    for name in ("q", "wrench"):
        np.testing.assert_array_equal(getattr(ours.poses, name), getattr(truth.poses, name))
    np.testing.assert_array_equal(ours.points, truth.points)
    fields = json.loads(result.read_text(), parse_constant=pytest.fail)
    assert (fields["schema"], fields["command"]) == (1, "import")
    assert (fields["poses"], fields["points"]) == (30, 90)
    assert fields["markers"] == {"m1": 30, "m2": 30, "m3": 30}
    named = {Path(entry["file"]).name for entry in fields["inputs"]}
    assert named == {"points.csv", "joints.csv"}


def test_a_plan_may_give_the_joints(folder: Path) -> None:
    """Its columns of order and level say nothing of a reading."""
    text = (folder / "joints.csv").read_text().splitlines()
    plan = [f"{line},{k or 'order'}" for k, line in enumerate(text)]
    (folder / "ordered.csv").write_text("\n".join(plan))
    done = run(folder / "points.csv", "--joints", folder / "ordered.csv", "-o", folder / "o.csv")
    assert done.exit_code == 0, done.output
    assert "order" not in (folder / "o.csv").read_text()


def test_images_of_a_board_become_rows(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """By the recipe that the page shows; an image without a board has no rows."""
    photographs = pytest.importorskip("tests.photographs")
    monkeypatch.chdir(tmp_path)
    Path("images").mkdir()
    drawn, truth = photographs.charuco(), []
    for k in range(2):
        T = photographs.facing(0.2 * k, (0.3 * k, 0.1), (0.25, 0.18), 0.5)
        image = photographs.photograph(drawn, T)
        photographs.cv2.imwrite(f"images/shot{k}.png", image)
        truth.append(photographs.pixels(photographs.points_of(), T))
    photographs.cv2.imwrite("images/shot2.png", np.full((720, 960), 90, np.uint8))
    (block,) = blocks("CharucoDetector")
    exec(compile(block, "import.md", "exec"), {})
    Path("kr270.urdf").write_text(embedded_text("kr270.urdf"))
    text = camera_cell(photographs.CHARUCO, PINHOLE, "kr270.urdf", "base_link", "tool0")
    Path("cell.toml").write_text(text.replace("[boards.b]", "[boards.table]"))
    header = "pose," + ",".join(f"A{k}_deg" for k in range(1, 7))
    Path("joints.csv").write_text(f"{header}\nshot1,1,-90,90,0,0,1\nshot0,0,-90,90,0,0,0\n")
    done = run("points.csv", "--joints", "joints.csv", "-o", "day.csv")
    assert done.exit_code == 0, done.output
    data = calib.load_measurements(calib.load_cell("cell.toml"), "day.csv")
    assert data.poses.names == ("shot1", "shot0")
    np.testing.assert_allclose(data.readings, truth[::-1], atol=0.3)
