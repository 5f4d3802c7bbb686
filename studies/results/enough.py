"""The JSON of ``posecal enough``: what is expected now, and after each further pose."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING, Literal, Self

from calib import Cell
from calib.model import Model
from calib.prediction.estimate import estimate_of
from studies.results.base import (
    MM,
    BeforeAfter,
    Count,
    Entry,
    Envelope,
    Judgement,
    Maybe,
    MaybePositive,
    NotNegative,
    Positive,
    Result,
)
from studies.results.expected import ExpectedErrors
from studies.results.parts import ParameterStd

if TYPE_CHECKING:
    from doe import Enough
    from doe.forecast.accuracy import ForecastStep

_HOUR = 3600.0  # s


class NoiseSoFar(Entry):
    """Standard deviation of a coordinate, as the data show it."""

    sigma_mm: NotNegative
    source: Literal["cell", "replicates", "residual"]
    pixel_mm: MaybePositive


class LastingError(Entry):
    """The error at the targets that no more poses lower.

    scatter_mm : of ``scatter_of``, the arm, or undecided: the arm or what the model lacks
    unexplained_mm : what the model lacks
    trend_mm : the part of it by which the trend of the day goes on until the targets' time
    heldout_mm : RMS at held-out poses, None where there are none
    missed_mm : there, else at the ends of the day as the others predict them, less the noise
    """

    rms_mm: NotNegative
    scatter_mm: NotNegative
    scatter_of: Literal["arm", "undecided"]
    unexplained_mm: NotNegative
    trend_mm: NotNegative
    targets_after_h: NotNegative | None
    heldout_mm: Maybe
    missed_mm: NotNegative

    @classmethod
    def of(cls, answer: Enough, cell: Cell) -> Self:
        """What an answer states of it."""
        own, found, after = answer.lacking, answer.found, cell.design.targets_after
        read = None if found is None or found.heldout is None else found.rms("heldout")
        return cls.from_object(
            own,
            scatter_of="undecided" if own.scatter_of == "undecided" else "arm",
            unexplained_mm=own.of_model * MM,
            targets_after_h=None if found is None or after is None else after / _HOUR,
            heldout_mm=None if read is None else read * MM,
        )


class PlanProgress(Entry):
    """Poses of the plan; ``to_measure`` counts the readings that are left as poses to go to.

    Of a pose that is ``begun``, one reading is there and another, as under the load, is left.
    """

    poses: Count
    measured: Count
    begun: Count = 0
    to_measure: Count


class ExpectedStep(Entry):
    """What is expected after one more pose; ``pose`` is None for now."""

    pose: str | None
    readings: Count
    task_rms_mm: Maybe
    task_worst_mm: Maybe
    task_most_mm: Maybe
    from_parameters_mm: Maybe
    unidentifiable: tuple[str, ...]


class KnownParameter(ParameterStd):
    """How well a parameter is known; share : of the size that such errors have."""

    share: Maybe


class KnownState(ExpectedStep):
    """A step with all that is known by then."""

    parameters: tuple[KnownParameter, ...]

    @classmethod
    def at(cls, model: Model, step: ForecastStep) -> Self:
        """A step of the model of the day."""
        share = step.std / model.sizes
        known = KnownParameter.known(model.parameters, step.std, share=share)
        return cls.from_object(step, unidentifiable=step.open, parameters=known)


class EnoughResult(Result):
    """The answer of ``posecal enough``."""

    command: Literal["enough"] = "enough"
    targets: str
    status: str
    reason: str | None
    noise: NoiseSoFar
    expected: ExpectedErrors | None
    lacking: LastingError
    plan: PlanProgress
    now: KnownState
    order: tuple[ExpectedStep, ...]
    end: KnownState
    goal_mm: Positive | None
    goal_beyond_reach: bool
    poses_to_goal: Count | None
    fresh_poses_to_goal: Count | None
    fresh: tuple[ExpectedStep, ...]

    @classmethod
    def of(
        cls,
        answer: Enough,
        cell: Cell,
        made_from: Envelope,
        *,
        planned: int = 0,
        warnings: Iterable[str] = (),
    ) -> Self:
        """An answer in a cell; planned : poses of the plan; warnings : of the data."""
        found, model, coming = answer.found, answer.model, answer.steps[1:]
        length, after = model.readout.channels.metric, cell.design.targets_after or 0.0
        return cls.from_object(
            answer,
            **made_from,
            warnings=(*warnings, *answer.match.warnings),
            targets=cell.targets_in_words,
            status="too_few" if found is None else found.status,
            reason=answer.why or None,
            noise=NoiseSoFar(
                sigma_mm=answer.sigma * MM,
                source="cell" if found is None else found.noise.source,
                pixel_mm=None if length else answer.footprint * MM,
            ),
            expected=None
            if found is None
            else ExpectedErrors.at_targets(cell, estimate_of(found, after)),
            lacking=LastingError.of(answer, cell),
            plan=PlanProgress(
                poses=planned,
                measured=answer.match.poses,
                begun=answer.match.begun,
                to_measure=len(coming),
            ),
            now=KnownState.at(model, answer.steps[0]),
            order=tuple(ExpectedStep.from_object(s, unidentifiable=s.open) for s in coming),
            end=KnownState.at(model, answer.steps[-1]),
            goal_beyond_reach=answer.beyond_reach,
            poses_to_goal=answer.needed,
            fresh_poses_to_goal=answer.fresh_needed,
            fresh=tuple(ExpectedStep.from_object(s, unidentifiable=s.open) for s in answer.fresh),
        )

    @property
    def main_table(self) -> tuple[ExpectedStep, ...]:
        return (self.now, *self.order)

    @property
    def rms_now_mm(self) -> float | None:
        """Expected at the targets now: of the fit, or as foreseen where there is none yet."""
        return self.now.task_rms_mm if self.expected is None else self.expected.rms_mm

    @property
    def error(self) -> BeforeAfter | None:
        """Expected at the targets now, and after all planned poses."""
        now, end = self.rms_now_mm, self.end.task_rms_mm
        if now is None or end is None:
            return None
        judged = None
        if self.goal_mm is not None:
            goal = f"goal {self.goal_mm:g} mm"
            judged = Judgement("fail", goal, "Not enough yet")
            if self.poses_to_goal == 0:
                judged = Judgement("pass", goal, "Enough")
        of, ends = "RMS error expected at the targets", ("now", "after all planned poses")
        return BeforeAfter(now, end, of, ends=ends, judged=judged)
