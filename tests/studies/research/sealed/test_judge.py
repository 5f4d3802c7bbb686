"""Answers written by hand, and what is said of them: names, twins, backgrounds, mixtures, scores."""

from __future__ import annotations

import math
from typing import Any

import pytest

from studies.research.rates import Rate
from studies.research.sealed.judge import is_listed, is_named, judge, judged_or_failed
from studies.research.sealed.score import FIRST, REAL, coverage, floors, reliability

CONDITIONS = {
    "wrong_sigma": False,
    "outliers": False,
    "hidden": False,
    "configurations": 45,
    "missing": None,
    "rigid": [],
    "known_geometry": False,
    "range_noise": None,
}


def effect(name: str, where: str, **more: Any) -> dict[str, Any]:
    return {"effect": name, "where": where, **more}


def key(
    family: str, *effects: dict[str, Any], outside: dict[str, Any] | None = None
) -> dict[str, Any]:
    common = {"beside": 200.0, "noncentrality": 200.0, "parameters": []}
    filled = [{**common, "places": [e["where"]], **e} for e in effects]
    return {
        "case": "case_0000",
        "family": family,
        "robot": "heavy",
        "conditions": CONDITIONS,
        "effects": filled,
        "outside": {**common, **outside} if outside else None,
        "noncentrality": 200.0,
        "floor_mm": 0.02,
    }


def answer(verdict: str, *effects: dict[str, Any], located: tuple[str, ...] = ()) -> dict[str, Any]:
    return {
        "verdict": verdict,
        "effects": list(effects),
        "located": [{"where": where, "depends_on": "time"} for where in located],
        "gap": {"heldout_before_mm": 0.03, "heldout_after_mm": 0.021},
    }


BACKLASH = effect(
    "backlash",
    "A3",
    parameters=[{"name": "half_width", "value": -40.0, "unit": "urad", "scored": True}],
)
DRIFT = effect("tracker_drift", "instrument", places=["base", "instrument"])


def named(
    value: float, std: float, unit: str = "urad", probability: float = 0.97
) -> dict[str, Any]:
    parameters = [{"name": "half_width", "value": value, "std": std, "unit": unit}]
    return effect("backlash", "A3", probability=probability, parameters=parameters)


def test_right() -> None:
    j = judge(key("single", BACKLASH), answer("explained", named(-41.0, 1.0), located=("A3",)))
    assert j.exact
    assert j.found
    assert j.located
    assert j.explained
    assert not j.misnamed
    assert j.intervals == (True,)
    assert j.statements == ((0.97, True),)
    assert j.over_floor == pytest.approx(1.05)


def test_ambiguous() -> None:
    members = [effect("base_drift", "base"), effect("tracker_drift", "instrument")]
    drift = effect("base_drift", "base", probability=0.5) | {"class": members}
    j = judge(key("single", DRIFT), answer("ambiguous", drift, located=("base",)))
    assert not j.exact
    assert j.found
    assert j.located
    alone = judge(key("single", DRIFT), answer("explained", effect("base_drift", "base")))
    assert not alone.found, "never separable, but the answer does not say so"
    wide = drift | {"class": [*members, *(effect("backlash", f"A{k}") for k in range(3))]}
    assert not judge(key("single", DRIFT), answer("ambiguous", wide)).found


def test_wrong() -> None:
    wrong = effect("transmission_scale", "A2", probability=0.96)
    j = judge(key("single", BACKLASH), answer("explained", wrong, located=("A2", "A3")))
    assert not any((j.exact, j.found, j.located))
    assert j.misnamed
    assert judge(key("single", BACKLASH), answer("ambiguous", wrong)).misnamed is False
    both = answer("explained", named(-40, 1.0), wrong, located=("A3", "A2"))
    j = judge(key("single", BACKLASH), both)
    assert j.found
    assert not j.exact


def test_missing() -> None:
    j = judge(key("single", BACKLASH), None)
    assert not any((j.answered, j.exact, j.found, j.located, j.misnamed))
    assert j.over_floor == math.inf
    nulls = FIRST.rates([judge(key("null"), None), judge(key("null"), answer("no_gap"))])[0]
    assert (nulls.hits, nulls.n) == (1, 2)


@pytest.mark.parametrize("effects", [[{"effect": "backlash"}], "backlash", [None], [["backlash"]]])
def test_malformed(effects: Any) -> None:
    assert not judged_or_failed(key("single", BACKLASH), {"effects": effects}).answered


@pytest.mark.parametrize(
    ("verdict", "effects", "depends", "scatters", "alarm"),
    [
        ("no_gap", [], [], True, False),
        ("unknown", [], ["pose"], True, False),
        ("unknown", [], ["pose"], False, True),
        ("unknown", [], ["pose", "q:A3"], True, True),
        ("unknown", [effect("backlash", "A3")], ["pose"], True, True),
        ("explained", [effect("backlash", "A3")], [], True, True),
        ("no_gap", [], [], False, False),
    ],
)
def test_an_arm_may_be_said_to_scatter(
    verdict: str, effects: list[dict[str, Any]], depends: list[str], scatters: bool, alarm: bool
) -> None:
    """A null is no alarm where it says that poses differ, if they do; a name or a place is one."""
    said = answer(verdict, *effects)
    said["located"] = [{"where": "arm", "depends_on": d} for d in depends]
    null = key("null")
    if scatters:
        null["conditions"] = {**CONDITIONS, "arm_noise": "unsaid"}
    found = judge(null, said)
    assert found.alarm == alarm
    assert [r.hits for r in FIRST.rates([found]) if r.figure == "false alarms"] == [alarm]
    assert not judge(key("single", BACKLASH), said).alarm
    said["gap"]["heldout_after_mm"] = None
    assert (judge(null, said).over_floor == math.inf) == alarm
    assert judge(null, None).alarm


def test_two_causes() -> None:
    other = effect("base_compliance", "base")
    both = answer(
        "explained", effect("base_compliance", "base"), named(-40, 1), located=("A3", "base")
    )
    j = judge(key("pair", BACKLASH, other), both)
    assert j.exact
    assert j.found
    assert j.located
    one = answer("explained", named(-40, 1), located=("A3",))
    j = judge(key("pair", BACKLASH, other), one)
    assert not any((j.exact, j.found, j.located))
    faint = {**BACKLASH, "beside": 30.0}
    assert not judge(key("pair", faint, other), both).visible


def test_outside() -> None:
    cause = effect("marker_drift", "marker:m1", places=["marker:m1"])
    honest = judge(key("outside", outside=cause), answer("unknown", located=("marker:m1",)))
    assert honest.unknown_located
    elsewhere = judge(key("outside", outside=cause), answer("unknown", located=("A3", "marker:m1")))
    assert not elsewhere.unknown_located
    sure = judge(key("outside", outside=cause), answer("explained", named(-40, 1)))
    assert sure.misnamed
    assert sure.intervals == ()


def test_a_bar_is_met_where_the_interval_reaches_it() -> None:
    assert Rate("f", "x", 3, 150, (0.0, 0.04)).met
    assert not Rate("f", "x", 20, 150, (0.0, 0.04)).met
    assert Rate("f", "x", 0, 0, (0.0, 0.04)).met is None


def test_whole_score() -> None:
    right = judge(key("single", BACKLASH), answer("explained", named(-41.0, 1.0), located=("A3",)))
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
    few = right.__class__(**{**right.__dict__, "conditions": {**CONDITIONS, "configurations": 15}})
    assert floors([few])["n"] == 0


# -- What counts as found, and as misnamed: tuned causes, twins, backgrounds, mixtures


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
