"""One answer against its key: what is named, in which class, at which value."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

_MICRO = (
    "urad", "um", "ppm", "ppm/h", "ppm/K", "urad/rad", "um/m", "um/rad", "urad/m", "urad/(N m)",
    "um/h", "urad/h", "um/(m K)",
)  # fmt: skip
_ONE = ("kg", "N", "1", "1/turn", "N m", "s", "readings")
SI = {
    **dict.fromkeys(_MICRO, 1e-6),
    **dict.fromkeys(_ONE, 1.0),
    "mm": 1e-3,
    "N/mm": 1e3,
    "nm/N": 1e-9,
    "min": 60.0,
}

_BY_PREFIX = {
    "cos_": "urad",
    "sin_": "urad",
    "half_width": "urad",
    "offset": "urad",
    "compliance": "urad/(N m)",
    "tilt": "urad/(N m)",
    "spring": "N/mm",
    "preload": "N",
    "mass": "kg",
    "weight": "1",
    "growth": "um/(m K)",
    "from_": "urad/rad",
    "com_": "mm",
    "scale": "urad/rad",
    "cycles": "1/turn",
    "per_move": "urad/rad",
    "per_speed": "urad",
    "torque": "N m",
    "tau": "min",
    "at": "s",
}
_BY_EFFECT = {
    ("tracker_scale", "scale"): "ppm",
    ("payload", "scale"): "1",
}
_SLIDING = {"urad": "um", "urad/(N m)": "nm/N", "urad/rad": "um/m"}


def unit(effect: str, name: str, slides: bool = False, timed: bool = True) -> str:
    """Unit of a parameter; slides : it belongs to a prismatic joint; timed : the file has a clock."""
    if name in ("tau", "at") and not timed:
        return "readings"
    if name in ("x", "y", "z", "rx", "ry", "rz"):
        turns = name.startswith("r")
        if effect == "tool_compliance":
            return "urad/(N m)" if turns else "nm/N"
        return ("urad" if turns else "um") + ("/h" if effect.endswith("drift") else "")
    if (effect, name) in _BY_EFFECT:
        return _BY_EFFECT[effect, name]
    found = next(shown for prefix, shown in _BY_PREFIX.items() if name.startswith(prefix))
    return _SLIDING.get(found, found) if slides else found


LARGEST_CLASS = 4
# What the first families call outside, and the catalogue came to hold; two jumps are each a step.
HELD = {
    "third_harmonic": "gear_ripple",
    "slipped_joint": "step",
    "settling_base": "step",
    "two_jumps": "step",
}

# What sealed keys call otherwise than the catalogue.
RENAMED = {"moved": "step", "focal_scale": "focal"}

Entry = dict[str, Any]


def name_of(effect: Entry) -> str:
    """Effect and place in one word."""
    return f"{effect['effect']}:{effect['where']}"


def class_of(effect: Entry) -> set[str]:
    """The effect itself, and those it says it cannot be told from where they are few."""
    listed = {name_of(e) for e in effect.get("class") or []} | {name_of(effect)}
    return listed if len(listed) <= LARGEST_CLASS else {name_of(effect)}


def names_of(truth: Entry) -> set[str]:
    """Effects of a key that are right."""
    kind = RENAMED.get(truth["effect"])
    renamed = {f"{kind}:{place}" for place in truth["places"]} if kind else set()
    return {name_of(truth), *truth.get("alike", ()), *renamed}


def is_named(effect: Entry, truth: Entry) -> bool:
    """The effect is the one of the key, at its cycles or its moment."""
    return name_of(effect) in names_of(truth) and _tuned(effect, truth)


def is_listed(effect: Entry, truth: Entry) -> bool:
    """The same, or the one of the key is in its class."""
    if name_of(effect) in names_of(truth):
        return _tuned(effect, truth)
    return bool(names_of(truth) & class_of(effect))


def is_true(effect: Entry, truths: Iterable[Entry], outside: Entry | None) -> bool:
    """The effect is in truth, or moves everything as something in truth does."""
    for truth in truths:
        if is_named(effect, truth) or name_of(effect) in truth.get("twins", ()):
            return True
    return outside is not None and name_of(effect) in held_names(outside)


def held_names(outside: Entry) -> set[str]:
    """Names that are right for a cause that the catalogue holds by now."""
    kind = HELD.get(outside["effect"])
    return {f"{kind}:{place}" for place in outside["places"]} if kind else set()


def _tuned(effect: Entry, truth: Entry) -> bool:
    """A value that it states, or an alias that it says, is near enough to the true one."""
    tuned = truth.get("tuned")
    if tuned is None:
        return True
    scale = SI[tuned["unit"]]
    true, near = tuned["value"] * scale, tuned["tolerance"] * scale
    return any(abs(value - true) <= near for value in _stated(effect, tuned["name"]))


def _stated(effect: Entry, name: str) -> list[float]:
    """Values of a tuned parameter that an answer gives, SI: its own, its aliases, its harmonics'."""
    given = {p["name"]: p for p in effect.get("parameters") or []}
    own = given.get(name)
    if own is None or own.get("value") is None:
        return []
    scale = SI.get(own.get("unit"), math.nan)
    values = [own["value"], *(own.get("aliases") or []), *(effect.get("aliases") or [])]
    if name == "cycles" and "cos_2" in given:
        values.append(2.0 * own["value"])
    return [float(value) * scale for value in values]


