"""Answers written by hand, and what is said of them: names, twins, backgrounds, mixtures, scores."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import pytest

from studies.research.rates import Rate
from studies.research.sealed.judge import is_listed, is_named, judge, judged_or_failed
from studies.research.sealed.score import FIRST, REAL, coverage, floors, reliability

Entry = dict[str, Any]
CONDITIONS = {"configurations": 45}


def effect(name: str, where: str, **more: Any) -> Entry:
    return {"effect": name, "where": where, **more}


def key(family: str, *effects: Entry, outside: Entry | None = None, **conditions: Any) -> Entry:
    common = {"beside": 200.0, "noncentrality": 200.0, "parameters": []}
    return {
        "case": "case_0000",
        "family": family,
        "robot": "heavy",
        "conditions": CONDITIONS | conditions,
        "effects": [{**common, "places": [e["where"]], **e} for e in effects],
        "outside": {**common, **outside} if outside else None,
        "noncentrality": 200.0,
        "floor_mm": 0.02,
    }


def answer(
    verdict: str, *effects: Entry, located: tuple[str, ...] = (), after: float | None = 0.021
) -> Entry:
    """Places may say on what they depend: ``A3 pose``, else on time."""
    places = [(*place.split(), "time")[:2] for place in located]
    return {
        "verdict": verdict,
        "effects": list(effects),
        "located": [{"where": where, "depends_on": on} for where, on in places],
        "gap": {"heldout_before_mm": 0.03, "heldout_after_mm": after},
    }


def value(name: str, value: float, unit: str, **more: Any) -> Entry:
    return {"name": name, "value": value, "unit": unit, **more}


# -- What is true


BACKLASH = effect("backlash", "A3", parameters=[value("half_width", -40.0, "urad", scored=True)])
DRIFT = effect("tracker_drift", "instrument", places=["base", "instrument"])
TILT = effect("base_compliance", "base")
FRICTION = effect("friction_windup", "A3", twins=["backlash:A3"])
RIPPLE = effect(
    "gear_ripple",
    "A3",
    tuned=value("cycles", 200.0, "1/turn", tolerance=4.0),
    parameters=[
        value("cycles", 200.0, "1/turn", scored=True),
        value("cos_1", 50.0, "urad", scored=True),
    ],
)
STEP = effect(
    "step",
    "base",
    places=["base", "instrument"],
    tuned=value("at", 1200.0, "s", tolerance=135.0),
    between={"at": [1180.0, 1220.0]},
    parameters=[value("at", 1200.0, "s", scored=True)],
)
BENEATH = {**RIPPLE, "background": True, "beside": 12.0}
OUTSIDE = effect("marker_drift", "marker:m1", places=["marker:m1"])

# -- What is said


def named(half_width: float = -40.0, std: float = 1.0, **more: Any) -> Entry:
    parameters = [value("half_width", half_width, "urad", std=std)]
    return effect("backlash", "A3", **{"probability": 0.97, "parameters": parameters, **more})


def ripple(cycles: float | None, **more: Any) -> Entry:
    parameters = [value("cos_1", 51.0, "urad", std=1.0)]
    if cycles is not None:
        parameters.append(value("cycles", cycles, "1/turn", std=0.1))
    return effect("gear_ripple", "A3", probability=0.97, **{"parameters": parameters, **more})


WRONG = effect("transmission_scale", "A2", probability=0.96)
MEMBERS = [effect("base_drift", "base"), effect("tracker_drift", "instrument")]
EITHER = effect("base_drift", "base", probability=0.5, **{"class": MEMBERS})
ANY = EITHER | {"class": [*MEMBERS, *(effect("backlash", f"A{k}") for k in range(3))]}
EITHER_PLAY = named(**{"class": [effect("friction_windup", "A3"), effect("backlash", "A3")]})

TRUE = ("exact", "found", "located")
JUDGED: dict[str, tuple[Entry, Entry | None, Entry]] = {
    "right": (
        key("single", BACKLASH), answer("explained", named(-41.0), located=("A3",)),
        {**dict.fromkeys((*TRUE, "explained"), True), "misnamed": False, "intervals": (True,),
         "statements": ((0.97, True),), "over_floor": pytest.approx(1.05)},
    ),
    "ambiguous": (
        key("single", DRIFT), answer("ambiguous", EITHER, located=("base",)),
        {"exact": False, "found": True, "located": True},
    ),
    "never separable, but not said so": (
        key("single", DRIFT), answer("explained", MEMBERS[0]), {"found": False},
    ),
    "a class too large": (
        key("single", DRIFT), answer("ambiguous", ANY), {"found": False},
    ),
    "wrong": (
        key("single", BACKLASH), answer("explained", WRONG, located=("A2", "A3")),
        {**dict.fromkeys(TRUE, False), "misnamed": True},
    ),
    "wrong, but not explained": (
        key("single", BACKLASH), answer("ambiguous", WRONG), {"misnamed": False},
    ),
    "right and wrong": (
        key("single", BACKLASH), answer("explained", named(), WRONG, located=("A3", "A2")),
        {"found": True, "exact": False},
    ),
    "no answer": (
        key("single", BACKLASH), None,
        {**dict.fromkeys((*TRUE, "answered", "misnamed"), False), "over_floor": math.inf},
    ),
    "no answer where nothing is": (key("null"), None, {"alarm": True}),
    "two causes": (
        key("pair", BACKLASH, TILT), answer("explained", TILT, named(), located=("A3", "base")),
        dict.fromkeys((*TRUE, "visible"), True),
    ),
    "one of two causes": (
        key("pair", BACKLASH, TILT), answer("explained", named(), located=("A3",)),
        dict.fromkeys(TRUE, False),
    ),
    "one of two is faint": (
        key("pair", {**BACKLASH, "beside": 30.0}, TILT), answer("explained", TILT, named()),
        {"visible": False},
    ),
    "unknown": (
        key("outside", outside=OUTSIDE), answer("unknown", located=("marker:m1",)),
        {"unknown_located": True},
    ),
    "unknown elsewhere": (
        key("outside", outside=OUTSIDE), answer("unknown", located=("A3", "marker:m1")),
        {"unknown_located": False},
    ),
    "unknown, but named": (
        key("outside", outside=OUTSIDE), answer("explained", named()),
        {"misnamed": True, "intervals": ()},
    ),
    "a twin": (
        key("single", FRICTION), answer("explained", named()),
        dict.fromkeys(("found", "exact", "sure_wrong", "misnamed"), False),
    ),
    "a twin that is said": (
        key("single", FRICTION), answer("explained", EITHER_PLAY), {"found": True},
    ),
    "beside a background": (
        key("single", BACKLASH, BENEATH), answer("explained", named(), located=("A3",)),
        {"exact": True, "visible": True, "truth": ("backlash:A3",)},
    ),
    "with its background": (
        key("single", BACKLASH, BENEATH), answer("explained", named(), ripple(200.0)),
        {"exact": True, "sure_wrong": False},
    ),
}  # fmt: skip


@pytest.mark.parametrize(("own", "said", "expected"), JUDGED.values(), ids=JUDGED)
def test_an_answer_is_judged(own: Entry, said: Entry | None, expected: Entry) -> None:
    found = judge(own, said)
    assert {name: getattr(found, name) for name in expected} == expected


@pytest.mark.parametrize("effects", [[{"effect": "backlash"}], "backlash", [None], [["backlash"]]])
def test_malformed(effects: Any) -> None:
    assert not judged_or_failed(key("single", BACKLASH), {"effects": effects}).answered


@pytest.mark.parametrize(
    ("said", "scatters", "alarm"),
    [
        (answer("no_gap", after=None), True, False),
        (answer("unknown", located=("arm pose",), after=None), True, False),
        (answer("unknown", located=("arm pose",), after=None), False, True),
        (answer("unknown", located=("arm pose", "arm q:A3"), after=None), True, True),
        (answer("unknown", named(), located=("arm pose",), after=None), True, True),
        (answer("explained", named(), after=None), True, True),
        (answer("no_gap", after=None), False, False),
    ],
)
def test_an_arm_may_be_said_to_scatter(said: Entry, scatters: bool, alarm: bool) -> None:
    """A null is no alarm where it says that poses differ, if they do; a name or a place is one."""
    found = judge(key("null", **({"arm_noise": "unsaid"} if scatters else {})), said)
    assert found.alarm == alarm
    assert [r.hits for r in FIRST.rates([found]) if r.figure == "false alarms"] == [alarm]
    assert (found.over_floor == math.inf) == alarm
    assert not judge(key("single", BACKLASH), said).alarm


@pytest.mark.parametrize(
    ("said", "alarm"),
    [
        (answer("no_gap"), False),
        (answer("unknown", located=("A3",)), False),
        (answer("unknown", located=("A2",)), True),
        (answer("explained", ripple(200.0), located=("A3",)), False),
        (answer("explained", ripple(150.0), located=("A3",)), True),
        (answer("explained", named(), located=("A3",)), True),
    ],
)
def test_a_background_is_no_alarm(said: Entry, alarm: bool) -> None:
    assert judge(key("null", BENEATH), said).alarm == alarm


HALF = ripple(100.0)
HALF["parameters"].append(value("cos_2", 50.0, "urad", std=1.0))


@pytest.mark.parametrize(
    ("said", "right"),
    [
        (ripple(203.9), True),
        (ripple(204.1), False),
        (ripple(None), False),
        (ripple(56.0), False),
        (ripple(56.0, aliases=[88.0, 200.5]), True),
        (ripple(100.0), False),
        (HALF, True),
        (effect("gear_ripple", "A2", parameters=ripple(200.0)["parameters"]), False),
    ],
)
def test_cycles_within_two_lines_or_as_an_alias_or_a_harmonic(said: Entry, right: bool) -> None:
    assert is_named(said, RIPPLE) == is_listed(said, RIPPLE) == right
    j = judge(key("single", RIPPLE), answer("explained", said))
    assert (j.exact, j.found, j.causes[0].found) == (right, right, right)
    assert len(j.intervals) == 2 * right


@pytest.mark.parametrize(
    ("at", "unit", "right", "held"),
    [
        (1230.0, "s", True, (True,)),
        (1300.0, "s", True, (False,)),
        (1340.0, "s", False, ()),
        (20.0, "min", True, (True,)),
        (27.0, "readings", False, ()),
    ],
)
def test_moment_of_a_step(at: float, unit: str, right: bool, held: tuple[bool, ...]) -> None:
    """Within three readings; its interval may end anywhere between the two readings beside it."""
    parameters = [value("at", at, unit, std=10.0 / (60.0 if unit == "min" else 1.0))]
    said = effect("step", "base", probability=0.95, parameters=parameters)
    j = judge(key("single", STEP), answer("explained", said, located=("instrument",)))
    assert (j.found, j.located, j.intervals, j.sure_wrong) == (right, True, held, not right)


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


# -- Scores of many


def test_a_bar_is_met_where_the_interval_reaches_it() -> None:
    assert Rate("f", "x", 3, 150, (0.0, 0.04)).met
    assert not Rate("f", "x", 20, 150, (0.0, 0.04)).met
    assert Rate("f", "x", 0, 0, (0.0, 0.04)).met is None
    assert Rate("f", "x", 9, 10).interval == pytest.approx((0.5958, 0.9821), abs=1e-3)


def test_whole_score() -> None:
    right = judge(key("single", BACKLASH), answer("explained", named(-41.0), located=("A3",)))
    failed = judge(key("single", BACKLASH), None)
    table = {(r.family, r.figure): r for r in FIRST.rates([right, right, failed])}
    exact = table["single, visible", "named exactly"]
    assert (exact.hits, exact.n) == (2, 3)
    assert (coverage([right, failed]).hits, coverage([right]).n) == (1, 1)
    shown = [row for row in reliability([right, right]) if row["n"]]
    assert [(row["family"], row["hits"], row["stated"]) for row in shown] == [
        ("0.95 to 0.99", 2, 0.97)
    ]
    assert floors([right, right, failed])["median"] == pytest.approx(1.05)
    assert floors([right, failed, failed])["median"] is None
    assert floors([replace(right, conditions={"configurations": 15})])["n"] == 0


def test_causes_of_a_mixture_one_by_one() -> None:
    mixed = key("mixture", BACKLASH, RIPPLE, STEP, {**TILT, "beside": 30.0})
    j = judge(mixed, answer("unknown", named(), ripple(150.0)))
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
    rose = REAL.rates([judge(mixed, answer("unknown", named(), after=0.031))])
    assert [(r.hits, r.n) for r in rose if r.figure == "held-out after above before"] == [(1, 1)]
