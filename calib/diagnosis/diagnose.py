"""Where the gap between model and measurement lies, and what causes it."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from calib.arrays import Array, Mask
from calib.cell import Cell
from calib.cell.targets import targets_of
from calib.diagnosis.candidates import Candidate, NotAsked, candidates
from calib.diagnosis.contest import Entry, Outcome, contest
from calib.diagnosis.earned import BY_TIME, CrossValidation
from calib.diagnosis.gap import Gap, gap_of, reach
from calib.diagnosis.hidden import Hidden, hidden
from calib.diagnosis.range_noise import Growth, growth
from calib.diagnosis.refused import Refused, believed, nothing, plausible
from calib.diagnosis.rounds import ALPHA
from calib.diagnosis.screen import refuted
from calib.diagnosis.shape import Doubt, shape_doubt
from calib.diagnosis.sparing import sparing
from calib.diagnosis.stage import Fit, Stage
from calib.diagnosis.verdict import Named, VerdictName, verdict
from calib.diagnosis.view import lineup
from calib.effects.protocol import ARM
from calib.effects.tuned import Tuned
from calib.errors import Unsolvable
from calib.identification.identify import check_counts, identify, whitening
from calib.identification.initial import initial_values
from calib.identification.mistakes import refuse_mistakes
from calib.identification.noise_level import (
    NoiseLevel,
    noise_level,
    of_levels,
    replicate_spread,
)
from calib.identification.outliers import judge, threshold
from calib.identification.tuning import profiled
from calib.model.build import build
from calib.model.covariance import determined
from calib.noise import counted
from calib.poses import Measurements
from calib.poses.moves import before_the_first_move, in_one_session
from calib.poses.visits import visits
from calib.threads import one_blas_thread

_REPLICATES = 10  # degrees of freedom of repeated readings worth believing
_GROSS = 10.0  # times the mean square of a typical group
_LEFT_OVER = 0.001  # the scatter of a few repeats is a weak witness
_ALONE = 0.9  # of what scatters, that one joint must hold to be named in place of the arm
_MOST_PASSES = 2  # contests, while outliers are judged anew


@dataclass(frozen=True, eq=False)
class Cause:
    """An effect of the catalogue that was found.

    values, std : ndarray, shape (k,), SI, std NaN where the data do not determine the value
    p : float, over all that was asked
    share : float, of the gap, NaN where there is none
    """

    named: Named
    doubt: Doubt
    values: Array
    std: Array
    p: float
    share: float

    @property
    def misshapen(self) -> bool:
        """Whether the cause is there in another form than the catalogue's."""
        return self.doubt.stands

    @property
    def displaced(self) -> bool:
        """Whether nothing of the cause is needed beside what its size varies with."""
        return self.misshapen and not self.doubt.also_there


@dataclass(frozen=True)
class Place:
    """Where a part of the gap sits, and on what it depends."""

    where: str
    depends_on: str
    share: float


@dataclass(frozen=True, eq=False)
class Diagnosis:
    """Result of :func:`diagnose`.

    outlier : ndarray of bool, shape (m,), poses that were left out; statistic, limit : judged by
    waiting : ndarray of bool, shape (m,), poses from before the first move, left out where approaches
        follow from the order: the arm came there from a side that nothing tells
    not_asked : causes that the table's columns cannot speak of
    refused : what the contest held and what is not named all the same
    before, after : Fit, of the user's model and with all that was found; stage : what they fit
    linear : Stage, the same to first order
    suspects : tuple of Candidate, all that was asked; outcome : Outcome, of the contest
    growth : Growth, of the noise with range, None where the residual shows none
    scale : float, actual over the standard deviation that the stage weighs by
    """

    verdict: VerdictName
    noise: NoiseLevel
    causes: tuple[Cause, ...]
    located: tuple[Place, ...]
    gap: Gap
    hidden: tuple[Hidden, ...]
    not_asked: tuple[NotAsked, ...]
    refused: tuple[Refused, ...]
    data: Measurements
    outlier: Mask
    waiting: Mask
    statistic: Array
    limit: float
    before: Fit
    after: Fit
    outcome: Outcome
    stage: Stage
    linear: Stage
    suspects: tuple[Candidate, ...]
    heldout: Measurements | None
    growth: Growth | None
    scale: float


