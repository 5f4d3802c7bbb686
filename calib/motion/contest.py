"""Which terms the torques need: those without which runs that are left out are predicted worse.

Terms enter in the order of physics, as pure greed takes a square root of speed for dry friction; a
member leaves where others do its work. Evidence is paired: of each run that is left out, how much the
squared error grows without the term, in a one-sided t test over runs, with a least gain. Rows never
count: a run of 2 400 rows is worth some ten to ninety.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from calib.arrays import Array
from calib.motion.effects import SCALE
from calib.motion.fit import Inertials, MotionFit, MotionModel, fit, left_out, rigid_torque
from calib.motion.gram import CURVE, LOSSES, Products, Term

LEAST = 0.04
"""Least gain of the squared error, 2 % of the error itself."""
ALPHA = 0.05
DELAY = "torque_delay"
_RIDGES = (1e1, 1e2, 1e3, 1e4)
_ALIKE = 1.005  # times the squared error of the best ridge
_USUAL = ("coulomb_friction", "viscous_friction", "armature", "pre_sliding")
"""Kinds that every drive has, so that their evidence is that of the best of all joints alone."""
_OF_LINKS = (SCALE, "spring", "torque_offset")  # terms that other links may stand for
_ROUNDS = 3
_MOST = 12  # removals and newcomers of one round


@dataclass(frozen=True)
class Evidence:
    """What runs that are left out say for a term.

    gain : mean growth of the squared error without it, as a share; p : of so much by chance, one-sided
    """

    gain: float
    p: float

    @property
    def helps(self) -> bool:
        """Whether parts that are left out are predicted better with it, be it by chance."""
        return self.gain > LEAST

    def stands(self, count: int = 1) -> bool:
        """Whether it is there, as one of so many that were asked."""
        return self.helps and self.p < ALPHA / count


def evidence(without: Array, with_it: Array, in_stretches: bool = False) -> Evidence:
    """Of squared errors (r,) of parts.

    in_stretches : whether parts are short: differences count, as a stretch may hold hardly any error
    """
    from scipy.stats import t

    count, total = len(without), float(with_it.sum())
    if in_stretches:
        gains = (without - with_it) / max(total / count, 1e-300)
    else:
        gains = np.log(np.maximum(without, 1e-300) / np.maximum(with_it, 1e-300))
    mean = float(gains.mean())
    gain = mean if in_stretches else float(np.expm1(mean))
    if count < 2:
        return Evidence(gain, 1.0)
    spread = max(float(gains.std(ddof=1)) / np.sqrt(count), 1e-12)
    return Evidence(gain, float(t.sf(mean / spread, count - 1)))


@dataclass(frozen=True, eq=False)
class Contest:
    """A model and how its runs are predicted by the others.

    squares : ndarray, shape (r, n); fits : of the others, run by run; weights : ndarray, shape (n,)
    """

    products: Products
    model: MotionModel
    weights: Array
    squares: Array
    fits: tuple[MotionFit, ...]

    @classmethod
    def of(cls, products: Products, model: MotionModel, weights: Array | None = None) -> Contest:
        """Fit a model; without weights those of its residual."""
        if weights is None:
            plain = fit(products, model, np.ones(len(model.terms)))
            squares = plain.squares(products).sum(axis=0)
            # A joint whose sensor says nothing counts for nothing.
            silent = squares <= 0.0
            weights = np.where(
                silent, 0.0, products.counts.sum(axis=0) / np.where(silent, 1.0, squares)
            )
        squares, fits = left_out(products, model, weights)
        return cls(products, model, weights, squares, tuple(fits))

    def evidence(self, without: Array, with_it: Array) -> Evidence:
        """Of squared errors of all parts, shape (r,)."""
        return evidence(without, with_it, self.products.in_stretches)

    @property
    def pooled(self) -> Array:
        """Squared error of each run over all joints, each in its residual's variance, shape (r,)."""
        return np.asarray(self.squares @ self.weights)

    @cached_property
    def _rigid(self) -> Array:
        """Combination of columns that is the torque of the links, of every part, shape (r, n, K)."""
        each = np.array([rigid_torque(self.products, found.x) for found in self.fits])
        return np.asarray(each[np.searchsorted(self.products.folds, self.products.fold)])

    def with_terms(self, joint: int, terms: Sequence[Term], scaled: bool) -> Array:
        """Squared error (r,) of a joint with other terms, the links of each fold as they are."""
        G, rigid = self.products.G[:, joint], self._rigid[:, joint]
        places = [p for term in terms for p in self.products.columns.of(joint, term)]
        L = np.zeros((len(rigid), G.shape[-1], len(places) + scaled))
        L[:, places, np.arange(len(places))] = 1.0
        y = np.zeros_like(rigid)
        y[:, -1] = 1.0
        if scaled:
            L[..., -1] = rigid
        else:
            y -= rigid
        fold = self.products.fold
        others = G.sum(axis=0) - np.array([G[fold == f].sum(axis=0) for f in fold])
        A, rhs = np.swapaxes(L, 1, 2) @ others @ L, np.swapaxes(L, 1, 2) @ (others @ y[..., None])
        size = np.sqrt(np.maximum(np.diagonal(A, axis1=1, axis2=2), 1e-300))
        A = A / size[:, :, None] / size[:, None, :] + 1e-10 * np.eye(A.shape[-1])
        b = np.linalg.solve(A, rhs / size[..., None]) / size[..., None]
        c = y - (L @ b)[..., 0]
        return np.asarray(np.maximum(np.einsum("rk,rkl,rl->r", c, G, c, optimize=True), 0.0))

    def of_joint(self, joint: int, model: MotionModel) -> Array:
        """The same with the terms of another model."""
        return self.with_terms(joint, model.terms[joint], model.scaled[joint])


