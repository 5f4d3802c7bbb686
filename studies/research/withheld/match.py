"""Whether a named effect is one that is there: its name, its class, and what is tuned in it."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Any

from studies.research.withheld.units import SI

LARGEST_CLASS = 4
# What the first families call outside, and the catalogue came to hold; two jumps are each a step.
HELD = {
    "third_harmonic": "gear_ripple",
    "slipped_joint": "step",
    "settling_base": "step",
    "two_jumps": "step",
}

Entry = dict[str, Any]


def name_of(effect: Entry) -> str:
    """Effect and place in one word."""
    return f"{effect['effect']}:{effect['where']}"


def class_of(effect: Entry) -> set[str]:
    """The effect itself, and those it says it cannot be told from where they are few."""
    listed = {name_of(e) for e in effect.get("class") or []} | {name_of(effect)}
    return listed if len(listed) <= LARGEST_CLASS else {name_of(effect)}


def is_named(effect: Entry, truth: Entry) -> bool:
    """The effect is the one of the key, at its cycles or its moment."""
    return name_of(effect) == name_of(truth) and _tuned(effect, truth)


def is_listed(effect: Entry, truth: Entry) -> bool:
    """The same, or the one of the key is in its class."""
    if name_of(effect) == name_of(truth):
        return _tuned(effect, truth)
    return name_of(truth) in class_of(effect)


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
