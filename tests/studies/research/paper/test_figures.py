"""Counterparts of the paper's figures stand where the model has them."""

from __future__ import annotations

import json
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from calib import Cell, Poses
from calib.arm.kinematics import forward
from studies.plots import Picture
from studies.research.paper import figures
from studies.research.paper.arm import LENGTHS_M, arm_of_equation_21

PAPER = json.loads((Path(__file__).parents[3] / "reference" / "paper.json").read_text())


@cache
def drawn() -> dict[str, Picture]:
    return {picture.name: picture for picture in figures.pictures()}


def numbers(picture: Picture, name: str, width: int = 3) -> list[float]:
    """The numbers of one row of the table."""
    row = next(row for row in picture.rows if row[0] == name)
    return [value for value in row if isinstance(value, float)][:width]


def test_arm_is_that_of_equation_21() -> None:
    q = np.random.default_rng(3).uniform(-3.0, 3.0, (20, 3))
    q1, q2, q3 = q.T
    l1, l2, l3 = LENGTHS_M
    frames = forward(arm_of_equation_21(), q)
    reach = l2 * np.cos(q2) + l3 * np.cos(q2 + q3)
    height = l1 + l2 * np.sin(q2) + l3 * np.sin(q2 + q3)
    printed = np.stack([reach * np.cos(q1), reach * np.sin(q1), height], axis=1)
    np.testing.assert_allclose(frames.o[:, -1], printed, atol=1e-12)
    along = np.stack(
        [np.cos(q2 + q3) * np.cos(q1), np.cos(q2 + q3) * np.sin(q1), np.sin(q2 + q3)], 1
    )
    np.testing.assert_allclose(frames.R[:, -1, :, 0], along, atol=1e-12)


@pytest.mark.parametrize("name", ["figure_1", "figure_4"])
def test_tool_has_the_markers_of_table_three(name: str) -> None:
    for marker, printed in PAPER["table_III_markers_mm"].items():
        assert numbers(drawn()[name], marker) == pytest.approx(printed)


def test_pose_of_approach_1_is_that_of_its_markers() -> None:
    """Any triangle gives back the end of link 3 and its orientation."""
    markers = np.random.default_rng(1).uniform(-0.1, 0.1, (3, 3))
    q = np.array([0.4, 0.9, -0.3])
    picture = figures.figure_2(q, markers)
    tip = forward(arm_of_equation_21(), q[None, :]).o[0, -1]
    assert numbers(picture, "p0") == pytest.approx(list(tip * 1e3))
    points = np.array([numbers(picture, f"p{j}") for j in (1, 2, 3)]) / 1e3
    sides = np.linalg.norm(points - np.roll(points, 1, axis=0), axis=1)
    np.testing.assert_allclose(sides, np.linalg.norm(markers - np.roll(markers, 1, axis=0), axis=1))


def test_setup_stands_at_table_two(kr270: Cell, table_two: Poses) -> None:
    picture = drawn()["figure_3"]
    frames = forward(kr270.robot, table_two.q)
    index = table_two.names.index("p06")
    # Free of the load the links' own weight bends the arm by millimetres.
    assert numbers(picture, "flange") == pytest.approx(list(frames.o[index, -1] * 1e3), abs=10.0)
    drop = [row[-1] for row in picture.rows]
    assert drop[0] == 0.0
    assert min(value for value in drop if isinstance(value, float)) < -1.0
    other = figures.figure_3(kr270, table_two, "p10")
    assert "p10" in other.caption


def test_command_writes_all(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    made = list(drawn().values())
    monkeypatch.setattr(figures, "pictures", lambda: made)
    folder = tmp_path / "figures"
    result = CliRunner().invoke(figures.main, [str(folder)])
    assert result.exit_code == 0, result.output
    expected = {f"figure_{k}.{end}" for k in (1, 2, 3, 4) for end in ("svg", "png", "csv")}
    assert {path.name for path in folder.iterdir()} == expected