def taken(model: MotionModel, joint: int, kind: str) -> MotionModel:
    """A model without a kind at a joint."""
    if kind == SCALE:
        scaled = tuple(own and j != joint for j, own in enumerate(model.scaled))
        return replace(model, scaled=scaled)
    return model.without(joint, kind)


def given(model: MotionModel, joint: int, term: Term) -> MotionModel:
    """A model with a term at a joint."""
    if term[0] == SCALE:
        scaled = tuple(own or j == joint for j, own in enumerate(model.scaled))
        return replace(model, scaled=scaled)
    return model.adding(joint, term)


def holds(model: MotionModel, joint: int, kind: str) -> bool:
    """Whether a kind is in a model at a joint."""
    if kind == SCALE:
        return model.scaled[joint]
    return any(own == kind for own, _ in model.terms[joint])


@dataclass(frozen=True)
class Question:
    """What is asked: kinds in the order of the ladder, and what stays in the model.

    rungs : kinds that enter together, rung after rung; ``inertials`` one of them
    kept : for each joint, kinds of the user's model; excluded : (kind, joint) that cannot be
    """

    rungs: tuple[tuple[str, ...], ...]
    kept: tuple[frozenset[str], ...]
    excluded: frozenset[tuple[str, int]] = frozenset()

    def may(self, kind: str, joint: int) -> bool:
        """Whether a kind is a candidate at a joint."""
        return kind not in self.kept[joint] and (kind, joint) not in self.excluded

    @property
    def count(self) -> int:
        """Kinds that are asked."""
        return sum(len(rung) for rung in self.rungs) + 1


def contest(products: Products, model: MotionModel, question: Question) -> Contest:
    """Climb the ladder, then exchange and remove until all that is left stands.

    A round after which left-out parts are predicted worse than after the one before does not count.
    """
    state = Contest.of(products, model)
    last = None
    for _ in range(_ROUNDS):
        before = state.model
        for rung in question.rungs:
            risen = _risen(state, question, rung)
            if "pre_sliding" in rung and _first(state, risen, "pre_sliding"):
                late = _late(state, question)
                # One clock in the place of friction at many joints, where it says as much.
                risen = _risen(late, question, rung) if _as_good(late, risen) else risen
            state = risen
        state = _reduced(state, question)
        if last is not None and _over(state, state, last).helps:
            return last
        last = state
        if state.model == before:
            break
    return state


