"""Causes found in simulated measurements, and none where there is none."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cache
from importlib.metadata import EntryPoint
from typing import ClassVar

import numpy as np
import pytest

import calib
from calib import Cell, Diagnosis, Measurements, effects, plugins
from calib.arrays import Array
from calib.diagnosis import error_curve
from calib.diagnosis.candidates import EXCLUDED
from calib.diagnosis.equivalence import SAME, classes, imitations
from calib.diagnosis.error_curve import ErrorCurve, frame_of
from calib.effects.joint import DriveError
from calib.effects.protocol import Unknown
from calib.effects.tuned import Tuned
from calib.errors import CalibError
from calib.model.build import build
from calib.poses import LAGS, Poses
from tests.day import SMALL, day, diagnosed, real_data

DRIFT = (60e-6 / 3600, 0.0, 0.0, 0.0, 60e-6 / 3600, 0.0)


def named(found: Diagnosis) -> set[str]:
    """All causes that may be meant."""
    return {key for keys in members(found) for key in keys}


def members(found: Diagnosis) -> list[list[str]]:
    return [[c.key for c, _ in cause.named.members] for cause in found.causes]


# -- What is there is found, and no more


@pytest.mark.long
@pytest.mark.parametrize("seed", range(2))
def test_nothing_is_found_where_nothing_is(seed: int) -> None:
    found = diagnosed("", 0.0, seed)
    assert (found.verdict, found.causes, found.located) == ("no_gap", (), ())
    assert found.gap.heldout_after == found.gap.heldout_before


# An effect, its values, and by how much its tuning may be off, of those that have one.
FOUND: list[tuple[str, tuple[float, ...], float | None]] = [
    ("backlash:A3", (60e-6,), None),
    ("transmission_harmonic:A4", (150e-6, -100e-6, 0.0, 0.0), None),
    ("bearing_compliance:A3", (40e-9,), None),
    ("thermal_expansion:arm", (12e-6,), None),
    ("gear_ripple:A3", (200.0, 6e-5, -5e-5), 0.5),
    ("warm_up:base", (1800.0, 3e-4, 0.0, 1e-4, 0.0, 0.0, 1e-4), 600.0),
    ("step:marker:m1", (2000.0, 1e-4, 0.0, -1e-4), 120.0),
]


@pytest.mark.long
@pytest.mark.parametrize(("effect", "values", "within"), FOUND)
def test_a_cause_is_named_and_measured(
    effect: str, values: tuple[float, ...], within: float | None
) -> None:
    found = diagnosed(effect, values, 5 if within is None else 0)
    where, tunings = effect.partition(":")[2], 0 if within is None else 1
    assert effect in named(found)
    assert (found.gap.heldout_after or 1.0) < 1.25 * found.gap.floor
    assert (found.gap.closed or 0.0) > 0.8
    cause = found.causes[0]
    if within is None:
        cause = next(c for c in found.causes if c.where == where)
        assert found.verdict in ("explained", "ambiguous")
        assert found.located[0].where == where
        assert cause.name in repr(found)
        assert len(repr(found).splitlines()) <= 20
    else:
        assert len(found.causes) == 1
        assert abs(cause.values[0] - values[0]) < within
        # Readings cannot tell whether the base warms, or the instrument.
        assert effect in (cause.named.candidate.key, "warm_up:base")
    if cause.named.candidate.key == effect:
        assert np.abs((cause.values - values)[tunings:] / cause.std[tunings:]).max() < 4.0


@pytest.mark.long
def test_links_may_follow_the_temperature_late() -> None:
    """The air swings as it likes, and the links are what has followed it with half an hour."""
    cell, data, _, _ = day("kr270", "thermal_expansion:arm", 30e-6, seed=5)
    links, rng = data.poses.temperature, np.random.default_rng(0)
    assert links is not None
    lagged = links[:, None] + rng.normal(0.0, 3.0, (len(data), len(LAGS)))
    lagged[:, LAGS == 1800.0] = links[:, None]
    poses = replace(data.poses, temperature=lagged[:, 0], lagged=lagged)
    found = calib.diagnose(cell, replace(data, poses=poses))
    assert [(c.name, c.where) for c in found.causes] == [("thermal_expansion", "arm")]
    lag, growth = found.causes[0].values
    assert lag == 1800.0
    assert abs(growth - 30e-6) < 4.0 * found.causes[0].std[1]


@pytest.mark.long
def test_what_the_readings_cannot_show_is_said() -> None:
    """A vertical load does not turn A1."""
    found = diagnosed("joint_compliance:A1", 3e-6, 5)
    assert found.verdict == "no_gap"
    hidden = {(h.effect, h.where): h.smallest for h in found.hidden}
    assert hidden["joint_compliance", "A1"] == np.inf


@pytest.mark.long
def test_a_slow_warm_up_may_stand_in_the_place_of_a_drift() -> None:
    """At its best tuning without the drift, not at what is left beside it."""
    found = diagnosed("base_drift:base", (1.5e-8, 0.0, 4e-9, 0.0, 0.0, 4e-9), 0)
    (entry,) = found.outcome.entries
    slow = {
        c.effect.kind: c.effect.tuning
        for c, _ in entry.rivals
        if c.echo and c.where == "base" and isinstance(c.effect, Tuned)
    }
    gains = {c.key: gain for c, gain in entry.rivals}
    session = np.ptp(found.data.poses.time)
    assert slow["warm_up"] > session
    assert gains["warm_up:base as base_drift:base"] > entry.gain - SAME
    assert "warm_up:base" in members(found)[0]


@pytest.mark.long
def test_a_cause_outside_the_catalogue_is_located() -> None:
    """A5 off by a step in its own angle: no name for it."""
    cell, data, held, _ = day(seed=2)
    model = build(cell, data.poses).model

    def shifted(part: Measurements) -> Measurements:
        off = np.zeros_like(part.poses.q)
        off[:, 4] = 3e-4 * np.tanh(4.0 * part.poses.q[:, 4])
        bent = replace(part.poses, q=part.poses.q + off)
        read, still = (model.predict(model.initial, own) for own in (bent, part.poses))
        return replace(part, readings=part.points + read - still)

    found = calib.diagnose(cell, shifted(data), heldout=shifted(held))
    assert found.verdict == "unknown"
    assert (found.located[0].where, found.located[0].depends_on) == ("A5", "q:A5")
    assert not [c for c in found.causes if c.named.candidate.where != "A5"]


@pytest.mark.parametrize("repeats", [0, pytest.param(12, marks=pytest.mark.long)])
def test_gross_outliers_and_noise_larger_than_stated_are_no_effect(repeats: int) -> None:
    """Of single readings, or where some are repeated; deviations grow with the noise."""
    cell, data, held, _ = day(noise=1.5, seed=4, twice=repeats)
    points = data.points.copy()
    points[[7, 22]] += np.array([0.4e-3, -0.3e-3, 0.2e-3])
    data = replace(data, readings=points)
    found, known = calib.diagnose(cell, data, heldout=held), calib.identify(cell, data)
    assert found.verdict == "no_gap"
    assert list(np.flatnonzero(found.outlier)) == [7, 22]
    assert found.noise.sigma == pytest.approx(1.5 * cell.noise.across, rel=0.1)
    std, shown = found.scale * np.sqrt(np.diag(found.after.covariance)), known.std > 0.0
    np.testing.assert_allclose(std[shown], known.std[shown], rtol=0.3)


@pytest.mark.long
def test_lost_motion_at_every_joint_is_found_joint_by_joint() -> None:
    """Small at each, as no joint alone would be believed among all that is asked."""
    found = diagnosed("backlash", (3e-5,) * 6, 0)
    keys = {c.named.candidate.key for c in found.causes}
    assert len(keys) >= 4
    assert keys <= {f"backlash:A{k}" for k in range(1, 7)}


OF_THE_COLUMNS = ("time", "temperature", "lagged", "approach", "motion")


@pytest.mark.long
def test_shuffled_columns_explain_nothing() -> None:
    """With the true order the drift is found by its name; with a random one no such effect is."""
    found = diagnosed("base_drift:base", DRIFT, 8)
    assert "base_drift:base" in members(found)[0]
    assert found.gap.over_time is not None  # predicted from the rest of the session, in its order
    before, after = found.gap.over_time
    assert after < 0.8 * before

    def dealt(data: Measurements, seed: int) -> Measurements:
        rng = np.random.default_rng(seed)
        columns = {n: getattr(data.poses, n)[rng.permutation(len(data))] for n in OF_THE_COLUMNS}
        return replace(data, poses=replace(data.poses, **columns))

    cell, data, held, _ = day("kr270", "base_drift:base", DRIFT, seed=8)
    control = calib.diagnose(cell, dealt(data, 1), heldout=dealt(held, 2))
    assert not [p for p in control.located if p.depends_on.split(":")[0] in OF_THE_COLUMNS]


# -- A class holds all causes that the data cannot tell apart, across kinds, and no excluded one


@pytest.mark.long
def test_a_heavier_load_is_in_the_class_of_the_link_that_it_looks_like() -> None:
    found = diagnosed("payload:payload", 1000.0, 3, "light", payload=False)
    assert found.verdict == "ambiguous"
    (members_of_it,) = members(found)
    assert "payload:payload" in members_of_it
    assert len(members_of_it) <= 4


@pytest.mark.long
@pytest.mark.parametrize("size", [1.0, 20.0])
def test_exact_twins_are_listed_at_any_size_and_nothing_else_is_one(size: float) -> None:
    """A base and an instrument that drift move everything alike."""
    found = diagnosed("base_drift:base", tuple(size * v for v in DRIFT), 8)
    pair = {"base_drift:base", "tracker_drift:instrument"}
    assert {*members(found)[0]} == pair
    (entry,) = found.outcome.entries
    others = imitations(found.outcome, entry)
    assert {t.candidate.key for t in others if t.exact} | {entry.candidate.key} == pair
    assert others[0].exact


@pytest.mark.long
def test_what_imitates_nothing_is_far() -> None:
    """Where the joint yields, friction winds it up by as much: one cause, two names."""
    found = diagnosed("backlash:elbow", 600.0, 1, "light")
    assert found.verdict == "explained"
    assert members(found) == [["backlash:elbow", "friction_windup:elbow"]]
    (_, lost), (_, wound) = found.causes[0].named.members
    assert lost == pytest.approx(wound)
    assert lost > 0.4
    (entry,) = found.outcome.entries
    assert min(t.left for t in imitations(found.outcome, entry)) > 100.0
    classed, _ = classes(found.stage, found.outcome)
    assert np.isclose(sum(share for _, share in classed[0].members), 1.0)


@pytest.mark.long
def test_what_the_user_excludes_is_never_named() -> None:
    cell, data, heldout, _ = day("light", "backlash:elbow", 600.0, seed=1)
    cell = replace(cell, excluded=("backlash:elbow", "transmission_harmonic"))
    found = calib.diagnose(cell, data, heldout=heldout)
    gone = {n.effect for n in found.not_asked if n.reason == EXCLUDED}
    assert gone >= {"backlash:elbow", "transmission_harmonic:elbow"}
    assert not gone & named(found)
    assert not gone & {f"{h.effect}:{h.where}" for h in found.hidden}
    assert (found.located[0].where, found.verdict) == ("elbow", "unknown")


# -- Rounding and the order of rows are no evidence


def told(found: Diagnosis) -> tuple[str, tuple[str, ...]]:
    """Verdict, and the causes in the order of their names."""
    return found.verdict, tuple(sorted(c.named.candidate.key for c in found.causes))


def rounded(data: Measurements, rng: np.random.Generator) -> Measurements:
    """With 1e-15 m (or as much of another unit) of noise more."""
    noise = 1e-15 * rng.normal(size=data.readings.shape) * data.seen[..., None]
    return replace(data, readings=data.readings + noise)


def shuffled(data: Measurements, rng: np.random.Generator) -> Measurements:
    """With its rows in an order that their own columns of order and time contradict."""
    return data.take(rng.permutation(len(data)))


def test_rounding_and_order_change_no_small_day() -> None:
    """Of which a joint errs once a turn."""
    cell, data, _, _ = day("6R", seed=5, **SMALL)
    rng, found = np.random.default_rng(0), diagnosed("", 0.0, 5, "6R", **SMALL)
    assert "transmission_harmonic:elbow" in named(found)
    assert told(calib.diagnose(cell, rounded(shuffled(data, rng), rng))) == told(found)


@pytest.mark.long
@pytest.mark.usefixtures("data")
def test_rounding_and_order_change_no_real_day() -> None:
    """Which had another verdict by the order of its rows."""
    cell, whole = real_data("meca500_right80")
    one = whole.take(np.sort(np.random.default_rng([0, 0]).permutation(len(whole))[:40]))
    rng = np.random.default_rng(0)
    changed = rounded(shuffled(one, rng), rng)
    assert told(calib.diagnose(cell, changed)) == told(calib.diagnose(cell, one))


# -- What remains, and what could hide, on days of an arm in MuJoCo

STATED = "repeatability_mm = 0.005\nrepeatability_urad = 5"
# Scatter (3-D, m), approaches and lines more for the cell; the verdict, what remains and of whom.
RESTS = {
    "told by second approaches": (3e-5, 2, "", ("no_gap", "scatter", "arm", "measured")),
    "more than any arm's": (3e-4, 1, "", ("unknown", "too_large", "model", "assumed")),
    "more than the cell says": (1e-4, 1, STATED, ("unknown", "too_large", "model", "stated")),
    "none": (0.0, 1, "", ("no_gap", "none", None, None)),
}
QUICK = ("told by second approaches", "more than any arm's")


@pytest.mark.parametrize(
    ("scatter", "approaches", "robot", "said"),
    [pytest.param(*own, id=name, marks=() if name in QUICK else pytest.mark.long)
     for name, own in RESTS.items()],
)  # fmt: skip
def test_what_remains_is_told_with_whose_it_is(
    scatter: float, approaches: int, robot: str, said: tuple[str | None, ...]
) -> None:
    cell, data, _, _ = day(
        "6R", seed=5, index=1, scatter=scatter, approaches=approaches, poses=40 // approaches,
        robot=robot,
    )  # fmt: skip
    found = calib.diagnose(cell, data)
    rest = found.rest
    assert (found.verdict, rest.kind) == said[:2]
    if rest.kind == "none":
        assert rest.size == 0.0
        return
    assert (rest.of, rest.source) == said[2:]
    if rest.kind == "too_large":
        assert found.located[-1].depends_on == "pose"
    else:
        assert not found.located
        assert rest.size == pytest.approx(3e-5 / np.sqrt(3.0), rel=0.4)


@pytest.mark.long
def test_what_hides_leaves_at_targets_what_is_said() -> None:
    """Against an arm that has it, read exactly."""
    cell, data, _, _ = day("6R", index=1, markers=2)
    found = calib.diagnose(cell, data)
    assert found.verdict == "no_gap"
    assert all(np.isfinite(h.left) and h.left >= 0.0 for h in found.hidden)
    for joint in (1, 4):
        where = cell.robot.joints[joint]
        (own,) = (h for h in found.hidden if (h.effect, h.where) == ("transmission_scale", where))
        own_scale = 1.0 + own.smallest * (np.arange(cell.robot.dof) == joint)
        other, _, exact, truth = day("6R", index=1, markers=2, truth=lambda q, s=own_scale: q * s)
        targets, _ = calib.load_targets(other, other.path.with_name("targets.csv"))
        off = calib.identify(other, exact).predict(targets) - truth.reached
        rms = float(np.sqrt(np.mean(np.sum(off**2, axis=-1))))
        assert rms == pytest.approx(own.left, rel=0.05)


# -- An effect of the user's own, in an installed package of theirs


@dataclass(frozen=True, eq=False)
class WarmEncoder(DriveError):
    """A joint's zero that follows the temperature."""

    kind: ClassVar[str] = "warm_encoder"
    uses: ClassVar[tuple[str, ...]] = ("temperature",)
    unknowns: ClassVar[tuple[Unknown, ...]] = (("slope", "urad/K", 1e-5),)

    def shares(self, poses: Poses) -> Array:
        return poses.warming[:, None]


