"""Answers against what is there, as those of poses are judged."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from studies.research.sealed_motions.truth import NULL, OUTSIDE, Case

_SURE = 0.9
# What is true beside the cause itself: a payload is a change of the last link's inertials.
_TRUE_BESIDE = {"payload": ("inertials", "arm")}
Name = tuple[str, str]


@dataclass(frozen=True)
class Score:
    """One case.

    right : whether every visible cause is in the class of a name; None where there is none to find
    wrong : names of at least 90 % that are not there; named : whether anything is
    held : of each interval, whether it holds the true value, by name of the value
    """

    family: str
    right: bool | None
    wrong: tuple[Name, ...]
    missed: tuple[Name, ...]
    named: bool
    held: tuple[tuple[str, bool], ...]
    verdict: str
    before: float
    after: float


def scored(case: Case, answer: Mapping[str, Any]) -> Score:
    """The score of an answer, as ``diagnose --json`` writes it."""
    there = {(own.effect, own.where) for own in case.causes}
    true = there | {_TRUE_BESIDE[own] for own, _ in there if own in _TRUE_BESIDE}
    classes = [{_name(m) for m in [e, *e["class"]]} for e in answer["effects"]]
    missed = tuple(
        (own.effect, own.where) for own in case.causes
        if own.seen and not any((own.effect, own.where) in each for each in classes)
    )  # fmt: skip
    sure = [e for e in answer["effects"] if e["probability"] >= _SURE]
    findable = case.family not in (NULL, OUTSIDE)
    gap = answer["gap"]
    return Score(
        case.family + (f" ({case.law})" if case.law else ""),
        not missed if findable else None,
        tuple(_name(e) for e in sure if _name(e) not in true),
        missed,
        bool(answer["effects"]),
        tuple(_intervals(case, answer["effects"])),
        answer["verdict"],
        gap["heldout_before_mm"],
        gap["heldout_after_mm"],
    )


def _name(effect: Mapping[str, Any]) -> Name:
    return effect["effect"], effect["where"]


def _intervals(case: Case, effects: Sequence[Mapping[str, Any]]) -> Iterable[tuple[str, bool]]:
    for own in case.causes:
        for effect in (e for e in effects if _name(e) == (own.effect, own.where)):
            said = {p["name"]: p["ci95"] for p in effect["parameters"]}
            for name, value in own.values.items():
                low, high = said[name]
                yield f"{own.effect} {name}", bool(low <= value <= high)


def wilson(hits: int, count: int) -> tuple[float, float]:
    """95 % limits of a share (Wilson, 1927)."""
    if not count:
        return 0.0, 1.0
    z, p = 1.96, hits / count
    middle, half = p + z**2 / (2 * count), z * np.sqrt(p * (1 - p) / count + z**2 / (4 * count**2))
    low, high = ((middle + sign * half) / (1 + z**2 / count) for sign in (-1.0, 1.0))
    return max(float(low), 0.0), min(float(high), 1.0)


def summary(scores: Sequence[Score]) -> list[dict[str, Any]]:
    """Shares with their limits, and what is asked of them."""
    findable = [own for own in scores if own.right is not None]
    nulls = [own for own in scores if own.family == NULL]
    held = [ok for own in scores for _, ok in own.held]
    counts = (
        ("class right", sum(bool(own.right) for own in findable), len(findable), ">= 90 %"),
        ("confidently wrong", sum(bool(own.wrong) for own in scores), len(scores), "<= 3 %"),
        ("nulls with a name", sum(own.named for own in nulls), len(nulls), "<= 3 %"),
        ("intervals that hold", sum(held), len(held), "92 .. 98 %"),
    )
    return [
        {"figure": name, "share": hits / max(total, 1), "count": f"{hits} of {total}",
         "95 % limits": "{:.3f} .. {:.3f}".format(*wilson(hits, total)), "asked": asked}
        for name, hits, total, asked in counts
    ]  # fmt: skip
