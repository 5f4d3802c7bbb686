"""A cell with found effects is the user's own file, and loads wherever it is written."""

from __future__ import annotations

import tomllib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import calib
from calib import Cell, Poses
from calib.effects import Effect
from calib.files.cell_out import extended_cell
from calib.model.build import build, context_of, place_effect
from studies import demo

SOURCE = Path(demo.__file__).parent


def effects(cell: Cell, poses: Poses, *names: str) -> list[Effect]:
    context = context_of(cell, poses)
    return [place_effect(*name.split(":"), context) for name in names]


def written(tmp_path: Path) -> Cell:
    """The embedded cell in a folder of its own."""
    folder = tmp_path / "here"
    folder.mkdir()
    (folder / "kr270.urdf").write_text((SOURCE / "kr270.urdf").read_text())
    (folder / "cell.toml").write_text((SOURCE / "cell.toml").read_text())
    return calib.load_cell(folder / "cell.toml")


def moved(plan: Poses) -> Poses:
    return replace(plan, approach=np.sign(np.sin(np.arange(plan.q.size).reshape(plan.q.shape))))


def test_all_else_stays_and_the_new_cell_loads(tmp_path: Path, table_two: Poses) -> None:
    cell, poses = written(tmp_path), moved(table_two)
    found = effects(cell, poses, "backlash:A3", "stiffness_vs_angle:A3")
    target = tmp_path / "there" / "better.toml"
    target.parent.mkdir()
    made = extended_cell(cell, found, poses, target)
    target.write_text(made.text)
    before, after = cell.path.read_text().splitlines(), made.text.splitlines()
    lost = [line for line in before if line not in after]
    assert [line.split(" =")[0] for line in lost] == ["urdf", "effects"]
    assert made.added == ("backlash:A3", "stiffness_vs_angle:A3")
    assert made.replaced == ("joint_compliance:A3",)
    assert not made.refused
    again = calib.load_cell(target)
    assert again.effects == (
        "base", "tool", "geometry", "stiffness_vs_angle:A2", "joint_compliance:A4,A5,A6",
        "backlash:A3", "stiffness_vs_angle:A3",
    )  # fmt: skip
    np.testing.assert_allclose(again.knots["A3"], found[1].knots, atol=1e-8)  # type: ignore[attr-defined]
    np.testing.assert_allclose(again.knots["A2"], cell.knots["A2"])
    assert again.robot_files[0].resolve() == cell.robot_files[0].resolve()
    assert tomllib.loads(made.text)["robot"]["urdf"] == "../here/kr270.urdf"
    build(again, poses)


def test_beside_the_cell_no_path_changes(tmp_path: Path, table_two: Poses) -> None:
    cell = written(tmp_path)
    made = extended_cell(cell, [], table_two, cell.path.with_name("other.toml"))
    assert made.text == cell.path.read_text()
    assert not made.added


@pytest.mark.parametrize(
    ("model", "expected"),
    [
        ('[model]\neffects = [\n  "base", # bolted down\n  "tool",\n]\n', ["base", "tool"]),
        ('model = { effects = ["base", "tool", "joint_compliance:A3"] }\n', ["base", "tool"]),
        (
            '[model]\neffects = ["base", "tool", "joint_compliance"]\n',
            ["base", "tool", "joint_compliance:A1,A2,A4,A5,A6"],
        ),
    ],
    ids=["with comments", "in one line", "everywhere"],
)
def test_any_way_to_write_the_model(
    tmp_path: Path, table_two: Poses, model: str, expected: list[str]
) -> None:
    cell = written(tmp_path)
    text = cell.path.read_text()
    head = text.split("[model]", 1)[0]
    inline = model.startswith("model")
    cell.path.write_text(model + head if inline else head + model)
    cell = calib.load_cell(cell.path)
    made = extended_cell(
        cell, effects(cell, table_two, "stiffness_vs_angle:A3"), table_two, cell.path
    )
    table = tomllib.loads(made.text)["model"]
    assert table["effects"] == [*expected, "stiffness_vs_angle:A3"]
    assert list(table["knots_deg"]) == ["A3"]
    assert ("# bolted down" in made.text) == ("# bolted down" in model)


def test_targets_are_named_from_the_new_folder(tmp_path: Path, table_two: Poses) -> None:
    cell = written(tmp_path)
    text = cell.path.read_text().replace('# targets = "targets.csv"', 'targets = "targets.csv"')
    cell.path.write_text(text)
    joints = [f"A{k}_deg" for k in range(1, 7)]
    (cell.path.parent / "targets.csv").write_text(f"{','.join(joints)}\n0,-60,70,20,45,10\n")
    made = extended_cell(calib.load_cell(cell.path), [], table_two, tmp_path / "new.toml")
    assert tomllib.loads(made.text)["design"]["targets"] == "here/targets.csv"


def test_what_the_model_cannot_hold_is_left_out_and_said(tmp_path: Path, table_two: Poses) -> None:
    cell = written(tmp_path)
    found = effects(cell, table_two, "joint_offset:A3", "backlash:A4")
    made = extended_cell(cell, found, moved(table_two), cell.path.with_name("new.toml"))
    assert made.added == ("backlash:A4",)
    ((name, reason),) = made.refused
    assert name == "joint_offset:A3"
    assert "in the same way" in reason


def test_of_two_effects_the_one_that_contains_the_other_stays(
    tmp_path: Path, table_two: Poses
) -> None:
    cell = written(tmp_path)
    (whole,) = effects(cell, table_two, "gravity_sag:arm")
    both = [*effects(cell, table_two, "gravity_sag:A2"), whole]
    made = extended_cell(cell, both, table_two, cell.path.with_name("new.toml"))
    assert made.added == ("gravity_sag:arm",)
