"""The JSON of ``posecal changes``: what moved between two results of one robot."""

from __future__ import annotations

from typing import Literal, Self

from pydantic import Field

from calib.change import FALSE_ALARM, Changes, verdict
from calib.inference.coverage import Interval
from calib.prediction.estimate import Estimate
from studies.results.base import (
    MM,
    Count,
    Entry,
    Envelope,
    Maybe,
    MaybePositive,
    NotNegative,
    Number,
    Positive,
    Result,
)


class ErrorInterval(Entry):
    """A value with its 95 % interval; None where that is open."""

    value: Number
    low: Maybe
    high: Maybe

    @classmethod
    def of(cls, found: Interval) -> Self:
        """An interval in m, in mm."""
        return cls(value=found.value * MM, low=found.low * MM, high=found.high * MM)


class ChangedParameter(Entry):
    """A parameter, after minus before; family_p : by chance, over all parameters together."""

    id: str
    change: Number
    std: MaybePositive
    family_p: Maybe
    moved: bool
    unit: str


class ChangesResult(Result):
    """What moved between two results of one robot.

    p : of so large a difference in so many independent rows, where nothing changed
    apart : bases and markers that stand elsewhere and are not compared
    change : of the robot between the days; kept : error with the values of BEFORE on that of AFTER
    """

    command: Literal["changes"] = "changes"
    before: str
    after: str
    status: Literal["unchanged", "changed"]
    p: NotNegative
    rows: Count
    parameters: tuple[ChangedParameter, ...] = Field(min_length=1)
    apart: tuple[str, ...]
    change_rms_mm: ErrorInterval
    kept_rms_mm: ErrorInterval
    kept_worst_mm: ErrorInterval
    tolerance_mm: Positive | None
    verdict: Literal["holds", "does_not", "cannot_be_said"] | None

    @classmethod
    def of(
        cls, found: Changes, estimate: Estimate, names: tuple[str, str], tolerance_mm: float | None,
        made_from: Envelope,
    ) -> Self:  # fmt: skip
        """Changes between two results of these names; estimate : of the later one."""
        between, (rms, worst) = found.difference, found.kept
        own = {p.key: p for p in estimate.model.parameters}
        columns = (between.keys, between.change, between.std, between.family_p, between.moved)
        return cls(
            **made_from,
            warnings=estimate.notes,
            before=names[0],
            after=names[1],
            status="changed" if between.p_value < FALSE_ALARM else "unchanged",
            p=between.p_value,
            rows=len(between.whitened),
            parameters=tuple(
                ChangedParameter(
                    id=own[key].id, unit=own[key].unit, change=change / own[key].scale,
                    std=std / own[key].scale, family_p=p, moved=bool(moved),
                )
                for key, change, std, p, moved in zip(*columns, strict=True)
            ),
            apart=between.apart,
            change_rms_mm=ErrorInterval.of(found.there),
            kept_rms_mm=ErrorInterval.of(rms),
            kept_worst_mm=ErrorInterval.of(worst),
            tolerance_mm=tolerance_mm,
            verdict=None if tolerance_mm is None else verdict(worst, tolerance_mm / MM),
        )  # fmt: skip
