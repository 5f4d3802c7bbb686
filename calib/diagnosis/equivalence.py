"""Observationally equivalent causes: rivals that the readings cannot tell from one that was found.

The linear gain of a rival misses those that need a few directions more for the same: they lose by the
price of these alone. So the signal that was found is also compared with its best imitation by each
cause. Rivals that explain about as much, and such imitations, make a class with calibrated shares.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from calib.arrays import Array, IntArray
from calib.diagnosis.candidates import Candidate
from calib.diagnosis.conditional import Conditional
from calib.diagnosis.judged import CLOSE, JudgedCandidate, alternatives
from calib.diagnosis.regression import CandidateColumns
from calib.diagnosis.search import Outcome, fitted
from calib.diagnosis.stage import Fit, Stage
from calib.diagnosis.state import SelectedEffect, SelectionState
from calib.effects.joint import JointCoupling
from calib.effects.tuned import Tuned
from calib.inference.evidence import visible_directions

_EXACT = 2e-4  # of a signal that a twin may leave: columns are those of the fit, to first order
_MORE = 3  # directions beyond those of a cause from which on anything can be imitated


@dataclass(frozen=True, eq=False)
class Imitation:
    """A cause whose columns imitate the signal of another.

    left : float, of the evidence for the other, what it cannot imitate
    more : int, directions that it needs beyond those of the other
    exact : bool, whether both stand for each other whole
    """

    candidate: Candidate
    left: float
    more: int
    exact: bool


def imitations(outcome: Outcome, entry: JudgedCandidate) -> list[Imitation]:
    """All causes by name beside an entry, the best imitation first."""
    state, own = outcome.judged, entry.member.own.columns
    beside, _ = state.without(entry.member)
    U = _directions(beside, own)
    signal, crossed = U.T @ beside.z[own], U.T @ beside.crossed(own)
    found = []
    for suspect in _imitators(state, entry.candidate):
        V = _directions(beside, suspect.columns)
        if V.shape[1] > U.shape[1] + _MORE:
            continue
        across = crossed[:, suspect.columns] @ V
        imitated = across.T @ signal
        left = float(signal @ signal - imitated @ imitated)
        same = V.shape[1] == U.shape[1] > 0
        worst = float(np.linalg.norm(across, -2)) if same else 0.0
        exact = 1.0 - worst**2 < _EXACT
        more = max(0, V.shape[1] - U.shape[1])
        found.append(Imitation(suspect.candidate, left, more, exact))
    return sorted(found, key=lambda twin: (not twin.exact, twin.left))


def _imitators(state: SelectionState, cause: Candidate) -> Iterator[CandidateColumns]:
    """Causes by name that may be another name for one that was selected."""
    active = {c.key for c in state.active}
    for own in alternatives(cause, state.candidates):
        c = own.candidate
        if not c.named or c.key in active:
            continue
        more = c.effect.contains(cause.effect.kind, cause.where)
        if not more:  # itself and more is no other name
            yield own


def _directions(beside: Conditional, own: IntArray) -> Array:
    """``T``, shape (k, d), that makes columns (k,) orthonormal directions ``X T`` beside a set."""
    T, seen = visible_directions(beside.squares(own[None])[0], beside.products.lengths(own))
    return T[:, seen]


_FAINT = 0.1  # of the best gain: what shows less is no rival
_TRIED = 5  # close rivals that are looked at
_ALIKE = 3  # twins beside them
_LARGEST = 4  # members of a class beyond which likeness lists the first of a kind only
SAME = 8.0
"""Difference of -2 log likelihood that tells nothing yet."""
# Estimated by maximum likelihood from 382 named effects of 560 simulated cases (seeds 4001 and 4002
# of studies.research.sealed), and again from 136 classes of 459 others (7201, 7103): 0.25 to 0.3.
# Likelihoods alone are too sure, for forms differ from the catalogue's.
_TEMPER = 0.3
# Of a cause's probability: no reading says which of two names is right. Of 51 lost motions in 459
# sealed cases 32 were friction's, as the cases were drawn.
_SECOND_NAME = 0.5


@dataclass(frozen=True, eq=False)
class Named:
    """An effect that was found, with the class of causes that it cannot be told from.

    members : tuple of (Candidate, share), causes that the data cannot tell apart, best first; how
        likely each is, if one of them is the cause
    aliased : whether these poses show the same at another tuning
    """

    entry: JudgedCandidate
    members: tuple[tuple[Candidate, float], ...]
    aliased: bool = False

    @property
    def candidate(self) -> Candidate:
        """The most probable cause."""
        return self.members[0][0]

    @property
    def curve_ratio(self) -> float:
        """Evidence of the best curve at its place over its own: above one, its form is not the best."""
        own = self.entry.gain
        where = self.entry.candidate.where
        free = [gain for c, gain in self.entry.rivals if not c.named and c.where == where]
        return max(free, default=0.0) / max(own, 1.0)

    @property
    def causes(self) -> tuple[Candidate, ...]:
        """The members that differ in what they do: each cause once, by its first name."""
        second = {other.key for c, _ in self.members for other in c.also}
        return tuple(c for c, _ in self.members if c.key not in second)

    @property
    def lead(self) -> float:
        """How likely the first is, by whatever name, if one of them is the cause."""
        names = {self.candidate.key, *(c.key for c in self.candidate.also)}
        return sum(share for c, share in self.members if c.key in names)


def classes(stage: Stage, outcome: Outcome) -> tuple[tuple[Named, ...], Fit]:
    """Every named entry with its close rivals; and the fit with the best of each.

    All are compared to first order, whatever else is modelled free to make room for them.
    """
    state = outcome.judged
    columns = {c.candidate.key: c for c in state.candidates}
    chosen = {id(entry): entry.member for entry in outcome.entries}
    found: list[Named] = []
    direction = float(np.log(max(2, outcome.fit.rows)))
    for entry in sorted(outcome.entries, key=lambda e: e.gain):
        if not entry.candidate.named:
            continue
        rest = [m.candidate for key, m in chosen.items() if key != id(entry)]
        others = imitations(outcome, entry)
        prices = {c.key: -gain - 2.0 * float(np.log(c.twin_odds)) for c, gain in entry.rivals}
        rivals = [c for c in _close(entry, others) if c not in rest and c.key in prices]
        # What stands elsewhere already is another name here, and never the first.
        again = {c.key for c in rivals if c.echo and any(c.is_like(o) for o in rest)}
        rivals.sort(key=lambda c: (c.key in again, prices[c.key]))
        ordered = [(c, prices[c.key]) for c in rivals]
        if rivals[0].key != entry.candidate.key:
            own = replace(columns[rivals[0].key], candidate=_in_its_own_name(rivals[0]))
            chosen[id(entry)] = SelectedEffect(own, 1.0)
        found.append(Named(entry, _members(ordered, others, direction)))
    found.sort(key=lambda named: -named.entry.gain)
    fit, poses = outcome.fit, stage.data.poses
    if any(chosen[id(entry)] is not entry.member for entry in outcome.entries):
        fit = fitted(stage, state.with_members(tuple(chosen.values())), outcome.before)
    for i, named in enumerate(found):
        (first, share), *further = named.members
        values, effect = fit.values[fit.positions(first.effect)], first.effect
        if isinstance(effect, JointCoupling):
            first = replace(first, depends_on=effect.driven_by(values, poses))
        aliased = isinstance(effect, Tuned) and len(effect.aliases(poses, values)) > 0
        found[i] = replace(named, members=((first, share), *further), aliased=aliased)
    return tuple(found), fit


def _close(entry: JudgedCandidate, others: Sequence[Imitation]) -> list[Candidate]:
    """The entry, what explains nearly as much in its place, and what moves the readings as it does."""
    best, gains = entry.rivals[0][1], dict(entry.rivals)
    least = max(0.0, best - CLOSE)
    rivals = [c for c, gain in entry.rivals if c.named and gain > least][:_TRIED]
    alike = [t.candidate for t in others if t.exact]
    alike += [t.candidate for t in others if t.left < SAME and not t.exact][:_ALIKE]
    seen = [c for c in (*rivals, *alike) if gains.get(c, 0.0) > _FAINT * best]
    return list(dict.fromkeys([entry.candidate, *seen]))


def _members(
    rivals: Sequence[tuple[Candidate, float]],
    others: Sequence[Imitation] = (),
    direction: float = 0.0,
) -> tuple[tuple[Candidate, float], ...]:
    """Rivals (candidate, price) that the data cannot tell from the first; calibrated shares.

    Exact twins, and what loses by the price of its further directions alone, belong to them.
    direction : float, that price for one
    """
    behind = np.clip([price - rivals[0][1] for _, price in rivals], 0.0, 700.0)
    known = {twin.candidate: twin for twin in others}
    chosen = [i for i, lost in enumerate(behind) if lost <= SAME]
    for i, (rival, _) in enumerate(rivals):
        twin = known.get(rival)
        if twin is None or i in chosen:
            continue
        kinds = {rivals[j][0].effect.kind for j in chosen}
        room = len(chosen) < _LARGEST or rival.effect.kind not in kinds
        if twin.exact or (room and behind[i] - twin.more * direction <= SAME):
            chosen.append(i)
    odds = np.array([rivals[i][0].odds * rivals[i][0].twin_odds for i in chosen])
    # How often a cause is met is known as it is: likelihoods alone are too sure.
    lost = behind[chosen] - 2.0 * np.log(odds[0] / odds)
    weights = odds * np.exp(-0.5 * _TEMPER * lost)
    shares = weights / weights.sum()
    found = []
    for i, share in zip(chosen, shares.tolist(), strict=True):
        candidate = _in_its_own_name(rivals[i][0])
        part = _SECOND_NAME if candidate.also else 0.0
        found.append((candidate, (1.0 - part) * share))
        found += [(other, part * share / len(candidate.also)) for other in candidate.also]
    return tuple(found)


def _in_its_own_name(candidate: Candidate) -> Candidate:
    """The same, no longer in the place of another."""
    return replace(candidate, echo="", line=1) if candidate.echo else candidate
