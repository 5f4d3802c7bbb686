"""What a result knows of the robot, and the error to expect of it: parameters, arm, model."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from calib.arrays import Array, Mask, in_parts
from calib.diagnosis.diagnose import Diagnosis
from calib.effects.readings import ReadingEffect
from calib.identification.identification import Identification
from calib.identification.noise import refuted
from calib.model import Model
from calib.model.covariance import errors_at, ignorance, working_points
from calib.observations.scatter import Owner, Variances, parted, pose_to_pose, scatter_variance
from calib.poses import Poses
from calib.prediction.discrepancy import FittedModel, ModelDiscrepancy, model_discrepancy
from calib.prediction.trend import trend_of
from calib.prediction.unmeasured import Unmeasured, unmeasured

_LEAST = 1e-6  # m: what adds less is not said


@dataclass(frozen=True, eq=False)
class Estimate:
    """An identified model in the form in which one result is handed on to the next command.

    model : Model; values : ndarray, shape (p,), SI
    covariance : ndarray, shape (p, p), SI; what the poses did not determine enters with a plausible
        size, less what the other parameters took up of it
    start : float, s, time of the session's first pose, from which drift counts
    discrepancy : ModelDiscrepancy, beside what differs from configuration to configuration
    undetermined : tuple of str, ids of the parameters that keep their nominal values
    notes : tuple of str, what a user of the values should know
    variances : Variances or None, of what errs as a whole and is new at every target
    configuration_of : whose those of the configurations are
    unmeasured : tuple of Unmeasured, effects that the model lacks and no reading could show
    trend : ndarray, shape (p, p), SI, or None: mean square of what the values are off by at the time of
        the targets, as the trend of the day goes on (:mod:`calib.prediction.trend`)
    clock_unit : str, of the session's clock, "s" or "reading"
    """

    model: Model
    values: Array
    covariance: Array
    start: float
    discrepancy: ModelDiscrepancy
    undetermined: tuple[str, ...]
    notes: tuple[str, ...] = ()
    converged: bool = True
    variances: Variances | None = None
    clock_unit: str = "s"
    configuration_of: Owner = "undecided"
    trend: Array | None = None
    unmeasured: tuple[Unmeasured, ...] = ()


@dataclass(frozen=True, eq=False)
class ExpectedError:
    """Error of the tool points at m targets, by its parts, which are independent.

    Distances are root mean squares over the points of a target, 3-D, in m.
    """

    estimate: Estimate
    targets: Poses

    @cached_property
    def parameters(self) -> Array:
        """Standard error (m,) by the uncertainty of the parameters, less how the instrument errs."""
        return self._by(self.estimate.covariance)

    @cached_property
    def arm(self) -> Array:
        """Error (m,) of an arm that errs anew at each target; what may be the model's counts here."""
        return self._scatter(0)

    @cached_property
    def model(self) -> Array:
        """What the model lacks (m,)."""
        return np.asarray(np.sqrt(self.discrepancy**2 + self.trend**2 + self.unmeasured**2))

    @cached_property
    def unmeasured(self) -> Array:
        """What effects may add (m,) that no reading could show."""
        squares = [(spread**2).sum(axis=(-1, -2)) for _, spread in self.by_effect]
        return np.sqrt(np.sum(squares, axis=0)) if squares else np.zeros(len(self.targets))

    @cached_property
    def by_effect(self) -> tuple[tuple[Unmeasured, Array], ...]:
        """Each kind of those effects, and the spread (m, 3 M, k) of what it may add, m."""
        known, there = self.estimate, self.targets
        return tuple((u, u.beyond(known.model, known.values, there)) for u in known.unmeasured)

    def never_measured(self, weights: Array) -> Iterator[str]:
        """What was never measured and what it may add, a sentence a kind; weights : (m,)."""
        for one, spread in self.by_effect:
            rms = float(np.sqrt(weights @ (spread**2).sum(axis=(-1, -2)) / weights.sum()))
            if rms > _LEAST:
                yield f"{one.condition(self.targets)}: {one.kind} may add {1e3 * rms:.2g} mm"

    @cached_property
    def discrepancy(self) -> Array:
        """Model discrepancy (m,), from configuration to configuration and beside that."""
        return np.hypot(self._scatter(1), self.estimate.discrepancy.rms)

    @cached_property
    def trend(self) -> Array:
        """How far the trend of the day will have gone (m,), zero where there is none."""
        trend = self.estimate.trend
        return np.zeros(len(self.targets)) if trend is None else self._by(trend)

    @cached_property
    def rms(self) -> Array:
        """All of it, shape (m,)."""
        return np.asarray(np.sqrt(self.parameters**2 + self.arm**2 + self.model**2))

    def _by(self, square: Array) -> Array:
        """Error (m,) by a mean square (p, p) of what the values are off by."""
        model, targets = self.estimate.model, self.targets
        kept = np.setdiff1d(np.arange(len(model.parameters)), model.where(ReadingEffect))
        arm = model.with_effects(
            tuple(e for e in model.effects if not isinstance(e, ReadingEffect))
        )
        values, own = self.estimate.values[kept], square[np.ix_(kept, kept)]
        parts = in_parts(len(targets), 3 * len(model.markers) * len(kept))
        return np.concatenate([errors_at(arm, values, own, targets.take(part)) for part in parts])

    def _scatter(self, part: int) -> Array:
        """Error (m,) of poses that err as a whole, by the arm's variances (0) or the model's (1)."""
        known, model = self.estimate.variances, working_points(self.estimate.model)
        chosen = None if known is None else parted(known, self.estimate.configuration_of)[part]
        found = scatter_variance(model, self.estimate.values, self.targets, chosen)
        return np.asarray(np.sqrt(found.mean(axis=-1)))


