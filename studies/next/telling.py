"""What a proposal says: go on with these poses, or stop, and why."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from studies.document import (
    PROBABILITY,
    Column,
    Document,
    Mood,
    Part,
    Section,
    Sentence,
    Table,
    listed,
    mm,
    plural,
)
from studies.joints import joint_columns
from studies.next.record import NextRecord, ProposedPose, RivalPair

_DIAGNOSED = {
    "no_gap": "The diagnosis finds no unmodelled error so far.",
    "explained": "The model lacks causes that the diagnosis finds. Run `posecal diagnose --cell-out`.",
    "ambiguous": "The model lacks something; several causes fit. Run `posecal diagnose`.",
    "unknown": "The model lacks something of unknown cause. Run `posecal diagnose`.",
}
_STOPS = {
    "goal": "the goal is reached, 19 times in 20",
    "beyond_reach": "more poses will not reach the goal",
    "averages": "more poses would only average noise",
    "settled": "no causes are left to tell apart",
    "nothing_found": "no cause in the catalogue explains the error",
    "no_pose_helps": "no pose tells the remaining causes apart",
}


def told(record: NextRecord) -> Document:
    """Go on or stop, the poses, and what is expected of them."""
    section = Section("next", "What to measure next", tuple(_parts(record)))
    return Document(tuple(_headline(record)), (section,))


def _headline(record: NextRecord) -> Iterator[Sentence]:
    why = " and ".join(_STOPS[stop] for stop in record.stops)
    if record.done:
        mood: Mood = "good" if {"goal", "settled", "averages"} & {*record.stops} else "warn"
        yield Sentence(f"Stop: {why}.", mood)
    else:
        own = {name for p in record.poses for name in _SERVES_BOTH.get(p.serves, (p.serves,))}
        serves = " and ".join(name for name in ("causes", "task") if name in own)
        yield Sentence(f"Measure {plural(len(record.poses), 'pose')} more, for {serves}.", "next")
        if why:
            yield Sentence(f"{why[0].upper()}{why[1:]}.")
    now, after = record.now, record.after
    if now is not None:
        goal = "" if record.goal_mm is None else f" (goal {record.goal_mm:g} mm)"
        yield Sentence(
            f"Expected error at the targets now: {mm(now.task_rms_mm)} RMS, below "
            f"{mm(now.task_most_mm)} 19 times in 20{goal}."
        )
    if now is not None and now.open:
        yield Sentence(f"Not identifiable yet: {listed(now.open, 5)}.", "warn")
    if record.shares is not None:
        yield Sentence(
            f"A compromise: {100.0 * record.shares.causes:.0f} % as good for the diagnosis, "
            f"{100.0 * record.shares.task:.0f} % for accuracy, as poses for one alone."
        )
    elif after is not None and not record.done:
        more = after.readings - (0 if now is None else now.readings)
        yield Sentence(f"After {plural(more, 'reading')} more: {mm(after.task_rms_mm)} RMS.")
    if record.verdict is not None:
        yield Sentence(_DIAGNOSED[record.verdict])


def _parts(record: NextRecord) -> Iterator[Part]:
    columns: tuple[Column[Any], ...] = (_POSE, *joint_columns(record.poses, detail=False), _SERVES)
    yield Table(columns, record.poses, "Poses to measure next")
    yield Table(_DOUBTS, record.doubts, "Causes to tell apart")
    yield Table(_FORMS, record.forms, "Causes whose form is not checked yet")


_SERVES_BOTH = {"both": ("causes", "task")}
_POSE: Column[ProposedPose] = Column("next pose", lambda row: row.pose)
_SERVES: Column[ProposedPose] = Column("for", lambda row: row.serves)
_DOUBTS: tuple[Column[RivalPair], ...] = (
    Column("causes to tell apart", lambda row: " or ".join(row.rivals)),
    Column("right choice now", lambda row: row.now, PROBABILITY),
    Column("with these poses", lambda row: row.after, PROBABILITY),
)
_FORMS: tuple[Column[RivalPair], ...] = (
    Column("cause found", lambda row: row.rivals[0]),
    Column("form checked now", lambda row: row.now, PROBABILITY),
    Column("with these poses", lambda row: row.after, PROBABILITY),
)