OWN = f"{__name__}:WarmEncoder"


@pytest.fixture
def announced(monkeypatch: pytest.MonkeyPatch) -> Iterator[object]:
    """Announces an effect as an installed package does, for one test."""

    def announce(name: str, value: str) -> None:
        entry = EntryPoint(name, value, "posecal.effects")
        monkeypatch.setattr(plugins, "entry_points", lambda group: [entry])
        effects.catalogue.cache_clear()

    yield announce
    effects.catalogue.cache_clear()


@pytest.mark.long
def test_an_own_effect_is_identified_and_diagnosed_by_its_name(announced) -> None:  # type: ignore[no-untyped-def]
    announced("warm_encoder", OWN)
    cell, data, _, _ = day("kr270", "warm_encoder:A3", 20e-6, seed=3)
    found = calib.diagnose(cell, data)
    (cause,) = found.causes
    assert (cause.named.candidate.key, found.verdict) == ("warm_encoder:A3", "explained")
    assert cause.named.candidate.depends_on == "temperature"
    assert abs(cause.values[0] - 20e-6) < 4.0 * cause.std[0]


@pytest.mark.parametrize(
    ("name", "value", "words"),
    [
        ("backlash", OWN, "is taken"),
        ("warm", f"{__name__}:nothing", "fails to load"),
        ("warm", "pathlib:Path", "no subclass"),
        ("warm", OWN, "calls itself"),
    ],
)
def test_what_is_no_effect_is_refused(announced, name: str, value: str, words: str) -> None:  # type: ignore[no-untyped-def]
    announced(name, value)
    with pytest.raises(CalibError, match=words):
        effects.catalogue()


