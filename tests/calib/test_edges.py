"""Inputs that would pass in silence, odd files, and wrong calls from Python: each ends in one line."""

from __future__ import annotations

import pickle
import re
import warnings
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import calib
from calib import Cell, Measurements
from calib.errors import CalibError, EffectCannotAct, InputError, TooFewPoses, UnknownEffect
from calib.files.estimate import load_estimate
from tests.bad_inputs.edits import Edit, added, column, effects, swap, times, whole

_AXES = tuple(f"A{k}_deg" for k in range(1, 7))


def edited(good: Path, folder: Path, **edits: Edit) -> tuple[Cell, Path]:
    """A cell and its table in a folder of their own, files changed by their stems."""
    for file in good.glob("*.*"):
        (folder / file.name).write_text(edits.get(file.stem, str)(file.read_text()))
    return calib.load_cell(folder / "cell.toml"), folder / "measurements.csv"


# -- What may be meant is said


def each_row(change: Callable[[dict[str, str]], dict[str, str]]) -> Edit:
    """Rows changed by their titles, further ones after the others."""

    def edit(text: str) -> str:
        head, *rows = [line.split(",") for line in text.strip().split("\n")]
        changed = [change(dict(zip(head, row, strict=True))) for row in rows]
        return "\n".join([",".join(changed[0]), *(",".join(row.values()) for row in changed), ""])

    return edit


def in_milliseconds(row: dict[str, str]) -> dict[str, str]:
    return row | {"time_s": str(30_000 * int(re.sub(r"\D", "", row["pose"])))}


def rounded(row: dict[str, str]) -> dict[str, str]:
    return row | {name: f"{float(row[name]):.1f}" for name in _AXES}


def in_metres(text: str) -> str:
    def scaled(found: re.Match[str]) -> str:
        return found[1] + str([float(x) / 1e3 for x in found[2].split(",")])

    return re.sub(r"(?m)^(m\d = )\[(.*)\]", scaled, text)


def beyond(degrees: str) -> Edit:
    return lambda text: text.replace(",-140,", f",{degrees},")


SIGMA = "sigma_mm = 0.010"
ODD: dict[str, tuple[str, Edit, str]] = {
    "milliseconds": ("measurements", each_row(in_milliseconds),
        r"measurements.csv: time_s: most readings are 8.3 h apart, .* divide by 1000"),
    "a sigma in micrometres": ("cell", swap(SIGMA, "sigma_mm = 10"),
        "cell.toml: instrument: .* of 10 mm is that of no instrument: .*micrometres, write 0.01 mm"),
    "a sigma in metres": ("cell", swap(SIGMA, "sigma_mm = 0.00001"),
        "cell.toml: instrument: .* of 1e-05 mm .* metres, write 0.01 mm"),
    "markers in metres": ("cell", in_metres,
        r"markers_mm: the farthest is 0\.\d+ mm .* if these are metres, write millimetres"),
    "joints that were rounded": ("measurements", each_row(rounded),
        "joint angles are rounded to 0.1 deg, which moves the tip by .* mm: write"),
    "radians": ("measurements", times(np.pi / 180.0, *_AXES),
        "joint angles reach only .* degrees: the range looks like radians"),
    "a wrench that nothing feels": ("cell", effects("base", "tool", "geometry"),
        "fx_N .. mz_Nm: nothing in .model. effects yields to this wrench, .* add joint_compliance"),
    "outside the limits": ("measurements", beyond("-141.5"),
        r"line \d+: joint A2 at -141.50 deg is outside its limits \(18 rows in all\)"),
    "just outside": ("measurements", beyond("-140.06"), "outside its limits"),
    "other columns": ("measurements", column("operator", "x"), "ignored columns: operator"),
}  # fmt: skip


@pytest.mark.parametrize("case", ODD)
def test_what_may_be_meant_is_said(case: str, good: Path, tmp_path: Path) -> None:
    stem, edit, said = ODD[case]
    data = calib.load_measurements(*edited(good, tmp_path, **{stem: edit}))
    (found,) = [text for text in data.warnings if re.search(said, text)]
    assert found.isprintable()