@one_blas_thread
def diagnose(cell: Cell, data: Measurements, *, heldout: Measurements | None = None) -> Diagnosis:
    """Find the unmodelled effects that the measurements show.

    heldout : measurements that take no part and on which the shrinkage of the error is proved

    Raises UnknownEffect, EffectCannotAct, TooFewPoses, ImplausibleData, CalibError.
    """
    if heldout is not None:
        data, heldout = in_one_session(data, heldout)
    model = build(cell, data.poses).model
    if (
        model.prior_rows
    ):  # as far as this robot is of the type: what it left must not look like a cause
        model = replace(model, prior=identify(cell, data).model.prior)
    check_counts(model, data)
    start = initial_values(model, data)
    refuse_mistakes(model, data, start)
    weights = whitening(cell, model, start, data)
    factor = _replicate_factor(data, weights)
    waiting = before_the_first_move(data.poses)
    stage = Stage(data, model, start, weights / factor, waiting, arm=cell.repeatability)
    suspects, missing = candidates(cell, model, data)
    linear = stage.about(stage.fit(()), [c.effect for c in suspects])
    asked = lineup(linear, suspects)
    outcome = contest(linear, asked)
    statistic, limit = np.zeros(len(data)), np.inf
    grows = growth(data, outcome.fit.r)
    if grows is not None:
        weights = weights / grows.relative[..., None, None]
        factor = _replicate_factor(data, weights)
        stage, linear = (replace(s, weights=weights / factor) for s in (stage, linear))
        outcome = contest(linear, asked)
    for _ in range(_MOST_PASSES):
        try:
            fit = stage.exact(outcome.fit)
        except Unsolvable:  # to first order an arm may be so soft that it does not stand
            outcome = plausible(linear, outcome)
            fit = stage.exact(outcome.fit)
        out, statistic, limit = _outliers(stage, fit)
        out |= waiting
        if not stage.robust and np.array_equal(out, stage.dropped):
            break
        stage = replace(stage, dropped=out, robust=False)
        linear = stage.about(fit, [c.effect for c in suspects])
        active = [_tuned_as(c, fit) for c in outcome.active]
        asked = lineup(linear, suspects, asked.banks)
        outcome = contest(linear, asked, active, outcome.proved)
    outcome, named, after, refused = believed(linear, outcome)
    before, after = stage.exact(outcome.before), stage.exact(sparing(linear, after))
    noise = _noise(stage, after, factor)
    counted = data.take(~stage.dropped)
    channels = stage.model.readout.channels
    floor = float(np.sqrt(channels.numbers_each(counted.seen))) * noise.sigma
    if heldout is not None and outcome.active:
        gap = gap_of(before, after, counted, heldout, floor, reach(stage, after, heldout))
        if gap.heldout_after is not None and gap.heldout_after >= (gap.heldout_before or 0.0):
            refused += tuple(
                Refused.of(c, "the poses held out are predicted no better") for c in outcome.active
            )
            outcome, named, after = nothing(outcome), (), before
            noise = _noise(stage, after, factor)
    scale = noise.factor / factor if noise.source != "cell" and after.mixing is None else 1.0
    left = _something_left(stage, outcome, after) or bool(refused and not outcome.active)
    std = _deviations(stage, after, scale) if named else np.zeros(0)
    causes = tuple(
        _cause(stage, outcome, n, after, scale, std, len(suspects), len(named)) for n in named
    )
    located = _located(stage, outcome, after, causes, scale, bool(refused))
    by_time = any(place.depends_on in BY_TIME for place in located)
    gap = gap_of(before, after, counted, heldout, floor, reach(stage, after, heldout), by_time)
    if by_time:
        added = after.model.effects[len(model.effects) :]
        account = CrossValidation(stage, after).ledger(added, by_time=True)
        gap = replace(gap, over_time=(account.rms_without, account.rms_with))
    entered = {cause.named.candidate.key for cause in causes}
    doubted = left or gap.open or any(c.misshapen for c in causes)
    doubted |= bool(causes) and noise.source == "residual"
    return Diagnosis(
        verdict=verdict(named, outcome, doubted, all(c.doubt.tested for c in causes)),
        noise=noise,
        causes=tuple(c for c in causes if not c.displaced),
        located=located,
        gap=gap,
        hidden=hidden(stage, outcome, entered, ALPHA, targets_of(cell)),
        not_asked=tuple(missing),
        refused=refused,
        data=data,
        outlier=stage.dropped & ~waiting,
        waiting=waiting,
        statistic=statistic,
        limit=limit,
        before=before,
        after=after,
        outcome=outcome,
        stage=stage,
        linear=linear,
        suspects=tuple(c for c in outcome.suspects if not c.echo),
        heldout=heldout,
        growth=grows,
        scale=scale,
    )


