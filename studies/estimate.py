"""The entry ``estimate`` of a result: the identified model as the next command reads it, in SI.

It is read by :func:`calib.files.estimate.load_estimate`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, TypeAlias

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


class Unexplained(Entry):
    """What is left at poses that took no part, or else at those of the fit."""

    rms_mm: NotNegative
    source: str


class Scatter(Entry):
    """Variances of joints, of the tip's translation and of its rotation, rad^2 or m^2."""

    approach: Row
    configuration: Row


class Estimated(Entry):
    """All that the next command needs."""

    parameters: tuple[EstimatedParameter, ...]
    covariance_si: tuple[Row, ...] = Field(alias="covariance_SI")
    session_start_s: Number
    session_clock: str = "s"
    unexplained: Unexplained
    scatter_si: Scatter | None = Field(default=None, alias="scatter_SI")
    undetermined: tuple[str, ...]
    notes: tuple[str, ...]
    converged: bool


def estimated(estimate: Estimate) -> Estimated:
    """The entry of an estimate."""
    variances = estimate.variances
    return Estimated(
        parameters=tuple(
            EstimatedParameter(effect=p.effect, where=p.where, name=p.name, value_SI=value)
            for p, value in zip(estimate.model.parameters, estimate.values.tolist(), strict=True)
        ),
        covariance_SI=tuple(map(tuple, estimate.covariance.tolist())),
        session_start_s=estimate.start,
        session_clock=estimate.clock_unit,
        unexplained=Unexplained(
            rms_mm=estimate.unexplained.rms * 1e3, source=estimate.unexplained.source
        ),
        scatter_SI=None
        if variances is None
        else Scatter(
            approach=tuple(variances.approach.tolist()),
            configuration=tuple(variances.configuration.tolist()),
        ),
        undetermined=estimate.undetermined,
        notes=estimate.notes,
        converged=estimate.converged,
    )
