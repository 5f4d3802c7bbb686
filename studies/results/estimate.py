"""The fitted model in a result: the estimate that the next command reads, residuals, outliers.

The estimate is in SI; :func:`calib.files.estimate.load_estimate` reads it.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from functools import cached_property
from typing import Any, ClassVar, Self

import numpy as np

from calib.arrays import Array
from calib.identification import Residuals
from calib.model import Model
from calib.poses import Measurements
from calib.prediction.estimate import Estimate
from studies.results.base import (
    MM,
    Entry,
    Maybe,
    NotNegative,
    Number,
    Outlier,
    Owner,
    Three,
)


class EstimatedParameter(Entry):
    """A parameter by its effect, its place and its name there."""

    effect: str
    where: str
    name: str
    value_SI: Number


class Unexplained(Entry):
    """What is left at poses that took no part, or else at those of the fit."""

    rms_mm: NotNegative
    source: str


class ScatterVariances(Entry):
    """Variances of joints, of the tip's translation and of its rotation, rad^2 or m^2."""

    approach: tuple[Number, ...]
    configuration: tuple[Number, ...]
    configuration_of: Owner


class UnmeasuredEffects(Entry):
    """Effects of one kind that the model lacks and no reading could show.

    effects : ``effect:where`` of each; square_SI : mean square of their parameters
    absorbed_SI : what each parameter of the model took up of each of theirs
    largest_mm : that they add at any reading; within : range of the readings' load [N], temperature
        [degC] or time [s]; time_s : at which targets without a time count
    """

    effects: tuple[str, ...]
    square_SI: tuple[tuple[Number, ...], ...]
    absorbed_SI: tuple[tuple[Number, ...], ...]
    largest_mm: NotNegative
    within: tuple[Number, Number]
    time_s: Maybe


class Estimated(Entry):
    """All that the next command needs."""

    parameters: tuple[EstimatedParameter, ...]
    covariance_SI: tuple[tuple[Number, ...], ...]
    session_start_s: Number
    session_clock: str
    unexplained: Unexplained
    scatter_SI: ScatterVariances | None
    trend_SI: tuple[tuple[Number, ...], ...] | None
    unmeasured: tuple[UnmeasuredEffects, ...] = ()
    undetermined: tuple[str, ...]
    notes: tuple[str, ...]
    converged: bool

    @classmethod
    def of(cls, estimate: Estimate) -> Self:
        """The entry of an estimate."""
        variances = estimate.variances
        return cls.from_object(
            estimate,
            parameters=tuple(
                EstimatedParameter.from_object(p, value_SI=value)
                for p, value in zip(estimate.model.parameters, estimate.values, strict=True)
            ),
            session_start_s=estimate.start,
            session_clock=estimate.clock_unit,
            unexplained=Unexplained.from_object(estimate.discrepancy),
            scatter_SI=None
            if variances is None
            else ScatterVariances.from_object(
                variances, configuration_of=estimate.configuration_of
            ),
            unmeasured=tuple(
                UnmeasuredEffects.from_object(
                    one, effects=tuple(f"{e.kind}:{e.where}" for e in one.effects)
                )
                for one in estimate.unmeasured
            ),
        )


Lengths = Three | tuple[Number, Number] | tuple[Number]
"""Residual of a point, of two of its coordinates, or of one length, mm."""
Pixels = tuple[Number, Number]


class Residual(Entry):
    """Measured minus predicted reading: of a point, along one length, or in an image.

    other : first word of the fields that hold the same by the model that it is compared with
    """

    other: ClassVar[str]
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

    @property
    def metric(self) -> bool:
        """Whether it is a length."""
        return self.u_px is None

    @cached_property
    def vector(self) -> tuple[float, ...]:
        """Its numbers: up to three coordinates, one length, or two of the image."""
        lengths = (self.x_mm, self.y_mm, self.z_mm, self.d_mm)
        values = lengths if self.metric else (self.u_px, self.v_px)
        return tuple(value for value in values if value is not None)

    @property
    def before(self) -> tuple[float, ...]:
        """The same by the model that it is compared with."""
        return getattr(self, f"{self.other}_{'mm' if self.metric else 'px'}") or ()

    @cached_property
    def lengths(self) -> tuple[float, float]:
        """Length of the residual by the model that it is compared with, and by this one."""
        return math.hypot(*self.before), math.hypot(*self.vector)

    @classmethod
    def each(
        cls, model: Model, data: Measurements, before: Array, after: Array, heldout: bool
    ) -> Iterator[Self]:
        """Every reading of a table, in the units that this class has.

        before, after : ndarray, shape (m, C, r), SI, what two models leave

        Of a point in the instrument's frame, of the origin of a body in its own.
        """
        poses, channel_names = data.poses, model.channel_names
        sites = [""] * len(poses) if poses.site is None else poses.site.tolist()
        for instrument, part in model.readout.channels.blocks:
            names = [f"{n.name}_{n.unit}" for n in instrument.numbers]
            markers = channel_names[part]
            units: dict[str, list[int]] = {}
            for k, number in enumerate(instrument.numbers):
                if names[k] in cls.model_fields:
                    units.setdefault(number.unit, []).append(k)
            measured = data.readings[:, part, : instrument.rows]
            scales = np.array([n.scale for n in instrument.numbers])
            old, new = (
                (instrument.shown(measured, off[:, part, : instrument.rows]) / scales).tolist()
                for off in (before, after)
            )
            for i, c in np.argwhere(data.seen[:, part]).tolist():
                values: dict[str, Any] = {}
                for unit, places in units.items():
                    values[f"{cls.other}_{unit}"] = tuple(old[i][c][k] for k in places)
                    values |= {names[k]: new[i][c][k] for k in places}
                yield cls(
                    pose=poses.names[i],
                    marker=markers[c],
                    instrument=instrument.name_at(sites[i]),
                    heldout=heldout,
                    **values,
                )


def outliers(part: Residuals, footprint: float) -> Iterator[Outlier]:
    """The outliers among poses fitted or held out; footprint : m, to one unit of the readings."""
    for i in np.flatnonzero(part.outlier).tolist():
        errors = np.where(part.channels.lengths, part.vectors[i], 0.0)
        largest = float(np.linalg.norm(errors, axis=-1).max()) * footprint * MM
        allowed = ", and the other poses leave nothing"
        if part.limit > 0.0:
            ratio = float(np.sqrt(part.statistic[i] / part.limit))
            allowed = f", {ratio:.1f} times what the other poses allow"
        reason = f"residual up to {largest:.3f} mm{allowed}"
        yield Outlier(pose=part.data.poses.names[i], reason=reason)
