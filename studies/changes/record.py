"""What ``posecal changes`` finds."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Literal

import numpy as np
from pydantic import Field

from studies.document import P, Shown
from studies.entries import CauseEntry
from studies.record import (
    OWN_UNIT,
    BeforeAfter,
    Count,
    Entry,
    Envelope,
    From,
    IntervalEntry,
    Judgement,
    Maybe,
    MaybePositive,
    NotNegative,
    Number,
    Positive,
    Record,
)

if TYPE_CHECKING:
    from calib.change import Changes
    from calib.change.causes import ChangeCause, Explanation
    from calib.change.comparison import AtTargets
    from studies.changes.days import ComparedDays

_MM = 1e3
_MOST = 8  # causes that are kept
_KNOWN = 1e8  # degrees of freedom from which noise counts as known


class DifferenceTest(Entry):
    """Against "nothing changed": the squared difference over the rows that both days determine.

    dof : of the noise behind it, None where that was known
    """

    statistic: NotNegative
    rows: Annotated[Count, From("whitened")]
    dof: Maybe
    p: Annotated[NotNegative, From("p_value")]
    false_alarm: Positive


class ChangedParameter(Entry):
    """A parameter, after minus before; std and family_p are None where a day does not determine it."""

    id: str
    effect: str
    where: str
    name: str
    change: Annotated[Number, OWN_UNIT]
    std: Annotated[MaybePositive, Shown("standard\ndeviation"), OWN_UNIT]
    family_p: Annotated[Maybe, Shown("p, of all\ntogether", P)]
    moved: bool
    unit: str


class UncomparedParameter(Entry):
    """A parameter of one result only, which takes no part; sigmas : its size in standard deviations."""

    id: str
    sigmas: NotNegative


class FitResiduals(Entry):
    """What the fits leave, 3-D RMS per point; p : of so much more on the later day by chance.

    excess : of the day with more, beyond the instrument; it counts as errors of the drives that were
    there on both days
    """

    before_mm: Annotated[NotNegative, From("left.0")]
    after_mm: Annotated[NotNegative, From("left.1")]
    p: Annotated[NotNegative, From("grown")]
    grown: Annotated[bool, From("leaves_more")]
    excess_mm: NotNegative


class CauseSize(Entry):
    """A size of a cause; None where the difference does not tell it."""

    name: str
    value: Annotated[Maybe, OWN_UNIT]
    std: Annotated[MaybePositive, OWN_UNIT]
    unit: str


class CauseExplanation(CauseEntry):
    """A cause beside the difference.

    effect : ``base`` and ``tool`` moved as a whole, ``marker``, or an effect
    share : of the squared difference; p_left : of what is left over, by chance
    """

    probability: NotNegative
    share: Annotated[Number, Shown("share of the\ndifference")]
    p_left: Annotated[NotNegative, Shown("p of\nthe rest", P)]
    explains: bool
    likely: bool
    sizes: tuple[CauseSize, ...]


class AtTarget(Entry):
    """What lies between the days at a target, and the error there with the values of before."""

    pose: str
    change_mm: IntervalEntry
    kept_mm: IntervalEntry


_OUTCOMES: dict[str, Literal["pass", "fail", "undecided"]] = {
    "holds": "pass",
    "does_not": "fail",
    "cannot_be_said": "undecided",
}


class ChangesRecord(Record):
    """What moved between two results of one robot.

    change : of the robot between the days; kept : with the values of BEFORE on the robot of AFTER;
    renewed : with those of AFTER; outside : RMS at most that may have come up outside the model, None
    where a result tells no poses; rest : beside each, by what the model lacks and the arm's scatter
    """

    command: Literal["changes"] = "changes"
    before: str
    after: str
    status: Literal["unchanged", "changed"]
    test: DifferenceTest
    parameters: tuple[ChangedParameter, ...] = Field(min_length=1)
    apart: Annotated[tuple[str, ...], From("difference.apart")]
    alone: tuple[UncomparedParameter, ...]
    left: FitResiduals
    cause: Annotated[Literal["none", "named", "ambiguous", "unclear"], From("told")]
    causes: tuple[CauseExplanation, ...]
    same_as: tuple[CauseEntry, ...]
    hidden: tuple[CauseEntry, ...]
    targets: Annotated[str, From("cell.targets_in_words")]
    change_rms_mm: Annotated[IntervalEntry, From("change.rms")]
    change_worst_mm: Annotated[IntervalEntry, From("change.worst")]
    kept_rms_mm: Annotated[IntervalEntry, From("expected.0")]
    kept_worst_mm: Annotated[IntervalEntry, From("expected.1")]
    renewed_rms_mm: NotNegative
    rest_mm: NotNegative
    outside_mm: NotNegative | None
    worst_at: str
    at_targets: tuple[AtTarget, ...] = Field(min_length=1)
    tolerance_mm: Positive | None
    verdict: Literal["holds", "does_not", "cannot_be_said"] | None

    @property
    def error(self) -> BeforeAfter:
        """At the targets today, with the values of before and with those of after."""
        judged = None
        if self.verdict is not None:
            by = f"tolerance {self.tolerance_mm:g} mm at any target, with {self.before}"
            judged = Judgement(_OUTCOMES[self.verdict], by)
        return BeforeAfter(
            self.kept_rms_mm.value,
            self.renewed_rms_mm,
            "RMS error at the targets today",
            ends=(f"with {self.before}", f"with {self.after}"),
            judged=judged,
        )


def changes_record(found: Changes, days: ComparedDays, made_from: Envelope) -> ChangesRecord:
    """The record of a comparison."""
    from calib.change.difference import FALSE_ALARM

    apart = found.difference
    return ChangesRecord.from_result(
        found,
        days,
        **made_from,
        warnings=days.notes,
        before=days.before_path.name,
        after=days.after_path.name,
        status="changed" if apart.changed else "unchanged",
        test=DifferenceTest.from_result(
            apart,
            dof=apart.dof if apart.dof < _KNOWN else None,
            false_alarm=FALSE_ALARM,
        ),
        parameters=ChangedParameter.from_each(
            found.parameters,
            change=apart.change,
            std=apart.std,
            family_p=apart.family_p,
            moved=apart.changed_parameters,
        ),
        alone=tuple(
            UncomparedParameter(id=f"{effect}:{where}.{name}", sigmas=sigmas)
            for (effect, where, name), sigmas in apart.alone.items()
        ),
        left=FitResiduals.from_result(
            apart, excess_mm=max(days.before.excess, days.after.excess) * _MM
        ),
        causes=tuple(map(_explained, found.explanations[:_MOST])) if apart.changed else (),
        same_as=tuple(map(_named, found.same_as)),
        hidden=tuple(_named(e.cause) for e in found.explanations if e.hidden),
        renewed_rms_mm=float(np.hypot(found.renewed, found.rest)) * _MM,
        worst_at=found.targets.names[found.kept.worst_at],
        at_targets=tuple(
            AtTarget(pose=name, change_mm=change, kept_mm=kept)
            for name, change, kept in zip(
                found.targets.names, _errors(found.change, 0.0), _errors(found.kept, found.rest),
                strict=True,
            )
        ),
    )  # fmt: skip


def _named(cause: ChangeCause) -> CauseEntry:
    return CauseEntry(effect=cause.kind, where=cause.where)


def _explained(found: Explanation) -> CauseExplanation:
    cause = found.cause
    sizes = CauseSize.from_each(cause.parameters, value=found.values, std=found.std)
    return CauseExplanation.from_result(found, effect=cause.kind, where=cause.where, sizes=sizes)


def _errors(found: AtTargets, rest: float) -> list[IntervalEntry]:
    shown = (np.hypot(found.errors, rest) * _MM).tolist()
    return [IntervalEntry(value=value, low=low, high=high) for value, low, high in shown]
