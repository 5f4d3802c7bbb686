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
from studies.research.truth.arms import HEAVY, Arm
from tests.calib.arm_days import SCARA, SEVEN, Day, day

ARMS = {arm.name: arm for arm in (HEAVY, SCARA, SEVEN)}


def found(of: Day, folder: Path) -> Mistake | None:
    cell, data = of.read(folder)
    model = build(cell, data.poses).model
    off = data.points - model.predict(initial_values(model, data), data.poses)
    return recognised(model, data, np.sqrt((off**2).sum(axis=-1).mean(axis=-1)))


def names_of(mistake: Mistake | None) -> tuple[str, ...]:
    return () if mistake is None else mistake.names


def joints_times(arm: Arm, **factors: float) -> Callable[[Array], Array]:
    return lambda q: q * [factors.get(name, 1.0) for name in arm.names]


def turned(arm: Arm, **degrees: float) -> Callable[[Array], Array]:
    return lambda q: q + np.radians([degrees.get(name, 0.0) for name in arm.names])


def turning_times(arm: Arm, factor: float) -> Callable[[Array], Array]:
    return lambda q: q * np.where(arm.slides, 1.0, factor)


def swapped(arm: Arm, one: int, other: int) -> Callable[[Array], Array]:
    order = np.arange(arm.dof)
    order[[one, other]] = other, one
    return lambda q: q[:, order]


def mixed(arm: Arm, joint: int, before: int, sign: float) -> Callable[[Array], Array]:
    return lambda q: q + sign * q[:, [before]] * (np.arange(arm.dof) == joint)


def times(factors: float | Sequence[float]) -> Callable[[Array], Array]:
    return lambda p: p * factors


def known(of: Day) -> Day:
    """The day with the instrument in the base frame, as the cell says."""
    of = replace(of, effects=("tool", "geometry"))
    return of.with_points(lambda p: (p - of.place[1]) @ of.place[0])


def lacking(*effects: str) -> Day:
    """A day whose base, and markers, are not where the cell has them."""
    of = day(seed=16)
    return replace(of, effects=effects, markers=np.add(of.markers, [0.1, -0.2, 0.15]))


def exchanged_at(poses: Sequence[int], a: int = 0, b: int = 1) -> Callable[[Array], Array]:
    def change(points: Array) -> Array:
        points = points.copy()
        points[np.ix_(poses, [a, b])] = points[np.ix_(poses, [b, a])]
        return points

    return change


def points(arm: Arm, seed: int, change: Callable[[Array], Array], shown: str = "mm") -> Day:
    return replace(day(arm, seed).with_points(change), units=("deg", "mm", shown))


def joints(
    arm: Arm, seed: int, change: Callable[[Array], Array], shown: str = "deg", markers: int = 3
) -> Day:
    of = day(arm, seed, markers=markers).with_joints(change)
    return replace(of, units=(shown, "mm", "mm"))


def lost(first: int, last: int) -> Day:
    """Points of which one was lost, and those after it stand a pose too early."""

    def early(points: Array) -> Array:
        points = points.copy()
        points[first:last] = np.roll(points[first:last], -1, axis=0)
        return points

    return day(HEAVY, 19).with_points(early)


def pasted(arm: Arm, by: int, markers: int) -> Day:
    """A column one line too high or too low: one end has no partner."""
    good = day(arm, 19, markers=markers)
    rows, kept = (
        (slice(None, -1), good.points[1:]) if by > 0 else (slice(1, None), good.points[:-1])
    )
    return replace(good, q=good.q[rows], points=kept)


def zero(arm: Arm, joint: str, degrees: float, markers: int = 3) -> Day:
    return joints(arm, 17, turned(arm, **{joint: degrees}), markers=markers)


def reversed_(arm: Arm, joint: str) -> Day:
    return joints(arm, 8, joints_times(arm, **{joint: -1.0}))


def gross(points: Array) -> Array:
    points = points.copy()
    points[[7, 30]] += [[[2.0, 0.0, 1.0]], [[0.0, -0.4, 0.1]]]
    return points


