"""What a result knows of the robot: the model, its values, and how sure they are."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeAlias

import numpy as np

from calib.arrays import Array, Mask
from calib.diagnosis.diagnose import Diagnosis
from calib.identification.identification import Identification
from calib.identification.noise_level import refuted
from calib.model import Model
from calib.model.covariance import ignorance
from calib.predict.discrepancy import Fitted, Unexplained, unexplained
from calib.scatter import Variances
from calib.scatter.owner import Owner, parted, pose_to_pose

Result: TypeAlias = Identification | Diagnosis


@dataclass(frozen=True, eq=False)
class Estimate:
    """An identified model in the form in which one result is handed on to the next command.

    model : Model; values : ndarray, shape (p,), SI
    covariance : ndarray, shape (p, p), SI; what the poses did not determine enters with a plausible
        size, less what the other parameters took up of it
    start : float, s, time of the session's first pose, from which drift counts
    unexplained : Unexplained
    variances : Variances or None, of what errs as a whole and is new at every target; rest_of : whose
        those of the configurations are
    undetermined : tuple of str, ids of the parameters that keep their nominal values
    notes : tuple of str, what a user of the values should know
    clock_unit : str, of the session's clock, "s" or "reading"
    converged : bool
    """

    model: Model
    values: Array
    covariance: Array
    start: float
    unexplained: Unexplained
    undetermined: tuple[str, ...]
    notes: tuple[str, ...] = ()
    converged: bool = True
    variances: Variances | None = None
    clock_unit: str = "s"
    rest_of: Owner = "undecided"

    @property
    def arm(self) -> Variances | None:
        """Variances of the arm's own scatter; what is undecided counts as the arm's."""
        return None if self.variances is None else parted(self.variances, self.rest_of)[0]

    @property
    def unfollowed(self) -> Variances | None:
        """Of what the model does not follow from configuration to configuration."""
        return None if self.variances is None else parted(self.variances, self.rest_of)[1]


def estimate_of(result: Result) -> Estimate:
    """The identified model of an identification or a diagnosis, for the next command."""
    return _identified(result) if isinstance(result, Identification) else _diagnosed(result)


def fitted_of(result: Identification) -> Fitted:
    """The fit of an identification and its noise, over what was not left out."""
    kept, levels = ~result.fit.outlier, result.levels
    known = np.diag(result.covariance) > 0.0
    return Fitted(
        model=result.model,
        values=result.values,
        covariance=result.covariance,
        span=np.eye(len(known))[:, known],
        data=result.fit.data.take(kept),
        weights=result.weights[kept],
        sigma=result.noise.believed * _instrument(result),
        variances=None if levels is None else levels.variances,
    )


def _identified(result: Identification) -> Estimate:
    fit, lost = fitted_of(result), np.diag(result.covariance) <= 0.0
    scanned = np.zeros(len(lost), dtype=bool)
    scanned[result.model.still] = True
    held = None if result.heldout is None else result.heldout.data
    return Estimate(
        fit.model,
        fit.values,
        result.knowledge,
        fit.data.poses.start,
        unexplained(fit, held, result.footprint),
        _names(fit.model, lost & ~scanned),
        _untold(result),
        converged=result.status != "not_converged",
        variances=fit.variances,
        clock_unit=fit.data.poses.clock_unit,
        rest_of=pose_to_pose(result.levels, result.scatter, fit.model.robot.reach).of,
    )


def _instrument(result: Identification) -> float:
    """Actual over stated noise of the instrument, as far as the data tell it from the rest."""
    noise, levels = result.noise, result.levels
    told = levels is not None and (
        levels.instrument_only or (levels.instrument_seen and levels.variances.any)
    )
    if told or noise.source != "residual":
        return noise.factor
    if levels is not None and levels.instrument_seen:
        return levels.variances.scale  # points of one pose tell it, whatever repeated ones do
    return noise.replicate_factor or 1.0  # the residual is what is to be explained


def _untold(result: Identification) -> tuple[str, ...]:
    """That the instrument cannot be told from the model where the residual exceeds the noise."""
    levels = result.levels
    if levels is None or levels.instrument_seen or result.noise.replicate_factor is not None:
        return ()
    louder = result.noise.source == "residual" and result.noise.factor > 1.0
    if not (louder or levels.variances.any):
        return ()
    return (
        "the residual exceeds the stated noise, and these data cannot tell the instrument from the arm "
        "and the model: all of the excess is expected to remain; read poses again, or more markers",
    )


def _diagnosed(result: Diagnosis) -> Estimate:
    """The model with all causes that have a name; what is merely located stays unexplained."""
    fit, scale, stage = result.after, result.scale, result.stage
    unnamed = [e.candidate for e in result.outcome.entries if not e.candidate.named]
    if unnamed:
        named = [cause.named.candidate.effect for cause in result.causes]
        fit = stage.exact(result.linear.fit(named, fit))
        # From the residual, where that refutes the stated deviation.
        scale = float(np.sqrt(fit.cost / fit.dof)) if refuted(fit.cost, fit.dof) else 1.0
    levels, cov = fit.levels, fit.covariance * scale**2
    kept, lost = ~stage.dropped, np.diag(cov) <= 0.0
    sigma = result.noise.sigma
    if levels is None or not levels.instrument_only:
        sigma = sigma / result.scale  # the residual is what is to be explained
    fitted = Fitted(
        model=fit.model,
        values=fit.values,
        covariance=cov,
        span=fit.span,
        data=result.data.take(kept),
        weights=stage.weights[kept],
        sigma=sigma,
        variances=None if levels is None else levels.variances,
    )
    return Estimate(
        fit.model,
        fit.values,
        cov + ignorance(fit.linear.independent[1], fit.span, fit.model.sizes, lost),
        result.data.poses.start,
        unexplained(fitted, result.heldout, fit.model.footprint(fit.values, result.data)),
        _names(fit.model, lost),
        _doubts(result),
        fit.converged,
        fitted.variances,
        result.data.poses.clock_unit,
        pose_to_pose(levels, stage.scatter, fit.model.robot.reach).of,
    )


def _doubts(result: Diagnosis) -> tuple[str, ...]:
    notes = []
    for cause in result.causes:
        first, *others = [f"{c.effect.kind}:{c.where}" for c, _ in cause.named.members]
        if others:
            notes.append(
                f"{first} stands for {' or '.join(others)} too, which the data cannot tell from it"
            )
    for entry in result.outcome.entries:
        if not entry.candidate.named:
            place = f"{entry.candidate.where} by {entry.candidate.depends_on}"
            notes.append(f"not corrected: the gap located at {place}, which has no named cause")
    return tuple(notes)


def _names(model: Model, chosen: Mask) -> tuple[str, ...]:
    return tuple(p.id for p, own in zip(model.parameters, chosen, strict=True) if own)
