"""Answers against what is there, as those of poses are judged."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from studies.research.rates import Rate
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
    return Score(
        case.family + (f" ({case.law})" if case.law else ""),
        not missed if case.family not in (NULL, OUTSIDE) else None,
        tuple(_name(e) for e in sure if _name(e) not in true),
        missed,
        bool(answer["effects"]),
        tuple(_intervals(case, answer["effects"])),
        answer["verdict"],
        answer["gap"]["heldout_before_mm"],
        answer["gap"]["heldout_after_mm"],
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


def rates(scores: Sequence[Score]) -> list[Rate]:
    """What is asked of all cases."""
    findable = [own.right for own in scores if own.right is not None]
    named = [own.named for own in scores if own.family == NULL]
    held = [ok for own in scores for _, ok in own.held]
    return [
        Rate.of("visible", "class right", findable, (0.9, 1.0)),
        Rate.of("all", "confidently wrong", [bool(own.wrong) for own in scores], (0.0, 0.03)),
        Rate.of(NULL, "a name", named, (0.0, 0.03)),
        Rate.of("parameters", "truth within the 95 % interval", held, (0.92, 0.98)),
    ]
