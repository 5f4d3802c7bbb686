"""``design --motions``: the motions to log, and the proof of how good they are."""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal, Self

import numpy as np

from studies.results.base import (
    Count,
    Entry,
    Envelope,
    Maybe,
    NotNegative,
    Number,
    Positive,
    Result,
)

if TYPE_CHECKING:
    from doe.motions import MotionDesign


def name_of(index: int) -> str:
    """Of the session of a motion, counted from zero."""
    return f"motion{index + 1}"


class PlannedMotion(Entry):
    """A motion to log; largest : speed of the fastest joint, and which joint that is."""

    session: str
    seconds: Positive
    payload_kg: NotNegative
    fastest: str
    largest: NotNegative
    unit: Literal["deg/s", "mm/s"]


class PredictedTerm(Entry):
    """A parameter of the torque and the deviation that it will have."""

    effect: str
    where: str
    name: str
    std: Maybe
    unit: str


class MotionDesignResult(Result):
    """The motions to log.

    motions : by which it is known from a design of poses
    value, bound : of the criterion, parameters in plausible sizes: a tenth of the torque, of a mass
    random : share of the bound that motions drawn by chance reach, median of a hundred choices
    open : inertials for which others of the model stand in every motion
    """

    command: Literal["design"] = "design"
    motions: Literal[True] = True
    criterion: str
    larger_is_better: bool
    value: Number
    bound: Number
    efficiency: Number
    random: Number
    chosen: tuple[PlannedMotion, ...]
    predicted_std: tuple[PredictedTerm, ...]
    open: tuple[str, ...]
    candidates: Count
    removed_by: dict[str, int]
    granted: tuple[str, ...]
    seconds: NotNegative

    @classmethod
    def of(cls, found: MotionDesign, made_from: Envelope) -> Self:
        """A design in its cell."""
        robot, chosen = found.cell.robot, []
        for k, own in enumerate(found.motions):
            v = np.abs(own.at(own.time)[1]).max(axis=0)
            shown = np.where(robot.prismatic, v * 1e3, np.degrees(v))
            first = int(v.argmax())
            chosen.append(PlannedMotion(
                session=name_of(k), seconds=own.lasts, payload_kg=own.payload.mass,
                fastest=robot.joints[first], largest=float(shown[first]),
                unit="mm/s" if robot.prismatic[first] else "deg/s",
            ))  # fmt: skip
        return cls(
            **made_from,
            criterion=found.criterion.name,
            larger_is_better=found.criterion.larger_is_better,
            value=found.value,
            bound=found.bound,
            efficiency=found.efficiency,
            random=found.random,
            chosen=tuple(chosen),
            predicted_std=tuple(
                PredictedTerm(effect=p.effect, where=p.where, name=p.name, std=std, unit=p.unit)
                for p, std in zip(found.parameters, found.std.tolist(), strict=True)
            ),
            open=found.open,
            candidates=found.candidates,
            removed_by=found.removed,
            granted=found.granted,
            seconds=found.seconds,
        )

    @property
    def kind(self) -> str:
        return "design_motions"

    @property
    def main_table(self) -> tuple[PlannedMotion, ...]:
        return self.chosen
