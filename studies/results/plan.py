"""The JSON of ``posecal diagnose --plan-only``: what a plan shows of causes that no model has yet."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import TYPE_CHECKING, Annotated, Literal, Self

from pydantic import Field

from calib import Cell
from calib.diagnosis.candidates import Candidate
from calib.diagnosis.detection_limit import ALPHA, POWER
from calib.effects.protocol import LoadEffect
from studies.results.base import (
    MICRO,
    Cause,
    Count,
    DetectionLimit,
    Entry,
    Envelope,
    Maybe,
    NotAsked,
    Number,
    Positive,
    Result,
)
from studies.results.identify import Unidentifiable

if TYPE_CHECKING:
    from doe.forecast.foresee import Detectability, PowerAnalysis

_INVISIBLE = 1e3  # times the usual size: rounding shows it, not these poses
Probability = Annotated[float, Field(gt=0, lt=1)]


class SeenCause(DetectionLimit):
    """The smallest size of one parameter, the best seen, or the reason why none would be found.

    plausible : a usual size; rms_um : how far the smallest moves the markers
    """

    parameter: str
    plausible: Positive
    rms_um: Maybe
    reason: str | None

    @classmethod
    def of(cls, cause: Detectability) -> Self:
        """What can be seen of a cause."""
        main, smallest = cause.parameters[cause.lead], cause.smallest
        return cls(
            effect=cause.candidate.effect.kind,
            where=cause.candidate.where,
            parameter=main.name,
            minimum_detectable=smallest[cause.lead] / main.scale,
            unit=main.unit,
            plausible=main.size / main.scale,
            rms_um=cause.moved[cause.lead] * MICRO,
            reason=cause.reason or None,
        )

    @property
    def unusual(self) -> bool:
        """Whether a cause of usual size may go unseen."""
        return (self.minimum_detectable or 0.0) > self.plausible

    @property
    def hidden(self) -> bool:
        """Whether no size that such an error may have is found."""
        size = self.minimum_detectable
        return bool(self.reason) or size is None or size > _INVISIBLE * self.plausible


class LookAlike(Cause):
    """A cause and what it is taken for at its smallest size.

    rho : share of the signal of plausible parameters that is imitated, and of the worst direction
    told_apart_from : the size from which on it is found beside the other, and as a multiple; None where
        none is
    """

    like: Cause
    rho: Number
    rho_worst: Maybe
    told_apart_times: Positive | None
    told_apart_from: Maybe
    parameter: str
    unit: str

    @classmethod
    def each(cls, found: PowerAnalysis) -> Iterator[Self]:
        """Every pair that is hard to separate, the hardest first."""
        for i, j in found.pairs:
            cause, other, times = found.seen[i], found.seen[j].candidate, float(found.times[i, j])
            main = cause.parameters[cause.lead]
            yield cls(
                effect=cause.candidate.effect.kind,
                where=cause.candidate.where,
                like=Cause(effect=other.effect.kind, where=other.where),
                rho=found.rho[i, j],
                rho_worst=found.rho_worst[i, j],
                told_apart_times=times if times < float("inf") else None,
                told_apart_from=times * cause.smallest[cause.lead] / main.scale,
                parameter=main.name,
                unit=main.unit,
            )


class EquivalentCauses(Entry):
    """Causes that stand for each other at these poses at any size."""

    members: tuple[Cause, ...]

    @classmethod
    def of(cls, candidates: Iterable[Candidate]) -> Self:
        """Causes as one group."""
        return cls(members=tuple(Cause(effect=c.effect.kind, where=c.where) for c in candidates))


class PlanResult(Result):
    """What a plan shows of causes that no model has yet."""

    command: Literal["diagnose"] = "diagnose"
    plan_only: Literal[True] = True
    joints: tuple[str, ...]
    readings: Count
    points: Count
    hidden_markers: Count
    before_the_first_move: tuple[str, ...]
    asked: Count
    alpha: Number
    power: Probability
    approach_derived: bool
    elastic_assumed: bool
    unidentifiable: tuple[Unidentifiable, ...]
    could_not_see: tuple[SeenCause, ...]
    look_alikes: tuple[LookAlike, ...]
    twins: tuple[EquivalentCauses, ...]
    not_asked: tuple[NotAsked, ...]

    @classmethod
    def of(cls, found: PowerAnalysis, cell: Cell, made_from: Envelope) -> Self:  # noqa: ARG003
        """A power analysis in a cell."""
        poses, seen = found.data.poses, [cause.candidate for cause in found.seen]
        through = any(isinstance(cause.effect, LoadEffect) for cause in seen)
        waits = zip(poses.names, found.waiting, strict=True)
        return cls(
            **made_from,
            joints=found.model.robot.joints,
            readings=len(found.data),
            points=int(found.data.seen.sum()),
            hidden_markers=int((~found.data.seen).sum()),
            before_the_first_move=tuple(name for name, waiting in waits if waiting),
            asked=found.asked,
            alpha=ALPHA,
            power=POWER,
            approach_derived=poses.approach_derived,
            elastic_assumed=found.assumed and through,
            unidentifiable=tuple(map(Unidentifiable.from_object, found.lost)),
            could_not_see=tuple(map(SeenCause.of, found.causes)),
            look_alikes=tuple(LookAlike.each(found)),
            twins=tuple(EquivalentCauses.of(seen[i] for i in group) for group in found.confounded),
            not_asked=tuple(map(NotAsked.from_object, found.missing)),
        )

    @property
    def seen(self) -> list[SeenCause]:
        """Causes that are found where they are large enough."""
        return [cause for cause in self.could_not_see if not cause.reason]

    @property
    def hidden(self) -> list[NotAsked]:
        """The others, with the reason."""
        every = self.could_not_see
        return [NotAsked(effect=own.key, reason=own.reason) for own in every if own.reason]

    def at_joints(self, effect: str) -> list[SeenCause | None]:
        """What is seen of an effect at each joint; nothing where it is seen at none."""
        own = {cause.where: cause for cause in self.could_not_see if cause.effect == effect}
        causes = [own.get(joint) for joint in self.joints]
        return causes if any(cause and not cause.reason for cause in causes) else []

    @property
    def pairs(self) -> list[LookAlike]:
        """Other causes than equivalent ones, each two once, the harder way round."""
        groups = [{member.key for member in group.members} for group in self.twins]
        once: dict[frozenset[str], LookAlike] = {}
        for pair in self.look_alikes:
            both = frozenset({pair.key, pair.like.key})
            if not any(both <= group for group in groups):
                once.setdefault(both, pair)
        return list(once.values())