def estimate_of(result: Identification | Diagnosis, after: float = 0.0) -> Estimate:
    """The identified model of an identification or a diagnosis, for the next command.

    after : s after the last reading at which the arm comes to its targets
    """
    if isinstance(result, Identification):
        return _identified(result, after)
    return _diagnosed(result, after)


def fitted_of(result: Identification) -> FittedModel:
    """The fit of an identification and its noise, over what was not left out."""
    kept, levels = ~result.fit.outlier, result.levels
    known = np.diag(result.covariance) > 0.0
    return FittedModel(
        result.model,
        result.values,
        result.covariance,
        np.eye(len(known))[:, known],
        result.fit.data.take(kept),
        result.weights[kept],
        result.noise.believed * _noise_scale(result),
        None if levels is None else levels.variances,
    )


def _identified(result: Identification, after: float) -> Estimate:
    fit, lost = fitted_of(result), np.diag(result.covariance) <= 0.0
    lost[result.model.still] = False
    held = None if result.heldout is None else result.heldout.data
    trend = trend_of(fit, after)
    return Estimate(
        fit.model,
        fit.values,
        result.knowledge,
        fit.data.poses.start,
        model_discrepancy(fit, held, result.footprint),
        _ids(fit.model, lost),
        tuple(_doubts_of_noise(result)),
        result.status != "not_converged",
        fit.variances,
        fit.data.poses.clock_unit,
        pose_to_pose(result.levels, result.scatter, fit.model.robot.reach).of,
        trend,
        tuple(unmeasured(result.cell, fit, after, trend is not None)),
    )


def _noise_scale(result: Identification) -> float:
    """Actual over stated noise of the instrument, as far as the data tell it from the rest."""
    noise, levels = result.noise, result.levels
    determined = levels is not None and (
        levels.instrument_only or (levels.instrument_seen and levels.variances.any)
    )
    if determined or noise.source != "residual":
        return noise.factor
    if levels is not None and levels.instrument_seen:
        return levels.variances.scale  # points of one pose tell it, whatever repeated ones do
    return noise.replicate_factor or 1.0  # the residual is what is to be explained


def _doubts_of_noise(result: Identification) -> Iterator[str]:
    """That the instrument cannot be told from the model where the residual exceeds the noise."""
    noise, levels = result.noise, result.levels
    if levels is None or levels.instrument_seen or noise.replicate_factor is not None:
        return
    if (noise.source == "residual" and noise.factor > 1.0) or levels.variances.any:
        yield (
            "the residual exceeds the stated noise, and these data cannot tell the instrument from the "
            "arm and the model: all of the excess is expected to remain; read poses again, or more "
            "markers"
        )


def _diagnosed(result: Diagnosis, after: float) -> Estimate:
    """The model with all causes that have a name; what is merely located is model discrepancy."""
    fit, scale, stage = result.after, result.scale, result.stage
    if any(not e.candidate.named for e in result.outcome.entries):
        named = [cause.named.candidate.effect for cause in result.fitted_causes]
        before, like = result.before, result.outcome.fit
        fit = stage.fit(named, before.values, fit.amplitudes, like.variances)
        fit = stage.with_variances(fit)
        # From the residual, where that refutes the stated deviation.
        scale = float(np.sqrt(fit.cost / fit.dof)) if refuted(fit.cost, fit.dof) else 1.0
    levels, cov, kept = fit.levels, fit.covariance * scale**2, ~stage.dropped
    lost, sigma = np.diag(cov) <= 0.0, result.noise.sigma
    if levels is None or not levels.instrument_only:
        sigma = sigma / result.scale  # the residual is what is to be explained
    variances, data = None if levels is None else levels.variances, result.data.take(kept)
    fitted = FittedModel(
        fit.model, fit.values, cov, fit.span, data, stage.weights[kept], sigma, variances
    )
    trend = trend_of(fitted, after)
    return Estimate(
        fit.model,
        fit.values,
        cov + ignorance(fit.linear.independent[1], fit.span, fit.model.sizes, lost),
        result.data.poses.start,
        model_discrepancy(fitted, result.heldout, fit.model.footprint(fit.values, result.data)),
        _ids(fit.model, lost),
        tuple(_doubts_of_causes(result)),
        fit.converged,
        variances,
        result.data.poses.clock_unit,
        pose_to_pose(levels, stage.scatter, fit.model.robot.reach).of,
        trend,
        tuple(unmeasured(result.cell, fitted, after, trend is not None)),
    )


def _doubts_of_causes(result: Diagnosis) -> Iterator[str]:
    """Which causes stand for others, too, and which place of the gap has no cause."""
    for cause in result.fitted_causes:
        first, *others = [f"{c.effect.kind}:{c.where}" for c, _ in cause.named.members]
        if others:
            also = " or ".join(others)
            yield f"{first} stands for {also} too, which the data cannot tell from it"
    for entry in result.outcome.entries:
        if not entry.candidate.named:
            place = f"{entry.candidate.where} by {entry.candidate.depends_on}"
            yield f"not corrected: the gap located at {place}, which has no named cause"


def _ids(model: Model, chosen: Mask) -> tuple[str, ...]:
    return tuple(p.id for p, taken in zip(model.parameters, chosen, strict=True) if taken)