# -- The curve of a located error against what was put in


@cache
def curve_of(effect: str, values: tuple[float, ...]) -> tuple[Diagnosis, ErrorCurve]:
    result = diagnosed(effect, values, 5)
    kind, where = effect.split(":")
    (cause,) = result.causes
    assert (cause.named.candidate.effect.kind, cause.named.candidate.where) == (kind, where)
    curve = error_curve.error_curve(result, cause.named.candidate)
    assert curve is not None
    return result, curve


HALF = 60e-6
HARMONIC = (150e-6, -100e-6, 0.0, 0.0)


@pytest.mark.long
def test_lost_motion_is_twice_its_half_width_whatever_the_offset() -> None:
    _, curve = curve_of("backlash:A3", (HALF,))
    assert curve.absorbed == 1  # a constant error of the joint is one of geometry
    assert (curve.knots[0], curve.knots[-1]) == (-1.0, 1.0)
    low, high = curve.value[[0, -1], 0]
    std = curve.std[[0, -1], 0]
    assert abs(high - low - 2.0 * HALF) < 4.0 * std.sum()
    assert std.max() < 0.1 * HALF
    assert curve.function == (True,)
    # Each pose by itself scatters around the curve.
    rest = curve.single - curve.at_poses
    assert np.isfinite(rest).all()
    assert abs(np.mean(rest)) < 0.05 * HALF