__all__ = ["LARGEST_CLASS", "CauseJudged", "Judgement", "judge"]

VISIBLE = 60.0  # noncentrality above which a cause counts as visible
CONFIDENT = 0.9
_Z = 1.96
_SEEN = {"mixture": max, "whole": max}
_COVERED = ("single", "pair", "mixture", "whole", "instrument")


@dataclass(frozen=True)
class CauseJudged:
    """One cause of a case: its name, its noncentrality beside the others, and whether it is found."""

    name: str
    beside: float
    found: bool

    @property
    def visible(self) -> bool:
        """Its noncentrality is above 60."""
        return self.beside > VISIBLE


@dataclass(frozen=True)
class Judgement:
    """What is right and wrong about one answer.

    visible : every cause's noncentrality, beside the others, is above 60; of a mixture or a whole
        arm that of one is
    answered : there is an answer
    alarm : it says so where nothing is; that an arm scatters is true of one that does
    exact : it names the causes and nothing else, each by its own name
    found : every cause is named, or is in a class of at most four
    located : the place of largest share is right; of two causes, the first two
    unknown_located : it calls the cause unknown, and its place is right; or names it, where the
        catalogue holds it by now
    misnamed : an effect that is not there is explained with confidence
    sure_wrong : an effect that is not there is named with confidence, whatever the verdict
    causes : each by itself
    explained : it says that nothing is left to explain
    statements : probability and truth of each named effect
    covered : effect, and whether the 95 % interval of a parameter holds the truth, of each parameter
        of a rightly named effect
    over_floor : held-out RMS after, over the true floor; infinite without an answer
    before_over_floor : the same before anything is added to the user's model
    over_reach : after, over what a fit of the true visible causes leaves; over the floor where the key
        does not say
    """

    case: str
    family: str
    robot: str
    conditions: dict[str, Any]
    truth: tuple[str, ...]
    noncentrality: float
    visible: bool
    answered: bool
    verdict: str
    named: tuple[str, ...]
    alarm: bool
    exact: bool
    found: bool
    located: bool
    unknown_located: bool
    misnamed: bool
    sure_wrong: bool
    causes: tuple[CauseJudged, ...]
    explained: bool
    statements: tuple[tuple[float, bool], ...]
    covered: tuple[tuple[str, bool], ...]
    over_floor: float
    before_over_floor: float
    over_reach: float

    @property
    def intervals(self) -> tuple[bool, ...]:
        """Whether each interval holds the truth."""
        return tuple(held for _, held in self.covered)


