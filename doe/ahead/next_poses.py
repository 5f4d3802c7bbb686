"""The verb: the poses that tell the rivals of a diagnosis apart, and what to do where no pose can."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from calib.arrays import Array, Mask
from calib.cell import Cell
from calib.cell.targets import targets_of
from calib.diagnosis import Diagnosis
from calib.errors import CalibError
from calib.poses import Poses
from calib.result import Result
from calib.threads import one_blas_thread
from doe.ahead.accuracy import Accuracy
from doe.ahead.causes import CauseForm, Discrimination, forms_of, rivalries, suspicious
from doe.ahead.forecast import Forecast, Offer, likely_read, refusal
from doe.ahead.information import SURE
from doe.ahead.remedies import Remedy, helpful
from doe.ahead.search import CompoundCriterion, Objective, PoseSearch, with_accuracy
from doe.day.day import quickest_order
from doe.plan import named
from doe.problem.target_errors import TargetErrors

POSES = 8
"""Poses that are chosen unless the user says otherwise."""
_CANDIDATES = 256
_TRIED = 32  # candidates that an intervention is tried on
_HELPED = 0.05  # rise of the probability from which poses are said to help
_SERVES = 0.5  # of an even share: what a pose must bring to a pair to be said to split it


@dataclass(frozen=True)
class PairPrediction:
    """Two rivals, and how likely the true one of them is preferred, whichever it is.

    rivals : two keys ``effect:where``
    now, after : float, with the data in hand, and with the next poses read as well
    remedies : tuple of Remedy, best first, where ``after`` is below ``SURE``
    """

    rivals: tuple[str, str]
    now: float
    after: float
    remedies: tuple[Remedy, ...] = ()

    @property
    def told(self) -> bool:
        """Whether the next poses are enough."""
        return self.after >= SURE

    @property
    def inseparable(self) -> bool:
        """Neither the poses nor any intervention that was tried tells them apart."""
        return not self.told and not self.remedies


@dataclass(frozen=True, eq=False, repr=False)
class NextPoses(Result):
    """Result of :func:`next_poses`.

    poses : Poses, configurations in the order of measuring; none where nothing is in doubt, or where
        no pose helps
    splits : for each pose, the pairs that it helps to tell apart
    predictions : tuple of PairPrediction, of every pair in doubt, the most doubtful first
    assumptions : tuple of str, how the poses are to be read for the predictions to hold
    forms : tuple of PairPrediction, causes that may have another form than their name's
    shares : of what as many poses for the causes alone, and for the accuracy alone, would bring; None
        where the accuracy is not asked for
    """

    poses: Poses
    splits: tuple[tuple[tuple[str, str], ...], ...] = ()
    predictions: tuple[PairPrediction, ...] = ()
    assumptions: tuple[str, ...] = ()
    forms: tuple[PairPrediction, ...] = ()
    shares: tuple[float, float] | None = None

    def sentences(self) -> list[str]:
        if not self.predictions:
            return ["Next poses: no cause is in doubt"]
        return [f"Next poses: {len(self.poses)} that tell causes apart", *self.assumptions]

    def rows(self) -> list[dict[str, object]]:
        return [
            {
                "cause": pair.rivals[0],
                "rival": pair.rivals[1],
                "probability_now": pair.now,
                "probability_after": pair.after,
            }
            for pair in self.predictions
        ]


@one_blas_thread
def next_poses(
    cell: Cell,
    diagnosis: Diagnosis,
    *,
    count: int = POSES,
    seed: int = 0,
    forms: bool = False,
    accuracy: bool = False,
    missed: Poses | None = None,
) -> NextPoses:
    """Poses that best separate what the diagnosis could not tell apart, within the cell's limits.

    count : int, configurations to choose; each is read under every load of the data
    seed : int, of the candidates
    forms : whether poses are to show, too, if a cause that is named has another form than its name's
    accuracy : whether they are to serve the accuracy at the targets beside that
    missed : poses that could not be read: what is nearer to them than to any that was is left out

    The smallest margin of all pairs is maximised by greedy choice and exchange (T-optimality). A pair
    that the whole pool of candidates cannot separate takes no part; for it, and for what is still in
    doubt afterwards, the interventions of :mod:`doe.ahead.remedies` are tried.

    Raises CalibError where count is not positive, or the cell allows no configuration at all.
    """
    if count < 1:
        raise CalibError(f"{count} next poses are too few; ask for at least one")
    nothing = NextPoses(named(np.zeros((0, cell.robot.dof)), "n"))
    if not np.isfinite(diagnosis.after.values).all():
        return nothing
    found = rivalries(diagnosis)
    if suspicious(diagnosis):  # what is there was taken for scatter, which would hide it
        alone = replace(diagnosis.after.observation, scatter=None)
        after = replace(diagnosis.after, levels=None, observation=alone)
        diagnosis = replace(diagnosis, after=after)
    rivals = [c.effect for members, _ in found for c in members]
    forecast = Forecast.after_diagnosis(cell, diagnosis, rivals)
    doubts = [doubt for r in found if (doubt := Discrimination.in_doubt(forecast, r)).pairs]
    unseen = tuple(forms_of(forecast, diagnosis)) if forms else ()
    if not doubts and not unseen:
        return nothing
    q = forecast.feasible(_CANDIDATES, seed)
    q = q[likely_read(cell.robot, q, diagnosis.data.poses, missed)]
    if not len(q):
        raise CalibError(refusal(missed))
    search = _search(doubts, unseen, forecast.offered(q, count), forecast.conditions.last, count)
    if search.objectives and accuracy:
        search = with_accuracy(search, accuracy_of(forecast, diagnosis), count)
    plan = search.best_plan(count) if search.objectives else []
    chosen = search.offer.q[plan]
    # Where no column depends on the approach the order is free: the shortest way.
    if search.offer.left is None and len(plan):
        chosen = chosen[quickest_order(cell, chosen)]
    judged = [own for doubt in doubts for own in _judged(doubt, forecast, chosen)]
    told = {pair.rivals for pair, _ in judged if pair.told}
    ways = _remedies(doubts, told, forecast, q[:_TRIED], count)
    pairs = [replace(pair, remedies=ways.get(pair.rivals, ())) for pair, _ in judged]
    shares = None
    if isinstance(search.weigh, CompoundCriterion):
        first, second = search.weigh.of(search.values(plan))
        shares = float(first), float(second)
    return NextPoses(
        named(chosen, "n"),
        tuple(tuple(p.rivals for p, serves in judged if serves[i]) for i in range(len(chosen))),
        tuple(sorted(pairs, key=lambda pair: pair.now)),
        assumptions_of(forecast, len(chosen)),
        tuple(_shown(form, forecast, chosen) for form in unseen),
        shares,
    )


def _search(
    doubts: Sequence[Discrimination],
    forms: Sequence[CauseForm],
    offer: Offer,
    start: Array,
    count: int,
) -> PoseSearch:
    """For what some choice of candidates might show."""
    reached = (doubt.within_reach(offer, start, count) for doubt in doubts)
    asked: list[Objective] = [doubt for doubt in reached if doubt.pairs]
    asked += [form for form in forms if form.hopeful(offer, start)]
    return PoseSearch(tuple(asked), offer, start)


def accuracy_of(forecast: Forecast, diagnosis: Diagnosis) -> Accuracy:
    """At the targets of the cell, after the readings in hand, for the user's model."""
    model = diagnosis.stage.model
    values = diagnosis.after.values[: len(model.parameters)]
    targets = TargetErrors.of(model, values, *targets_of(forecast.cell)).per(model.sizes)
    return Accuracy.of(targets, forecast.known.independent[1], model.sizes)


