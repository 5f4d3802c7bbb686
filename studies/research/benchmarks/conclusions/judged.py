"""What was said of a day against what was true: one row of the file."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from studies.research.benchmarks.conclusions.days import Day
from studies.research.benchmarks.conclusions.sizing import VISIBLE
from studies.research.benchmarks.conclusions.true_causes import TrueCause
from studies.research.withheld.match import Entry, is_listed, is_named, name_of

Row = dict[str, Any]
RIGHT, IN_CLASS, WRONG = "right", "in_class", "wrong"
FAMILY = 2 / 3
_TWINS = {
    "instrument": "base",
    "tracker_drift": "base_drift",
    "friction_windup": "backlash",
}
_KEPT = (
    "effect", "where", "probability", "standing", "p_value", "shape_p_value", "shape_power",
    "shape_tested", "share_of_gap", "chosen_again", "curve_ratio",
)  # fmt: skip


def judged(day: Day, said: Row) -> Row:
    """Truth, answer, and what of it is right."""
    effects = [_effect(e, day.causes) for e in said.get("effects") or []]
    found = [_found(said, cause) for cause in day.causes]
    located = [(p["where"], p["depends_on"]) for p in said.get("located") or []]
    return {
        "kind": day.kind,
        "arm": day.scene.arm.name,
        "configurations": day.scene.count,
        "ratio": day.ratio,
        "in_joints": day.scene.scatter is not None and bool(day.scene.scatter.joints.any()),
        **day.more,
        "truth": [f"{cause.kind}:{cause.where}" for cause in day.causes],
        "sizes": [cause.size for cause in day.causes],
        "noncentrality": list(day.noncentrality),
        "verdict": said["verdict"],
        "rest": said.get("rest"),
        "gap": said.get("gap"),
        "noise": said.get("noise"),
        "located": located[:4],
        "located_first": bool(located and day.causes) and located[0][0] in _places(day.causes[0]),
        "effects": effects,
        "refused": [f"{r['effect']}:{r['where']}" for r in said.get("refused") or []],
        "outliers": len(said.get("outliers") or []),
        "error": said.get("error"),
        "seconds": said["seconds"],
        "found": [how is not None for how in found],
        "by_name": [how == RIGHT for how in found],
        "wrong": sum(e["outcome"] == WRONG for e in effects),
        "members": day.family,
        "family": _family(day, found),
    }  # fmt: skip


def outcome(effect: Entry, causes: Sequence[TrueCause]) -> str:
    """Whether a named effect is a true one, may be by its class, or is not there."""
    truths = [name for cause in causes for name in cause.names]
    if any(is_named(effect, truth) for truth in truths):
        return RIGHT
    return IN_CLASS if any(is_listed(effect, truth) for truth in truths) else WRONG


def _places(cause: TrueCause) -> set[str]:
    """Where it sits, by any of its names."""
    return {cause.where, *(str(name["where"]) for name in cause.names)}


def _found(said: Row, cause: TrueCause) -> str | None:
    """How the best of the effects has a cause."""
    outcomes = [outcome(e, [cause]) for e in said.get("effects") or []]
    return next((how for how in (RIGHT, IN_CLASS) if how in outcomes), None)


def _family(day: Day, found: Sequence[str | None]) -> Row | None:
    """How many of the visible members are named as such."""
    if not day.family:
        return None
    members = zip(found[: day.family], day.noncentrality, strict=False)
    visible = [how is not None for how, beside in members if beside > VISIBLE]
    named = sum(visible)
    return {"named": named, "visible": len(visible), "found": named >= FAMILY * len(visible)}


def _entry(effect: Entry) -> float | None:
    """Probability of an effect by any of its names: base and instrument move everything alike."""
    if effect.get("probability") is None:
        return None
    alike = [e for e in effect.get("class") or [effect] if _same(e) == _same(effect)]
    return max(sum(e.get("probability") or 0.0 for e in alike), float(effect["probability"]))


def _same(effect: Entry) -> tuple[str, str]:
    """Effect and place by the first of the names that mean the same."""
    kind, where = str(effect["effect"]), str(effect["where"])
    return _TWINS.get(kind, kind), _TWINS.get(where, where)


def _effect(effect: Entry, causes: Sequence[TrueCause]) -> Row:
    given = [p for p in effect.get("parameters") or [] if p.get("std")]
    return {
        **{key: effect.get(key) for key in _KEPT},
        "class": [(name_of(e), e.get("probability")) for e in effect.get("class") or []],
        "class_size": len(effect.get("class") or []),
        "entry": _entry(effect),
        "size_in_std": max((abs(p["value"] / p["std"]) for p in given), default=None),
        "parameters": effect.get("parameters"),
        "outcome": outcome(effect, causes),
    }
