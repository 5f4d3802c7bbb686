"""What ``posecal fleet`` finds."""

from __future__ import annotations

from statistics import median
from typing import Annotated, ClassVar, Literal, Self, TypeAlias

from pydantic import Field, model_validator

from studies.document import MM, TENTH, Shown
from studies.entries import CauseEntry
from studies.record import (
    BeforeAfter,
    Count,
    Entry,
    Maybe,
    MaybePositive,
    NotNegative,
    Number,
    Positive,
    Record,
)

Status: TypeAlias = Literal["converged", "not_converged", "rank_deficient"]
Verdict: TypeAlias = Literal["no_gap", "explained", "ambiguous", "unknown"]
Share = tuple[Number, Number]


class FleetErrors(Entry):
    """RMS distances between measured and predicted points; nominal : base and markers fitted."""

    nominal: Annotated[NotNegative | None, Shown(rule=MM, unit="mm RMS")] = None
    fitted: Annotated[NotNegative | None, Shown("identified", MM, "mm RMS")] = None
    heldout: Annotated[NotNegative | None, Shown("held out", MM, "mm RMS")] = None


class NamedEntry(CauseEntry):
    """A cause that was found, and what the data cannot tell from it, itself first."""

    alike: tuple[str, ...]


class SessionEntry(Entry):
    """A table of a robot. What was not asked for or could not be done is None; fault says why.

    robot, table : their places below the folder; type : name of the robot's model
    day : YYYY-MM-DD; results : files that hold all the rest
    pixel_mm : of a pixel at the points, where cameras alone read: errors are those of pixels there
    """

    robot: str
    type: str
    table: Annotated[str, Shown(detail=True)]
    day: str | None
    fault: Annotated[str | None, Shown("what is wrong")]
    status: Status | None
    poses: Count | None
    rms_mm: FleetErrors
    sigma_mm: Annotated[NotNegative | None, Shown("noise", detail=True)]
    verdict: Verdict | None
    causes: tuple[NamedEntry, ...]
    results: Annotated[tuple[str, ...], Shown(detail=True)]
    pixel_mm: MaybePositive = None

    @model_validator(mode="after")
    def _has_errors(self) -> Self:
        if self.status is not None and None in (self.rms_mm.nominal, self.rms_mm.fitted):
            raise ValueError("a session with a status has no rms_mm")
        return self


class SharedEntry(CauseEntry):
    """A cause among the robots of a type.

    robots : in which it is named; possible : in which it is named or cannot be told from what is
    """

    robots: Count
    possible: Count
    share_ci95: Share


class TypeEntry(Entry):
    """Robots of one model; figures are medians of the last table of each."""

    type: str
    robots: Count
    diagnosed: Count
    rms_mm: FleetErrors
    verdicts: dict[Verdict, Count]
    causes: tuple[SharedEntry, ...]


class OutlyingFigure(Entry):
    """A figure by which a robot stands out of its type.

    deviation : from the typical value, in spreads; limit : what chance seldom exceeds in any of all
    """

    robot: str
    type: str
    what: Annotated[str, Shown("figure")]
    unit: str
    value: Number
    typical: Number
    spread: NotNegative
    deviation: Annotated[NotNegative, Shown("off by", TENTH, unit="spreads")]
    limit: Annotated[Positive, Shown(rule=TENTH, unit="spreads")]


class RobotTrend(Entry):
    """The tables of a robot that was measured again, in their order.

    days : since the first, None where a table has no date; p : of a steady rise or fall of the nominal
    model's error, None of fewer than four
    """

    robot: str
    type: str
    tables: tuple[str, ...]
    days: tuple[int, ...] | None
    nominal_mm: tuple[NotNegative, ...] = Field(min_length=2)
    fitted_mm: tuple[NotNegative, ...]
    p: Annotated[Maybe, Shown("p of a trend")]

    @model_validator(mode="after")
    def _one_each(self) -> Self:
        lengths = {len(self.tables), len(self.nominal_mm), len(self.fitted_mm)}
        if lengths | {len(self.tables if self.days is None else self.days)} != {len(self.tables)}:
            raise ValueError("tables, days, nominal_mm and fitted_mm are of different lengths")
        return self

    @property
    def change_mm(self) -> float:
        """From the first to the last table."""
        return self.nominal_mm[-1] - self.nominal_mm[0]


class FleetRecord(Record):
    """Every robot below a folder."""

    of_one_cell: ClassVar[bool] = False
    command: Literal["fleet"] = "fleet"
    folder: str
    verbs: tuple[Literal["identify", "diagnose"], ...] = Field(min_length=1)
    holdout: str | None
    sessions: tuple[SessionEntry, ...] = Field(min_length=1)
    types: tuple[TypeEntry, ...]
    off: tuple[OutlyingFigure, ...]
    trends: tuple[RobotTrend, ...]

    @model_validator(mode="after")
    def _belongs_together(self) -> Self:
        robots = {own.robot for own in self.sessions}
        told = {own.robot for own in self.off} | {own.robot for own in self.trends}
        if not told <= robots:
            raise ValueError("off and trends name robots that have no session")
        for own in self.types:
            if any(cause.robots > own.diagnosed for cause in own.causes):
                raise ValueError("a cause is counted in more robots than were diagnosed")
        return self

    @property
    def latest(self) -> dict[str, FleetErrors]:
        """Errors of the last table of each robot that was identified."""
        return {own.robot: own.rms_mm for own in self.sessions if own.status}

    @property
    def error(self) -> BeforeAfter | None:
        """Medians over robots, held out where that is known of all."""
        last = self.latest.values()
        held = all(own.heldout is not None for own in last)
        before = [own.nominal for own in last if own.nominal is not None]
        after = [own.heldout if held else own.fitted for own in last]
        known = [own for own in after if own is not None]
        if not before or len(known) < len(after):
            return None
        of = f"RMS error at {{where}}, median of {len(last)} robots"
        return BeforeAfter(median(before), median(known), of, heldout=held)

    @property
    def robots(self) -> int:
        """How many there are."""
        return len({own.robot for own in self.sessions})

    @property
    def faults(self) -> tuple[SessionEntry, ...]:
        """Tables with which something could not be done."""
        return tuple(own for own in self.sessions if own.fault)