def _risen(state: Contest, question: Question, rung: Sequence[str]) -> Contest:
    """The state with the kinds of a rung at every joint where they help."""
    if "inertials" in rung:
        return _with_inertials(state, question)
    model = state.model
    for j in range(len(model.terms)):
        for kind in rung:
            if not question.may(kind, j) or holds(model, j, kind):
                continue
            own = state.of_joint(j, model)
            better = [(state.of_joint(j, given(model, j, t)), t) for t in _variants(state, j, kind)]
            if not better:
                continue
            squares, term = min(better, key=lambda pair: float(pair[0].sum()))
            if state.evidence(own, squares).helps and squares.sum() < own.sum():
                model = given(model, j, term)
    model = tuned(state, model, rung)
    return state if model == state.model else Contest.of(state.products, model)


def _first(state: Contest, risen: Contest, kind: str) -> bool:
    """Whether a kind is in the second model and was at no joint of the first."""
    joints = range(len(state.model.terms))
    before, after = (any(holds(own.model, j, kind) for j in joints) for own in (state, risen))
    return after and not before


def _late(state: Contest, question: Question) -> Contest:
    """The state with all torques late."""
    model = state.model
    for j in range(len(model.terms)):
        if question.may(DELAY, j):
            model = given(model, j, _variants(state, j, DELAY)[0])
    return Contest.of(state.products, model, state.weights)


def _as_good(one: Contest, other: Contest) -> bool:
    return float((one.squares @ other.weights).sum()) <= float(other.pooled.sum())


def _variants(state: Contest, joint: int, kind: str) -> list[Term]:
    return [(SCALE, 0.0)] if kind == SCALE else state.products.columns.variants(joint, kind)


def tuned(state: Contest, model: MotionModel, rung: Sequence[str]) -> MotionModel:
    """The model with the best variant of its kinds."""
    for j, terms in enumerate(model.terms):
        for kind, _ in terms:
            variants = state.products.columns.variants(j, kind)
            if kind in rung and len(variants) > 1:
                best = min(
                    variants, key=lambda t: float(state.of_joint(j, model.adding(j, t)).sum())
                )
                model = model.adding(j, best)
    return model


def _with_inertials(state: Contest, question: Question) -> Contest:
    """The state with the payload or all inertials free, where that predicts better.

    Springs, offsets and scales of several joints do the work of wrong masses: they leave for all
    inertials, and enter again where they must. They come back alone where they predict as well.
    """
    model, may_all = state.model, question.may("inertials", 0)
    if model.inertials == "inertials":
        if not may_all:
            return state
        fixed = Contest.of(state.products, replace(model, inertials="none"), state.weights)
        fixed = _risen(fixed, question, _OF_LINKS)
        return fixed if _as_good(fixed, state) else state
    for kind, j in members(state, question):
        model = taken(model, j, kind) if kind in _OF_LINKS else model
    fixed = state
    if model.inertials == "none" and question.may("payload", 0):
        payload = _risen(_freed(state, model, "payload"), question, _OF_LINKS)
        if _over(state, fixed, payload).stands(question.count):
            fixed = payload
    if not may_all:
        return fixed
    whole = _risen(_freed(state, model, "inertials"), question, _OF_LINKS)
    evident = judged(fixed, question).items()
    stand_ins = sum(kind in _OF_LINKS and own.stands() for (kind, _), own in evident)
    several = stand_ins + (fixed.model.inertials == "payload") > 1
    if _over(state, fixed, whole).stands(question.count):
        return whole
    return whole if several and not _over(state, whole, fixed).stands() else fixed


def _over(state: Contest, one: Contest, other: Contest) -> Evidence:
    """Evidence for another state over one, both in the weights of a third."""
    return state.evidence(one.squares @ state.weights, other.squares @ state.weights)


