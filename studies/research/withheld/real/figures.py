"""What is asked of cases of real arms, beside the figures of the first families."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from studies.research.withheld.figures import Bar, Figure, Questions, Rate, Test
from studies.research.withheld.judge import CONFIDENT, CauseJudged, Judgement

_FIGURES: tuple[Figure, ...] = (
    ("null", None, "false alarms", lambda j: j.alarm, (0.0, 0.04)),
    ("null", None, "confidently misnamed", lambda j: j.sure_wrong, (0.0, 0.03)),
    ("single", True, "something found", lambda j: j.gap, None),
    ("single", True, "named exactly", lambda j: j.exact, None),
    ("single", True, "within its class", lambda j: j.found, (0.93, 1.0)),
    ("single", True, "located", lambda j: j.located, (0.95, 1.0)),
    ("single", True, "confidently misnamed", lambda j: j.sure_wrong, (0.0, 0.03)),
    ("single", False, "within its class", lambda j: j.found, None),
    ("single", False, "confidently misnamed", lambda j: j.sure_wrong, (0.0, 0.03)),
    ("mixture", True, "something found", lambda j: j.gap, None),
    ("mixture", True, "confidently misnamed", lambda j: j.sure_wrong, (0.0, 0.03)),
    ("whole", True, "its kind named", lambda j: _kind_named(j), None),
    ("whole", True, "confidently misnamed", lambda j: j.sure_wrong, (0.0, 0.03)),
    ("outside", True, "something found", lambda j: j.gap, None),
    ("outside", True, "unknown and located", lambda j: j.unknown_located, (0.85, 1.0)),
    ("outside", True, "located", lambda j: j.located, None),
    ("outside", True, "located with its variable", lambda j: j.depends, None),
    ("outside", True, "confidently misnamed", lambda j: j.sure_wrong, (0.0, 0.03)),
)
_CONDITIONS: dict[str, Test] = {
    "once a visit": lambda j: j.conditions["visit"] == "once",
    "free and loaded": lambda j: j.conditions["visit"] == "free and loaded",
    "thrice without a move": lambda j: j.conditions["visit"] == "thrice",
    "one marker": lambda j: bool(j.conditions["one_marker"]),
    "no time column": lambda j: j.conditions["missing"] == "time",
    "other columns missing": lambda j: j.conditions["missing"] not in (None, "time"),
    "ripples in the background": lambda j: bool(j.conditions["background"]),
    "torques measured": lambda j: bool(j.conditions["torques"]),
    "gear ratios said": lambda j: bool(j.conditions["ratios_said"]),
    "one joint on a grid": lambda j: bool(j.conditions["grid"]),
    "arm noise, said": lambda j: j.conditions.get("arm_noise") == "said",
    "arm noise, unsaid": lambda j: j.conditions.get("arm_noise") == "unsaid",
    "sigma wrong": lambda j: bool(j.conditions["wrong_sigma"]),
    "outliers": lambda j: bool(j.conditions["outliers"]),
    "hidden markers": lambda j: bool(j.conditions["hidden"]),
    "geometry known": lambda j: bool(j.conditions["known_geometry"]),
}
_EACH = "mixture, each visible cause"
_JOINT = "whole, each visible joint"
_AGAIN = (
    ("null", "false alarms"),
    ("single, visible", "within its class"),
    ("single, visible", "located"),
    (_EACH, "cause found"),
    (_JOINT, "joint found"),
    ("outside, visible", "unknown and located"),
)
_SIZES = ((60.0, 200.0), (200.0, 600.0), (600.0, float("inf")))


@dataclass(frozen=True)
class _Real(Questions):
    def rates(self, judged: Sequence[Judgement]) -> list[Rate]:
        return [*super().rates(judged), *_each(judged), *_overall(judged)]


REAL = _Real(_FIGURES, _CONDITIONS, _AGAIN, ("single", "mixture", "whole"), (1.06, 1.2))


def _each(judged: Sequence[Judgement]) -> list[Rate]:
    """Causes of mixtures and joints of whole arms, one by one, by class membership."""
    mixed, joints = _causes(judged, "mixture"), _causes(judged, "whole")
    found = [
        _found(_EACH, "cause found", mixed, (0.75, 1.0)),
        *(_found(_EACH, _band(size), [c for c in mixed if _within(c, size)]) for size in _SIZES),
    ]
    several = [j for j in judged if j.family == "mixture" and j.visible]
    for low, high in ((3, 4), (5, 6), (7, 8)):
        own = [j for j in several if low <= len(j.causes) <= high]
        found.append(_found(_EACH, f"of {low} or {high} causes", _causes(own, "mixture")))
    return [*found, _found(_JOINT, "joint found", joints)]


def _overall(judged: Sequence[Judgement]) -> list[Rate]:
    """What holds for all cases together: held-out errors that rose, names that were sure."""
    both = [j for j in judged if j.answered and j.before_over_floor < float("inf")]
    rose = sum(not j.over_floor <= j.before_over_floor * (1.0 + 1e-6) for j in both)
    sure = [right for j in judged for p, right in j.statements if p >= CONFIDENT]
    near = [right for j in judged for p, right in j.statements if 0.925 <= p < 0.975]
    return [
        Rate("all", "held-out after above before", rose, len(both), (0.0, 0.01)),
        Rate(
            "all",
            "confidently misnamed",
            sum(j.sure_wrong for j in judged),
            len(judged),
            (0.0, 0.03),
        ),
        Rate("names", "given 0.90 or more, right", sum(sure), len(sure)),
        Rate("names", "given 0.925 to 0.975, right", sum(near), len(near), (0.93, 0.97)),
    ]


def verdicts(judged: Iterable[Judgement]) -> dict[str, dict[str, int]]:
    """How often each visible cause outside the catalogue got each verdict."""
    found: dict[str, Counter[str]] = {}
    for j in judged:
        if j.family == "outside" and j.visible:
            found.setdefault(j.truth[0].partition(":")[0], Counter())[j.verdict] += 1
    return {cause: dict(found[cause]) for cause in sorted(found)}


def _causes(judged: Iterable[Judgement], family: str) -> list[CauseJudged]:
    return [c for j in judged if j.family == family for c in j.causes if c.visible]


def _found(family: str, figure: str, causes: Sequence[CauseJudged], bar: Bar | None = None) -> Rate:
    return Rate(family, figure, sum(c.found for c in causes), len(causes), bar)


def _within(cause: CauseJudged, size: tuple[float, float]) -> bool:
    return size[0] < cause.beside <= size[1]


def _band(size: tuple[float, float]) -> str:
    low, high = size
    return (
        f"noncentrality above {low:g}"
        if high == float("inf")
        else f"noncentrality {low:g} to {high:g}"
    )


def _kind_named(j: Judgement) -> bool:
    kind = j.truth[0].partition(":")[0]
    return any(name.partition(":")[0] == kind for name in j.named)
