"""``posecal enough`` as a user sees it at two in the afternoon."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

import calib
from calib.files.write_tables import measurements_csv
from tests.doe.forecast.day import MODEL, of_poses, whole_day
from tests.studies.command_line import paper_cell, result


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("half")
    cell = calib.load_cell(paper_cell(path, *MODEL))
    plan = calib.load_plan(cell, path / "plan.csv")
    data = of_poses(whole_day(cell, plan), [2, 5, 8, 11, 14, 1], 15)
    (path / "half.csv").write_text(measurements_csv(cell, data))
    return path


def asked(folder: Path, *more: object) -> tuple[dict[str, Any], str]:
    call = ("enough", folder / "cell.toml", folder / "half.csv", *more)
    return result(folder / "out.json", *call, kind="enough")


@pytest.mark.long
def test_it_names_the_poses_that_the_goal_needs_or_how_many_more(folder: Path) -> None:
    plan = ("--plan", folder / "plan.csv")
    now, _ = asked(folder, *plan)
    assert now["plan"] == {"poses": 15, "measured": 6, "to_measure": 9}
    goal = now["order"][2]["task_most_mm"] * 1.0001
    fields, said = asked(folder, *plan, "--goal-mm", goal)
    names = ", ".join(step["pose"] for step in fields["order"][:3])
    assert fields["poses_to_goal"] == 3
    assert f"after 3 more: {names}" in said
    assert {Path(entry["file"]).name for entry in fields["inputs"]} == {
        "cell.toml", "kr270.urdf", "half.csv", "plan.csv",
    }  # fmt: skip
    assert all(p["std"] > 0.0 for p in fields["end"]["parameters"])
    _, said = asked(folder, *plan, "--goal-mm", 5)
    assert "You may stop." in said
    fields, said = asked(folder, *plan, "--goal-mm", 0.97 * now["end"]["task_most_mm"])
    assert fields["poses_to_goal"] is None
    assert f"--poses {fields['fresh_poses_to_goal']}" in said


def test_without_a_plan(folder: Path) -> None:
    fields, said = asked(folder)
    assert fields["order"] == []
    assert "planned poses" not in said
    assert f"RMS now, from {fields['now']['readings']} readings." in said