def _freed(state: Contest, model: MotionModel, inertials: Inertials) -> Contest:
    """The state with inertials free, by the ridge that predicts best."""
    models = [replace(model, inertials=inertials, ridge=ridge) for ridge in _RIDGES]
    found = [Contest.of(state.products, model, state.weights) for model in models]
    best = min(float(own.pooled.sum()) for own in found)
    # The weakest of those that predict alike: a strong one biases what other terms then mend.
    return next(own for own in found if float(own.pooled.sum()) < _ALIKE * best)


def members(state: Contest, question: Question) -> Iterator[tuple[str, int]]:
    """Kinds and joints of the model that were not the user's."""
    for j, terms in enumerate(state.model.terms):
        kinds = [kind for kind, _ in terms] + ([SCALE] if state.model.scaled[j] else [])
        yield from ((kind, j) for kind in kinds if question.may(kind, j))


def judged(state: Contest, question: Question) -> dict[tuple[str, int], Evidence]:
    """Evidence for every member, alone and over all joints of its kind."""
    found, kinds = dict[tuple[str, int], Evidence](), dict[str, list[tuple[int, Array]]]()
    for kind, j in members(state, question):
        without = _without(state, kind, j)
        found[kind, j] = state.evidence(without, state.of_joint(j, state.model))
        kinds.setdefault(kind, []).append((j, without))
    shown = {}
    for kind, each in kinds.items():
        both = [
            (state.weights[j] * w, state.weights[j] * state.of_joint(j, state.model))
            for j, w in each
        ]
        pooled = state.evidence(*np.sum(both, axis=0))
        for j, _ in each:
            own = found[kind, j]
            usual, joints = kind in _USUAL, len(state.model.terms)
            by_kind = pooled.stands(joints if usual else question.count) and own.stands()
            alone = own.stands(joints if usual else question.count * joints)
            shown[kind, j] = (
                own if alone or not by_kind else Evidence(own.gain, min(own.p, pooled.p))
            )
            if not (alone or by_kind):
                shown[kind, j] = Evidence(own.gain, max(own.p, ALPHA))
    return _clocks(state, shown)


def _without(state: Contest, kind: str, j: int) -> Array:
    """Squared error (r,) of a joint without a kind; links that may stand for it are found anew."""
    model = taken(state.model, j, kind)
    losses = state.products.robot.losses
    if kind in LOSSES and losses is not None and losses[j, LOSSES.index(kind)]:
        # What the file has may bend about standstill, and that is no cause.
        model = model.adding(j, (kind, CURVE))
    if kind in _OF_LINKS and state.model.inertials != "none":
        return np.asarray(Contest.of(state.products, model, state.weights).squares[:, j])
    return state.of_joint(j, model)


def _clocks(
    state: Contest, shown: dict[tuple[str, int], Evidence]
) -> dict[tuple[str, int], Evidence]:
    """The evidence, a delay refused that most joints do not show: one clock stamps them all."""
    late = [key for key, own in shown.items() if key[0] == DELAY and own.stands()]
    if 2 * len(late) > len(state.model.terms):
        return shown
    return {k: Evidence(e.gain, max(e.p, ALPHA)) if k[0] == DELAY else e for k, e in shown.items()}


def _reduced(state: Contest, question: Question) -> Contest:
    """The state without what does not stand, the weakest first.

    Stretches of one run or two are too few and too unlike for a test: what helps stays in the fit.
    """
    few = state.products.in_stretches
    for _ in range(_MOST * len(state.model.terms)):
        shown = judged(state, question).items()
        weak = {k: e for k, e in shown if not (e.helps if few else e.stands())}
        if not weak:
            break
        (kind, j), _ = max(weak.items(), key=lambda pair: (pair[1].p, -pair[1].gain))
        model = taken(state.model, j, kind)
        squares = state.squares.copy()
        squares[:, j] = state.of_joint(j, model)
        state = replace(state, model=model, squares=squares)
    state = Contest.of(state.products, state.model)
    if question.may(state.model.inertials, 0) and state.model.inertials != "none":
        fixed = Contest.of(state.products, replace(state.model, inertials="none"), state.weights)
        if not state.evidence(fixed.pooled, state.pooled).stands(question.count):
            state = fixed
    return state
