"""Odd inputs beyond the list of ``tests.bad_inputs``: sizes, warnings, plans and targets."""

from __future__ import annotations

import pickle
import re
from pathlib import Path

import pytest

import calib
from calib.errors import EffectCannotAct, InputError, TooFewPoses, UnknownEffect
from calib.files.write_tables import measurements_csv
from studies.demo.embedded import embedded_cell, embedded_plan
from tests.bad_inputs.edits import effects, without
from tests.helpers import simulated
from tests.studies.command_line import paper_cell


@pytest.fixture(scope="module")
def good_table() -> str:
    cell = embedded_cell()
    data, _, _ = simulated(cell, embedded_plan(cell), 0)
    return measurements_csv(cell, data)


@pytest.fixture
def folder(tmp_path: Path, good_table: str) -> Path:
    paper_cell(tmp_path)
    (tmp_path / "measurements.csv").write_text(good_table)
    return tmp_path


def test_effect_without_any_load(folder: Path) -> None:
    """A compliance without link masses or wrench must not silently do nothing."""
    urdf = folder / "kr270.urdf"
    urdf.write_text(re.sub(r'<mass value="\d+"/>', '<mass value="0"/>', urdf.read_text()))
    table = folder / "measurements.csv"
    for name in ("fx_N", "fy_N", "fz_N", "mx_Nm", "my_Nm", "mz_Nm"):
        table.write_text(without(name)(table.read_text()))
    path = folder / "cell.toml"
    path.write_text(effects("base", "joint_compliance:A3")(path.read_text()))
    cell = calib.load_cell(path)
    with pytest.raises(EffectCannotAct, match="nothing loads the arm; give wr"):
        calib.identify(cell, calib.load_measurements(cell, table))


def test_a_gigabyte_of_garbage_is_refused_early(folder: Path) -> None:
    """Sparse files: nothing of the gigabyte is read beyond its first line."""
    cell = calib.load_cell(folder / "cell.toml")
    for name, load in (
        ("big.csv", lambda path: calib.load_measurements(cell, path)),
        ("big.toml", calib.load_cell),
    ):
        path = folder / name
        with path.open("wb") as file:
            file.truncate(10**9)
        with pytest.raises(InputError, match="too large"):
            load(path)
    wide = folder / "wide.csv"
    wide.write_text("pose,marker," + "x" * 200_000)
    with pytest.raises(InputError, match="line 1: is no line of a CSV table"):
        calib.load_measurements(cell, wide)


WARNINGS = {
    "outside the limits": (
        lambda t: t.replace(",-140,", ",-141.5,"),
        r"line \d+: joint A2 at -141.50 deg is outside its limits \(18 rows in all\)",
    ),
    "other columns": (
        lambda t: "\n".join(
            line + (",operator" if i == 0 else ",x") if line else line
            for i, line in enumerate(t.split("\n"))
        ),
        "ignored columns: operator",
    ),
}


@pytest.mark.parametrize("case", list(WARNINGS))
def test_warnings(folder: Path, case: str) -> None:
    edit, message = WARNINGS[case]
    path = folder / "measurements.csv"
    path.write_text(edit(path.read_text()))
    data = calib.load_measurements(calib.load_cell(folder / "cell.toml"), path)
    assert re.search(message, "\n".join(data.warnings)), data.warnings


@pytest.mark.parametrize(("beyond", "warns"), [(0.04, False), (0.06, True)])
def test_a_reading_hardly_beyond_a_limit_is_no_fault(
    folder: Path, beyond: float, warns: bool
) -> None:
    path = folder / "measurements.csv"
    path.write_text(path.read_text().replace(",-140,", f",{-140 - beyond},"))
    data = calib.load_measurements(calib.load_cell(folder / "cell.toml"), path)
    assert any("outside its limits" in w for w in data.warnings) is warns


def test_errors_come_whole_from_another_process() -> None:
    for error in (
        InputError("cell.toml", "line 3", "is odd", "mend it"),
        EffectCannotAct("backlash:A2", "nothing moves", "move it"),
        TooFewPoses(3, 7, 42, 21),
        UnknownEffect("unknown"),
    ):
        again = pickle.loads(pickle.dumps(error))
        assert type(again) is type(error)
        assert str(again) == str(error)
        assert vars(again) == vars(error)
