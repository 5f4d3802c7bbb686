"""What ``posecal enough`` finds."""

from __future__ import annotations

import math
from itertools import pairwise
from typing import TYPE_CHECKING, Literal, Self

from pydantic import model_validator

from studies.record import (
    Count,
    Entry,
    Envelope,
    Maybe,
    NotNegative,
    Positive,
    Record,
)

if TYPE_CHECKING:
    from calib.model import Model
    from doe import Enough
    from doe.ahead.forecast import Step as Forecast

_MM = 1e3
_HOUR = 3600.0


class Noise(Entry):
    """Standard deviation of a coordinate, as the data show it."""

    sigma_mm: NotNegative
    source: Literal["cell", "replicates", "residual"]


class Seen(Entry):
    """What poses showed that the fit was without: their error less the instrument's noise, 3-D RMS.

    ``heldout_mm`` is what was read there, noise included, None where no poses were held out.
    """

    rms_mm: NotNegative
    source: str
    heldout_mm: Maybe


class Lacking(Entry):
    """The error at the targets that no more poses lower.

    scatter_mm : of ``scatter_of``, the arm, or undecided: the arm or what the model lacks
    unexplained_mm : what the model lacks, from pose to pose and at poses that the fit was without
    unexplained_surely : whether that is more than chance
    trend_mm : how far the trend of the day goes by the targets' time; trend_an_hour_later_mm : and an
        hour later, None where there is none, or no time
    """

    rms_mm: NotNegative
    scatter_mm: NotNegative
    scatter_of: Literal["arm", "undecided"] = "undecided"
    unexplained_mm: NotNegative
    unexplained_from: str
    unexplained_surely: bool = True
    trend_mm: NotNegative = 0.0
    trend_an_hour_later_mm: Maybe = None
    targets_after_h: NotNegative | None = None
    seen: Seen | None = None

    @property
    def open_end(self) -> bool:
        """Whether a trend goes on, to a time that nobody said, or that no clock tells."""
        untold = self.targets_after_h is None
        return bool(self.trend_mm) and (untold or self.trend_an_hour_later_mm is None)


class Progress(Entry):
    """Poses of the plan; ``to_measure`` counts the readings that are left as poses to go to."""

    poses: Count
    measured: Count
    to_measure: Count


class Step(Entry):
    """What is expected after one more pose; ``pose`` is None for now."""

    pose: str | None
    readings: Count
    task_rms_mm: Maybe
    task_worst_mm: Maybe
    task_most_mm: Maybe
    from_parameters_mm: Maybe
    unidentifiable: tuple[str, ...]


class Parameter(Entry):
    """How well a parameter is known; ``share`` is the share of the size that such errors have."""

    id: str
    effect: str
    where: str
    name: str
    std: Maybe
    unit: str
    share: Maybe


class State(Step):
    """A step with all that is known by then."""

    parameters: tuple[Parameter, ...]


class EnoughRecord(Record):
    """The answer of ``posecal enough``."""

    command: Literal["enough"] = "enough"
    targets: str
    status: str
    reason: str | None
    noise: Noise
    lacking: Lacking
    plan: Progress
    now: State
    order: tuple[Step, ...]
    end: State
    goal_mm: Positive | None
    goal_beyond_reach: bool
    poses_to_goal: Count | None
    fresh_poses_to_goal: Count | None
    fresh: tuple[Step, ...]
    pays_until: Count | None

    @model_validator(mode="after")
    def _belongs_together(self) -> Self:
        ids = [[p.id for p in state.parameters] for state in (self.now, self.end)]
        if ids[0] != ids[1]:
            raise ValueError("now and end have other parameters")
        if any(step.pose is None for step in self.order):
            raise ValueError("a pose to come in order has no name")
        if max(self.poses_to_goal or 0, self.pays_until or 0) > len(self.order):
            raise ValueError("poses_to_goal and pays_until count more poses than order holds")
        if self.goal_mm is None and self.poses_to_goal is not None:
            raise ValueError("poses_to_goal has no goal_mm")
        return self

    @property
    def gains(self) -> tuple[float | None, ...]:
        """By which share each pose of the order lowers the expected error."""
        values = [step.task_rms_mm for step in (self.now, *self.order)]
        return tuple(None if not a or b is None else 1.0 - b / a for a, b in pairwise(values))


def enough_record(answer: Enough, planned: int, targets: str, made_from: Envelope) -> EnoughRecord:
    """The record of an answer.

    planned : int, poses of the plan; targets : in words
    """
    found, now, coming = answer.found, answer.steps[0], answer.steps[1:]
    return EnoughRecord(
        **made_from,
        warnings=answer.match.warnings,
        targets=targets,
        status="too_few" if found is None else found.status,
        reason=answer.why or None,
        noise=Noise(
            sigma_mm=answer.sigma * _MM, source="cell" if found is None else found.noise.source
        ),
        lacking=_lacking(answer),
        plan=Progress(poses=planned, measured=answer.match.poses, to_measure=len(coming)),
        now=_state(answer.model, now),
        order=tuple(map(_step, coming)),
        end=_state(answer.model, answer.steps[-1]),
        goal_mm=None if answer.goal is None else answer.goal * _MM,
        goal_beyond_reach=answer.beyond_reach,
        poses_to_goal=answer.needed,
        fresh_poses_to_goal=answer.fresh_needed,
        fresh=tuple(map(_step, answer.fresh)),
        pays_until=answer.pays_until,
    )


def _lacking(answer: Enough) -> Lacking:
    found = answer.lacking
    return Lacking(
        rms_mm=found.rms * _MM,
        scatter_mm=found.scatter * _MM,
        scatter_of="undecided" if found.rest_of == "undecided" else "arm",
        unexplained_mm=found.of_model * _MM,
        unexplained_from=found.unexplained.source,
        unexplained_surely=found.surely,
        trend_mm=found.trend * _MM,
        trend_an_hour_later_mm=None if found.an_hour_on is None else found.an_hour_on * _MM,
        targets_after_h=None if found.after is None else found.after / _HOUR,
        seen=_seen(answer),
    )


def _seen(answer: Enough) -> Seen | None:
    seen, found = answer.lacking.seen, answer.found
    if found is None or not seen.source:
        return None
    read = found.rms("heldout")
    return Seen(
        rms_mm=seen.rms * _MM,
        source=seen.source,
        heldout_mm=None if read is None else read * _MM,
    )


def _step(step: Forecast) -> Step:
    return Step(
        pose=step.pose or None,
        readings=step.readings,
        task_rms_mm=step.task_rms * _MM,
        task_worst_mm=step.task_worst * _MM,
        task_most_mm=step.task_most * _MM,
        from_parameters_mm=step.from_parameters * _MM,
        unidentifiable=step.open,
    )


def _state(model: Model, step: Forecast) -> State:
    parameters = tuple(
        Parameter(
            id=p.id,
            effect=p.effect,
            where=p.where,
            name=p.name,
            std=std / p.scale if math.isfinite(std) else None,
            unit=p.unit,
            share=std / p.size if math.isfinite(std) else None,
        )
        for p, std in zip(model.parameters, step.std.tolist(), strict=True)
    )
    own = _step(step)
    return State(**own.model_dump(), parameters=parameters)