def _shown(form: CauseForm, forecast: Forecast, q: Array) -> PairPrediction:
    """How surely another form of a cause would be seen, now and with the poses read."""
    names, now = (form.key, f"another form of {form.key}"), float(form.power(form.now.S))
    if not len(q):
        return PairPrediction(names, now, now)
    whole = form.now.added(form.columns_of(forecast.in_order(q), q))
    return PairPrediction(names, now, float(form.power(whole.S)))


def _judged(
    doubt: Discrimination, forecast: Forecast, q: Array
) -> Iterator[tuple[PairPrediction, Mask]]:
    """Every pair before and after, and to which poses it owes that, (m,); as they are read."""
    now = after = doubt.probabilities(doubt.now)
    serves = np.zeros((len(q), len(now)), dtype=bool)
    if len(q):
        blocks = doubt.columns_of(forecast.in_order(q), q)
        whole = doubt.now.added(blocks)
        after, reached = doubt.probabilities(whole), doubt.separation(whole)
        gained = reached - doubt.separation(doubt.now)
        rest = (doubt.now.added(np.delete(blocks, i, axis=0)) for i in range(len(q)))
        lost = reached - np.array([doubt.separation(own) for own in rest])
        serves = ((lost >= _SERVES * gained / len(q)) & (gained > 0.0)).any(axis=-1)
        serves &= (after >= SURE) | (after > now + _HELPED)
    for i, key in enumerate(doubt.keys):
        yield PairPrediction(key, float(now[i]), float(after[i])), serves[:, i]


def _remedies(
    doubts: Sequence[Discrimination],
    told: Collection[tuple[str, str]],
    forecast: Forecast,
    q: Array,
    count: int,
) -> dict[tuple[str, str], tuple[Remedy, ...]]:
    """Interventions that tell apart what poses cannot, each with the poses best for it.

    told : keys of the pairs that poses do tell apart
    """
    open_ = [doubt.only(np.array([k not in told for k in doubt.keys])) for doubt in doubts]
    open_ = [doubt for doubt in open_ if doubt.pairs]

    def surely(changed: Forecast, allowed: Array) -> Iterator[tuple[tuple[str, str], float]]:
        offer, start = changed.offered(allowed, count), changed.conditions.last
        for doubt in open_:
            within = Discrimination.within(changed, doubt.members, doubt.pairs)
            search = _search([within], [], offer, start, count)
            if not search.objectives:
                continue
            plan = search.greedy(count)
            after = within.probabilities(search.known(plan)[0])
            if after.max() >= SURE:  # worth a second look, as it is read
                rows = within.columns_of(changed.in_order(offer.q[plan]), offer.q[plan])
                after = within.probabilities(within.now.added(rows))
            yield from zip(doubt.keys, after.tolist(), strict=True)

    return helpful(forecast, q, surely, SURE) if open_ else {}


def assumptions_of(forecast: Forecast, count: int) -> tuple[str, ...]:
    """How the poses to come are taken to be read."""
    if not count:
        return ()
    conditions = forecast.conditions
    loads = len(conditions.loads)
    said = [
        "one reading a pose" if loads == 1 else f"each pose under all {loads} loads of the data"
    ]
    said.append("in the order given, from where the data end; the approach follows from the order")
    if conditions.time is not None:
        said.append(f"one reading every {conditions.pace:.0f} s from the last reading on")
    if conditions.temperature is not None:
        said.append(f"at the last temperature, {conditions.temperature:.1f} degC")
    return tuple(said)