# Rows that a spreadsheet leaves empty are none, and hardly beyond a limit is no fault.
@pytest.mark.parametrize("edit", [str, beyond("-140.04"), added(2 * (18 * "," + "\n"))])
def test_nothing_is_said_of_good_files(edit: Edit, good: Path, tmp_path: Path) -> None:
    def trimmed(text: str) -> str:
        commas = text.split("\n")[0].count(",") * ","
        return re.sub(r"(?m)^,+$", commas, edit(text))

    data = calib.load_measurements(*edited(good, tmp_path, measurements=trimmed))
    assert not data.warnings
    assert len(data) == 30


# -- What cannot be meant is refused


def test_what_cannot_be_meant_is_refused(good: Path, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="did you mean 'sigma_mm' or 'sigma_px'"):
        edited(good, tmp_path, cell=swap(SIGMA, "sigma = 0.015"))
    cell, table = edited(good, tmp_path)
    radians = whole(",".join(_AXES) + "\n" + 3 * "0.5,-1.2,1.5,0.2,0.4,1\n")("")
    (tmp_path / "targets.csv").write_text(radians)
    said = "line 1: joint angles reach only 1.5 degrees, .* name the columns <joint>_rad"
    with pytest.raises(InputError, match=said):
        calib.load_targets(cell, tmp_path / "targets.csv")
    (tmp_path / "wide.csv").write_text("pose,marker," + "x" * 200_000)
    with pytest.raises(InputError, match="line 1: is no line of a CSV table"):
        calib.load_measurements(cell, tmp_path / "wide.csv")
    with table.open("wb") as file, (tmp_path / "big.toml").open("wb") as other:
        file.truncate(10**9)  # sparse: nothing of the gigabyte is read beyond its first line
        other.truncate(10**9)
    with pytest.raises(InputError, match="too large"):
        calib.load_measurements(cell, table)
    with pytest.raises(InputError, match="too large"):
        calib.load_cell(tmp_path / "big.toml")


def test_a_result_of_another_robot_is_none_of_this_cell(good: Path) -> None:
    cell = calib.load_cell(good / "cell.toml")
    names = tuple(f"other{k}" for k in range(1, 7))
    other = replace(cell, robot=replace(cell.robot, joints=names))
    said = r"is not of this cell: .*give the cell that it was made with"
    with pytest.raises(InputError, match=said):
        load_estimate(other, good / "result.json")


# -- Wrong calls from Python

Q, POINTS = np.zeros((20, 6)), np.ones((20, 3, 3))


def weightless(cell: Cell) -> Cell:
    robot = replace(cell.robot, masses=np.zeros(6))
    return replace(cell, robot=robot, load=None, effects=("base", "joint_compliance:A3"))


