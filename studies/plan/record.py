"""What ``posecal diagnose --plan-only`` finds."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Annotated, Literal

import numpy as np
from pydantic import Field

from studies.document import CORRELATION, STD, Shown
from studies.entries import CauseEntry, DetectionLimitEntry, NotAskedEntry
from studies.record import (
    Count,
    Entry,
    Envelope,
    From,
    Maybe,
    Number,
    Positive,
    Record,
    UnidentifiableEntry,
)

if TYPE_CHECKING:
    from doe.forecast.foresee import Detectability, PowerAnalysis

_UM = 1e6
Probability = Annotated[float, Field(gt=0, lt=1)]


class DetectableSize(Entry):
    """A parameter taken alone, with the part of its signal that is left beside the model."""

    name: str
    minimum_detectable: Annotated[Maybe, From("smallest", own_unit=True)]
    unit: str
    left: Number


class SeenCause(DetectionLimitEntry):
    """The smallest size of one parameter, the best seen, or the reason why none would be found.

    plausible : a usual size; rms_um : how far the smallest moves the markers
    """

    parameter: Annotated[str, Shown("of")]
    plausible: Annotated[Positive, Shown("usual", STD, detail=True)]
    rms_um: Maybe
    reason: str | None
    parameters: tuple[DetectableSize, ...] = Field(min_length=1)

    @property
    def size(self) -> float:
        """The smallest one of a cause that is seen."""
        return self.minimum_detectable or 0.0

    @property
    def unusual(self) -> bool:
        """Whether a cause of usual size may go unseen."""
        return self.size > self.plausible


class LookAlike(CauseEntry):
    """A cause and what it is taken for at its smallest size.

    rho : correlation over plausible parameters, and in the worst direction
    told_apart_from : the size from which on that is sure, and as a multiple; None where none would do
    """

    like: CauseEntry
    rho: Annotated[Number, Shown(rule=CORRELATION)]
    rho_worst: Maybe
    probability_at_minimum: Number
    told_apart_times: Positive | None
    told_apart_from: Maybe
    parameter: str
    unit: str


class EquivalentCauses(Entry):
    """Causes that stand for each other at these poses at any size."""

    members: tuple[CauseEntry, ...]


class PlanRecord(Record):
    """What a plan can tell of causes that no model has yet."""

    command: Literal["diagnose"] = "diagnose"
    plan_only: Literal[True] = True
    joints: Annotated[tuple[str, ...], From("model.robot.joints")]
    readings: Annotated[Count, From("data")]
    points: Count
    hidden_markers: Count
    before_the_first_move: tuple[str, ...]
    asked: Count
    alpha: Number
    power: Probability
    sure: Probability
    approach_derived: Annotated[bool, From("data.poses.approach_derived")]
    elastic_assumed: bool
    unidentifiable: Annotated[tuple[UnidentifiableEntry, ...], From("lost")]
    could_not_see: tuple[SeenCause, ...]
    look_alikes: tuple[LookAlike, ...]
    twins: tuple[EquivalentCauses, ...]
    not_asked: Annotated[tuple[NotAskedEntry, ...], From("missing")]

    @property
    def kind(self) -> str:
        return "plan"

    @property
    def seen(self) -> tuple[SeenCause, ...]:
        """Causes that are found where they are large enough."""
        return tuple(cause for cause in self.could_not_see if not cause.reason)


def plan_record(found: PowerAnalysis, made_from: Envelope) -> PlanRecord:
    """The record of what a plan can tell."""
    from calib.diagnosis.detection_limit import ALPHA, POWER
    from calib.effects.protocol import LoadEffect
    from doe.forecast.likeness import SURE

    poses = found.data.poses
    through = any(isinstance(cause.candidate.effect, LoadEffect) for cause in found.seen)
    return PlanRecord.from_result(
        found,
        **made_from,
        warnings=(),
        points=int(found.data.seen.sum()),
        hidden_markers=int((~found.data.seen).sum()),
        before_the_first_move=[
            name for name, waits in zip(poses.names, found.waiting, strict=True) if waits
        ],
        alpha=ALPHA,
        power=POWER,
        sure=SURE,
        elastic_assumed=found.assumed and through,
        could_not_see=map(_seen, found.causes),
        look_alikes=_look_alikes(found),
        twins=[
            EquivalentCauses(members=tuple(_cause(found.seen[i]) for i in group))
            for group in found.confounded
        ],
    )


def _cause(cause: Detectability) -> CauseEntry:
    return CauseEntry(effect=cause.candidate.effect.kind, where=cause.candidate.where)


def _seen(cause: Detectability) -> SeenCause:
    lead, parameters = cause.lead, cause.parameters
    main = parameters[lead]
    return SeenCause(
        **dict(_cause(cause)),
        parameter=main.name,
        minimum_detectable=cause.smallest[lead] / main.scale,
        unit=main.unit,
        plausible=main.size / main.scale,
        rms_um=cause.moved[lead] * _UM,
        reason=cause.reason or None,
        parameters=DetectableSize.from_each(parameters, smallest=cause.smallest, left=cause.share),
    )


def _look_alikes(found: PowerAnalysis) -> Iterator[LookAlike]:
    if found.alike is None:
        return
    rho, worst = found.alike.rho, found.alike.rho_worst
    needed = np.array([cause.needed for cause in found.seen])
    chance = found.alike.preferred(needed, found.detection.rows)
    for i, j in found.pairs:
        cause, times = found.seen[i], float(found.times[i, j])
        main = cause.parameters[cause.lead]
        yield LookAlike(
            **dict(_cause(cause)),
            like=_cause(found.seen[j]),
            rho=float(rho[i, j]),
            rho_worst=float(worst[i, j]),
            probability_at_minimum=float(chance[i, j]),
            told_apart_times=times if times < float("inf") else None,
            told_apart_from=times * float(cause.smallest[cause.lead]) / main.scale,
            parameter=main.name,
            unit=main.unit,
        )
