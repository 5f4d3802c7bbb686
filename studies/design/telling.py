"""What a design says: the plan, the proof of how good it is, and what it will determine."""

from __future__ import annotations

from collections.abc import Iterator

from studies.design.pictures import pictures
from studies.design.record import CurveStep, DesignPose, DesignRecord, PredictedStd, RivalPlan
from studies.document import (
    FOUR,
    HUNDREDTH,
    MM,
    PROVED,
    STD,
    TEXT,
    TWO,
    Column,
    Detail,
    Document,
    Figure,
    Part,
    Section,
    Sentence,
    Table,
    mm,
    plural,
)
from studies.joints import joint_columns
from studies.targets import over_the_workspace

_MOST_PARAMETERS = 24  # above it base and tool are for the page
_WORTH_EXPLAINING = 0.002  # missing efficiency


def told(record: DesignRecord) -> Document:
    """What was chosen and how good it is; the poses, and what they will determine."""
    headline = (
        *([Sentence(record.unchecked, "warn")] if record.unchecked else []),
        Sentence(_size(record)),
        Sentence(_certificate(record), "good"),
    )
    section = Section("plan", "The plan and its proof", tuple(_parts(record)))
    return Document(headline, (section,))


def _size(record: DesignRecord) -> str:
    """How many poses were chosen, beside what, and what is measured twice."""
    said = plural(record.chosen, "pose")
    if record.reference is not None:
        repeats = plural(len(record.reference.poses), "repeat")
        said += f" and {repeats} of {record.reference.pose}"
    if record.reapproaches is not None:
        said += f" and {plural(len(record.reapproaches.again), 'repeat visit')}"
    if record.extends is not None:
        said += f" beside {record.extends} already measured"
    return (
        f"{said}. Expected error at the targets: {mm(record.task_rms_mm)} RMS, "
        f"{mm(record.task_worst_mm)} at worst."
    )


def _certificate(record: DesignRecord) -> str:
    """The proof as a sentence."""
    proof, fresh = record.proof, record.proof.efficiency_fresh
    squared = " (of the squared RMS)" if record.criterion.startswith("task") else ""
    if proof.proved_optimal:
        best, found = "", plural(proof.nodes, "node")
        if fresh is not None:
            best = f"; certified efficiency {PROVED(fresh)}{squared} among fresh candidates"
        return f"No plan of these candidates is better: proved by branch and bound ({found}){best}."
    certified = f"Certified efficiency {PROVED(record.efficiency)}"
    of = f"{record.candidates.feasible} candidates"
    if record.criterion == "task" and record.bound is not None and record.value:
        better = 100.0 * max(0.0, 1.0 - record.bound / record.value)
        return f"{certified}: no plan from {of} lowers the error by more than {better:.1f} %."
    return f"{certified} by criterion {record.criterion}: the best plan from {of} has 100 %."


def _parts(record: DesignRecord) -> Iterator[Part]:
    yield from _proof(record)
    yield from _losses(record)
    yield from _facts(record)
    yield Table(_poses(record), record.poses, "Poses, in the order of measuring", of_poses=True)
    yield from _determined(record)
    if record.against:
        yield _plans(record)
    if record.curve:
        yield Table(_steps(record), record.curve, "Fewer and more poses")
        yield from _reading(record)
    drawn = [Figure(draw) for draw in pictures(record)]
    if record.at_targets:
        drawn.append(Figure(lambda: over_the_workspace(record.at_targets)))
    yield Detail(tuple(drawn), "Figures of the plan")
    yield from (Sentence(note, "note", "note") for note in record.notes)


def _proof(record: DesignRecord) -> Iterator[Part]:
    yield Sentence(plural(len(record.predicted_std), "parameter"), label="determines")
    beyond = "above" if record.larger_is_better else "below"
    yield Sentence(
        f"{FOUR(record.value)} {record.criterion_unit}; no plan is {beyond} {FOUR(record.bound)}",
        label=record.criterion,
    )
    rest, proof = 1.0 - record.efficiency, record.proof
    told = [
        Sentence(
            "The proof does not depend on the search: the criterion is concave in the information of a "
            "plan, so its slope at any point bounds all plans."
        )
    ]
    if rest > _WORTH_EXPLAINING and not proof.proved_optimal:
        solver, spread = min(proof.solver_gap, rest), 1.0 - proof.agreement_of_starts
        said = (
            f"{100.0 * solver:.2f} of the missing {100.0 * rest:.2f} % are the solver's tolerance. "
            f"Searches from different starts ended {100.0 * spread:.2f} % apart."
        )
        told.append(Sentence(said))
    yield Detail(tuple(told), "What the proof rests on")
    indices = list(record.observability.items())
    yield Detail((Table(_OBSERVABILITY, indices),), "Observability, by parameters of usual size")