def _replicate_factor(data: Measurements, weights: Array) -> float:
    """Actual over stated noise by readings repeated without a move; one where they agree.

    One too where they are few. Readings between which the arm moved hold its repeatability as well.
    Groups with a gross error do not count: whatever is no noise stands out among the others.
    """
    _, group = np.unique(
        np.column_stack([data.poses.repeated, visits(data.poses)]), axis=0, return_inverse=True
    )
    group = group.reshape(-1)
    repeated = [group == g for g in np.flatnonzero(np.bincount(group) > 1)]
    spreads = np.array(
        [replicate_spread(data.take(g), weights[g]) for g in repeated] or np.zeros((0, 2))
    )
    spreads = spreads[spreads[:, 1] > 0]
    if not len(spreads):
        return 1.0
    squares = spreads[:, 0] / spreads[:, 1]
    typical = np.quantile(squares, 0.25, method="lower")
    spread, dof = spreads[squares <= _GROSS * typical].sum(axis=0)
    if dof < _REPLICATES or not spread:  # without any spread they are copies
        return 1.0
    return float(np.sqrt(spread / dof)) if refuted(float(spread), int(dof)) else 1.0


def _tuned_as(candidate: Candidate, fit: Fit) -> Candidate:
    """A candidate with the tuning that it has in a fit."""
    if not isinstance(candidate.effect, Tuned):
        return candidate
    return candidate.as_tuned(float(fit.values[fit.positions(candidate.effect)[0]]))


def _outliers(stage: Stage, fit: Fit) -> tuple[Mask, Array, float]:
    """Poses that the model with all its effects does not explain."""
    statistic = stage.statistics(fit)
    limit = threshold(statistic, fit.r.shape[-1])
    return judge(statistic, limit), statistic, limit


def _noise(stage: Stage, fit: Fit, factor: float) -> NoiseLevel:
    """Noise from the residual of the final model, the stated one or the repeats' where they agree."""
    kept = ~stage.dropped
    cost = float((fit.r**2).sum())
    weights = stage.weights[kept] * factor
    dof = int(counted(weights).sum()) - fit.spent
    lengths = stage.model.readout.channels.lengths
    alone = noise_level(cost * factor**2, dof, stage.data.take(kept), weights, lengths)
    if alone.source == "residual" and fit.levels is not None and fit.levels.instrument_only:
        # What the markers of one reading say of each other repeats in every reading.
        return replace(alone, source="replicates")
    if fit.mixing is None or fit.levels is None:
        return alone
    found = of_levels(fit.levels, alone)
    return replace(found, factor=found.factor * factor)


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
    if repeats < _REPLICATES or rest <= 0:
        return False
    F = max(outcome.last.cost - spread, 0.0) / rest / (spread / repeats)
    return bool(fdtrc(rest, repeats, F) < _LEFT_OVER)


