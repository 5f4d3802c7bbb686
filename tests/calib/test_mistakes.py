"""Mistakes of users on days of arms in MuJoCo: each is said, and nothing is said of honest days."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import calib
from calib.arrays import Array
from calib.errors import ImplausibleData, Unsolvable
from calib.identification.mistakes import Mistake, recognised
from calib.identification.start import initial_values
from calib.model.build import build
from calib.model.covariance import identifiable
from tests.day import HEAVY, SCARA, SEVEN, Arm, FileDay, file_day

Change = Callable[[Array], Array]


def found(of: FileDay, folder: Path) -> Mistake | None:
    cell, data = of.read(folder)
    model = build(cell, data.poses).model
    off = data.points - model.predict(initial_values(model, data), data.poses)
    return recognised(model, data, np.sqrt((off**2).sum(axis=-1).mean(axis=-1)))


def names_of(mistake: Mistake | None) -> tuple[str, ...]:
    return () if mistake is None else mistake.names


# -- What users do to columns of joints and of points


def by_joint(arm: Arm, usual: float, **own: float) -> Array:
    return np.array([own.get(name, usual) for name in arm.names])


def off_by(arm: Arm, **degrees: float) -> Change:
    return lambda q: q + np.radians(by_joint(arm, 0.0, **degrees))


def times(factors: float | Sequence[float] | Array) -> Change:
    return lambda columns: columns * factors


def swapped(arm: Arm, one: int, other: int) -> Change:
    order = np.arange(arm.dof)
    order[[one, other]] = other, one
    return lambda q: q[:, order]


def mixed(arm: Arm, joint: int, before: int, sign: float) -> Change:
    return lambda q: q + sign * q[:, [before]] * (np.arange(arm.dof) == joint)


def exchanged_at(poses: Sequence[int]) -> Change:
    def change(points: Array) -> Array:
        points = points.copy()
        points[np.ix_(poses, [0, 1])] = points[np.ix_(poses, [1, 0])]
        return points

    return change


def gross(points: Array) -> Array:
    points = points.copy()
    points[[7, 30]] += [[[2.0, 0.0, 1.0]], [[0.0, -0.4, 0.1]]]
    return points


def known(of: FileDay) -> FileDay:
    """The day with the instrument in the base frame, as the cell says."""
    of = replace(of, effects=("tool", "geometry"))
    return of.with_points(lambda p: (p - of.place[1]) @ of.place[0])


def lacking(*effects: str) -> FileDay:
    """A day whose base, and markers, are not where the cell has them."""
    of = file_day(seed=16)
    return replace(of, effects=effects, markers=np.add(of.markers, [0.1, -0.2, 0.15]))


def points(arm: Arm, seed: int, change: Change, shown: str = "mm") -> FileDay:
    return replace(file_day(arm, seed).with_points(change), units=("deg", "mm", shown))


def joints(arm: Arm, seed: int, change: Change, shown: str = "deg", markers: int = 3) -> FileDay:
    of = file_day(arm, seed, markers=markers).with_joints(change)
    return replace(of, units=(shown, "mm", "mm"))


def zero(arm: Arm, joint: str, degrees: float, markers: int = 3) -> FileDay:
    return joints(arm, 17, off_by(arm, **{joint: degrees}), markers=markers)


def reversed_(arm: Arm, joint: str) -> FileDay:
    return joints(arm, 8, times(by_joint(arm, 1.0, **{joint: -1.0})))


def turning(arm: Arm, factor: float) -> Change:
    return times(np.where(arm.slides, 1.0, factor))


def lost(first: int, last: int) -> FileDay:
    """Points of which one was lost, and those after it stand a pose too early."""
    of = file_day(HEAVY, 19)
    early = of.points.copy()
    early[first:last] = np.roll(early[first:last], -1, axis=0)
    return replace(of, points=early)


def pasted(arm: Arm, by: int, markers: int) -> FileDay:
    """A column one line too high or too low: one end has no partner."""
    of = file_day(arm, 19, markers=markers)
    high, low = slice(None, -1), slice(1, None)
    rows, kept = (high, low) if by > 0 else (low, high)
    return replace(of, q=of.q[rows], points=of.points[kept])


def exchanged(arm: Arm, markers: int, poses: Sequence[int]) -> FileDay:
    return file_day(arm, 11, markers=markers).with_points(exchanged_at(poses))


SOME = {k: sorted(np.random.default_rng(k).choice(50, k, replace=False).tolist()) for k in (1, 19)}
SLIDES = times(by_joint(SCARA, 1.0, Z=1e-3))
IN_MODEL, M_FOR_MM = "to [model] effects", "points in metres for millimetres"
Z_OR_MIRROR, ALL = "Z reversed, mirrored", range(50)
# A day, the names of its mistakes, what the text holds, and the poses concerned where not all are.
WRONG: list[tuple[Callable[[], FileDay], str, str, Sequence[int]]] = [
    (lambda: points(HEAVY, 1, times([1, -1, 1])), "mirrored", "", ()),
    (lambda: points(HEAVY, 1, lambda p: p[..., [1, 0, 2]]), "mirrored", "", ()),
    # A SCARA cannot tell it from a screw that runs the other way: both are said.
    (lambda: points(SCARA, 1, times([1, -1, 1])), Z_OR_MIRROR, "", ()),
    # With the instrument in the base frame the axis is told.
    (lambda: known(file_day()).with_points(times([1, -1, 1])), "mirrored y", "", ()),
    (lambda: known(file_day()).with_points(np.negative), "negated", "", ()),
    # A column called mm that holds metres, and the like: as the user would write them.
    (lambda: points(HEAVY, 5, times(1e-3)), M_FOR_MM, "", ()),
    (lambda: points(SCARA, 5, times(1e3), "m"), "points in millimetres for metres", "", ()),
    (lambda: points(SCARA, 5, times(1 / 25.4)), "points in inches for millimetres", "", ()),
    (lambda: points(HEAVY, 5, times(1 / 0.0254), "m"), "points in inches for metres", "", ()),
    (lambda: points(HEAVY, 5, times(25.4)), "points in millimetres for inches", "", ()),
    (lambda: joints(SCARA, 6, SLIDES), "slides in metres for millimetres", "", ()),
    (lambda: joints(SCARA, 6, SLIDES).with_points(times(1e-3)),
     "lengths in metres for millimetres", "", ()),
    (lambda: joints(HEAVY, 7, turning(HEAVY, np.pi / 180)), "joints in radians",
     "radians in columns of deg; name the columns A1_rad", ()),
    (lambda: joints(SCARA, 7, turning(SCARA, 180 / np.pi), "rad"), "joints in degrees",
     "degrees in columns of rad; name the columns J1_deg", ()),
    (lambda: reversed_(HEAVY, "A2"), "A2 reversed", "", ()),
    # The same arm with a free tool: half a turn of the joint before turns the axis round.
    (lambda: reversed_(HEAVY, "A5"), "A4 off by 180 deg, A5 reversed", "", ()),
    (lambda: joints(HEAVY, 13, times(by_joint(HEAVY, 1.0, A4=-1.0))).with_points(gross),
     "A4 reversed", "", ()),
    (lambda: known(zero(HEAVY, "A1", 90)), "A1 off by 90 deg", "", ()),
    (lambda: zero(HEAVY, "A3", -90), "A3 off by -90 deg", "add 90 deg to A3", ()),
    (lambda: zero(SCARA, "J2", 180, 1), "J2 off by 180 deg", "add 180 deg to J2", ()),
    (lambda: zero(SEVEN, "e1", 90), "e1 off by 90 deg", "add -90 deg to e1", ()),
    (lambda: joints(HEAVY, 18, off_by(HEAVY, A2=90, A3=-90)),
     "A2 off by 90 deg and A3 off by -90 deg", "", ()),
    (lambda: joints(HEAVY, 9, swapped(HEAVY, 1, 2)), "A2 and A3 swapped", "", ()),
    (lambda: joints(SCARA, 9, swapped(SCARA, 1, 3)), "J2 and J4 swapped", "", ()),
    (lambda: joints(HEAVY, 10, mixed(HEAVY, 2, 1, 1.0)), "A3 - A2", "", ()),
    (lambda: joints(SCARA, 10, mixed(SCARA, 1, 0, -1.0)), "J2 + J1", "", ()),
    (lambda: lacking("tool", "geometry"), "base taken as known", IN_MODEL, ()),
    (lambda: lacking("geometry"), "base and tool taken as known", IN_MODEL, ()),
    (lambda: lacking("joint_offset"), "base and tool taken as known", IN_MODEL, ()),
    (lambda: lacking("base", "geometry"), "tool taken as known", IN_MODEL, ()),
    (lambda: replace(file_day(seed=12).with_points(exchanged_at(ALL)), effects=("base", "geometry")),
     "m1 and m2 exchanged", "in [markers_mm]", ()),
    (lambda: pasted(HEAVY, 1, 1), "shifted by 1", "move their columns down by one pose", ()),
    (lambda: pasted(HEAVY, -1, 3), "shifted by -1", "move their columns up by one pose", ()),
    (lambda: lost(0, 30), "shifted by 1", "", range(29)),
    (lambda: lost(43, 50), "shifted by 1", "", range(43, 49)),
    (lambda: exchanged(HEAVY, 2, SOME[1]), "exchanged", "markers m1 and m2 are exch", SOME[1]),
    (lambda: exchanged(HEAVY, 3, SOME[19]), "exchanged", f"at p{SOME[19][0]:03d}", SOME[19]),
    # What is none: base, tool or free markers take it up; no quarter is no convention; gross errors.
    (lambda: zero(HEAVY, "A1", 90), "", "", ()),
    (lambda: joints(HEAVY, 18, off_by(HEAVY, A2=30)), "", "", ()),
    (lambda: file_day(seed=12).with_points(exchanged_at(ALL)), "", "", ()),
    (lambda: file_day(seed=13).with_points(gross), "", "", ()),
    # Nor is what an arm errs by, however few its poses.
    (lambda: file_day(HEAVY, 20, markers=1), "", "", ()),
    (lambda: file_day(SEVEN, 21, poses=12, markers=1, link=0.03), "", "", ()),
    (lambda: file_day(SCARA, 22, link=0.1), "", "", ()),
    (lambda: file_day(HEAVY, 22, markers=1, link=0.1), "", "", ()),
]  # fmt: skip


@pytest.mark.sampled
@pytest.mark.parametrize("case", range(len(WRONG)))
def test_what_is_wrong_is_said(case: int, tmp_path: Path) -> None:
    wrong, expected, said, poses = WRONG[case]
    mistake = found(wrong(), tmp_path)
    assert ", ".join(sorted(names_of(mistake))) == expected
    if mistake is not None:
        assert mistake.nominal > 10.0 * mistake.mended
        assert mistake.poses == tuple(f"p{i:03d}" for i in poses)
        assert all(part in mistake.text for part in said.split("; "))


def test_poses_held_out_hide_no_shift(tmp_path: Path) -> None:
    cell, data = file_day(HEAVY, 19).with_points(lambda p: np.roll(p, 1, axis=0)).read(tmp_path)
    kept, held = data.split(0.3, np.random.default_rng(0))
    with pytest.raises(ImplausibleData, match="shifted by one pose"):
        calib.identify(cell, kept, heldout=held)


@pytest.mark.long
@pytest.mark.parametrize("name", ["irb120_faro", "fanuc_r2000", "ur10_leica_b", "meca500_right80"])
def test_real_days(data: Path, name: str) -> None:
    """Nothing of them as they are; mirrored, or with a joint reversed, that alone."""
    cell = calib.load_cell(data / name / "cell.toml")
    table = calib.load_measurements(cell, data / name / "measurements.csv")
    model = build(cell, table.poses).model
    far = np.full(len(table), model.robot.reach)
    assert recognised(model, table, far) is None, "asked, though the misfit gives no cause"
    mirrored = replace(table, readings=table.points * [1.0, -1.0, 1.0])
    assert names_of(recognised(model, mirrored, far)) == ("mirrored",)
    q = table.poses.q * np.where(np.arange(model.robot.dof) == 2, -1.0, 1.0)
    other_way = replace(table, poses=replace(table.poses, q=q))
    assert names_of(recognised(model, other_way, far)) == (f"{model.robot.joints[2]} reversed",)


def test_verbs_refuse_with_what_is_known(tmp_path: Path) -> None:
    cell, data = file_day(seed=14).with_points(times(1 / 25.4)).read(tmp_path)
    for verb in (calib.identify, calib.diagnose):
        with pytest.raises(ImplausibleData, match=r"inches.* multiply x, y and z by 25\.4") as said:
            verb(cell, data)
        assert said.value.mistakes == ("points in inches for millimetres",)
        assert said.value.nominal > 1.0
        assert said.value.mended < 3e-3


def test_what_is_no_number_is_no_traceback() -> None:
    """As an arm has it that is too soft to stand, where nothing in the table helps."""
    rows = np.eye(4)
    rows[2, 1] = np.nan
    with pytest.raises(Unsolvable, match="check the units"):
        identifiable(rows, np.ones(4), ("a", "b", "c", "d"))
