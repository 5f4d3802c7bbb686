"""One answer against its key."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

from studies.withheld.units import SI

VISIBLE = 60.0  # noncentrality above which a cause counts as visible
LARGEST_CLASS = 4
CONFIDENT = 0.9
_Z = 1.96


@dataclass(frozen=True)
class Judgement:
    """What is right and wrong about one answer.

    visible : every cause's noncentrality, beside the others, is above 60
    twin : another effect moves everything alike, so that its own name is a matter of luck
    answered : there is an answer
    gap : it says that there is something
    alarm : it says so where nothing is; that an arm scatters is true of one that does
    exact : it names the causes and nothing else, each by its own name
    found : every cause is named, or is in a class of at most four
    located : the place of largest share is right; of two causes, the first two
    unknown_located : it calls the cause unknown, and its place is right
    depends : what the located cause depends on is right too
    misnamed : an effect that is not there is explained with confidence
    explained : it says that nothing is left to explain
    further : it names effects that are not there
    statements : probability and truth of each named effect
    covered : effect, and whether the 95 % interval of a parameter holds the truth, of each parameter
        of a rightly named effect
    over_floor : held-out RMS after, over the true floor; infinite without an answer
    before_over_floor : the same before anything is added to the user's model
    """

    case: str
    family: str
    robot: str
    conditions: dict[str, Any]
    truth: tuple[str, ...]
    noncentrality: float
    visible: bool
    twin: bool
    answered: bool
    verdict: str
    named: tuple[str, ...]
    gap: bool
    alarm: bool
    exact: bool
    found: bool
    located: bool
    unknown_located: bool
    depends: bool
    misnamed: bool
    explained: bool
    further: bool
    statements: tuple[tuple[float, bool], ...]
    covered: tuple[tuple[str, bool], ...]
    over_floor: float
    before_over_floor: float

    @property
    def intervals(self) -> tuple[bool, ...]:
        """Whether each interval holds the truth."""
        return tuple(held for _, held in self.covered)


def judge(key: dict[str, Any], answer: dict[str, Any] | None) -> Judgement:
    """Compare an answer, None where the run failed, with its key."""
    causes = key["effects"] or ([key["outside"]] if key["outside"] else [])
    given = answer or {}
    effects = list(given.get("effects") or [])
    true = [_name(effect) for effect in key["effects"]]
    named = [_name(effect) for effect in effects]
    places = [str(entry.get("where")) for entry in given.get("located") or []]
    located = bool(causes) and all(
        any(place in cause["places"] for place in places[: len(causes)]) for cause in causes
    )
    verdict = str(given.get("verdict", "none"))
    wrong = [e for e in effects if _name(e) not in true]
    return Judgement(
        case=key["case"],
        family=key["family"],
        robot=key["robot"],
        conditions=key["conditions"],
        truth=tuple(_name(cause) for cause in causes),
        noncentrality=key["noncentrality"],
        visible=bool(causes) and min(cause["beside"] for cause in causes) > VISIBLE,
        twin=any(len(cause["places"]) > 1 for cause in causes),
        answered=answer is not None,
        verdict=verdict,
        named=tuple(named),
        gap=answer is not None and verdict != "no_gap",
        alarm=not (causes or _silent(key, given)),
        exact=bool(true) and sorted(named) == sorted(true),
        found=bool(true) and all(any(t in _class(e) for e in effects) for t in true),
        located=located,
        unknown_located=verdict == "unknown" and located,
        depends=located and _depends_right(causes, given),
        misnamed=verdict == "explained"
        and any((e.get("probability") or 0.0) > CONFIDENT for e in wrong),
        explained=verdict == "explained",
        further=len(wrong) > 0 and len(named) > len(true),
        statements=tuple(
            (float(e["probability"]), _name(e) in true)
            for e in effects
            if e.get("probability") is not None
        ),
        covered=_covered(key, effects) if key["family"] in ("single", "pair") else (),
        over_floor=_over_floor(key, given),
        before_over_floor=_ratio(key, (given.get("gap") or {}).get("heldout_before_mm")),
    )


def _name(effect: dict[str, Any]) -> str:
    return f"{effect['effect']}:{effect['where']}"


def _class(effect: dict[str, Any]) -> set[str]:
    """The effect itself, and those it says it cannot be told from where they are few."""
    listed = {_name(e) for e in effect.get("class") or []} | {_name(effect)}
    return listed if len(listed) <= LARGEST_CLASS else {_name(effect)}


def _depends_right(causes: list[dict[str, Any]], answer: dict[str, Any]) -> bool:
    first = answer["located"][0].get("depends_on")
    return any(first in cause["depends_on"] for cause in causes)


def _silent(key: dict[str, Any], answer: dict[str, Any]) -> bool:
    """Nothing found but, where the arm scatters, that poses differ by what follows no column."""
    if answer.get("verdict") == "no_gap":
        return True
    places = answer.get("located") or []
    return (
        answer.get("verdict") == "unknown"
        and "arm_noise" in key["conditions"]
        and not answer.get("effects")
        and all(place.get("depends_on") == "pose" for place in places)
    )


def _covered(key: dict[str, Any], effects: list[dict[str, Any]]) -> tuple[tuple[str, bool], ...]:
    """Parameters given with a standard deviation; others make no claim, unknown units a false one."""
    held = []
    for truth in key["effects"]:
        for effect in (e for e in effects if _name(e) == _name(truth)):
            given = {p["name"]: p for p in effect.get("parameters") or []}
            for parameter in truth["parameters"]:
                answer = given.get(parameter["name"])
                if not parameter["scored"] or answer is None:
                    continue
                if answer.get("value") is None or answer.get("std") is None:
                    continue
                scale = SI.get(answer.get("unit"), math.nan) / SI[parameter["unit"]]
                off = abs(answer["value"] * scale - parameter["value"])
                held.append((str(truth["effect"]), off <= _Z * answer["std"] * scale))
    return tuple(held)


def _over_floor(key: dict[str, Any], answer: dict[str, Any]) -> float:
    gap = answer.get("gap") or {}
    after = gap.get("heldout_after_mm")
    if after is None and _silent(key, answer):
        after = gap.get("heldout_before_mm")  # nothing was added, so before is after
    return _ratio(key, after)


def _ratio(key: dict[str, Any], rms_mm: float | None) -> float:
    return math.inf if rms_mm is None else float(rms_mm) / float(key["floor_mm"])
