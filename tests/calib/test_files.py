"""Files: results written whole, estimates read back, rows copied or stuck, and targets as tip poses."""

from __future__ import annotations

import json
import os
import random
import resource
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import calib
from calib import Cell, Measurements
from calib.arrays import Array
from calib.errors import InputError
from calib.files.estimate import load_estimate
from calib.files.write import write_files
from calib.model.build import build
from calib.observations.scatter import Variances
from calib.prediction.discrepancy import ModelDiscrepancy
from calib.prediction.estimate import Estimate
from studies.results.estimate import Estimated
from tests.day import FileDay, file_day

# -- Old results stay whole whatever happens while new ones are written

OLD = b"old\n"


@pytest.fixture
def old(tmp_path: Path) -> Path:
    path = tmp_path / "result.json"
    path.write_bytes(OLD)
    return path


def names(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir())


TARGETS = {
    "a folder": ("folder", r"folder: cannot be written \(is a folder\); name a file in it"),
    "a missing folder": ("no/new.json", r"cannot be written \(no such folder\); make the folder"),
    "a file for a folder": ("result.json/new.json", r"cannot be written \(no such folder\)"),
    "a name too long": ("x" * 300, r"cannot be written \(File name too long\); name another"),
    "a NUL": ("a\0b", r"cannot be written \(no name of a file\); name another"),
    "a link to nowhere": ("broken", r"cannot be written \(No such file or directory\)"),
    "a full device": ("/dev/full", r"cannot be written \(No space left on device\)"),
}


@pytest.mark.parametrize("case", TARGETS)
def test_one_bad_target_leaves_everything_as_it_was(case: str, old: Path) -> None:
    folder = old.parent
    (folder / "folder").mkdir()
    (folder / "broken").symlink_to("nowhere/new.json")
    before = names(folder)
    target, said = TARGETS[case]
    for order in (1, -1):
        contents = [(old, b"new\n"), (folder / target, b"new\n")][::order]
        with pytest.raises(InputError, match=said):
            write_files(dict(contents))
        assert old.read_bytes() == OLD
        assert names(folder) == before


def test_links_are_followed_permissions_kept_and_new_files_follow_the_umask(old: Path) -> None:
    old.chmod(0o640)
    link, dangling = old.parent / "link", old.parent / "dangling"
    link.symlink_to(old.name)
    dangling.symlink_to("made.json")
    before = os.umask(0o027)
    try:
        write_files({link: "new\n", dangling: "made\n"})
    finally:
        os.umask(before)
    assert link.is_symlink()
    assert old.read_text() == "new\n"
    made = old.parent / "made.json"
    assert made.read_text() == "made\n"
    assert [path.stat().st_mode & 0o777 for path in (old, made)] == [0o640, 0o640]


def test_no_space_in_the_middle_of_a_file(old: Path) -> None:
    """A limit on the size of files stands for a disk that fills while the second one is written."""
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (10_000, limits[1]))
    try:
        with pytest.raises(InputError, match=r"result.json: cannot be written \(File too large\)"):
            write_files({old.parent / "small": b"s", old: b"n" * 100_000})
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    assert old.read_bytes() == OLD
    assert names(old.parent) == ["result.json"]


# A shell that starts the tests in the background has them ignore interrupts, and so their children.
WRITER = """
import signal
import sys
from pathlib import Path
signal.signal(signal.SIGINT, signal.default_int_handler)
from calib.files.write import write_files
folder = Path(sys.argv[1])
n = 0
while True:
    n += 1
    write_files({folder / name: f"{n}\\n" * 100_000 for name in ("a", "b")})
"""


@pytest.mark.parametrize(("end", "rounds"), [(signal.SIGKILL, 2), (signal.SIGINT, 1)])
def test_ended_at_any_moment_every_file_is_whole(
    end: signal.Signals, rounds: int, tmp_path: Path
) -> None:
    for _ in range(rounds):
        call = [sys.executable, "-c", WRITER, str(tmp_path)]
        process = subprocess.Popen(call, stderr=subprocess.PIPE)
        while not (tmp_path / "b").exists():
            time.sleep(0.005)
        time.sleep(random.Random().uniform(0.0, 0.1))
        process.send_signal(end)
        process.communicate()
        for name in ("a", "b"):
            rows = (tmp_path / name).read_text().split("\n")
            assert len(rows) == 100_001
            assert len(set(rows[:-1])) == 1
            (tmp_path / name).unlink()
        if end == signal.SIGINT:
            assert names(tmp_path) == [], "no temporary file is left"
        for left in tmp_path.iterdir():
            left.unlink()


# -- An estimate goes through its file whole, whatever its unit's numbers are

UNIX = 1_763_700_000.0  # s, November 2025


def spring(cell: Cell) -> Estimate:
    """Nothing but plausible sizes, a spring of 1e5 N/m among them, at times of today."""
    model = build(replace(cell, effects=("gravity_compensator:A2", "gravity_sag:A2"))).model
    none = ModelDiscrepancy(0.0, "fitted poses")
    scatter = Variances(1.0, np.linspace(0.0, 1e-9, 8), np.linspace(2e-9, 0.0, 8))
    known = Estimate(model, 0.0 * model.sizes, np.diag(model.sizes**2), UNIX, none, ())
    return replace(known, variances=scatter)


