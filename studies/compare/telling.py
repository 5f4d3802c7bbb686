"""What a comparison says: the best plan, what approach #1 loses, and whether to believe it."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from typing import Any, TypeAlias

import numpy as np

from calib.arrays import Array
from studies import document as doc
from studies.compare.agreement import BELIEVED
from studies.compare.record import ComparedApproach, ComparedPlan, CompareRecord
from studies.document import Shown, listed, mm, plural
from studies.plots import deviations, ellipses
from studies.plots.style import APPROACHES, Picture

_MOST_PARAMETERS = 24  # above it base and tool are for the page
_MOST_NAMES = 4
_SAME = 1.005
_MOODS: dict[bool | None, doc.Mood] = {None: "", True: "good", False: "warn"}
_TITLES = {
    "pose plain": "#1\nplain",
    "pose normalised": "#1\nnorm.",
    "pose full": "#1\nfull",
    "points": "#2\npoints",
}


def told(record: CompareRecord) -> doc.Document:
    """The answer, accuracy of every approach at every plan, and what each parameter is known to."""
    says = record.agreement.says
    headline = (
        _best(record),
        doc.Sentence(f"{says[:1].upper()}{says[1:]}.", _MOODS[record.agreement.believed]),
    )
    section = doc.Section("approaches", "Both methods side by side", tuple(_parts(record)))
    return doc.Document(headline, (section,))


def _best(record: CompareRecord) -> doc.Sentence:
    """The plan that leaves the smallest error."""
    p = plural(len(record.plans[0].ids), "parameter")
    known = _known(record)
    if not known:
        return doc.Sentence(f"No plan determines all {p}.", "warn")
    best = min(known, key=lambda name: known[name])
    if len(record.plans) == 1:
        return doc.Sentence(
            f"{best}: expected error {mm(known[best])} RMS from marker points (#2)."
        )
    return doc.Sentence(
        f"Best of {plural(len(record.plans), 'plan')}: {best}, with an expected error of "
        f"{mm(known[best])} RMS from marker points (#2)."
    )


def _known(record: CompareRecord) -> dict[str, float]:
    """Task RMS with approach #2 of the plans that determine every parameter."""
    rms = {plan.plan: plan.points.task_rms_mm for plan in record.plans}
    return {name: value for name, value in rms.items() if value is not None}


def _parts(record: CompareRecord) -> Iterator[doc.Part]:
    yield from _others(record)
    yield from _gain(record)
    yield from _belief(record)
    yield from _lost(record)
    yield doc.Table(
        _ACCURACY,
        list(_accuracy(record)),
        "Error expected at the targets",
        "Simulated: standard deviation over simulated experiments. p: probability of such a difference "
        "by chance.",
    )
    if len(record.plans) == 1:
        yield from _by_approach(record.plans[0], record.trials > 1)
    else:
        yield from _by_plan(record)
    yield from (doc.Figure(draw) for draw in pictures(record))
    yield from (doc.Sentence(note, "note", "note") for note in record.notes)


def _others(record: CompareRecord) -> Iterator[doc.Sentence]:
    """What the other plans need to draw level."""
    known = _known(record)
    least = min(known.values(), default=0.0)
    for name, value in known.items():
        if value > _SAME * least:
            times = (value / least) ** 2
            yield doc.Sentence(
                f"{name} has to be measured {times:.2f} times to match it",
                label="plans",
            )


def _gain(record: CompareRecord) -> Iterator[doc.Sentence]:
    """What approach #1 loses, plain and by its full covariance."""
    if all(plan.of("pose full") is None for plan in record.plans):
        yield doc.Sentence(
            "full pose (#1) needs three markers that are not in line; marker points (#2) do not",
            label="method",
        )
        return
    factors = [f.factor for plan in record.plans for f in plan.improvement if f.factor is not None]
    if not factors:
        return
    yield doc.Sentence(
        f"full pose (#1), plainly weighted, is {min(factors):.2f} to {max(factors):.3g} times less "
        "certain than marker points (#2)",
        label="method",
    )
    worst = max(map(_loss, record.plans))
    yield doc.Sentence(
        "weighted by its full covariance, #1 equals #2"
        if worst < _SAME
        else f"weighted by its full covariance, #1 is up to {worst:.2f} times less certain: it has to "
        "estimate the marker geometry first"
    )


