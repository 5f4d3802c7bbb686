"""What results hold of a fitted model: the estimate that the next command reads, and residuals.

The estimate is in SI and read by :func:`calib.files.estimate.load_estimate`.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import cached_property
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Self, TypeAlias

import numpy as np
from pydantic import Field

from studies.record import Entry, From, Maybe, NotNegative, Number, Owner, Three

if TYPE_CHECKING:
    from calib.arrays import Array
    from calib.model import Model
    from calib.poses import Measurements
    from calib.prediction.estimate import Estimate


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
    configuration_of: Owner


class Estimated(Entry):
    """All that the next command needs."""

    parameters: tuple[EstimatedParameter, ...]
    covariance_si: tuple[Row, ...] = Field(alias="covariance_SI")
    session_start_s: Annotated[Number, From("start")]
    session_clock: Annotated[str, From("clock_unit")]
    unexplained: Annotated[UnexplainedEntry, From("discrepancy")]
    scatter_si: ScatterEntry | None = Field(alias="scatter_SI")
    trend_si: tuple[Row, ...] | None = Field(alias="trend_SI")
    undetermined: tuple[str, ...]
    notes: tuple[str, ...]
    converged: bool


def estimated(estimate: Estimate) -> Estimated:
    """The entry of an estimate."""
    variances = estimate.variances
    return Estimated.from_result(
        estimate,
        parameters=EstimatedParameter.from_each(estimate.model.parameters, value=estimate.values),
        trend_si=estimate.trend,
        scatter_si=variances and ScatterEntry.from_result(variances, estimate),
    )


Lengths: TypeAlias = Three | tuple[Number, Number] | tuple[Number]
"""Residual of a point, of two of its coordinates, or of one length, mm."""
Pixels: TypeAlias = tuple[Number, Number]

_NUMBERS = {
    "mm": ("x_mm", "y_mm", "z_mm", "d_mm"),
    "px": ("u_px", "v_px"),
}
"""What an error may be told in, by unit."""


class ResidualEntry(Entry):
    """Measured minus predicted reading: of a point, along one length, or in an image.

    beside : what the fields of the model that it is held against begin with
    """

    beside: ClassVar[str]
    pose: str
    marker: str
    instrument: str
    x_mm: Maybe = None
    y_mm: Maybe = None
    z_mm: Maybe = None
    d_mm: Maybe = None
    u_px: Maybe = None
    v_px: Maybe = None
    heldout: bool

    @cached_property
    def _told(self) -> dict[str, tuple[float, ...]]:
        every = {unit: [getattr(self, name) for name in own] for unit, own in _NUMBERS.items()}
        told = {unit: tuple(n for n in own if n is not None) for unit, own in every.items()}
        return {unit: own for unit, own in told.items() if own}

    @property
    def vector(self) -> tuple[float, ...]:
        """Its numbers: up to three coordinates, one length, or two of the image."""
        (told,) = self._told.values()
        return told

    @property
    def before(self) -> tuple[float, ...]:
        """The same by the model that it is held against."""
        (unit,) = self._told
        return getattr(self, f"{self.beside}_{unit}") or ()

    @property
    def metric(self) -> bool:
        """Whether it is a length."""
        return "mm" in self._told

    @classmethod
    def of_readings(
        cls, model: Model, data: Measurements, before: Array, after: Array, heldout: bool
    ) -> Iterator[Self]:
        """Each reading of a table, in the units that this kind of entry has.

        before, after : ndarray, shape (m, C, r), SI, what two models leave

        Of a point in the instrument's frame, of the origin of a body in its own.
        """
        poses = data.poses
        sites = [""] * len(poses) if poses.site is None else poses.site.tolist()
        for instrument, part in model.readout.channels.blocks:
            scales = np.array([n.scale for n in instrument.numbers])
            measured = data.readings[:, part, : instrument.rows]
            old, new = (
                instrument.shown(measured, off[:, part, : instrument.rows]) / scales
                for off in (before, after)
            )
            by_unit: dict[str, dict[str, int]] = {}
            for k, number in enumerate(instrument.numbers):
                if (name := f"{number.name}_{number.unit}") in cls.model_fields:
                    by_unit.setdefault(number.unit, {})[name] = k
            for i, c in np.argwhere(data.seen[:, part]).tolist():
                told: dict[str, Any] = {}
                for unit, names in by_unit.items():
                    told[f"{cls.beside}_{unit}"] = tuple(old[i, c, list(names.values())].tolist())
                    told |= {name: float(new[i, c, k]) for name, k in names.items()}
                yield cls(
                    pose=poses.names[i],
                    marker=model.channel_names[part][c],
                    instrument=instrument.name_at(sites[i]),
                    heldout=heldout,
                    **told,
                )
