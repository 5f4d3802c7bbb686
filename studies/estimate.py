"""The entry ``estimate`` of a result: the identified model as the next command reads it, in SI.

It is read by :func:`calib.files.estimate.load_estimate`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal, TypeAlias

from pydantic import Field

from studies.record import Entry, NotNegative, Number

if TYPE_CHECKING:
    from calib.compensation.estimate import Estimate

Row: TypeAlias = tuple[Number, ...]


class EstimatedParameter(Entry):
    """A parameter by its effect, its place and its name there."""

    effect: str
    where: str
    name: str
    value_si: Number = Field(alias="value_SI")


class UnexplainedEntry(Entry):
    """What is left at poses that took no part, or else at those of the fit."""

    rms_mm: NotNegative
    source: str


class ScatterEntry(Entry):
    """Variances of joints, of the tip's translation and of its rotation, rad^2 or m^2.

    configuration_of : whose those of the configurations are
    """

    approach: Row
    configuration: Row
    configuration_of: Literal["instrument", "arm", "model", "undecided"] = "undecided"


class TrendEntry(Entry):
    """What moves on through the day: ``taken + (1 - exp(-clock / tau)) moving`` for each tau."""

    taus: Row
    weights: Row
    taken_si: tuple[Row, ...] = Field(alias="taken_SI")
    moving_si: tuple[Row, ...] = Field(alias="moving_SI")
    last: Number


class Estimated(Entry):
    """All that the next command needs."""

    parameters: tuple[EstimatedParameter, ...]
    covariance_si: tuple[Row, ...] = Field(alias="covariance_SI")
    session_start_s: Number
    session_clock: str = "s"
    unexplained: UnexplainedEntry
    scatter_si: ScatterEntry | None = Field(default=None, alias="scatter_SI")
    trend: TrendEntry | None = None
    undetermined: tuple[str, ...]
    notes: tuple[str, ...]
    converged: bool


def estimated(estimate: Estimate) -> Estimated:
    """The entry of an estimate."""
    variances = estimate.variances
    return Estimated.from_result(
        estimate,
        parameters=[
            EstimatedParameter.from_result(p, value_si=value)
            for p, value in zip(estimate.model.parameters, estimate.values, strict=True)
        ],
        session_start_s=estimate.start,
        session_clock=estimate.clock_unit,
        scatter_si=None
        if variances is None
        else ScatterEntry.from_result(variances, configuration_of=estimate.rest_of),
    )
