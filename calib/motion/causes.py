"""The terms of a torque that were found: their values, how sure they are, and what may replace them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from calib.arm.robot import Robot
from calib.arrays import Array
from calib.effects.context import ARM
from calib.motion.contest import (
    DELAY,
    LEAST,
    Contest,
    Evidence,
    Question,
    given,
    holds,
    judged,
    taken,
)
from calib.motion.effects import EFFECTS, INERTIALS, KINDS, PAYLOAD, SCALE
from calib.motion.fit import MotionFit, sizes_of
from calib.motion.regressor import PER_LINK

Standing = Literal["established", "likely", "one_of"]
_OF_LINK = ("mass", "mx", "my", "mz", "ixx", "ixy", "ixz", "iyy", "iyz", "izz")
_UNITS = ("kg", *["kg m"] * 3, *["kg m^2"] * 6)
_SURE = 0.9  # probability from which on a term is taken for certain
_EVEN = 0.5  # at most, of one that no test confirms
_REFUSED = 0.01  # of a rival, one of ten that are asked in the place of each term


@dataclass(frozen=True)
class MotionParameter:
    """A value with its standard deviation by the jackknife over runs, and a 95 % interval; SI."""

    name: str
    unit: str
    value: float
    std: float
    low: float
    high: float


@dataclass(frozen=True)
class MotionCause:
    """A term of the torque that the runs need.

    rivals : kinds that predict left-out runs as well in its place, each with its probability
    share : of the squared error that the model had, what returns without it
    """

    effect: str
    where: str
    evidence: Evidence
    probability: float
    rivals: tuple[tuple[str, str, float], ...]
    parameters: tuple[MotionParameter, ...]
    share: float

    @property
    def standing(self) -> Standing:
        """How sure it is."""
        if self.rivals:
            return "one_of"
        return "established" if self.probability >= _SURE else "likely"


@dataclass(frozen=True)
class UnseenTerm:
    """What these motions could not show: the size that would be found; None where no size would be."""

    effect: str
    where: str
    smallest: float | None
    unit: str


def causes_of(
    question: Question,
    before: Contest,
    state: Contest,
    values: tuple[Contest, MotionFit, float],
    robot: Robot,
    chosen: bool,
) -> list[MotionCause]:
    """Every term that entered, the largest share first.

    values : what gives them, of the same model: fits without each run and of all, and s, by which
        efforts were stamped earlier than they are
    """
    power = np.where(state.products.power > 0.0, state.products.power, np.inf)
    excess = float(((before.squares - state.squares) / power).sum())
    found = []
    for (kind, j), own in judged(state, question).items():
        without = state.of_joint(j, taken(state.model, j, kind))
        grown = float((without - state.squares[:, j]).sum() / power[j])
        rivals = [] if chosen else _rivals(question, state, robot, kind, j)
        here = robot.joints[j]
        odds = [1.0, *(weight for _, weight in rivals)]
        sure = (1.0 - min(1.0, own.p)) / sum(odds)
        if not (chosen or own.stands()):
            sure = min(sure, _EVEN)
        found.append(MotionCause(
            kind, here, own, sure,
            tuple((n, ARM if n == INERTIALS else here, weight * sure) for n, weight in rivals),
            _parameters(*values, kind, j), max(grown / excess, 0.0) if excess > 0.0 else 0.0,
        ))  # fmt: skip
    if state.model.inertials != "none" and (chosen or question.may(state.model.inertials, 0)):
        found.append(_of_links(state, *values[:2], robot, excess))
    return sorted(found, key=lambda cause: -cause.share)


def _rivals(
    question: Question, state: Contest, robot: Robot, kind: str, j: int
) -> list[tuple[str, float]]:
    """Kinds that in the place of one predict the left-out runs as well, and their weights beside it."""
    rest = taken(state.model, j, kind)
    now, found = state.of_joint(j, state.model), []
    for name in [own.kind for own in KINDS] + ([SCALE] if not all(state.model.scaled) else []):
        if name == kind or holds(rest, j, name) or not question.may(name, j):
            continue
        terms = [(SCALE, 0.0)] if name == SCALE else state.products.columns.variants(j, name)
        for squares in sorted((state.of_joint(j, given(rest, j, t)) for t in terms), key=np.sum)[
            :1
        ]:
            worse = state.evidence(squares, now)
            if worse.gain < LEAST or worse.p > _REFUSED:
                found.append((name, _odds(worse.p)))
    if kind == "stribeck_friction" and "coulomb_friction" not in dict(found):
        found.append(("coulomb_friction", 1.0))  # of another law of speed
    if (
        kind in ("spring", "gravity_compensator")
        and state.model.inertials == "none"
        and question.may(INERTIALS, 0)
    ):
        found.append((INERTIALS, 1.0))  # a wrong mass beyond the joint pulls as a spring does
    if kind == "armature" and state.model.inertials == "inertials" and not robot.parents[j]:
        found.append((INERTIALS, 1.0))  # a rotor of the first joint turns as its link does
    return found


def _odds(p: float) -> float:
    """Of a rival that is worse with such a p, at most (Sellke et al., Am. Stat. 55(1), 2001)."""
    return float(-np.e * p * np.log(p)) if 0.0 < p < 1.0 / np.e else 1.0


def _parameters(
    state: Contest, whole: MotionFit, late: float, kind: str, j: int
) -> tuple[MotionParameter, ...]:
    """Values of a term, with deviations by the jackknife over runs."""
    if kind == SCALE:
        return (
            _jackknifed("scale", "1", whole.g[j] - 1.0, [own.g[j] - 1.0 for own in state.fits]),
        )
    begin = 0
    for name, variant in state.model.terms[j]:
        count = len(EFFECTS[name].unknowns)
        if name == kind:
            added = late if name == DELAY else 0.0
            found = [
                _jackknifed(*u, whole.b[j][i] + added, [own.b[j][i] + added for own in state.fits])
                for i, u in enumerate(EFFECTS[name].unknowns, begin)
            ]
            if name == "pre_sliding":
                found.append(
                    MotionParameter("distance", "rad", 1.0 / variant, np.nan, np.nan, np.nan)
                )
            return tuple(found)
        begin += count
    return ()


def _jackknifed(name: str, unit: str, value: float, others: Sequence[float]) -> MotionParameter:
    """A value and those without each run (r,)."""
    from scipy.stats import t

    count = len(others)
    std = float(np.sqrt((count - 1.0) / count * ((np.array(others) - np.mean(others)) ** 2).sum()))
    half = std * float(t.ppf(0.975, max(count - 1, 1)))
    return MotionParameter(name, unit, float(value), std, float(value - half), float(value + half))


def _of_links(
    state: Contest, values: Contest, whole: MotionFit, robot: Robot, excess: float
) -> MotionCause:
    """The cause that stands for the inertials that are free."""
    fixed = Contest.of(state.products, replace(state.model, inertials="none"), state.weights)
    own, S = state.evidence(fixed.pooled, state.pooled), sizes_of(state.products)
    power = np.where(state.products.power > 0.0, state.products.power, np.inf)
    grown = float(((fixed.squares - state.squares) / power).sum())
    payload = state.model.inertials == "payload"
    links = range(robot.dof - 1 if payload else 0, robot.dof)
    parameters = []
    for k in links:
        for i, (name, unit) in enumerate(zip(_OF_LINK, _UNITS, strict=True)):
            at = k * PER_LINK + i
            parameters.append(_jackknifed(
                name if payload else f"{robot.joints[k]}.{name}", unit, whole.x[at] * S[at],
                [f.x[at] * S[at] for f in values.fits],
            ))  # fmt: skip
    kind = PAYLOAD if payload else INERTIALS
    return MotionCause(kind, PAYLOAD if payload else ARM, own, 1.0 - min(1.0, own.p), (),
                       tuple(parameters), grown / excess if excess > 0.0 else 0.0)  # fmt: skip


def torque_constants(state: Contest, whole: MotionFit) -> Array:
    """Torque for one ampere and its deviation, (n, 2), NaN where the deviation is half of it."""
    found = []
    for j, g in enumerate(whole.g):
        own = _jackknifed("", "", g, [f.g[j] for f in state.fits])
        known = own.std < 0.5 * abs(g)
        found.append((1.0 / g, own.std / g**2) if known else (np.nan, np.nan))
    return np.array(found)


def unseen_terms(
    question: Question, state: Contest, whole: MotionFit, robot: Robot
) -> list[UnseenTerm]:
    """Terms that did not enter: the smallest size of which the error would fall by the least gain."""
    found, G = [], state.products.total
    squares = whole.squares(state.products).sum(axis=0)
    for j, joint in enumerate(robot.joints):
        for kind in KINDS:
            terms = state.products.columns.variants(j, kind.kind)
            if not terms or holds(state.model, j, kind.kind) or not question.may(kind.kind, j):
                continue
            places = [p for t in state.model.terms[j] for p in state.products.columns.of(j, t)]
            at = int(state.products.columns.of(j, terms[len(terms) // 2])[0])
            known = G[j][np.ix_(places, places)]
            beside = (
                G[j][at, at]
                - G[j][at, places] @ np.linalg.pinv(known, hermitian=True) @ G[j][places, at]
            )
            seen = beside > 1e-6 * G[j][at, at] > 0.0
            smallest = float(np.sqrt(LEAST * squares[j] / beside)) if seen else None
            found.append(UnseenTerm(kind.kind, joint, smallest, kind.unknowns[0][1]))
    return found