def _loss(plan: ComparedPlan) -> float:
    """Largest ratio of standard deviations, fully weighted #1 over #2."""
    full = plan.of("pose full")
    if full is None:
        return 1.0
    pairs = [(a.std, b.std) for a, b in zip(full.parameters, plan.points.parameters, strict=True)]
    if any((a is None) != (b is None) for a, b in pairs):
        return 1.0
    return max([1.0, *(a / b for a, b in pairs if a is not None and b)])


def _belief(record: CompareRecord) -> Iterator[doc.Sentence]:
    found = record.agreement
    if not record.trials:
        return
    yield doc.Sentence(f"{plural(record.trials, 'simulated experiment')} a plan", label="simulated")
    low, high = found.worst_ratio_band99
    if found.chi2_p is not None and found.worst_ratio is not None and low and high:
        yield doc.Sentence(
            f"standard deviations, simulated over predicted: {found.worst_ratio:.2f} farthest from one "
            f"({low:.2f} to {high:.2f} by chance among {found.ratios}); p = {doc.P(found.chi2_p)}, "
            f"refuted below {BELIEVED}"
        )
    for plan in record.plans:
        for own in plan.approaches:
            if own.not_converged:
                yield doc.Sentence(
                    f"{own.not_converged} of {record.trials} fits of {_label(own)} at {plan.plan} "
                    "did not converge and are left out"
                )


def _lost(record: CompareRecord) -> Iterator[doc.Sentence]:
    """What hidden markers and undetermined parameters take away."""
    for plan in record.plans:
        if plan.hidden_markers:
            less = plan.readings_without_pose
            few = f"; too few markers for #1 in {plural(less, 'reading')}" if less else ""
            hidden = plural(plan.hidden_markers, "point")
            yield doc.Sentence(f"{hidden} of {plan.plan} out of sight{few}", label="hidden")
        names = [p.id for p in plan.points.parameters if p.std is None]
        if names:
            yield doc.Sentence(
                f"{plan.plan} does not determine {listed(names, _MOST_NAMES)}. The other figures take "
                "these as nominal",
                "warn",
                "open",
            )


def _label(own: ComparedApproach) -> str:
    length = "" if own.length_mm is None else f" ({own.length_mm:g} mm)"
    return APPROACHES[own.key].label + length


_ACCURACY = doc.heads(
    "plan",
    Shown("poses", doc.COUNT),
    "method",
    *("error\nRMS [mm]", "at worst [mm]", "simulated [mm]"),
    Shown("p", doc.P),
)


def _accuracy(record: CompareRecord) -> Iterator[tuple[Any, ...]]:
    """Every approach at every plan, the plan named once."""
    for plan in record.plans:
        for k, own in enumerate(plan.approaches):
            named = ("", 0) if k else (plan.plan, plan.poses)
            p = own.agreement and own.agreement.chi2_p
            rms, worst, simulated = own.task_rms_mm, own.task_worst_mm, own.monte_carlo_task_rms_mm
            yield *named, _label(own), rms, worst, simulated, p


_Values: TypeAlias = list[tuple[Shown, list[Any]]]
"""Columns with a value for each parameter."""


def _by_approach(plan: ComparedPlan, simulated: bool) -> Iterator[doc.Part]:
    """Standard deviations under every approach, and what plain #1 loses."""
    columns = [
        _std(_TITLES[own.key], own)
        for own in plan.approaches
        if own.key != "pose full" or _loss(plan) > _SAME
    ]
    if simulated:
        drawn = [p.monte_carlo_std for p in plan.points.parameters]
        columns.append((Shown("#2\nsim.", doc.STD), drawn))
    if plan.improvement:
        factors = [f.factor for f in plan.improvement]
        columns.append((Shown("plain\nover #2", doc.HUNDREDTH), factors))
    loses = ", and what plain #1 loses" if plan.improvement else ""
    yield from _tables(plan, columns, f"Standard deviations{loses}")


