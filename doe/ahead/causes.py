"""What is asked of causes: which of several is there, and whether one has the form of its name.

A cause e that is there moves the markers by ``X_e b``, b its fit to the data. What is left of it beside
all that is modelled and a rival follows from the Schur complement (:mod:`doe.ahead.information`).

A cause that stands alone is not explained while nobody could have seen that its size runs with an angle
(:mod:`calib.diagnosis.shape`). The poses that show it are those where the cause is large and the angles
are many: the power of that test, foreseen.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import TypeAlias

import numpy as np

from calib.arrays import Array, IntArray, Mask, stacked
from calib.diagnosis import Diagnosis
from calib.diagnosis.candidates import Candidate
from calib.diagnosis.causes import Cause
from calib.diagnosis.contest import Entrant
from calib.diagnosis.equivalence import SAME
from calib.diagnosis.shape import SHAPE_ALPHA, TESTED, chance_of, wave_power, waves
from calib.diagnosis.stepwise import linear_scores
from calib.evidence import visible_directions
from doe.ahead.forecast import Forecast, Offer
from doe.ahead.information import SURE, Information, Likeness, likeness, margins

_MARGIN = 1.6448536269514722  # standard deviations of ``SURE``
_SOMETHING = 1.0  # noise variances that a rival must explain to be one
_REACH = 25.0
"""Gain by which a rival may trail and still be in reach: at a predicted probability of 0.95 two
standard deviations above the mean."""
_NEAREST = 3  # rivals of a cause that stands alone
_MOST = 5  # rivals in one place: ten pairs
_WAVES = 4  # of each angle
_SURELY = 1e-12  # least probability, and greatest


Rivalry: TypeAlias = tuple[tuple[Candidate, ...], bool]
"""Causes that compete for one place among the effects found, and whether the diagnosis itself could not
tell them apart."""


def rivalries(diagnosis: Diagnosis) -> tuple[Rivalry, ...]:
    """The places in doubt: classes of several members, else causes with a rival in reach.

    Causes by name only: a curve bends to whatever is there, so that no pose tells it from its rivals.
    """
    if suspicious(diagnosis):
        return _suspected(diagnosis)
    curves = [c for c in diagnosis.outcome.active if not c.named]
    chosen = [*(cause.named.candidate for cause in diagnosis.causes), *curves]
    ambiguous = any(len(cause.named.causes) > 1 for cause in diagnosis.causes)
    found = []
    for cause in diagnosis.causes:
        members = list(cause.named.causes)
        declared = len(members) > 1
        if not declared and not ambiguous:
            members = [cause.named.candidate, *_near(cause.named.entry, chosen)]
        if len(members) > 1:
            found.append((tuple(members[:_MOST]), declared))
    return tuple(found)


def suspicious(diagnosis: Diagnosis) -> bool:
    """Whether something is there that nothing found accounts for, by name or without."""
    nothing = not diagnosis.causes and not diagnosis.outcome.active
    return nothing and diagnosis.verdict == "unknown"


def _suspected(diagnosis: Diagnosis) -> tuple[Rivalry, ...]:
    """Where something is there and nothing is found, the causes that explain most of it."""
    view = diagnosis.outcome.view.by_instrument
    named = [c for c in view.suspects if c.named and not c.echo]
    scores = linear_scores(view.complement, view, named)
    leading = sorted(named, key=lambda c: -scores[c.key].gain)[:_MOST]
    return ((tuple(leading), True),) if len(leading) > 1 else ()


def _near(entry: Entrant, chosen: Sequence[Candidate]) -> list[Candidate]:
    """Rivals by name whose gain comes close."""
    taken = {c.key for c in chosen}
    top = entry.rivals[0][1]
    near = [c for c, gain in entry.rivals if gain > top - _REACH and c.key not in taken]
    return [c for c in near if c.named and not c.echo][:_NEAREST]


@dataclass(frozen=True, eq=False)
class Discrimination:
    """The question which of two causes is there, of several pairs.

    now : Information, of the rivals beside all that is modelled, after the data
    order : ndarray of int, shape (n + K,), parameters in its order; sizes : of each, plausible, SI
    columns : tuple of ndarray of int, of each rival among the K
    b : tuple of ndarray, shape (k,), values of each rival in its place, in plausible sizes
    pairs : tuple of (int, int), rivals that are compared; members : tuple of Candidate, the rivals
    planned : int, rows of the data and of the poses to be chosen, None where none are
    """

    now: Information
    order: IntArray
    sizes: Array
    columns: tuple[IntArray, ...]
    b: tuple[Array, ...]
    pairs: tuple[tuple[int, int], ...]
    members: tuple[Candidate, ...] = ()
    planned: int | None = None

    @classmethod
    def of(
        cls,
        rows: Array,
        y: Array,
        sizes: Array,
        rivals: Sequence[IntArray],
        pairs: Sequence[tuple[int, int]],
    ) -> Discrimination:
        """From independent rows (N, p) of the data, the columns of all parameters.

        y : ndarray, shape (N,), residual without any of the rivals, to which each is fitted
        sizes : ndarray, shape (p,), plausible sizes; rivals : positions of each rival's parameters
        """
        own = np.concatenate(list(rivals))
        rest = np.setdiff1d(np.arange(rows.shape[1]), own)
        order = np.concatenate([rest, own])
        whole = Information.of(np.column_stack([rows[:, order] * sizes[order], y]), len(rest))
        now = replace(whole, root=whole.root[:-1, :-1])
        ends = np.cumsum([0, *map(len, rivals)])
        columns = tuple(np.arange(a, b) for a, b in itertools.pairwise(ends))
        S, lengths, score = now.S, now.lengths, whole.S[:-1, -1]
        seen = [visible_directions(S[np.ix_(at, at)], lengths[at])[0] for at in columns]
        b = tuple(U @ (U.T @ score[at]) for U, at in zip(seen, columns, strict=True))
        return cls(now, order, sizes[order], columns, b, tuple(pairs))

    @classmethod
    def within(
        cls, forecast: Forecast, members: Sequence[Candidate], pairs: Sequence[tuple[int, int]]
    ) -> Discrimination:
        """Of the rivals of one place, as the readings in hand know them."""
        model, (r, rows) = forecast.model, forecast.known.independent
        at = [model.amounts(c.effect) for c in members]
        own = np.concatenate(at)
        # Each rival takes the place of all: to first order, whole refits differ by less than noise.
        y = r + rows[:, own] @ forecast.values[own]
        return replace(cls.of(rows, y, model.sizes, at, pairs), members=tuple(members))

    @classmethod
    def in_doubt(cls, forecast: Forecast, rivalry: Rivalry) -> Discrimination:
        """The pairs in doubt; those of a class are by declaration, if either explains anything.

        A cause that stands alone is in doubt where another would often be preferred though it is true;
        that a richer rival would not show beside it is what Schwarz's price means.
        """
        members, declared = rivalry
        pairs = list(itertools.combinations(range(len(members)), 2))
        pairs = pairs if declared else pairs[: len(members) - 1]  # the first and each other
        found = cls.within(forecast, members, pairs)
        doubtful = found.preferences(found.now)[:, 0] < SURE
        signal = found.likeness(found.now).size[:, 0][np.array(pairs)].min(axis=1)
        return found.only((declared | doubtful) & (signal > _SOMETHING))

    @property
    def keys(self) -> list[tuple[str, str]]:
        """Of the pairs, ``effect:where`` of both."""
        return [(self.members[i].key, self.members[j].key) for i, j in self.pairs]

    def only(self, kept: Mask) -> Discrimination:
        """The same with some of the pairs, (pairs,) of bool."""
        return replace(self, pairs=tuple(itertools.compress(self.pairs, kept)))

    def within_reach(self, offer: Offer, start: Array, count: int) -> Discrimination:
        """The same with the pairs that some choice of ``count`` candidates might tell apart.

        A pair that no choice brings to the margin of ``SURE`` is not worth the poses that others need.
        What is left of one beside another is a least squares minimum, and so concave in the weights of
        the candidates: the plane that touches it at even weights lies above. Its slope towards a
        candidate is what the rival leaves of the truth there.

        start : ndarray, shape (dof,), where the arm stands
        """
        blocks = self.columns_of(offer.rows(slice(None), start), offer.q)
        planned, count = self.now.rows + count * blocks.shape[1], min(count, len(blocks))
        share = count / len(blocks)
        even, whole = self.now.added(np.sqrt(share) * blocks), self.now.added(blocks)
        _, D = even.left(blocks)
        S, limit = even.S, self.likeness(even).remaining
        for f, other in enumerate(self.columns):
            U = visible_directions(S[np.ix_(other, other)], even.lengths[other])[0]
            for e, (at, b) in enumerate(zip(self.columns, self.b, strict=True)):
                imitated = U @ (U.T @ (S[np.ix_(other, at)] @ b))
                slope = ((D[..., at] @ b - D[..., other] @ imitated) ** 2).sum(axis=-1)
                limit[e, f] += np.sort(slope)[-count:].sum() - share * slope.sum()
        k = self.likeness(whole).directions
        # Nothing scatters less than the difference of rivals that share all they can.
        best = margins(limit, k, np.minimum.outer(k, k), planned)[..., 0]
        reached = self.of_pairs(best).min(axis=-1) >= _MARGIN
        return replace(self.only(reached), planned=planned)

    def columns_of(self, rows: Array, q: Array) -> Array:
        """Rows (..., r, p) of SI units in the columns of the information, (..., r, n + K)."""
        del q
        return np.asarray(rows[..., self.order] * self.sizes)

    def likeness(self, known: Information, S: Array | None = None) -> Likeness:
        """How alike the rivals are as they were fitted; S : other Gram matrices (..., K, K)."""
        signals = [b[:, None] for b in self.b]
        return likeness(known.S if S is None else S, known.lengths, self.columns, signals)

    def of_pairs(self, found: Array) -> Array:
        """Of (..., E, E) both directions of every pair, shape (..., pairs, 2): either as the truth."""
        first, second = np.array(self.pairs, dtype=int).reshape(-1, 2).T
        return np.stack([found[..., first, second], found[..., second, first]], axis=-1)

    def separation(self, known: Information) -> Array:
        """What is left of each rival beside the other, in noise variances, shape (pairs, 2)."""
        return self.of_pairs(self.likeness(known).remaining[..., 0])

    def values(self, known: Information, S: Array) -> Array:
        """Margins once the poses are read by which the truth is to stand alone, (..., pairs).

        Standard deviations, of the worse direction.
        """
        alike, rows = self.likeness(known, S), known.rows if self.planned is None else self.planned
        found = margins(alike.remaining, alike.directions, alike.shared, rows, SAME)[..., 0]
        return np.asarray(self.of_pairs(found).min(axis=-1))

    def preferences(self, known: Information) -> Array:
        """Probability that the truth is preferred, shape (pairs, 2): the first one, the second one."""
        alike = self.likeness(known)
        return self.of_pairs(alike.preferred(alike.size[:, 0], known.rows))

    def probabilities(self, known: Information) -> Array:
        """The same, whichever of the two it is, shape (pairs,)."""
        return np.asarray(self.preferences(known).min(axis=-1))


@dataclass(frozen=True, eq=False)
class CauseForm:
    """The question whether a cause has the form of its name.

    columns_of : callable, rows (m, r, p) at configurations (m, dof) -> those of the fitted, and what
        the cause does times each wave over the angles of the joints, in plausible sizes
    now : Information, of the waves beside all that is modelled, after the data
    chances : ndarray, shape (joints,), what each counts; alpha : float, chance of a false doubt
    """

    key: str
    columns_of: Callable[[Array, Array], Array]
    now: Information
    chances: Array
    alpha: float

    def values(self, known: Information, S: Array) -> Array:
        """In standard deviations like those of rivals: enough of either is enough."""
        from scipy.special import ndtri

        del known
        power = np.clip(self.power(S), _SURELY, 1.0 - _SURELY)
        return np.asarray(ndtri(power) - ndtri(TESTED) + ndtri(SURE))[..., None]

    def power(self, S: Array) -> Array:
        """Probability of seeing another form, from products of the waves (..., K, K), shape (...)."""
        lengths, found = self.now.lengths, np.zeros(S.shape[:-2])
        for i, chance in enumerate(self.chances):
            at = slice(_WAVES * i, _WAVES * (i + 1))
            found += chance * wave_power(S[..., at, at], lengths[at], chance * self.alpha)
        return np.asarray(found / self.chances.sum())

    def hopeful(self, offer: Offer, start: Array) -> bool:
        """Whether all candidates together would show it."""
        blocks = self.columns_of(offer.rows(slice(None), start), offer.q)
        return bool(self.power(self.now.added(blocks).S) >= TESTED)


def forms_of(forecast: Forecast, diagnosis: Diagnosis) -> Iterator[CauseForm]:
    """Causes of which no reading would have shown another form, with what the data tell of it."""
    for cause in diagnosis.causes:
        if not (cause.doubt.tested or cause.misshapen):
            found = _form(forecast, diagnosis, cause)
            if found is not None:
                yield found


def _form(forecast: Forecast, diagnosis: Diagnosis, cause: Cause) -> CauseForm | None:
    model, q = diagnosis.after.model, diagnosis.data.poses.q
    own = model.amounts(cause.named.candidate.effect)
    joints = np.flatnonzero(np.ptp(q, axis=0) > 0.0)
    if not len(joints) or not len(own):
        return None
    sizes, moving = model.sizes, diagnosis.after.values[own]

    def beside(rows: Array, at: Array) -> Array:
        run = np.concatenate([waves(model.robot, at, q, int(k)) for k in joints], axis=1)
        moved = rows[..., own] @ moving
        # What only rivals have is none of this question.
        modelled = rows[..., : len(sizes)] * sizes
        return np.concatenate([modelled, moved[..., None] * run[:, None, :]], axis=-1)

    rows = stacked(beside(forecast.known.by_reading, q))
    held = forecast.known.held[:, : len(sizes)] * sizes
    held = np.pad(held, ((0, 0), (0, rows.shape[1] - len(sizes))))
    now = Information.of(np.concatenate([rows, held]), len(sizes))
    robot, where = model.robot, cause.named.candidate.where
    chances = np.array([chance_of(robot, robot.joints[k], where) for k in joints])
    alpha = SHAPE_ALPHA / max(1, len(diagnosis.causes))
    return CauseForm(cause.named.candidate.key, beside, now, chances, alpha)