def judge(key: dict[str, Any], answer: dict[str, Any] | None) -> Judgement:
    """Compare an answer, None where the run failed, with its key."""
    truths, outside = key["effects"], key["outside"]
    main = [truth for truth in truths if not truth.get("background")]
    causes = main or ([outside] if outside else [])
    given = answer or {}
    effects = list(given.get("effects") or [])
    places = [str(entry.get("where")) for entry in given.get("located") or []]
    located = bool(causes) and all(
        any(place in cause["places"] for place in places[: len(causes)]) for cause in causes
    )
    verdict = str(given.get("verdict", "none"))
    wrong = [e for e in effects if not is_true(e, truths, outside)]
    sure = [e for e in wrong if (e.get("probability") or 0.0) >= CONFIDENT]
    held = outside is not None and any(name_of(e) in held_names(outside) for e in effects)
    return Judgement(
        case=key["case"],
        family=key["family"],
        robot=key["robot"],
        conditions=key["conditions"],
        truth=tuple(name_of(cause) for cause in causes),
        noncentrality=key["noncentrality"],
        visible=bool(causes)
        and _SEEN.get(key["family"], min)(cause["beside"] for cause in causes) > VISIBLE,
        answered=answer is not None,
        verdict=verdict,
        named=tuple(name_of(effect) for effect in effects),
        alarm=not (causes or _silent(key, given)),
        exact=bool(main) and _exactly(main, truths, effects),
        found=bool(main) and all(any(is_listed(e, t) for e in effects) for t in main),
        located=located,
        unknown_located=located and (verdict in ("unknown", "partly") or (held and not wrong)),
        misnamed=verdict == "explained"
        and any((e.get("probability") or 0.0) > CONFIDENT for e in wrong),
        sure_wrong=bool(sure),
        causes=tuple(
            CauseJudged(name_of(t), t["beside"], any(is_listed(e, t) for e in effects))
            for t in main
        ),
        explained=verdict == "explained",
        statements=tuple(
            (float(e["probability"]), any(is_named(e, truth) for truth in truths))
            for e in effects
            if e.get("probability") is not None
        ),
        covered=_covered(key, effects) if key["family"] in _COVERED else (),
        over_floor=_over_floor(key, given),
        before_over_floor=_ratio(key, (given.get("gap") or {}).get("heldout_before_mm")),
        over_reach=_over_floor(key, given)
        * key["floor_mm"]
        / key.get("reachable_mm", key["floor_mm"]),
    )


def _exactly(
    main: list[dict[str, Any]], truths: list[dict[str, Any]], effects: list[dict[str, Any]]
) -> bool:
    """Each cause is named once, and nothing but what is there."""
    once = all(sum(is_named(e, truth) for e in effects) == 1 for truth in main)
    return once and all(any(is_named(e, truth) for truth in truths) for e in effects)


def _silent(key: dict[str, Any], answer: dict[str, Any]) -> bool:
    """Nothing found but what is there: that poses differ where the arm scatters, a background."""
    if answer.get("verdict") == "no_gap":
        return True
    background = [truth for truth in key["effects"] if truth.get("background")]
    if not (background or "arm_noise" in key["conditions"]):
        return False
    effects, places = answer.get("effects") or [], answer.get("located") or []
    rippled = {truth["where"] for truth in background}
    return (
        answer.get("verdict")
        in ("unknown", *(("explained", "partly", "ambiguous") if effects else ()))
        and all(is_true(effect, background, None) for effect in effects)
        and all(p.get("depends_on") == "pose" or p.get("where") in rippled for p in places)
    )


def _covered(key: dict[str, Any], effects: list[dict[str, Any]]) -> tuple[tuple[str, bool], ...]:
    """Parameters given with a standard deviation; others make no claim, unknown units a false one."""
    held = []
    for truth in key["effects"]:
        for effect in (e for e in effects if is_named(e, truth)):
            given = {p["name"]: p for p in effect.get("parameters") or []}
            for parameter in truth["parameters"]:
                answer = given.get(parameter["name"])
                if not parameter["scored"] or answer is None:
                    continue
                if answer.get("value") is None or answer.get("std") is None:
                    continue
                scale = SI.get(answer.get("unit"), math.nan) / SI[parameter["unit"]]
                off = _off(answer["value"] * scale, truth, parameter)
                held.append((str(truth["effect"]), off <= _Z * answer["std"] * scale))
    return tuple(held)


def _off(value: float, truth: dict[str, Any], parameter: dict[str, Any]) -> float:
    """Distance from the truth, or from all that the data cannot tell from it."""
    low, high = truth.get("between", {}).get(parameter["name"], [parameter["value"]] * 2)
    return max(float(low) - value, value - float(high), 0.0)


def _over_floor(key: dict[str, Any], answer: dict[str, Any]) -> float:
    gap = answer.get("gap") or {}
    after = gap.get("heldout_after_mm")
    if after is None and _silent(key, answer):
        after = gap.get("heldout_before_mm")  # nothing was added, so before is after
    return _ratio(key, after)


def _ratio(key: dict[str, Any], rms_mm: float | None) -> float:
    return math.inf if rms_mm is None else float(rms_mm) / float(key["floor_mm"])
