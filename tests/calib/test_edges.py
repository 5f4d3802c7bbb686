"""Inputs that would pass in silence, and wrong calls from Python: each ends in one line."""

from __future__ import annotations

import re
import warnings
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import calib
from calib.errors import CalibError, InputError
from calib.files.estimate import load_estimate
from tests.bad_inputs.edits import Edit, added, effects, swap, times, whole
from tests.helpers import measured_cell
from tests.studies.command_line import run as posecal

_AXES = tuple(f"A{k}_deg" for k in range(1, 7))


@pytest.fixture(scope="module")
def good(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("good")
    measured_cell(folder)
    return folder


def each_row(change: Callable[[list[str], dict[str, str]], str], *titles: str) -> Edit:
    """Further fields of every row, by its fields and titles."""

    def edit(text: str) -> str:
        head, *rows = [line.split(",") for line in text.strip().split("\n")]
        lines = [change(row, dict(zip(head, row, strict=True))) for row in rows]
        return "\n".join([",".join([*head, *titles]), *lines, ""])

    return edit


def in_milliseconds(row: list[str], named: dict[str, str]) -> str:
    return ",".join([*row, str(30_000 * int(re.sub(r"\D", "", named["pose"])))])


def rounded(row: list[str], named: dict[str, str]) -> str:
    digits = {name: f"{float(named[name]):.1f}" for name in _AXES}
    return ",".join(digits.get(name, text) for name, text in named.items())


def in_metres(text: str) -> str:
    def scaled(found: re.Match[str]) -> str:
        return found[1] + str([float(x) / 1e3 for x in found[2].split(",")])

    return re.sub(r"(?m)^(m\d = )\[(.*)\]", scaled, text)


ODD: dict[str, tuple[str, Edit, str]] = {
    "milliseconds": (
        "measurements.csv",
        each_row(in_milliseconds, "time_s"),
        r"measurements.csv: time_s: most readings are 8.3 h apart, .* divide by 1000",
    ),
    "a sigma in micrometres": (
        "cell.toml",
        swap("sigma_mm = 0.010", "sigma_mm = 10"),
        "cell.toml: instrument: .* of 10 mm is that of no instrument: .*micrometres, write 0.01 mm",
    ),
    "a sigma in metres": (
        "cell.toml",
        swap("sigma_mm = 0.010", "sigma_mm = 0.00001"),
        "cell.toml: instrument: .* of 1e-05 mm .* metres, write 0.01 mm",
    ),
    "markers in metres": (
        "cell.toml",
        in_metres,
        "cell.toml: markers_mm: the farthest is 0\\.\\d+ mm .* if these are metres, write millimetres",
    ),
    "joints that were rounded": (
        "measurements.csv",
        each_row(rounded),
        "measurements.csv: joint angles are rounded to 0.1 deg, which moves the tip by .* mm: write",
    ),
    "radians": (
        "measurements.csv",
        times(np.pi / 180.0, *_AXES),
        "joint angles reach only .* degrees: the range looks like radians",
    ),
    "a wrench that nothing feels": (
        "cell.toml",
        effects("base", "tool", "geometry"),
        "fx_N .. mz_Nm: nothing in .model. effects yields to this wrench, .* add joint_compliance",
    ),
}


@pytest.mark.parametrize("case", ODD)
def test_what_may_be_meant_is_said(case: str, good: Path, tmp_path: Path) -> None:
    name, edit, said = ODD[case]
    for file in good.iterdir():
        text = file.read_text()
        (tmp_path / file.name).write_text(edit(text) if file.name == name else text)
    cell = calib.load_cell(tmp_path / "cell.toml")
    data = calib.load_measurements(cell, tmp_path / "measurements.csv")
    (found,) = [text for text in data.warnings if re.search(said, text)]
    assert found.isprintable()


def test_nothing_is_said_of_good_files(good: Path) -> None:
    cell = calib.load_cell(good / "cell.toml")
    assert not calib.load_measurements(cell, good / "measurements.csv").warnings


REFUSED: dict[str, tuple[str, Edit, str]] = {
    "targets in radians": (
        "targets.csv",
        whole(",".join(_AXES) + "\n" + 3 * "0.5,-1.2,1.5,0.2,0.4,1\n"),
        "targets.csv: line 1: joint angles reach only 1.5 degrees, .* name the columns <joint>_rad",
    ),
    "a unit left out": (
        "cell.toml",
        swap("sigma_mm = 0.010", "sigma = 0.015"),
        "instrument.sigma: is not a known key; did you mean 'sigma_mm' or 'sigma_px'",
    ),
}


@pytest.mark.parametrize("case", REFUSED)
def test_what_cannot_be_meant_is_refused(case: str, good: Path, tmp_path: Path) -> None:
    name, edit, said = REFUSED[case]
    for file in good.iterdir():
        (tmp_path / file.name).write_text(file.read_text())
    before = (tmp_path / name).read_text() if (tmp_path / name).exists() else ""
    (tmp_path / name).write_text(edit(before))
    with pytest.raises(InputError, match=said):
        calib.load_targets(calib.load_cell(tmp_path / "cell.toml"), tmp_path / "targets.csv")


def test_rows_that_a_spreadsheet_leaves_empty_are_none(good: Path, tmp_path: Path) -> None:
    text = (good / "measurements.csv").read_text()
    empty = "," * text.split("\n")[0].count(",")
    (tmp_path / "data.csv").write_text(added(f"{empty}\n{empty}\n")(text))
    cell = calib.load_cell(good / "cell.toml")
    data = calib.load_measurements(cell, tmp_path / "data.csv")
    assert len(data) == len(calib.load_measurements(cell, good / "measurements.csv"))


def test_a_result_of_another_robot_is_none_of_this_cell(good: Path, tmp_path: Path) -> None:
    path = tmp_path / "result.json"
    call = ("identify", good / "cell.toml", good / "measurements.csv", "--json", path)
    assert posecal(*call).exit_code == 0
    cell = calib.load_cell(good / "cell.toml")
    names = tuple(f"other{k}" for k in range(1, 7))
    other = replace(cell, robot=replace(cell.robot, joints=names))
    with pytest.raises(
        InputError, match=r"is not of this cell: .*give the cell that it was made with"
    ):
        load_estimate(other, path)


def readings(cell: calib.Cell, count: int = 20) -> calib.Measurements:
    q = cell.robot.sobol(count)
    return calib.Measurements.of(q, np.ones((count, 3, 3)), sigma=1e-5)


Q, POINTS = np.zeros((20, 6)), np.ones((20, 3, 3))
EDGES: dict[str, tuple[Callable[[calib.Cell], Any], str]] = {
    "five joints for six": (
        lambda c: calib.predict(c, np.zeros((4, 5)), {}),
        r"plan: joint values have shape \(4, 5\), expected \(4, 6\)",
    ),
    "poses of five joints": (
        lambda c: calib.parameters(c, calib.poses_at(np.zeros((4, 5)))),
        r"plan: joint values have shape \(4, 5\)",
    ),
    "data of five joints": (
        lambda c: calib.identify(c, calib.Measurements.of(Q[:, :5], POINTS)),
        r"data: joint values have shape \(20, 5\), expected \(20, 6\)",
    ),
    "20 poses against 30": (
        lambda c: calib.Measurements.of(Q, np.ones((30, 3, 3))),
        r"readings: have shape \(30, 3, 3\), .* of 20 poses",
    ),
    "names of other poses": (lambda c: calib.poses_at(Q, ["a"]), "q: 20 rows, and 1 poses"),
    "a wrench of one pose": (
        lambda c: calib.poses_at(Q, wrench=np.zeros((1, 6))),
        "wrench: 1 rows, and 20 poses",
    ),
    "two markers for three": (
        lambda c: calib.identify(c, calib.Measurements.of(Q, POINTS[:, :2])),
        "data: has 2 channels, and the cell 3",
    ),
    "points of one marker, flat": (
        lambda c: calib.Measurements.of(Q, POINTS[:, 0]),
        r"points: have shape \(20, 3\), expected \(poses, markers, 3\)",
    ),
    "a path that is not there": (lambda c: calib.identify(c, "no.csv"), "no.csv: cannot be read"),
    "arrays for data": (lambda c: calib.diagnose(c, Q), "data: .* is no Measurements; name a file"),
    "a name for a cell": (lambda c: calib.identify("cell.toml", Q), "cell: 'cell.toml' is none"),
    "words for a plan": (lambda c: calib.predict(c, ["a"], {}), "plan: .* is none; give poses"),
    "NaN in joints": (
        lambda c: calib.Measurements.of(np.full((20, 6), np.nan), POINTS),
        "q: pose 'p0000' has a number that is none",
    ),
    "NaN in points": (
        lambda c: calib.Measurements.of(Q, POINTS * np.nan),
        "points: pose 'p0000' has a number that is none; .* hide what was not seen by seen",
    ),
    "NaN in data": (
        lambda c: calib.identify(
            c, replace(readings(c), readings=np.full((20, 3, 3), np.nan))
        ),
        "data: readings: pose 'p0000' has a number that is none",
    ),
    "a share above one": (
        lambda c: calib.identify(c, readings(c), heldout=1.5),
        "fraction: 1.5 is none; take one between 0 and 1",
    ),
    "markers of two numbers": (
        lambda c: calib.Cell(c.robot, {"m": (1.0, 2.0)}),
        "markers: each is three finite coordinates in metres",
    ),
    "NaN in markers": (
        lambda c: calib.Cell(c.robot, {"m": (1.0, 2.0, np.nan)}),
        "markers: each is three finite coordinates",
    ),
    "a path for a robot": (
        lambda c: calib.Cell("arm.urdf", c.markers),
        "robot: 'arm.urdf' is none; read one",
    ),
    "a number for an instrument": (
        lambda c: calib.Cell(c.robot, c.markers, (1e-5,)),
        "instrument: 1e-05 is none; make one, as Tracker",
    ),
}  # fmt: skip


@pytest.mark.parametrize("case", EDGES)
def test_wrong_calls_name_the_argument(case: str, kr270: calib.Cell) -> None:
    call, said = EDGES[case]
    with pytest.raises(CalibError, match=said):
        call(kr270)


@pytest.mark.parametrize(
    ("make", "said"),
    [
        (
            lambda c: calib.Cell(c.robot, c.markers * 1e3, calib.Tracker(1e-5)),
            "Python, write metres",
        ),
        (
            lambda c: calib.Cell(c.robot, c.markers, calib.Tracker(sigma=0.015)),
            "of 15 mm is that of",
        ),
    ],
)
def test_millimetres_are_warned_of(
    make: Callable[[calib.Cell], calib.Cell], said: str, kr270: calib.Cell
) -> None:
    with pytest.warns(UserWarning, match=said):
        cell = make(kr270)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        replace(cell, effects=("base",))


def test_plain_arrays_and_seeds_will_do(kr270: calib.Cell, good: Path) -> None:
    data = calib.load_measurements(kr270, good / "measurements.csv")
    same = calib.Measurements.of(data.poses.q, data.readings, wrench=data.poses.wrench)
    np.testing.assert_array_equal(same.poses.approach, data.poses.approach)
    parts = data.split(0.3, 0), data.split(0.3, np.random.default_rng(0))
    assert parts[0][1].poses.names == parts[1][1].poses.names
    found = calib.identify(kr270, data, heldout=0.3)
    assert found.rms("heldout") is not None
    assert calib.__version__[0].isdigit()