def _losses(record: DesignRecord) -> Iterator[Sentence]:
    lost, markers = record.survives.loss_of_pose, record.survives.loss_of_marker
    if lost.worst is not None and lost.task_rms_mm is None:
        yield Sentence(
            f"without pose {lost.worst}, some parameters are not identifiable", label="loss"
        )
    elif lost.worst is not None:
        kept = "" if lost.efficiency is None else (
            f" (certified efficiency of what remains: {PROVED(lost.efficiency)})"
        )  # fmt: skip
        yield Sentence(
            f"without pose {lost.worst}, the worst to lose: {mm(lost.task_rms_mm)} RMS{kept}",
            label="loss",
        )
    gone = [name for name, rms in markers.items() if rms is None]
    if gone:
        yield Sentence(f"without marker {', '.join(gone)}, some parameters are not identifiable")
    elif markers:
        most = max(rms for rms in markers.values() if rms is not None)
        yield Sentence(f"without any one marker: up to {mm(most)} RMS")


def _facts(record: DesignRecord) -> Iterator[Sentence]:
    own = record.candidates
    removed = ", ".join(f"{name.replace('_', ' ')} {n}" for name, n in own.removed_by.items() if n)
    by = f" (removed by {removed})" if removed else ""
    yield Sentence(f"{own.feasible} of {own.drawn} feasible{by}", label="candidates")
    yield Sentence(
        f"{_travel(record)}, the sum of the largest joint motion of every move",
        label="travel",
    )


def _travel(record: DesignRecord) -> str:
    turned, slid = record.joint_travel_deg, record.joint_travel_mm
    said = [f"{turned:.0f} deg"] if turned or not slid else []
    return " and ".join([*said, *([f"{slid:.0f} mm"] if slid else [])])


def _poses(record: DesignRecord) -> tuple[Column[DesignPose], ...]:
    named: Column[DesignPose] = Column("pose", lambda row: row.pose)
    level: Column[DesignPose] = Column("level", lambda row: row.level, FOUR, detail=True)
    joints = joint_columns(record.poses, HUNDREDTH, detail=False)
    return (named, *joints, level) if record.level_joint else (named, *joints)


_DETERMINED: tuple[Column[PredictedStd], ...] = (
    Column("effect", lambda row: row.effect, TEXT),
    Column("where", lambda row: row.where, TEXT),
    Column("parameter", lambda row: row.name, TEXT),
    Column("expected standard\ndeviation", lambda row: row.std, STD),
    Column("unit", lambda row: row.unit, TEXT),
)


def _determined(record: DesignRecord) -> Iterator[Part]:
    """What the plan determines; base and tool on the page alone where there are many."""
    many = len(record.predicted_std) > _MOST_PARAMETERS
    placing = [p for p in record.predicted_std if many and p.effect in ("base", "tool")]
    robot = [p for p in record.predicted_std if p not in placing]
    yield Table(_DETERMINED, robot, "What the plan will determine")
    if placing:
        yield Detail((Table(_DETERMINED, placing),), "What it will determine of base and tool")


_INDICES = {
    "O1": "their mean",
    "O2": "smallest by largest",
    "O3": "smallest",
    "O4": "smallest squared by largest",
    "O5": "one by the sum of their inverses",
}


_OBSERVABILITY: tuple[Column[tuple[str, float]], ...] = (
    Column("index", lambda row: row[0]),
    Column("value, larger is better", lambda row: row[1], TWO),
    Column("of the singular values", lambda row: _INDICES[row[0]]),
)


def _plans(record: DesignRecord) -> Table[tuple[str, int, DesignRecord | RivalPlan]]:
    """The plan and those beside it, by the same bound: name, poses, what it is worth."""
    plans: list[tuple[str, int, DesignRecord | RivalPlan]] = [
        ("this plan", record.proved, record),
        *((name, plan.poses, plan) for name, plan in record.against.items()),
    ]
    columns: list[Column[tuple[str, int, DesignRecord | RivalPlan]]] = [
        Column("plan", lambda row: row[0]),
        Column("poses", lambda row: row[1], FOUR),
        Column(record.criterion, lambda row: row[2].value, FOUR),
        Column("efficiency\n(bound)", lambda row: row[2].efficiency, FOUR),
        Column("task RMS", lambda row: row[2].task_rms_mm, MM, "mm"),
        Column("trace of\ncovariance", lambda row: row[2].trace, FOUR),
        Column("det(M)\n^(1/p)", lambda row: row[2].determinant, FOUR),
    ]
    if record.criterion == "task":
        del columns[4]  # which is the criterion's
    return Table(columns, plans, "Plans judged by the same bound")


_STEP_RMS: Column[CurveStep] = Column("task RMS", lambda row: row.task_rms_mm, MM, "mm")


def _steps(record: DesignRecord) -> tuple[Column[CurveStep], ...]:
    return (
        Column("poses", lambda row: row.poses, FOUR),
        Column(record.criterion, lambda row: row.value, FOUR),
        *(() if record.criterion == "task" else (_STEP_RMS,)),
        Column("efficiency\n(bound)", lambda row: row.efficiency, FOUR),
    )


def _reading(record: DesignRecord) -> Iterator[Sentence]:
    """What the curve tells."""
    if record.pays_until is not None:
        yield Sentence(
            f"from {record.pays_until} poses on, more poses only average noise: twice as many "
            "lower the error by a third. These plans are not polished; the one above is a little "
            "better",
            label="curve",
        )
    for name, count in record.matches.items():
        said = f"{count} poses are" if count else "no plan of this range is"
        yield Sentence(f"{said} as good as {name} with {record.against[name].poses}")