@pytest.mark.long
def test_a_curve_follows_the_truth_within_its_band() -> None:
    result, curve = curve_of("transmission_harmonic:A4", HARMONIC)
    q, a = result.data.poses.q[:, 3], result.causes[0].values
    truth = HARMONIC[0] * np.cos(q) + HARMONIC[1] * np.sin(q)
    # Both without what nothing but their difference shows: a constant.
    off = curve.at_poses[:, 0] - truth
    off = off - np.average(off, weights=curve.std_at_poses[:, 0] ** -2)
    h = np.diff(curve.knots)[0]
    interpolated = h**2 / 8.0 * np.hypot(*HARMONIC[:2])  # error of a line through knots
    assert np.abs(off).max() < interpolated + 4.0 * curve.std_at_poses.max()
    assert np.std(off) < 0.35 * np.std(truth)
    # The effect is drawn as fitted, but for what is absorbed: here nearly a constant.
    fitted = a[0] * np.cos(q) + a[1] * np.sin(q) + a[2] * np.cos(2 * q) + a[3] * np.sin(2 * q)
    assert np.ptp(fitted - curve.effect[:, 0]) < 0.1 * np.ptp(fitted)


@pytest.mark.long
def test_tilts_across_a_joint_and_loads() -> None:
    _, curve = curve_of("bearing_compliance:A3", (40e-9,))
    assert curve.directions.shape == (6, 2)
    np.testing.assert_allclose(curve.directions.T @ curve.directions, np.eye(2), atol=1e-12)
    np.testing.assert_allclose(curve.directions[:3], 0.0)
    np.testing.assert_array_equal(curve.load, curve.directions[:, 0])
    slope = np.polyfit(curve.variable, curve.effect[:, 0], 1)[0]
    assert slope == pytest.approx(40e-9, rel=0.25)
    assert curve.function == (True, False)  # the other tilt has a moment of its own


def test_places_without_a_single_frame_have_no_curve(kr270: Cell) -> None:
    frames = {"base": 0, "A1": 1, "A6": 6, "tool": 7, "arm": None, "instrument": None}
    for where, frame in {**frames, "payload": None}.items():
        assert frame_of(where, kr270.robot) == frame
