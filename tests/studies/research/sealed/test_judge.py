"""Answers written by hand, and what is said of them."""

from __future__ import annotations

import math
from typing import Any

import pytest

from studies.research.sealed.judge import judge, judged_or_failed
from studies.research.sealed.score import (
    FIRST,
    Rate,
    coverage,
    floors,
    reliability,
)

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
