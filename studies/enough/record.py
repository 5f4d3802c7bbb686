"""What ``posecal enough`` finds."""

from __future__ import annotations

from itertools import pairwise
from typing import TYPE_CHECKING, Annotated, Literal

from studies.noise import pixel_mm
from studies.record import (
    OWN_UNIT,
    BeforeAfter,
    Count,
    Entry,
    Envelope,
    From,
    Judgement,
    Maybe,
    MaybePositive,
    NotNegative,
    Positive,
    Record,
)

if TYPE_CHECKING:
    from calib.model import Model
    from doe import Enough
    from doe.forecast.accuracy import ForecastStep

_MM = 1e3


class NoiseSoFar(Entry):
    """Standard deviation of a coordinate, as the data show it."""

    sigma_mm: NotNegative
    source: Literal["cell", "replicates", "residual"]
    pixel_mm: MaybePositive


class SeenElsewhere(Entry):
    """What poses showed that the fit was without: their error less the instrument's noise, 3-D RMS.

    ``heldout_mm`` is what was read there, noise included, None where no poses were held out.
    """

    rms_mm: NotNegative
    source: str
    heldout_mm: Maybe


class LackingEntry(Entry):
    """The error at the targets that no more poses lower.

    scatter_mm : of ``scatter_of``, the arm, or undecided: the arm or what the model lacks
    unexplained_mm : what the model lacks, from pose to pose and at poses that the fit was without
    unexplained_surely : whether that is more than chance
    trend_mm : the part of it by which the trend of the day goes on until the targets' time
    """

    rms_mm: NotNegative
    scatter_mm: NotNegative
    scatter_of: Literal["arm", "undecided"]
    unexplained_mm: Annotated[NotNegative, From("of_model")]
    unexplained_from: Annotated[str, From("discrepancy.source")]
    unexplained_surely: Annotated[bool, From("surely")]
    trend_mm: NotNegative
    targets_after_h: Annotated[NotNegative | None, From("after")]
    seen: SeenElsewhere | None


class PlanProgress(Entry):
    """Poses of the plan; ``to_measure`` counts the readings that are left as poses to go to."""

    poses: Count
    measured: Count
    to_measure: Count


class ExpectedStep(Entry):
    """What is expected after one more pose; ``pose`` is None for now."""

    pose: str | None
    readings: Count
    task_rms_mm: Maybe
    task_worst_mm: Maybe
    task_most_mm: Maybe
    from_parameters_mm: Maybe
    unidentifiable: Annotated[tuple[str, ...], From("open")]


class KnownParameter(Entry):
    """How well a parameter is known; ``share`` is the share of the size that such errors have."""

    id: str
    effect: str
    where: str
    name: str
    std: Annotated[Maybe, OWN_UNIT]
    unit: str
    share: Maybe


class StateEntry(ExpectedStep):
    """A step with all that is known by then."""

    parameters: tuple[KnownParameter, ...]


class EnoughRecord(Record):
    """The answer of ``posecal enough``."""

    command: Literal["enough"] = "enough"
    targets: str
    status: str
    reason: str | None
    noise: NoiseSoFar
    lacking: LackingEntry
    plan: PlanProgress
    now: StateEntry
    order: tuple[ExpectedStep, ...]
    end: StateEntry
    goal_mm: Positive | None
    goal_beyond_reach: Annotated[bool, From("beyond_reach")]
    poses_to_goal: Annotated[Count | None, From("needed")]
    fresh_poses_to_goal: Annotated[Count | None, From("fresh_needed")]
    fresh: tuple[ExpectedStep, ...]
    pays_until: Count | None

    @property
    def error(self) -> BeforeAfter | None:
        """Expected at the targets now, and after all planned poses."""
        now, end = self.now.task_rms_mm, self.end.task_rms_mm
        if now is None or end is None:
            return None
        judged = None
        if self.goal_mm is not None:
            goal, reached = f"goal {self.goal_mm:g} mm", self.poses_to_goal == 0
            enough = Judgement("pass", goal, "Enough")
            judged = enough if reached else Judgement("fail", goal, "Not enough yet")
        return BeforeAfter(
            now,
            end,
            "RMS error expected at the targets",
            ends=("now", "after all planned poses"),
            judged=judged,
        )

    @property
    def gains(self) -> tuple[float | None, ...]:
        """By which share each pose of the order lowers the expected error."""
        values = [step.task_rms_mm for step in (self.now, *self.order)]
        return tuple(None if not a or b is None else 1.0 - b / a for a, b in pairwise(values))


def enough_record(answer: Enough, planned: int, targets: str, made_from: Envelope) -> EnoughRecord:
    """The record of an answer.

    planned : int, poses of the plan; targets : in words
    """
    found, coming = answer.found, answer.steps[1:]
    return EnoughRecord.from_result(
        answer,
        **made_from,
        warnings=answer.match.warnings,
        targets=targets,
        status="too_few" if found is None else found.status,
        reason=answer.why or None,
        noise=NoiseSoFar.from_result(
            answer,
            source="cell" if found is None else found.noise.source,
            pixel_mm=pixel_mm(answer.model, answer.footprint),
        ),
        lacking=LackingEntry.from_result(answer.lacking, seen=_seen(answer)),
        plan=PlanProgress(poses=planned, measured=answer.match.poses, to_measure=len(coming)),
        now=_state(answer.model, answer.steps[0]),
        order=coming,
        end=_state(answer.model, answer.steps[-1]),
    )


def _seen(answer: Enough) -> SeenElsewhere | None:
    found, seen = answer.found, answer.lacking.seen
    if found is None or not seen.source:
        return None
    read = found.rms("heldout")
    return SeenElsewhere.from_result(seen, heldout_mm=None if read is None else read * _MM)


def _state(model: Model, step: ForecastStep) -> StateEntry:
    share = step.std / model.sizes
    parameters = KnownParameter.from_each(model.parameters, std=step.std, share=share)
    return StateEntry.from_result(step, parameters=parameters)