def at_some(count: int) -> list[int]:
    return sorted(np.random.default_rng(count).choice(50, count, replace=False).tolist())


Wrong = tuple[Callable[[], Day], str, str, list[int]]
"""A day, the names of its mistakes, what the text holds, and the poses concerned."""


def every(wrong: Callable[[], Day], names: str, said: str = "") -> Wrong:
    return wrong, names, said, []


def some(wrong: Callable[[], Day], names: str, poses: Sequence[int], said: str = "") -> Wrong:
    return wrong, names, said, list(poses)


EXCHANGED = [(HEAVY, 2, 1), (HEAVY, 3, 19), (SCARA, 3, 6), (SEVEN, 2, 19)]
IN_MODEL, IN_MARKERS = "to [model] effects", "in [markers_mm]"
WRONG = [
    every(lambda: points(HEAVY, 1, times([1, -1, 1])), "mirrored"),
    every(lambda: points(HEAVY, 1, times([1, 1, -1])), "mirrored"),
    every(lambda: points(HEAVY, 1, np.negative), "mirrored"),
    every(lambda: points(HEAVY, 1, lambda p: p[..., [1, 0, 2]]), "mirrored"),
    # A SCARA cannot tell it from a screw that runs the other way: both are said.
    every(lambda: points(SCARA, 1, times([1, -1, 1])), "Z reversed, mirrored"),
    every(lambda: points(SEVEN, 1, times([1, 1, -1])), "mirrored"),
    # With the instrument in the base frame the axis is told.
    every(lambda: known(day()).with_points(times([1, -1, 1])), "mirrored y"),
    every(lambda: known(day()).with_points(np.negative), "negated"),
    # A column called mm that holds metres, and the like: as the user would write them.
    every(lambda: points(HEAVY, 5, times(1e-3), "mm"), "points in metres for millimetres"),
    every(lambda: points(SCARA, 5, times(1e3), "m"), "points in millimetres for metres"),
    every(lambda: points(SCARA, 5, times(1 / 25.4), "mm"), "points in inches for millimetres"),
    every(lambda: points(HEAVY, 5, times(1 / 0.0254), "m"), "points in inches for metres"),
    every(lambda: points(HEAVY, 5, times(25.4), "mm"), "points in millimetres for inches"),
    every(
        lambda: joints(SCARA, 6, joints_times(SCARA, Z=1e-3)), "slides in metres for millimetres"
    ),
    every(
        lambda: joints(SCARA, 6, joints_times(SCARA, Z=1e-3)).with_points(times(1e-3)),
        "lengths in metres for millimetres",
    ),
    every(
        lambda: joints(HEAVY, 7, turning_times(HEAVY, np.pi / 180), "deg"),
        "joints in radians",
        "radians in columns of deg; name the columns A1_rad",
    ),
    every(
        lambda: joints(SCARA, 7, turning_times(SCARA, 180 / np.pi), "rad"),
        "joints in degrees",
        "degrees in columns of rad; name the columns J1_deg",
    ),
    every(lambda: reversed_(HEAVY, "A2"), "A2 reversed"),
    # The same arm with a free tool: half a turn of the joint before turns the axis round.
    every(lambda: reversed_(HEAVY, "A5"), "A4 off by 180 deg, A5 reversed"),
    every(lambda: reversed_(HEAVY, "A6"), "A5 off by 180 deg, A6 reversed"),
    every(lambda: reversed_(SCARA, "Z"), "Z reversed, mirrored"),
    every(lambda: reversed_(SEVEN, "A3"), "A3 reversed"),
    every(
        lambda: day(seed=13).with_joints(joints_times(HEAVY, A4=-1.0)).with_points(gross),
        "A4 reversed",
    ),
    every(lambda: zero(HEAVY, "A4", 180), "A4 off by 180 deg, A5 reversed"),
    every(lambda: known(zero(HEAVY, "A1", 90)), "A1 off by 90 deg"),
    every(lambda: zero(HEAVY, "A2", 90, 1), "A2 off by 90 deg", "add -90 deg to A2"),
    every(lambda: zero(HEAVY, "A3", -90), "A3 off by -90 deg", "add 90 deg to A3"),
    every(lambda: zero(SCARA, "J2", 180, 1), "J2 off by 180 deg", "add 180 deg to J2"),
    every(lambda: zero(SEVEN, "A4", 90), "A4 off by 90 deg", "add -90 deg to A4"),
    every(
        lambda: joints(HEAVY, 18, turned(HEAVY, A2=90, A3=-90)),
        "A2 off by 90 deg and A3 off by -90 deg",
    ),
    every(lambda: joints(HEAVY, 9, swapped(HEAVY, 1, 2)), "A2 and A3 swapped"),
    every(lambda: joints(HEAVY, 9, swapped(HEAVY, 4, 5)), "A5 and A6 swapped"),
    every(lambda: joints(SCARA, 9, swapped(SCARA, 1, 3)), "J2 and R swapped"),
    every(lambda: joints(SEVEN, 9, swapped(SEVEN, 0, 6)), "A1 and A7 swapped"),
    every(lambda: joints(HEAVY, 10, mixed(HEAVY, 2, 1, 1.0)), "A3 - A2"),
    every(lambda: joints(SCARA, 10, mixed(SCARA, 1, 0, -1.0)), "J2 + J1"),
    every(lambda: lacking("tool", "geometry"), "base taken as known", IN_MODEL),
    every(lambda: lacking("geometry"), "base and tool taken as known", IN_MODEL),
    every(lambda: lacking("joint_offset"), "base and tool taken as known", IN_MODEL),
    every(lambda: lacking("base", "geometry"), "tool taken as known", IN_MODEL),
    every(
        lambda: replace(
            day(seed=12).with_points(exchanged_at(range(50))), effects=("base", "geometry")
        ),
        "m1 and m2 exchanged",
        IN_MARKERS,
    ),
    every(lambda: pasted(HEAVY, 1, 1), "shifted by 1", "move their columns down by one pose"),
    every(lambda: pasted(HEAVY, -1, 3), "shifted by -1", "move their columns up by one pose"),
    every(lambda: pasted(SCARA, 1, 3), "shifted by 1"),
    every(lambda: pasted(SEVEN, -1, 1), "shifted by -1"),
    some(lambda: lost(0, 30), "shifted by 1", range(29)),
    some(lambda: lost(12, 50), "shifted by 1", range(12, 49)),
    some(lambda: lost(43, 50), "shifted by 1", range(43, 49)),
    *(
        some(
            lambda arm=arm, markers=markers, count=count: day(arm, 11, markers=markers).with_points(
                exchanged_at(at_some(count))
            ),
            "exchanged",
            at_some(count),
            f"markers m1 and m2 are exchanged at p{at_some(count)[0]:03d}",
        )
        for arm, markers, count in EXCHANGED
    ),
    # What is none: base, tool or free markers take it up; no quarter is no convention; gross errors.
    every(lambda: zero(HEAVY, "A1", 90), ""),
    every(lambda: joints(HEAVY, 18, turned(HEAVY, A2=30)), ""),
    every(lambda: day(seed=12).with_points(exchanged_at(range(50))), ""),
    every(lambda: day(seed=13).with_points(gross), ""),
]


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
    cell, data = day(HEAVY, 19).with_points(lambda p: np.roll(p, 1, axis=0)).read(tmp_path)
    kept, held = data.split(0.3, np.random.default_rng(0))
    with pytest.raises(ImplausibleData, match="shifted by one pose"):
        calib.identify(cell, kept, heldout=held)


@pytest.mark.sampled
@pytest.mark.parametrize(("arm", "markers"), [("heavy", 1), ("scara", 3), ("seven", 1)])
def test_nothing_is_said_of_an_arm_that_errs(arm: str, markers: int, tmp_path: Path) -> None:
    for seed, (poses, link) in enumerate([(50, 0.0), (12, 0.03), (50, 0.1)]):
        honest = day(ARMS[arm], 20 + seed, poses=poses, markers=markers, link=link)
        assert found(honest, tmp_path) is None


@pytest.mark.sampled
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
    cell, data = day(seed=14).with_points(lambda p: p / 25.4).read(tmp_path)
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