NAN = np.nan
EDGES: list[tuple[Callable[[Cell], Any], str]] = [
    (lambda c: calib.predict(c, np.zeros((4, 5)), {}),
     r"plan: joint values have shape \(4, 5\), expected \(4, 6\)"),
    (lambda c: calib.parameters(c, calib.poses_at(np.zeros((4, 5)))),
     r"plan: joint values have shape \(4, 5\)"),
    (lambda c: calib.identify(c, Measurements.of(Q[:, :5], POINTS)),
     r"data: joint values have shape \(20, 5\), expected \(20, 6\)"),
    (lambda c: Measurements.of(Q, np.ones((30, 3, 3))),
     r"readings: have shape \(30, 3, 3\), .* of 20 poses"),
    (lambda c: calib.poses_at(Q, ["a"]), "q: 20 rows, and 1 poses"),
    (lambda c: calib.poses_at(Q, wrench=np.zeros((1, 6))), "wrench: 1 rows, and 20 poses"),
    (lambda c: calib.identify(c, Measurements.of(Q, POINTS[:, :2])),
     "data: has 2 channels, and the cell 3"),
    (lambda c: Measurements.of(Q, POINTS[:, 0]),
     r"points: have shape \(20, 3\), expected \(poses, markers, 3\)"),
    (lambda c: Measurements.of(Q, POINTS, sigma=np.full((20, 2), 1e-5)),
     r"sigma: has shape \(20, 2\), expected \(20, 3\) or one number"),
    (lambda c: calib.identify(weightless(c), Measurements.of(c.robot.sobol(20), POINTS)),
     "joint_compliance:A3 cannot act: nothing loads the arm; give wr"),
    (lambda c: calib.identify(c, "no.csv"), "no.csv: cannot be read"),
    (lambda c: calib.diagnose(c, Q), "data: .* is no Measurements; name a file"),
    (lambda c: calib.identify("cell.toml", Q), "cell: 'cell.toml' is none"),
    (lambda c: calib.predict(c, ["a"], {}), "plan: .* is none; give poses"),
    (lambda c: Measurements.of(Q * NAN, POINTS), "q: pose 'p0000' has a number that is none"),
    (lambda c: Measurements.of(Q, POINTS * NAN),
     "points: pose 'p0000' has a number that is none; .* hide what was not seen by seen"),
    (lambda c: calib.identify(c, replace(Measurements.of(Q, POINTS), readings=POINTS * NAN)),
     "data: readings: pose 'p0000' has a number that is none"),
    (lambda c: calib.identify(c, Measurements.of(c.robot.sobol(20), POINTS), heldout=1.5),
     "fraction: 1.5 is none; take one between 0 and 1"),
    (lambda c: Cell(c.robot, {"m": (1.0, 2.0)}),
     "markers: each is three finite coordinates in metres"),
    (lambda c: Cell(c.robot, {"m": (1.0, 2.0, NAN)}), "markers: each is three finite coordinates"),
    (lambda c: Cell("arm.urdf", c.markers), "robot: 'arm.urdf' is none; read one"),
    (lambda c: Cell(c.robot, c.markers, (1e-5,)), "instrument: 1e-05 is none; make one, as Tracker"),
]  # fmt: skip


@pytest.mark.parametrize("case", range(len(EDGES)))
def test_wrong_calls_name_the_argument(case: int, kr270: Cell) -> None:
    call, said = EDGES[case]
    with pytest.raises(CalibError, match=said):
        call(kr270)


@pytest.mark.parametrize(
    ("times_markers", "sigma", "said"),
    [(1e3, 1e-5, "Python, write metres"), (1.0, 0.015, "of 15 mm is that of")],
)
def test_millimetres_are_warned_of(
    times_markers: float, sigma: float, said: str, kr270: Cell
) -> None:
    with pytest.warns(UserWarning, match=said):
        cell = Cell(kr270.robot, kr270.markers * times_markers, calib.Tracker(sigma=sigma))
    with warnings.catch_warnings(action="error"):
        replace(cell, effects=("base",))


def test_plain_arrays_and_seeds_will_do(kr270: Cell, good: Path) -> None:
    data = calib.load_measurements(kr270, good / "measurements.csv")
    same = Measurements.of(data.poses.q, data.readings, wrench=data.poses.wrench)
    np.testing.assert_array_equal(same.poses.approach, data.poses.approach)
    parts = data.split(0.3, 0), data.split(0.3, np.random.default_rng(0))
    assert parts[0][1].poses.names == parts[1][1].poses.names
    assert calib.identify(kr270, data, heldout=0.3).rms("heldout") is not None
    assert calib.__version__[0].isdigit()


def test_errors_come_whole_from_another_process() -> None:
    for error in (
        InputError("cell.toml", "line 3", "is odd", "mend it"),
        EffectCannotAct("backlash:A2", "nothing moves", "move it"),
        TooFewPoses(3, 7, 42, 21),
        UnknownEffect("unknown"),
    ):
        again = pickle.loads(pickle.dumps(error))
        assert type(again) is type(error)
        assert (str(again), vars(again)) == (str(error), vars(error))