def test_an_estimate_is_read_back_and_damage_is_said(kr270: Cell, tmp_path: Path) -> None:
    known, path = spring(kr270), tmp_path / "result.json"
    fields = {"command": "identify", "estimate": Estimated.of(known).model_dump(by_alias=True)}
    text = json.dumps(fields)
    path.write_text(text)
    read = load_estimate(kr270, path)
    assert known.covariance.max() == 1e10
    assert read.start == UNIX
    np.testing.assert_array_equal(read.covariance, known.covariance)
    assert read.variances is not None
    np.testing.assert_array_equal(read.variances.approach, known.variances.approach)
    np.testing.assert_array_equal(read.variances.configuration, known.variances.configuration)
    own = fields["estimate"]["scatter_SI"]
    damaged = [text.replace(str(UNIX), start) for start in ("NaN", "1e400", "1e13")]
    for damage in ([1e-9] * 3, [-1e-9] * 8, None):
        own["approach"] = damage
        damaged.append(json.dumps(fields))
    for bad in damaged:
        assert bad != text
        path.write_text(bad)
        with pytest.raises(InputError, match="estimate: is damaged"):
            load_estimate(kr270, path)
    fields["estimate"]["scatter_SI"] = None
    path.write_text(json.dumps(fields))
    assert load_estimate(kr270, path).variances is None


# -- Rows copied bit for bit, an instrument that stuck, and honest repeats, which are neither

GOOD = file_day(seed=30, poses=30)


def read(of: FileDay, folder: Path, digits: int = 9) -> Measurements:
    """The table as read, its points shown with so many digits of a millimetre."""
    return of.with_points(lambda p: np.round(p * 1e3, digits) / 1e3).read(folder)[1]


def again(of: FileDay, poses: Array, noise: float = 0.0) -> FileDay:
    """Some poses once more at the end, read with fresh noise [m]."""
    new = of.points[poses] + np.random.default_rng(1).normal(size=of.points[poses].shape) * noise
    q = np.concatenate([of.q, of.q[poses]])
    return replace(of, q=q, points=np.concatenate([of.points, new]))


@pytest.mark.parametrize("count", [1, 20])
def test_copies_are_left_out_and_said(count: int, tmp_path: Path) -> None:
    data = read(again(GOOD, np.arange(count)), tmp_path)
    assert data.poses.names == tuple(f"p{i:03d}" for i in range(30))
    (said,) = [text for text in data.warnings if "last digit" in text]
    assert "p000 and p030" in said
    assert "left out" in said
    good = read(GOOD, tmp_path)
    np.testing.assert_array_equal(data.points, good.points)
    np.testing.assert_array_equal(data.poses.q, good.poses.q)


# A display of 0.1 mm: the second visit reads the same by chance, and nobody copied.
@pytest.mark.parametrize(("noise", "digits"), [(2e-5, 9), (2e-5, 4), (1e-6, 1)])
def test_readings_of_a_second_approach_are_kept(noise: float, digits: int, tmp_path: Path) -> None:
    data = read(again(GOOD, np.arange(20), noise), tmp_path, digits)
    assert len(data) == 50
    assert not data.warnings
    if digits == 9:  # copies beside them are found
        mixed = again(again(GOOD, np.arange(10), noise), np.arange(20, 30))
        assert read(mixed, tmp_path).poses.names == tuple(f"p{i:03d}" for i in range(40))


def test_an_instrument_that_stuck_is_named_and_kept(tmp_path: Path) -> None:
    points = GOOD.points.copy()
    points[6] = points[5]
    data = read(replace(GOOD, points=points), tmp_path)
    assert len(data) == 30
    (said,) = data.warnings
    assert "the points of p005 and p006 are equal to the last digit, but the joints are not" in said
    assert "measure these poses again" in said


def test_a_load_hung_on_is_no_copy(tmp_path: Path) -> None:
    """Equal joints and points under another wrench are another reading, as exact data have it."""
    folder = again(GOOD, np.arange(20)).written(tmp_path)
    head, *rows = (folder / "measurements.csv").read_text().strip().split("\n")
    loads = [f"{row},0,0,{-500 if i >= 90 else 0},0,0,0" for i, row in enumerate(rows)]
    columns = f"{head},fx_N,fy_N,fz_N,mx_Nm,my_Nm,mz_Nm"
    (folder / "measurements.csv").write_text("\n".join([columns, *loads, ""]))
    cell = calib.load_cell(folder / "cell.toml")
    assert len(calib.load_measurements(cell, folder / "measurements.csv")) == 50


STUCK = "p00531 and p00532, p01062 and p01063 are equal to the last digit"


# Of a UR10 the joints moved by 136 and 83 deg, nine numbers did not; of a Meca500, read to 0.001 mm,
# nine of 186 repeats are equal by chance.
@pytest.mark.parametrize(
    ("name", "count", "stuck"), [("ur10_leica_b", 1495, STUCK), ("meca500_right80", 279, "")]
)
def test_real_readings_that_stuck_or_repeat(data: Path, name: str, count: int, stuck: str) -> None:
    cell = calib.load_cell(data / name / "cell.toml")
    found = calib.load_measurements(cell, data / name / "measurements.csv")
    said = " ".join(found.warnings)
    assert len(found) == count
    assert stuck in said
    assert ("last digit" in said) == bool(stuck)