def _cause(
    stage: Stage,
    outcome: Outcome,
    named: Named,
    after: Fit,
    scale: float,
    std: Array,
    asked: int,
    causes: int,
) -> Cause:
    effect = named.candidate.effect
    own = after.positions(effect)
    share = _share(outcome, after, named.entry, scale)
    p = min(1.0, named.entry.score.p * asked)
    doubt = shape_doubt(stage, after, effect, causes)
    return Cause(named, doubt, after.values[own], std[own], p, share)


def _deviations(stage: Stage, after: Fit, scale: float) -> Array:
    """Standard deviations of all values, shape (p,), NaN where the data do not determine the value.

    Of tunings those of the profile likelihood, where that is no parabola.
    """
    std = np.where(determined(after.span), scale * np.sqrt(np.diag(after.covariance)), np.nan)
    observation = stage.observation(after.model, after.weight)
    observation = replace(observation, scatter=stage.scatter.at(after.variances))
    profile = profiled(observation, after.values, after.span, std, scale)
    return np.where(np.isfinite(profile), profile, std)


def _share(outcome: Outcome, after: Fit, entry: Entry, scale: float) -> float:
    """By how much the sum of squares would rise without it, over its excess before; NaN without one.

    scale : float, actual over stated standard deviation; the noise left beside the estimated parameters
        is what it says, or less where less is left
    """
    before, left = (float((fit.r**2).sum()) for fit in (outcome.before, after))
    rows = int(np.count_nonzero(np.abs(after.J).sum(axis=-1)))
    excess = before - min(left, (rows - after.spent) * scale**2)
    return entry.fall / excess if excess > 0.0 else np.nan


def _located(
    stage: Stage,
    outcome: Outcome,
    after: Fit,
    causes: tuple[Cause, ...],
    scale: float,
    refused: bool,
) -> tuple[Place, ...]:
    """Places of all that was found, largest share first.

    refused : whether something was there that nothing was named for
    """
    found = [
        Place(c.named.candidate.where, c.named.candidate.depends_on, c.share)
        for c in causes
        if not c.displaced
    ]
    for c in causes:
        if c.misshapen:
            part = min(1.0, c.doubt.fall / max(c.named.entry.score.fall, 1e-9))
            share = c.share if c.displaced else part * c.share
            place = Place(c.named.candidate.where, c.doubt.depends_on, share)
            if (place.where, place.depends_on) not in {(p.where, p.depends_on) for p in found}:
                found.append(place)
    for entry in outcome.entries:
        if not entry.candidate.named:
            share = _share(outcome, after, entry, scale)
            found.append(Place(entry.candidate.where, entry.candidate.depends_on, share))
    if after.variances.configuration.any() or (refused and not found):
        # Beside a cause its share is undefined: it is no effect that could be taken out again.
        share = np.nan if found else _unfollowed(outcome, after)
        found.append(Place(_scattering(stage, after), "pose", share))
    return tuple(sorted(found, key=lambda place: -np.nan_to_num(place.share)))


def _scattering(stage: Stage, after: Fit) -> str:
    """The joint that nearly all comes from which differs from pose to pose; else the arm."""
    variances, robot = after.variances.configuration, after.model.robot
    each = [
        float(stage.scatter.point_variance(variances * (np.arange(len(variances)) == k)).mean())
        for k in range(len(variances))
    ]
    first = int(np.argmax(each))
    alone = first < robot.dof and each[first] > _ALONE * sum(each)
    return robot.joints[first] if alone else ARM


def _unfollowed(outcome: Outcome, after: Fit) -> float:
    """Share of the gap that differs from pose to pose and that nothing found follows."""
    before, left = (float((fit.r**2).sum()) for fit in (outcome.before, after))
    dof = int(np.count_nonzero(np.abs(after.J).sum(axis=-1))) - after.spent
    noise = dof * after.variances.scale**2
    return max(left - noise, 0.0) / (before - noise) if before > noise else np.nan