def _by_plan(record: CompareRecord) -> Iterator[doc.Part]:
    """Standard deviations of approach #2 at each plan, where all have the same parameters."""
    first = record.plans[0]
    shared = [plan for plan in record.plans if plan.ids == first.ids]
    columns = [_std(plan.plan, plan.points) for plan in shared]
    yield from _tables(first, columns, "Standard deviations from marker points (#2) at each plan")
    for plan in record.plans:
        if plan not in shared:
            yield doc.Sentence(f"{plan.plan} has other parameters (JSON)", "note")


def _std(title: str, own: ComparedApproach) -> tuple[Shown, list[Any]]:
    return Shown(title, doc.STD), [p.std for p in own.parameters]


def _tables(plan: ComparedPlan, values: _Values, name: str) -> Iterator[doc.Part]:
    """By parameter; those of base and tool on the page alone where there are many."""
    points = plan.points.parameters
    columns = doc.heads("effect", "where", "parameter", "unit", *(head for head, _ in values))
    many = len(points) > _MOST_PARAMETERS
    placing = [i for i, p in enumerate(points) if many and p.effect in ("base", "tool")]
    robot = [i for i in range(len(points)) if i not in placing]

    def rows(chosen: list[int]) -> Iterator[tuple[Any, ...]]:
        named: set[str] = set()
        for i in chosen:
            p = points[i]
            effect, plain = p.effect, p.name.replace("compliance@", "@")
            yield (
                "" if effect in named else effect,
                p.where,
                plain,
                p.unit,
                *(own[i] for _, own in values),
            )
            named.add(effect)

    yield doc.Table(columns, list(rows(robot)), name)
    if placing:
        table = doc.Table(columns, list(rows(placing)))
        yield doc.Detail((table,), f"{name}, base and tool")


Draw = Callable[[], Picture]

_MOST = 20  # plans that a figure can keep apart; the table holds them all


def pictures(record: CompareRecord) -> Iterator[Draw]:
    """Every figure, plan by plan; file names begin with the plan's where there are several."""
    if 1 < len(record.plans) <= _MOST:
        yield lambda: by_plan(record)
    for plan in record.plans:
        for draw in of_plan(plan):
            yield draw if len(record.plans) == 1 else partial(_named, plan, draw)


def _named(plan: ComparedPlan, draw: Draw) -> Picture:
    picture = draw()
    start = re.sub(r"[^\w.-]+", "_", plan.plan.removesuffix(".csv"))
    return replace(picture, name=f"{start}_{picture.name}", title=f"{plan.plan}: {picture.title}")


def by_plan(record: CompareRecord) -> Picture:
    """Standard deviations of approach #2 at every plan of the same parameters side by side."""
    first = record.plans[0]
    return deviations.by_approach(
        first.ids,
        _units(first),
        {plan.plan: _deviations(plan.points) for plan in record.plans if plan.ids == first.ids},
        name="plans",
        title="Uncertainty of each parameter, by plan (approach #2)",
    )


def of_plan(plan: ComparedPlan) -> Iterator[Draw]:
    """Figures of one plan, as far as the result holds what they show."""
    yield lambda: by_approach(plan)
    if plan.entangled:
        yield lambda: entangled(plan)


def by_approach(plan: ComparedPlan) -> Picture:
    """Standard deviations by approach."""
    return deviations.by_approach(
        plan.ids, _units(plan), {own.key: _deviations(own) for own in plan.approaches}
    )


def entangled(plan: ComparedPlan) -> Picture:
    """Error ellipses of the parameters that go together most."""
    unit, first = dict(zip(plan.ids, _units(plan), strict=True)), plan.entangled[0]
    return ellipses.ellipses(
        [(a, unit[a], b, unit[b]) for a, b in (pair.ids for pair in plan.entangled)],
        {k: np.array([pair.covariance[k] for pair in plan.entangled]) for k in first.covariance},
    )


def _units(plan: ComparedPlan) -> list[str]:
    return [p.unit for p in plan.points.parameters]


def _deviations(own: ComparedApproach) -> Array:
    return np.array([p.std for p in own.parameters], dtype=float)
