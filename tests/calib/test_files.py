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
from scipy.spatial.transform import Rotation

import calib
from calib import Cell, Measurements
from calib.arm.inverse import solutions
from calib.arrays import Array
from calib.errors import InputError
from calib.files.cartesian import solution_said
from calib.files.estimate import load_estimate
from calib.files.write import write_files
from calib.model.build import build
from calib.prediction.discrepancy import ModelDiscrepancy
from calib.prediction.estimate import Estimate
from calib.scatter import Variances
from studies.results.estimate import Estimated
from tests.day import HEAVY, LIGHT, LIMITED_SEVEN, MARKERS, SCARA, Arm, FileDay, Mechanism, file_day

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


# -- Targets as poses of the tip, against arms in MuJoCo

_CROSS = np.concatenate([np.zeros((1, 3)), np.eye(3)])  # origin and ends of the tip's axes


def tips(arm: Arm, q: Array) -> tuple[Array, Array]:
    """Axes (m, 3, 3) and origins (m, 3), m, of the nominal tip, by MuJoCo."""
    points = Mechanism(arm, np.zeros((arm.dof + 2, 6)), _CROSS, weighs=False).posed(q).points
    return np.swapaxes(points[:, 1:] - points[:, :1], 1, 2), points[:, 0]


def with_targets(folder: Path, arm: Arm, R: Array, o: Array, unit: str = "mm") -> tuple[Cell, Path]:
    """Cell and table of targets."""
    q = np.tile(arm.limits.mean(axis=1), (2, 1))
    FileDay(arm, q, np.zeros((2, len(MARKERS), 3))).written(folder)
    x, y, z, w = Rotation.from_matrix(R).as_quat().T
    rows = np.column_stack([o * (1e3 if unit == "mm" else 1.0), w, x, y, z])
    head = f"pose,x_{unit},y_{unit},z_{unit},qw,qx,qy,qz"
    lines = [f"t{i}," + ",".join(f"{v:.12g}" for v in row) for i, row in enumerate(rows, 1)]
    (folder / "targets.csv").write_text("\n".join([head, *lines, ""]))
    return calib.load_cell(folder / "cell.toml"), folder / "targets.csv"


def drawn(arm: Arm, count: int, seed: int = 0) -> Array:
    low, high = arm.limits.T
    share = np.random.default_rng(seed).uniform(0.15, 0.85, (count, arm.dof))
    return np.asarray(low + share * (high - low))


@pytest.mark.parametrize("unit", ["mm", "m"])
@pytest.mark.parametrize("arm", [HEAVY, LIGHT, LIMITED_SEVEN, SCARA], ids=lambda arm: arm.name)
def test_joints_put_the_tip_where_it_is_wanted(tmp_path: Path, arm: Arm, unit: str) -> None:
    R, o = tips(arm, drawn(arm, 12))
    targets, weights = calib.load_targets(*with_targets(tmp_path, arm, R, o, unit))
    assert targets.names == tuple(f"t{i}" for i in range(1, 13))
    assert (weights == 1.0).all()
    R_found, o_found = tips(arm, targets.q)
    np.testing.assert_allclose(o_found, o, atol=2e-8)
    np.testing.assert_allclose(R_found, R, atol=2e-8)
    low, high = arm.limits.T
    assert ((targets.q >= low - 1e-9) & (targets.q <= high + 1e-9)).all()


def test_the_solution_is_the_nearest_and_is_said(tmp_path: Path) -> None:
    R, o = tips(LIGHT, drawn(LIGHT, 6, 1))
    cell, path = with_targets(tmp_path, LIGHT, R, o)
    targets, _ = calib.load_targets(cell, path)
    low, high = LIGHT.limits.T
    reference = (low + high) / 2.0
    for i, (own, taken) in enumerate(zip(solutions(cell.robot, R, o), targets.q, strict=True)):
        assert len(own.q) > 1
        tip_R, tip_o = tips(LIGHT, own.q)
        np.testing.assert_allclose(tip_o, np.tile(o[i], (len(own.q), 1)), atol=2e-8)
        np.testing.assert_allclose(tip_R, np.tile(R[i], (len(own.q), 1, 1)), atol=2e-8)
        turns = (np.array(list(np.ndindex(*[3] * 6))) - 1) * 2.0 * np.pi
        every = (own.q[:, None] + turns).reshape(-1, 6)
        inside = every[((every >= low) & (every <= high)).all(axis=1)]
        best = np.linalg.norm(inside - reference, axis=1).min()
        assert np.linalg.norm(taken - reference) == pytest.approx(best, abs=1e-6)
        reference = taken
    said = " ".join(solution_said(cell.robot, targets.names, targets.q))
    first = f"{LIGHT.joints[0].name}_deg "
    assert f"at t1 the solution nearest to the middle of the joint ranges, {first}" in said


def test_what_is_out_of_reach_or_no_orientation_is_refused_by_its_line(tmp_path: Path) -> None:
    R, o = tips(LIGHT, drawn(LIGHT, 3))
    cell, path = with_targets(tmp_path, LIGHT, R, o + [[0.0], [9.0], [0.0]] * np.eye(3)[0])
    with pytest.raises(
        InputError, match=r"line 3.*does not reach this tip within its limits: \d+\.\d mm"
    ) as failed:
        calib.load_targets(cell, path)
    assert "\n" not in str(failed.value)
    text = cell.path.read_text()
    narrow = f"[robot.limits_deg]\n{LIGHT.joints[0].name} = [179.0, 179.5]\n[markers_mm]"
    cell.path.write_text(text.replace("[markers_mm]", narrow))
    head, first, _, last = path.read_text().splitlines()
    for table, said in (
        ([head, first, last], "within its limits: "),
        ([head.replace(",qz", ",q_z"), first], "lack column qz"),
        (
            [head, first, last.rsplit(",", 1)[0] + ",5"],
            "line 3, column qw: the quaternion's length",
        ),
    ):
        path.write_text("\n".join([*table, ""]))
        with pytest.raises(InputError, match=said):
            calib.load_targets(calib.load_cell(cell.path), path)
