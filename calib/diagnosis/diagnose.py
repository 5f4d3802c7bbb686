"""Where the gap between model and measurement lies, and what causes it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from calib.arrays import Array
from calib.cell import Cell
from calib.cell.targets import targets_of
from calib.diagnosis.candidates import candidates
from calib.diagnosis.contest import Outcome
from calib.diagnosis.diagnosis import Cause, Diagnosis
from calib.diagnosis.earned import BY_TIME, CrossValidation
from calib.diagnosis.finding import Finding, finding_of
from calib.diagnosis.hidden import hidden
from calib.diagnosis.located import located, share_of
from calib.diagnosis.refused import far_out
from calib.diagnosis.searched import searched
from calib.diagnosis.shape import shape_doubt
from calib.diagnosis.stage import Fit, Stage
from calib.diagnosis.stated import stated
from calib.diagnosis.verdict import VerdictName, verdict
from calib.identification.checks import check_counts
from calib.identification.heldout import with_stations_of
from calib.identification.identify import identify
from calib.identification.initial import initial_values
from calib.identification.mistakes import refuse_mistakes
from calib.identification.noise_level import REPLICATES, replicate_spread
from calib.identification.tuning import profiled
from calib.identification.whitening import whitening
from calib.model import Model
from calib.model.build import build
from calib.model.covariance import determined
from calib.poses import Measurements
from calib.poses.moves import before_the_first_move, in_one_session
from calib.threads import one_blas_thread

_LEFT_OVER = 0.001  # the scatter of a few repeats is a weak witness


@one_blas_thread
def diagnose(cell: Cell, data: Measurements, *, heldout: Measurements | None = None) -> Diagnosis:
    """Find the unmodelled effects that the measurements show.

    heldout : measurements that take no part: what is found does not depend on them, and is told by
        how far it shrinks their error

    Raises UnknownEffect, EffectCannotAct, TooFewPoses, ImplausibleData, CalibError.
    """
    if heldout is not None:
        data, heldout = in_one_session(data, with_stations_of(data, heldout))
    stage = _stage(cell, data)
    waiting = stage.dropped
    suspects, missing = candidates(cell, stage.model, data)
    search = searched(stage, suspects)
    finding = finding_of(search)
    causes = _causes(finding, len(suspects))
    outcome, after, refused = finding.outcome, finding.after, finding.refused
    stage = search.stage
    places = located(stage, outcome, after, causes, finding.scale, bool(refused))
    by_time = any(place.depends_on in BY_TIME for place in places)
    gap = finding.gap(heldout, by_time)
    gap = replace(gap, over_time=_over_time(stage, after)) if by_time else gap
    entered = {c.named.candidate.key for c in causes}
    return Diagnosis(
        verdict=_verdict(finding, causes),
        noise=finding.noise,
        causes=tuple(c for c in causes if not c.displaced),
        located=places,
        gap=gap,
        hidden=hidden(stage, outcome, entered, targets_of(cell)),
        not_asked=tuple(missing),
        refused=refused,
        data=data,
        outlier=stage.dropped & ~waiting,
        waiting=waiting,
        statistic=search.statistic,
        limit=search.limit,
        before=finding.before,
        after=after,
        outcome=outcome,
        stage=stage,
        linear=search.linear,
        suspects=tuple(c for c in outcome.suspects if not c.echo),
        heldout=heldout,
        growth=search.growth,
        scale=finding.scale,
    )


def _stage(cell: Cell, data: Measurements) -> Stage:
    """What the readings are fitted by, refused where they cannot be; without those before a move."""
    model = _model(cell, data)
    check_counts(model, data)
    start = initial_values(model, data)
    refuse_mistakes(model, data, start)
    weights, waiting = whitening(cell, model, start, data), before_the_first_move(data.poses)
    model, start = model.extended(start, stated(model, start, data))
    return Stage(data, model, start, weights, waiting, arm=cell.repeatability)


def _over_time(stage: Stage, after: Fit) -> tuple[float, float]:
    """Error at blocks of time left out, without and with all that was found, 3-D RMS, m."""
    found = after.model.effects[len(stage.model.effects) :]
    account = CrossValidation(stage, after).ledger(found, by_time=True)
    return account.rms_without, account.rms_with


def _verdict(finding: Finding, causes: Sequence[Cause]) -> VerdictName:
    """In doubt where something is left, a cause has another form, or the residual tells the noise."""
    left = _something_left(finding.search.stage, finding.outcome, finding.after)
    left |= bool(finding.refused and not finding.outcome.active)
    doubted = left or any(c.misshapen for c in causes)
    doubted |= bool(causes) and finding.noise.source == "residual"
    tested = all(c.doubt.tested for c in causes)
    return verdict(finding.named, finding.outcome, doubted, tested)


def _model(cell: Cell, data: Measurements) -> Model:
    """What the cell contains, with what these readings let be believed of its type and its sizes."""
    model = build(cell, data.poses).model
    if not model.prior_rows and cell.size_prior != "estimated":
        return model
    return replace(model, prior=identify(cell, data).model.prior)


def _causes(finding: Finding, asked: int) -> tuple[Cause, ...]:
    """What is named, with its size and share.

    asked : int, over how many its p counts
    """
    if not finding.named:
        return ()
    stage, after = finding.search.stage, finding.after
    std, count = _deviations(stage, after, finding.scale), len(finding.named)
    found = []
    for named in finding.named:
        effect = named.candidate.effect
        own = after.positions(effect)
        share = share_of(finding.outcome, after, named.entry, finding.scale)
        p = min(1.0, named.entry.score.p * asked)
        doubt = shape_doubt(stage, after, effect, count)
        large = far_out(after, named.candidate)
        found.append(Cause(named, doubt, after.values[own], std[own], p, share, large))
    return tuple(found)


def _deviations(stage: Stage, after: Fit, scale: float) -> Array:
    """Standard deviations of all values, shape (p,), NaN where the data do not determine the value.

    Of tunings those of the profile likelihood, where that is no parabola.
    """
    std = np.where(determined(after.span), scale * np.sqrt(np.diag(after.covariance)), np.nan)
    observation = stage.observation(after.model, after.weight)
    observation = replace(observation, scatter=stage.scatter.at(after.variances))
    profile = profiled(observation, after.values, after.span, std, scale)
    return np.where(np.isfinite(profile), profile, std)


def _something_left(stage: Stage, outcome: Outcome, after: Fit) -> bool:
    """Whether the residual exceeds the scatter of repeated readings: lack of fit, by an F test.

    Where poses err together, whether they do so beyond the arm's repeatability.
    """
    from scipy.special import fdtrc

    if after.mixing is not None:
        return bool(after.variances.configuration.any())
    kept = ~stage.dropped
    spread, repeats = replicate_spread(stage.data.take(kept), stage.weights[kept])
    rest = outcome.last.dof - repeats
    if repeats < REPLICATES or rest <= 0:
        return False
    F = max(outcome.last.cost - spread, 0.0) / rest / (spread / repeats)
    return bool(fdtrc(rest, repeats, F) < _LEFT_OVER)
