"""What a design says and shows: the plan, the proof of how good it is, and what it will determine."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from studies import document as doc
from studies.day import told as day_told
from studies.design.record import (
    CurveStepEntry,
    DesignPose,
    DesignRecord,
    PredictedStd,
    RivalPlan,
)
from studies.document import FOUR, Shown, mm, plural
from studies.entries import joint_columns
from studies.plots import deviations
from studies.plots.style import Picture

_MOST_PARAMETERS = 24  # above it base and tool are for the page
_WORTH_EXPLAINING = 0.002  # missing efficiency


def told(record: DesignRecord) -> doc.Document:
    """What was chosen and how good it is; the poses, and what they will determine."""
    headline = (
        *([doc.Sentence(record.unchecked, "warn")] if record.unchecked else []),
        doc.Sentence(_size(record)),
        doc.Sentence(_certificate(record), "good"),
    )
    section = doc.Section("plan", "The plan and its proof", tuple(_parts(record)))
    return doc.Document(headline, (section,))


def _size(record: DesignRecord) -> str:
    """How many poses were chosen, beside what, and what is measured twice."""
    said = plural(record.chosen, "pose")
    if record.reapproaches is not None:
        said += f" and {plural(len(record.reapproaches.again), 'repeat visit')}"
    if record.extends is not None:
        said += f" beside {record.extends} already measured"
    granted = f", taking for granted {'; '.join(record.granted)}" if record.granted else ""
    return (
        f"{said}. Expected error at the targets: {mm(record.task_rms_mm)} RMS, "
        f"{mm(record.task_worst_mm)} at worst{granted}."
    )


def _certificate(record: DesignRecord) -> str:
    """The proof as a sentence."""
    certified = f"Certified efficiency {doc.PROVED(record.efficiency)}"
    of = f"{record.candidates.feasible} candidates"
    if record.criterion == "task" and record.bound is not None and record.value:
        better = 100.0 * max(0.0, 1.0 - record.bound / record.value)
        return f"{certified}: no plan from {of} lowers the error by more than {better:.1f} %."
    return f"{certified} by criterion {record.criterion}: the best plan from {of} has 100 %."


def _parts(record: DesignRecord) -> Iterator[doc.Part]:
    yield from _proof(record)
    yield from _losses(record)
    yield from _facts(record)
    yield doc.Table(_poses(record), record.poses, "Poses, in the order of measuring")
    yield from _determined(record)
    if record.against:
        yield _plans(record)
    if record.curve:
        yield doc.Table(_steps(record), record.curve, "Fewer and more poses")
        yield from _reading(record)
    yield doc.Figure(lambda: deviations_by_plan(record))
    yield from (doc.Sentence(note, "note", "note") for note in record.notes)


def _proof(record: DesignRecord) -> Iterator[doc.Part]:
    yield doc.Sentence(plural(len(record.predicted_std), "parameter"), label="determines")
    beyond = "above" if record.larger_is_better else "below"
    yield doc.Sentence(
        f"{doc.FOUR(record.value)} {record.criterion_unit}; no plan is {beyond} "
        f"{doc.FOUR(record.bound)}",
        label=record.criterion,
    )
    rest, proof = 1.0 - record.efficiency, record.proof
    told = [
        doc.Sentence(
            "The proof does not depend on the search: the criterion is concave in the information of a "
            "plan, so its slope at any point bounds all plans."
        )
    ]
    if rest > _WORTH_EXPLAINING:
        solver, spread = min(proof.solver_gap, rest), 1.0 - proof.agreement_of_starts
        said = (
            f"{100.0 * solver:.2f} of the missing {100.0 * rest:.2f} % are the solver's tolerance. "
            f"Searches from different starts ended {100.0 * spread:.2f} % apart."
        )
        told.append(doc.Sentence(said))
    yield doc.Detail(tuple(told), "What the proof rests on")
    indices = [(name, own, _INDICES[name]) for name, own in record.observability.items()]
    yield doc.Detail(
        (doc.Table(_OBSERVABILITY, indices),), "Observability, by parameters of usual size"
    )


def _losses(record: DesignRecord) -> Iterator[doc.Sentence]:
    lost, markers = record.survives.loss_of_pose, record.survives.loss_of_marker
    if lost.worst is not None and lost.task_rms_mm is None:
        yield doc.Sentence(
            f"without pose {lost.worst}, some parameters are not identifiable", label="loss"
        )
    elif lost.worst is not None:
        yield doc.Sentence(
            f"without pose {lost.worst}, the worst to lose: {mm(lost.task_rms_mm)} RMS",
            label="loss",
        )
    gone = [name for name, rms in markers.items() if rms is None]
    if gone:
        yield doc.Sentence(
            f"without marker {', '.join(gone)}, some parameters are not identifiable"
        )
    elif markers:
        most = max(rms for rms in markers.values() if rms is not None)
        yield doc.Sentence(f"without any one marker: up to {mm(most)} RMS")


def _facts(record: DesignRecord) -> Iterator[doc.Sentence]:
    own = record.candidates
    removed = ", ".join(f"{name.replace('_', ' ')} {n}" for name, n in own.removed_by.items() if n)
    by = f" (removed by {removed})" if removed else ""
    yield doc.Sentence(f"{own.feasible} of {own.drawn} feasible{by}", label="candidates")
    yield doc.Sentence(
        f"{_travel(record)}, the sum of the largest joint motion of every move",
        label="travel",
    )
    if record.day is not None:
        yield from day_told(record.day)


def _travel(record: DesignRecord) -> str:
    turned, slid = record.joint_travel_deg, record.joint_travel_mm
    said = [f"{turned:.0f} deg"] if turned or not slid else []
    return " and ".join([*said, *([f"{slid:.0f} mm"] if slid else [])])


def _poses(record: DesignRecord) -> tuple[doc.Column[DesignPose], ...]:
    joints = joint_columns(record.poses, doc.HUNDREDTH, detail=False)
    return doc.columns(DesignPose, "pose", *joints, "level" if record.level_joint else "")


_DETERMINED = doc.columns(PredictedStd, "effect where name std unit")


def _determined(record: DesignRecord) -> Iterator[doc.Part]:
    """What the plan determines; base and tool on the page alone where there are many."""
    many = len(record.predicted_std) > _MOST_PARAMETERS
    placing = [p for p in record.predicted_std if many and p.effect in ("base", "tool")]
    robot = [p for p in record.predicted_std if p not in placing]
    yield doc.Table(_DETERMINED, robot, "What the plan will determine")
    if placing:
        yield doc.Detail(
            (doc.Table(_DETERMINED, placing),), "What it will determine of base and tool"
        )


_INDICES = {
    "O1": "their mean",
    "O2": "smallest by largest",
    "O3": "smallest",
    "O4": "smallest squared by largest",
    "O5": "one by the sum of their inverses",
}


_OBSERVABILITY = doc.heads(
    "index", Shown("value, larger is better", doc.TWO), "of the singular values"
)


def _plans(record: DesignRecord) -> doc.Table[tuple[Any, ...]]:
    """The plan and those beside it, by the same bound: name, poses, what it is worth."""
    plans: list[tuple[str, int, DesignRecord | RivalPlan]] = [
        ("this plan", len(record.poses), record),
        *((name, plan.poses, plan) for name, plan in record.against.items()),
    ]
    rows = [
        (name, poses, own.value, own.efficiency, own.task_rms_mm, own.trace, own.determinant)
        for name, poses, own in plans
    ]
    columns = [
        *doc.heads(
            "plan",
            *(Shown(own, FOUR) for own in ("poses", record.criterion, "efficiency\n(bound)")),
            "task RMS [mm]",
            *(Shown(own, FOUR) for own in ("trace of\ncovariance", "det(M)\n^(1/p)")),
        )
    ]
    if record.criterion == "task":
        del columns[4]  # which is the criterion's
    return doc.Table(columns, rows, "Plans judged by the same bound")


def _steps(record: DesignRecord) -> tuple[doc.Column[CurveStepEntry], ...]:
    value = doc.Column[CurveStepEntry](record.criterion, lambda row: row.value, doc.FOUR)
    rms = "" if record.criterion == "task" else "task_rms_mm"
    return doc.columns(CurveStepEntry, "poses", value, rms, "efficiency")


def _reading(record: DesignRecord) -> Iterator[doc.Sentence]:
    """What the curve tells."""
    if record.pays_until is not None:
        yield doc.Sentence(
            f"from {record.pays_until} poses on, more poses only average noise: twice as many "
            "lower the error by a third. These plans are not polished; the one above is a little "
            "better",
            label="curve",
        )
    for name, count in record.matches.items():
        said = f"{count} poses are" if count else "no plan of this range is"
        yield doc.Sentence(f"{said} as good as {name} with {record.against[name].poses}")


def deviations_by_plan(record: DesignRecord) -> Picture:
    """Standard deviations of the plan and of those judged beside it."""
    plans = {"this plan": [p.std for p in record.predicted_std]}
    plans |= {name: list(own.std) for name, own in record.against.items() if own.std}
    return deviations.by_approach(
        [p.id for p in record.predicted_std],
        [p.unit for p in record.predicted_std],
        {name: np.array(std, dtype=float) for name, std in plans.items()},
        title="Uncertainty of each parameter, by plan",
    )
