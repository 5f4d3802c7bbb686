"""Result of an identification: estimates, uncertainties and residuals."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from difflib import get_close_matches
from functools import cached_property
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from calib.arrays import Array, Mask
from calib.cell import Cell
from calib.effects.protocol import Parameter
from calib.effects.tool_base import Base
from calib.errors import CalibError
from calib.identification.estimate import Estimation
from calib.identification.residuals import Residuals
from calib.identification.variances import Undetected
from calib.inference.coverage import LEVEL, coverage_factor, effective_freedom, freedom
from calib.model.covariance import Unidentifiable, correlation
from calib.model.reduction import Dropped
from calib.observations import Approach
from calib.observations.scatter import Scatter
from calib.poses import Poses
from calib.poses.moves import visits
from calib.result import Result

Status = Literal["converged", "not_converged", "rank_deficient"]

ADVICE: dict[Status, str] = {
    "converged": "every parameter of the model was estimated",
    "not_converged": "the search did not settle: the model or the data are far off; check joint "
    "names, units and signs, and look at the outliers",
    "rank_deficient": "some parameters cannot be told from these poses and keep their nominal "
    "values; see what is unidentifiable, and measure poses that excite it",
}
_UNSEEN = (
    "they move nothing that is read against the instrument that reads it, so no reading at any pose "
    "tells them, and errors at targets are without theirs"
)
_OFF = (
    "the nominal model is off by {:.0f} mm: check units, signs and order of the joints, the order of "
    "the rows, and the units of URDF and points"
)
_NO_LENGTH = (
    "no length is measured, so the size of the arm is not identifiable and stays nominal. Give "
    "[[known_distances]] between sockets"
)
_DERIVED = (
    "approach directions are derived from the order {}{}. If there were moves in between, add columns "
    "approach_<joint>"
)
_SHOWN = 6  # poses named in a warning
_FAR = 0.05  # of the arm's size: no nominal model is off by as much


class EstimatedValue(NamedTuple):
    """A value and its standard deviation, SI; NaN where it was not estimated."""

    value: float
    std: float


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class Identification(Result, Estimation):
    """Result of :func:`calib.identify`: the estimate, and how good it is.

    ``values``, shape (p,), SI, are in the order of ``model.parameters``.

    covariance : ndarray, shape (p, p), SI, base and tool included; zero for what was not estimated
    ignorance : ndarray, shape (p, p), SI, what values that were not estimated add to it, at their
        plausible sizes (:func:`calib.model.covariance.ignorance`)
    undetected : covariance, shape (p, p), SI, that scatter adds which was not found, part of
        ``covariance``, and that scatter; None where it was found, or is known
    approach : "points" or "pose"
    absorbed : tuple of Dropped, constants that others stand for at any pose
    fit, heldout : Residuals, of what was fitted and of poses that took no part, None without any
    nominal : ndarray, shape (p,), base and markers fitted, all else as in the nominal model
    """

    cell: Cell
    covariance: Array
    ignorance: Array
    undetected: tuple[Array, Undetected] | None
    approach: Approach
    absorbed: tuple[Dropped, ...]
    fit: Residuals
    heldout: Residuals | None
    nominal: Array

    @property
    def status(self) -> Status:
        """Whether the search settled, and whether it estimated every parameter."""
        if not (self.best.converged and self.regular):
            return "not_converged"
        return "rank_deficient" if self.choice.unidentifiable else "converged"

    @property
    def iterations(self) -> int:
        """Of the last search."""
        return self.best.iterations

    @property
    def dof(self) -> int:
        """Degrees of freedom of the residuals."""
        return self.left[1]

    @property
    def rank(self) -> int:
        """How many directions the readings determine."""
        return len(self.choice.kept)

    @property
    def unidentifiable(self) -> tuple[Unidentifiable, ...]:
        """Parameters that the poses, or the instruments at any poses, do not determine, and why."""
        unseen = tuple(dropped.id for dropped in self.absorbed if not dropped.absorbed_by)
        lost = self.choice.unidentifiable
        return (*lost, Unidentifiable(unseen, _UNSEEN)) if unseen else lost

    @property
    def undecided(self) -> tuple[str, ...]:
        """Poses that are outliers by one fit and none by the next."""
        return self._named(self.judgement.kept != self.kept)

    @property
    def unused(self) -> tuple[str, ...]:
        """Poses whose markers were measured and are too few for approach pose."""
        return self._named(self.fit.data.seen.any(axis=1) & ~self.weights.any(axis=(1, 2, 3)))

    @property
    def waiting(self) -> tuple[str, ...]:
        """Readings left out because nothing tells from which side the joints came."""
        return self._named(np.logical_not(self.fit.data.seen.any(axis=1)))

    def _named(self, poses: ArrayLike) -> tuple[str, ...]:
        return tuple(self.fit.data.poses.names[i] for i in np.flatnonzero(poses))

    @property
    def weights(self) -> Array:
        """Whitening matrices of the readings, shape (m, C, r, r), zero for hidden ones."""
        return self.observation.weights

    @property
    def scatter(self) -> Scatter | None:
        """How whole poses err together."""
        return self.observation.scatter

    @property
    def prior_weight(self) -> float:
        """What is known beside the readings weighs so many times more, as they err so much more."""
        return self.observation.prior_weight

    @cached_property
    def footprint(self) -> float:
        """Metres to one unit of distances and noise: 1 unless no reading is a length."""
        return self.model.footprint(self.values, self.fit.data)

    @cached_property
    def _parts(self) -> dict[str, tuple[Residuals, Mask]]:
        """Residuals whose lengths are stated, and the poses (m,) they are of."""
        model, data, held = self.model, self.fit.data, self.heldout
        every = np.ones(len(data), dtype=bool)
        parts = {
            "nominal": (Residuals.of(model, data, self.nominal), every),
            "fitted": (self.fit, self.kept),
            "fitted_all": (Residuals.of(model, data, self.first.values), every),
        }
        if held is not None:
            parts["heldout"] = held, np.ones(len(held.data), dtype=bool)
            parts["heldout_trimmed"] = held, ~held.outlier
        return parts

    @cached_property
    def distances(self) -> dict[str, Array]:
        """Distances between measured and predicted points, m, of each part.

        Parts are "nominal", "fitted", "fitted_all", "heldout", "heldout_trimmed".
        """
        return {key: part.lengths(poses) for key, (part, poses) in self._parts.items()}

    def rms(self, key: str) -> float | None:
        """3-D root mean square per point [m] of an entry of ``distances``."""
        lengths = self.distances.get(key, np.zeros(0))
        return _rms(lengths) if len(lengths) else None

    @cached_property
    def by_instrument(self) -> dict[tuple[str, str], dict[str, float]]:
        """RMS of the errors of each instrument in each of its units, by the same parts."""
        table: dict[tuple[str, str], dict[str, float]] = {}
        for key, (part, poses) in self._parts.items():
            for name, unit, errors in part.errors(poses):
                table.setdefault((name, unit), {}).update(
                    {key: _rms(errors)} if len(errors) else {}
                )
        return table

    @property
    def knowledge(self) -> Array:
        """Covariance of all values, those that were not estimated included, shape (p, p), SI."""
        return self.covariance + self.ignorance

    @cached_property
    def correlation(self) -> Array:
        """Correlation matrix, shape (p, p)."""
        return correlation(self.covariance)

    @property
    def std(self) -> Array:
        """Standard deviations, shape (p,), SI; NaN where nothing was estimated."""
        variance = np.diag(self.covariance)
        return np.sqrt(np.where(variance > 0.0, variance, np.nan))

    @property
    def freedom(self) -> float:
        """Degrees of freedom behind the covariance: those of the noise, infinite where it is known.

        Where poses err as a whole, by as much as the data show, stays count and not points.
        """
        shown = bool(self.levels.levels)
        return freedom(self.noise.dof, self.stays, self.rank, as_a_whole=shown)

    @property
    def stays(self) -> int:
        """How often the arm came to a pose whose readings count."""
        return len(np.unique(visits(self.fit.data.poses)[~self.fit.outlier]))

    @property
    def freedoms(self) -> Array:
        """Effective degrees of freedom of each standard deviation, shape (p,), infinite if known."""
        return np.broadcast_to(effective_freedom(self._variances), self.values.shape)

    @property
    def _variances(self) -> list[tuple[Array, float]]:
        """Parts of the variance of each value (p,), with their degrees of freedom."""
        whole = np.diag(self.covariance)
        if self.undetected is None:
            return [(whole, self.freedom)]
        added = np.clip(np.diag(self.undetected[0]), 0.0, whole)  # below nothing is rounding
        return [(whole - added, self.freedom), (added, self.undetected[1].freedom)]

    def interval(self, level: float = LEVEL) -> Array:
        """Coverage interval of each parameter, shape (p, 2), SI.

        Student's t at the effective degrees of freedom (JCGM 100, G.4).
        """
        half = coverage_factor(self.freedoms, level=level) * self.std
        return np.column_stack([self.values - half, self.values + half])

    @property
    def weak(self) -> tuple[str, ...]:
        """Robot parameters whose standard deviation exceeds the size that such errors have."""
        robot = (each for each in self._estimates if each[0].effect not in ("base", "tool"))
        return tuple(p.id for p, value, std in robot if std > max(p.size, abs(value)))

    def predict(self, poses: Poses) -> Array:
        """Readings at other poses, shape (m, C, r), by the model as fitted: the same knots."""
        return self.model.predict(self.values, poses)

    @property
    def marker_positions(self) -> Array:
        """Markers in the tip frame, shape (M, 3), m."""
        return self.model.marker_positions(self.values)

    @property
    def bases(self) -> dict[str, Array]:
        """Placement of the base in each station's frame: (x, y, z, rx, ry, rz), m and rad."""
        return {
            effect.where: self.values[part]
            for effect, part in self.model.parts
            if isinstance(effect, Base) and effect.of.has_stations
        }

    def __getitem__(self, name: str) -> EstimatedValue:
        """A parameter by its id, such as ``geometry:A3.x``. Raises CalibError for another name."""
        for p, value, std in self._estimates:
            if p.id == name:
                return EstimatedValue(value, std)
        known = [p.id for p in self.model.parameters]
        close = get_close_matches(name, known, n=1) or known[:1]
        raise CalibError(f"no parameter {name!r}; there is {close[0]}")

    @property
    def warnings(self) -> tuple[str, ...]:
        """Warnings about data, model and result, a sentence each."""
        return tuple(self._warned())

    def _warned(self) -> Iterator[str]:
        model, poses = self.model, self.fit.data.poses
        nominal = (self.rms("nominal") or 0.0) * self.footprint
        if nominal > _FAR * model.robot.reach:
            yield _OFF.format(nominal * 1e3)
        if model.scaleless and any(p.effect == "geometry" for p in model.parameters):
            yield _NO_LENGTH
        if names := self.undecided:
            shown = ", ".join(names[:_SHOWN]) + (" .." if names[_SHOWN:] else "")
            yield f"the fits do not agree whether to reject {shown}: check the readings there"
        for p, value, std in self._estimates:
            if p.name.startswith("compliance") and value < -5.0 * std:
                torque = p.effect == "measured_torque"
                signs = "columns <joint>_Nm" if torque else "wrench and of gravity"
                yield f"{p.id} is negative: check the sign of the {signs}"
        if poses.approach_derived and any("approach" in e.uses for e in model.effects):
            order = "of the file" if poses.time is None else "in time"
            names = self.waiting
            skipped = f"; {', '.join(names)} skipped: direction unknown" if names else ""
            yield _DERIVED.format(order, skipped)

    def sentences(self) -> list[str]:
        each = ((key, self.rms(key)) for key in ("nominal", "fitted", "heldout"))
        errors = [f"{key} {1e3 * error:.4g} mm" for key, error in each if error is not None]
        kept, out = int((~self.fit.outlier).sum()), int(self.fit.outlier.sum())
        return [
            f"Identification: {self.rank} of {len(self.values)} parameters from {kept} readings, "
            f"{out} outliers",
            f"RMS error of a point: {', '.join(errors)}" if errors else "no reading is a length",
            f"{self.status}: {ADVICE[self.status]}",
            *self.warnings,
        ]

    def rows(self) -> list[dict[str, object]]:
        return [
            {"parameter": p.id, "value": value / p.scale, "std": std / p.scale, "unit": p.unit}
            for p, value, std in self._estimates
        ]

    @property
    def _estimates(self) -> list[tuple[Parameter, float, float]]:
        """Each parameter with its value and standard deviation, SI."""
        both = self.values.tolist(), self.std.tolist()
        return list(zip(self.model.parameters, *both, strict=True))


def _rms(lengths: Array) -> float:
    return float(np.sqrt(np.mean(lengths**2)))
