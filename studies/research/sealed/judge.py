"""One answer against its key: what is named, in which class, at which value."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

_MICRO = (
    "urad", "um", "ppm", "ppm/h", "ppm/K", "urad/rad", "um/m", "um/rad", "urad/m", "urad/(N m)",
    "um/h", "urad/h", "um/(m K)",
)  # fmt: skip
_ONE = ("kg", "N", "1", "1/turn", "N m", "s", "readings")
SI = {
    **dict.fromkeys(_MICRO, 1e-6), **dict.fromkeys(_ONE, 1.0),
    "mm": 1e-3, "N/mm": 1e3, "nm/N": 1e-9, "min": 60.0,
}  # fmt: skip
_BY_PREFIX = {
    "cos_": "urad", "sin_": "urad", "half_width": "urad", "offset": "urad",
    "compliance": "urad/(N m)", "tilt": "urad/(N m)", "spring": "N/mm", "preload": "N", "mass": "kg",
    "weight": "1", "growth": "um/(m K)", "from_": "urad/rad", "com_": "mm", "scale": "urad/rad",
    "cycles": "1/turn", "per_move": "urad/rad", "per_speed": "urad", "torque": "N m", "tau": "min",
    "at": "s",
}  # fmt: skip
_BY_EFFECT = {("tracker_scale", "scale"): "ppm", ("payload", "scale"): "1"}
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
    shown = next(shown for prefix, shown in _BY_PREFIX.items() if name.startswith(prefix))
    return _SLIDING.get(shown, shown) if slides else shown


LARGEST_CLASS = 4
VISIBLE = 60.0  # noncentrality above which a cause counts as visible
CONFIDENT = 0.9
_Z = 1.96
_SEEN = {"mixture": max, "whole": max}
_WITH_INTERVALS = ("single", "pair", "mixture", "whole")
# What the first families call outside, and the catalogue came to hold; two jumps are each a step.
_HELD = {
    "third_harmonic": "gear_ripple",
    **dict.fromkeys(("slipped_joint", "settling_base", "two_jumps"), "step"),
}
Entry = dict[str, Any]


def name_of(effect: Entry) -> str:
    """Effect and place in one word."""
    return f"{effect['effect']}:{effect['where']}"


def _class_of(effect: Entry) -> set[str]:
    """The effect itself, and those it says it cannot be told from where they are few."""
    listed = {name_of(e) for e in effect.get("class") or []} | {name_of(effect)}
    return listed if len(listed) <= LARGEST_CLASS else {name_of(effect)}


def _held(truth: Entry) -> set[str]:
    """Names of what the first families call outside, where the catalogue holds it by now."""
    kind = _HELD.get(truth["effect"])
    return {f"{kind}:{place}" for place in truth["places"]} if kind else set()


def _names_of(truth: Entry) -> set[str]:
    """Effects of a key that are right."""
    return {name_of(truth), *truth.get("alike", ())}


def is_named(effect: Entry, truth: Entry) -> bool:
    """The effect is the one of the key, at its cycles or its moment."""
    return name_of(effect) in _names_of(truth) and _tuned(effect, truth)


def is_listed(effect: Entry, truth: Entry) -> bool:
    """The same, or the one of the key is in its class."""
    if name_of(effect) in _names_of(truth):
        return _tuned(effect, truth)
    return bool(_names_of(truth) & _class_of(effect))


def is_true(effect: Entry, truths: Iterable[Entry], outside: Entry | None) -> bool:
    """The effect is in truth, or moves everything as something in truth does."""
    name = name_of(effect)
    known = any(is_named(effect, t) or name in t.get("twins", ()) for t in truths)
    return known or (outside is not None and name in _held(outside))


def _tuned(effect: Entry, truth: Entry) -> bool:
    """A value that it states, or an alias that it says, is near enough to the true one."""
    tuned = truth.get("tuned")
    if tuned is None:
        return True
    scale = SI[tuned["unit"]]
    true, near = tuned["value"] * scale, tuned["tolerance"] * scale
    return any(abs(value - true) <= near for value in _stated(effect, tuned["name"]))


def _stated(effect: Entry, name: str) -> list[float]:
    """Values of a tuned parameter that an answer gives, SI, with aliases and harmonics."""
    given = {p["name"]: p for p in effect.get("parameters") or []}
    stated = given.get(name)
    if stated is None or stated.get("value") is None:
        return []
    scale = SI.get(stated.get("unit"), math.nan)
    values = [stated["value"], *(stated.get("aliases") or []), *(effect.get("aliases") or [])]
    if name == "cycles" and "cos_2" in given:
        values.append(2.0 * stated["value"])
    return [float(value) * scale for value in values]


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
    alarm : it says so where nothing is; that an arm scatters is true of one that does
    exact : it names the causes and nothing else, each by its name
    found : every cause is named, or is in a class of at most four
    located : the place of largest share is right; of two causes, the first two
    unknown_located : it calls the cause unknown, and its place is right; or names it, where the
        catalogue holds it by now
    misnamed : an effect that is not there is explained with confidence
    sure_wrong : an effect that is not there is named with confidence, whatever the verdict
    statements : probability and truth of each named effect
    intervals : whether the 95 % interval of each parameter of a rightly named effect holds the truth
    over_floor, before_over_floor : held-out RMS after and before anything is added to the user's model,
        over the true floor; infinite without an answer
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
    intervals: tuple[bool, ...]
    over_floor: float
    before_over_floor: float


def judged_or_failed(key: Entry, answer: Entry | None) -> Judgement:
    """An answer that cannot be read as one is none."""
    try:
        return judge(key, answer)
    except (AttributeError, KeyError, TypeError, ValueError):
        return judge(key, None)


def judge(key: Entry, answer: Entry | None) -> Judgement:
    """Compare an answer, None where the run failed, with its key."""
    truths, outside, family = key["effects"], key["outside"], key["family"]
    main = [truth for truth in truths if not truth.get("background")]
    causes = main or ([outside] if outside else [])
    given = answer or {}
    effects = list(given.get("effects") or [])
    verdict = str(given.get("verdict", "none"))
    located = _located(causes, given)
    wrong = [e for e in effects if not is_true(e, truths, outside)]
    surest = max((e.get("probability") or 0.0 for e in wrong), default=0.0)
    held = _held(outside) if outside else set()
    told = verdict in ("unknown", "partly") or (
        not wrong and any(name_of(e) in held for e in effects)
    )
    each = [
        CauseJudged(name_of(t), t["beside"], any(is_listed(e, t) for e in effects)) for t in main
    ]
    beside = [cause["beside"] for cause in causes]
    return Judgement(
        case=key["case"],
        family=family,
        robot=key["robot"],
        conditions=key["conditions"],
        truth=tuple(map(name_of, causes)),
        noncentrality=key["noncentrality"],
        visible=bool(causes) and _SEEN.get(family, min)(beside) > VISIBLE,
        answered=answer is not None,
        verdict=verdict,
        named=tuple(map(name_of, effects)),
        alarm=not (causes or _silent(key, given)),
        exact=bool(main) and _exactly(main, truths, effects),
        found=bool(main) and all(cause.found for cause in each),
        located=located,
        unknown_located=located and told,
        misnamed=verdict == "explained" and surest > CONFIDENT,
        sure_wrong=surest >= CONFIDENT,
        causes=tuple(each),
        explained=verdict == "explained",
        statements=tuple(
            (float(e["probability"]), any(is_named(e, truth) for truth in truths))
            for e in effects
            if e.get("probability") is not None
        ),
        intervals=_intervals(truths, effects) if family in _WITH_INTERVALS else (),
        over_floor=_ratio(_after(key, given), key["floor_mm"]),
        before_over_floor=_ratio(
            (given.get("gap") or {}).get("heldout_before_mm"), key["floor_mm"]
        ),
    )


def _located(causes: Sequence[Entry], answer: Entry) -> bool:
    places = [str(entry.get("where")) for entry in answer.get("located") or []][: len(causes)]
    return bool(causes) and all(any(p in cause["places"] for p in places) for cause in causes)


def _exactly(main: list[Entry], truths: list[Entry], effects: list[Entry]) -> bool:
    """Each cause is named once, and nothing but what is there."""
    once = all(sum(is_named(e, truth) for e in effects) == 1 for truth in main)
    return once and all(any(is_named(e, truth) for truth in truths) for e in effects)


def _silent(key: Entry, answer: Entry) -> bool:
    """Nothing found but what is there: that poses differ where the arm scatters, a background."""
    verdict = answer.get("verdict")
    if verdict == "no_gap":
        return True
    background = [truth for truth in key["effects"] if truth.get("background")]
    if not (background or "arm_noise" in key["conditions"]):
        return False
    effects, places = answer.get("effects") or [], answer.get("located") or []
    rippled = {truth["where"] for truth in background}
    said = ("unknown", "explained", "partly", "ambiguous") if effects else ("unknown",)
    return (
        verdict in said
        and all(is_true(effect, background, None) for effect in effects)
        and all(p.get("depends_on") == "pose" or p.get("where") in rippled for p in places)
    )


def _intervals(truths: list[Entry], effects: list[Entry]) -> tuple[bool, ...]:
    """Parameters given with a standard deviation; others make no claim, unknown units a false one."""
    held = []
    for truth in truths:
        for effect in (e for e in effects if is_named(e, truth)):
            given = {p["name"]: p for p in effect.get("parameters") or []}
            for true in (own for own in truth["parameters"] if own["scored"]):
                said = given.get(true["name"], {})
                if said.get("value") is None or said.get("std") is None:
                    continue
                scale = SI.get(said.get("unit"), math.nan) / SI[true["unit"]]
                # From the truth, or from all that the data cannot tell from it.
                low, high = truth.get("between", {}).get(true["name"], [true["value"]] * 2)
                off = max(low - said["value"] * scale, said["value"] * scale - high, 0.0)
                held.append(bool(off <= _Z * said["std"] * scale))
    return tuple(held)


def _after(key: Entry, answer: Entry) -> float | None:
    gap = answer.get("gap") or {}
    after: float | None = gap.get("heldout_after_mm")
    if after is None and _silent(key, answer):
        after = gap.get("heldout_before_mm")  # nothing was added, so before is after
    return after


def _ratio(rms: float | None, floor: float) -> float:
    return math.inf if rms is None else float(rms) / float(floor)
