"""What counts as found, and as misnamed: tuned causes, twins, backgrounds, mixtures."""

from __future__ import annotations

from typing import Any

import pytest

from studies.research.sealed.judge import is_listed, is_named, judge
from studies.research.sealed.score import REAL
from tests.studies.research.sealed.test_judge import BACKLASH, answer, effect, key, named

RIPPLE = effect(
    "gear_ripple",
    "A3",
    tuned={"name": "cycles", "value": 200.0, "unit": "1/turn", "tolerance": 4.0},
    parameters=[
        {"name": "cycles", "value": 200.0, "unit": "1/turn", "scored": True},
        {"name": "cos_1", "value": 50.0, "unit": "urad", "scored": True},
    ],
)
STEP = effect(
    "step",
    "base",
    places=["base", "instrument"],
    tuned={"name": "at", "value": 1200.0, "unit": "s", "tolerance": 135.0},
    between={"at": [1180.0, 1220.0]},
    parameters=[{"name": "at", "value": 1200.0, "unit": "s", "scored": True}],
)


def ripple(cycles: float | None, **more: Any) -> dict[str, Any]:
    parameters = [{"name": "cos_1", "value": 51.0, "std": 1.0, "unit": "urad"}]
    if cycles is not None:
        parameters.append({"name": "cycles", "value": cycles, "std": 0.1, "unit": "1/turn"})
    return effect("gear_ripple", "A3", probability=0.97, **{"parameters": parameters, **more})


@pytest.mark.parametrize(
    ("said", "right"),
    [
        (ripple(203.9), True),
        (ripple(204.1), False),
        (ripple(None), False),
        (ripple(56.0), False),
        (ripple(56.0, aliases=[88.0, 200.5]), True),
        (ripple(100.0), False),
        (effect("gear_ripple", "A2", parameters=ripple(200.0)["parameters"]), False),
    ],
)
def test_cycles_within_two_lines_or_as_an_alias(said: dict[str, Any], right: bool) -> None:
    truth = key("single", RIPPLE)["effects"][0]
    assert is_named(said, truth) == is_listed(said, truth) == right
    j = judge(key("single", RIPPLE), answer("explained", said))
    assert (j.exact, j.found, j.causes[0].found) == (right, right, right)
    assert len(j.intervals) == (right and sum(p["name"] != "" for p in said["parameters"]))


def test_harmonic_of_half_the_cycles_is_the_line() -> None:
    half = ripple(100.0)
    half["parameters"].append({"name": "cos_2", "value": 50.0, "std": 1.0, "unit": "urad"})
    assert is_named(half, RIPPLE)


@pytest.mark.parametrize(
    ("value", "unit", "right", "held"),
    [
        (1230.0, "s", True, True),
        (1300.0, "s", True, False),
        (1340.0, "s", False, None),
        (20.0, "min", True, True),
        (27.0, "readings", False, None),
    ],
)
def test_moment_of_a_step(value: float, unit: str, right: bool, held: bool | None) -> None:
    """Within three readings; its interval may end anywhere between the two readings beside it."""
    std = 10.0 / 60.0 if unit == "min" else 10.0
    parameters = [{"name": "at", "value": value, "std": std, "unit": unit}]
    said = effect("step", "base", probability=0.95, parameters=parameters)
    j = judge(key("single", STEP), answer("explained", said, located=("instrument",)))
    assert j.found == right
    assert j.located
    assert j.intervals == (() if held is None else (held,))
    assert j.sure_wrong == (not right)


def test_twins_are_not_misnamed_nor_found_unless_said() -> None:
    friction = effect("friction_windup", "A3", twins=["backlash:A3"])
    told = answer("explained", named(-40.0, 1.0))
    j = judge(key("single", friction), told)
    assert not any((j.found, j.exact, j.sure_wrong, j.misnamed))
    told["effects"][0]["class"] = [effect("friction_windup", "A3"), effect("backlash", "A3")]
    assert judge(key("single", friction), told).found


def test_background_is_no_alarm_and_not_asked_for() -> None:
    null = key("null", {**RIPPLE, "background": True, "beside": 12.0})
    for said, alarm in (
        (answer("no_gap"), False),
        (answer("unknown", located=("A3",)), False),
        (answer("unknown", located=("A2",)), True),
        (answer("explained", ripple(200.0), located=("A3",)), False),
        (answer("explained", ripple(150.0), located=("A3",)), True),
        (answer("explained", named(-40.0, 1.0), located=("A3",)), True),
    ):
        assert judge(null, said).alarm == alarm
    both = key("single", BACKLASH, {**RIPPLE, "background": True, "beside": 12.0})
    alone = judge(both, answer("explained", named(-40.0, 1.0), located=("A3",)))
    assert alone.exact
    assert alone.visible
    assert alone.truth == ("backlash:A3",)
    with_it = answer("explained", named(-40.0, 1.0), ripple(200.0), located=("A3",))
    assert judge(both, with_it).exact
    assert not judge(both, with_it).sure_wrong


def test_causes_of_a_mixture_one_by_one() -> None:
    faint = effect("base_compliance", "base", beside=30.0)
    mixed = key("mixture", BACKLASH, RIPPLE, STEP, faint)
    mixed["conditions"] = {**mixed["conditions"], "visit": "once", "one_marker": False}
    j = judge(mixed, answer("unknown", named(-40.0, 1.0), ripple(150.0)))
    assert j.visible
    assert [(c.name, c.visible, c.found) for c in j.causes] == [
        ("backlash:A3", True, True),
        ("gear_ripple:A3", True, False),
        ("step:base", True, False),
        ("base_compliance:base", False, False),
    ]
    assert j.sure_wrong
    assert j.statements == ((0.97, True), (0.97, False))
    table = {(r.family, r.figure): (r.hits, r.n) for r in REAL.rates([j])}
    assert table["mixture, each visible cause", "cause found"] == (1, 3)
    assert table["names", "given 0.925 to 0.975, right"] == (1, 2)
    assert table["all", "held-out after above before"] == (0, 1)
    worse = answer("unknown", named(-40.0, 1.0))
    worse["gap"]["heldout_after_mm"] = 0.031
    rose = REAL.rates([judge(mixed, worse)])
    assert [(r.hits, r.n) for r in rose if r.figure == "held-out after above before"] == [(1, 1)]


@pytest.mark.parametrize(
    ("kind", "said", "right"),
    [
        ("third_harmonic", "gear_ripple", True),
        ("slipped_joint", "step", True),
        ("two_jumps", "step", True),
        ("slipped_joint", "gear_ripple", False),
        ("marker_drift", "step", False),
    ],
)
def test_what_the_catalogue_came_to_hold_may_be_named(kind: str, said: str, right: bool) -> None:
    cause = effect(kind, "A3", places=["A3"])
    told = answer("explained", effect(said, "A3", probability=0.99), located=("A3",))
    j = judge(key("outside", outside=cause), told)
    assert (j.unknown_located, j.misnamed, j.sure_wrong) == (right, not right, not right)
