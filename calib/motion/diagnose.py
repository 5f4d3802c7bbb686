"""Which unmodelled cause makes the measured joint torques differ from those of the model."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from calib.arm.robot import Robot
from calib.arrays import Array
from calib.cell import Cell
from calib.errors import CalibError, UnknownEffect
from calib.motion.contest import (
    ALPHA,
    LEAST,
    Contest,
    Evidence,
    Question,
    contest,
    given,
    holds,
    judged,
    taken,
)
from calib.motion.effects import EFFECTS, INERTIALS, KINDS, NAMES, PAYLOAD, SCALE
from calib.motion.encoders import GearFit, gear_fits
from calib.motion.fit import MotionFit, MotionModel, fit, sizes_of
from calib.motion.gram import Products, products
from calib.motion.motions import Motions, Unit
from calib.motion.regressor import PER_LINK
from calib.motion.stretches import correlation_time_of

Verdict = Literal["no_gap", "explained", "partly", "ambiguous", "unknown"]
Standing = Literal["established", "likely", "one_of"]
LADDER: tuple[tuple[str, ...], ...] = (
    ("torque_offset",),
    ("coulomb_friction", "viscous_friction"),
    ("armature",),
    (INERTIALS,),
    (SCALE,),
    ("pre_sliding",),
    ("load_friction",),
    ("stribeck_friction",),
    ("spring",),
    ("torque_ripple",),
    ("torque_delay",),
)
_RUNS = 5  # fewer are cut into stretches
_STRETCH, _LEFT_OUT = 2.0, 5.0  # autocorrelation times, of one, and of what is left out of one run
_NOISE = 1.5  # times the sensor's noise, up to which nothing remains
_OF_LINK = ("mass", "mx", "my", "mz", "ixx", "ixy", "ixz", "iyy", "iyz", "izz")
_UNITS = ("kg", *["kg m"] * 3, *["kg m^2"] * 6)
_SURE = 0.9


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


@dataclass(frozen=True, eq=False)
class TorqueGap:
    """Errors as shares of the RMS of each joint's torque.

    before, after, moving : ndarray, shape (n,); moving : after, where the joint moves
    kind : whether at held-out runs, at runs left out in turn, or at the fitted ones
    """

    before: Array
    after: Array
    moving: Array
    kind: Literal["heldout", "crossvalidated"]

    @staticmethod
    def overall(shares: Array) -> float:
        """Quadratic mean over joints."""
        return float(np.sqrt(np.nanmean(shares**2)))


@dataclass(frozen=True, eq=False)
class MotionDiagnosis:
    """Result of :func:`diagnose_motions`.

    runs : what was left out in turn; blocks : whether these are blocks of time within runs
    fitted, heldout, crossed : TorqueGap, heldout None where nothing was
    floor : share of the torque that the sensors' noise is, quadratic mean over joints
    constants : ndarray, shape (n, 2), torque at the joint for one ampere and its deviation; NaN where a
        joint's torque does not tell; None where efforts are torques
    gears : what second encoders say of each gear
    """

    cell: Cell
    verdict: Verdict
    causes: tuple[MotionCause, ...]
    fitted: TorqueGap
    crossed: TorqueGap
    heldout: TorqueGap | None
    floor: float
    rest: Literal["none", "structure"]
    hidden: tuple[UnseenTerm, ...]
    runs: tuple[str, ...]
    blocks: bool
    unit: Unit
    constants: Array | None
    gears: tuple[GearFit, ...]
    state: Contest
    fit: MotionFit

    @property
    def gap(self) -> TorqueGap:
        """At held-out runs where there are any."""
        return self.crossed if self.heldout is None else self.heldout


def diagnose_motions(
    cell: Cell, motions: Motions, *, heldout: Motions | None = None
) -> MotionDiagnosis:
    """Find the terms of the torque that the model lacks.

    heldout : runs that take no part, and tell how far the error falls

    Raises UnknownEffect for a place that is none; CalibError for motions in which nothing moves.
    """
    found = products_of(cell, motions)
    user, question = _asked(cell, motions, found)
    before = Contest.of(found, user)
    state = contest(found, user, question)
    return _concluded(cell, motions, heldout, question, before, state)


def identify_motions(
    cell: Cell, motions: Motions, *, heldout: Motions | None = None
) -> MotionDiagnosis:
    """Estimate the terms that the cell's model contains, and none beside.

    Raises as :func:`diagnose_motions`; CalibError where the model names no term of a torque.
    """
    if not cell.motion.effects:
        raise CalibError(f"[model] effects names no term of a torque; known are {', '.join(NAMES)}")
    found = products_of(cell, motions)
    user, question = _asked(cell, motions, found)
    nothing = replace(user, terms=((),) * cell.robot.dof, inertials="none",
                      scaled=(motions.unit == "A",) * cell.robot.dof)  # fmt: skip
    everything = replace(question, kept=(frozenset[str](),) * cell.robot.dof)
    return _concluded(cell, motions, heldout, everything, Contest.of(found, nothing),
                      Contest.of(found, user), chosen=True)  # fmt: skip


def products_of(cell: Cell, motions: Motions, whole: bool = False) -> Products:
    """The products of runs, or of blocks where these are few. Raises CalibError where nothing moves."""
    cut: dict[str, float] = {}
    if len(motions.runs) < _RUNS and not whole:
        time = correlation_time_of(cell, motions)
        cut = {"stretch": _STRETCH * time}
        cut |= {"left_out": _LEFT_OUT * time} if len(motions.runs) == 1 else {}
    return products(
        cell.robot, motions, KINDS, gravity=cell.gravity, ratios=cell.gear_ratios,
        payload=cell.payload, cutoff=cell.motion.cutoff, **cut,
    )  # fmt: skip


def _asked(cell: Cell, motions: Motions, found: Products) -> tuple[MotionModel, Question]:
    """The user's model, and what is asked beside it. Raises UnknownEffect."""
    n, of_current = cell.robot.dof, motions.unit == "A"
    model = MotionModel(((),) * n, (of_current,) * n)
    kept = [{SCALE} if of_current else set[str]() for _ in range(n)]
    for text in cell.motion.effects:
        kind, _, rest = text.partition(":")
        places = [own.strip() for own in rest.split(",")] if rest else list(cell.robot.joints)
        if kind in (PAYLOAD, INERTIALS):
            model = replace(model, inertials="payload" if kind == PAYLOAD else "inertials")
            for own in kept:
                own.add(INERTIALS)
            continue
        for where in places:
            if where not in cell.robot.joints:
                raise UnknownEffect(
                    f"{kind} cannot act at {where!r}; joints are {', '.join(cell.robot.joints)}"
                )
            j = cell.robot.joints.index(where)
            terms = [(SCALE, 0.0)] if kind == SCALE else found.columns.variants(j, kind)
            if not terms:
                raise UnknownEffect(f"{kind} cannot act at {where!r}; state its [robot.gear_ratio]")
            model = given(model, j, terms[len(terms) // 2])
            kept[j].add(kind)
    excluded = frozenset((kind, j) for kind, j in _excluded(cell))
    return model, Question(LADDER, tuple(map(frozenset, kept)), excluded)


def _excluded(cell: Cell) -> list[tuple[str, int]]:
    """Kinds and joints that the cell excludes."""
    joints, found = cell.robot.joints, []
    for text in cell.motion.excluded:
        kind, _, where = text.partition(":")
        found += [(kind, j) for j, name in enumerate(joints) if not where or name == where]
    return found


# -- conclusions -------------------------------------------------------------------------------


def _concluded(
    cell: Cell,
    motions: Motions,
    heldout: Motions | None,
    question: Question,
    before: Contest,
    state: Contest,
    *,
    chosen: bool = False,
) -> MotionDiagnosis:
    """The result of a contest; chosen : whether the user chose the terms, so that none has rivals."""
    found = state.products
    whole = fit(found, state.model, state.weights)
    first = fit(found, before.model, before.weights)
    causes = tuple(_causes(question, before, state, whole, cell.robot, chosen))
    held = None
    if heldout is not None:
        kept_out = products_of(cell, heldout, whole=True)
        held = _gap(kept_out, first.squares(kept_out), whole, kept_out, "heldout")
    fitted = _gap(found, first.squares(found), whole, found, "crossvalidated")
    crossed = replace(
        fitted, before=_shares(before.squares, found), after=_shares(state.squares, found)
    )
    power = np.where(found.power > 0.0, found.power, np.nan)
    floor = TorqueGap.overall(np.sqrt((found.noise**2).mean(axis=0) / power))
    after = TorqueGap.overall(fitted.after)
    rest: Literal["none", "structure"] = "none" if after < _NOISE * floor else "structure"
    return MotionDiagnosis(
        cell=cell,
        verdict=_verdict(causes, rest),
        causes=causes,
        fitted=fitted,
        crossed=crossed,
        heldout=held,
        floor=floor,
        rest=rest,
        hidden=tuple(_hidden(question, state, whole, cell.robot)),
        runs=found.names,
        blocks=found.in_stretches,
        unit=motions.unit,
        constants=_constants(state, whole) if motions.unit == "A" else None,
        gears=gear_fits(cell, motions),
        state=state,
        fit=whole,
    )


def _verdict(causes: Sequence[MotionCause], rest: str) -> Verdict:
    standing = {cause.standing for cause in causes}
    if not causes:
        return "no_gap" if rest == "none" else "unknown"
    if standing != {"established"}:
        return "ambiguous"
    return "explained" if rest == "none" else "partly"


def _shares(squares: Array, found: Products) -> Array:
    """RMS error of each joint as a share of its torque's, of squared errors (r, n)."""
    power = found.total[:, -1, -1]
    return np.asarray(np.sqrt(squares.sum(axis=0) / np.where(power > 0.0, power, np.nan)))


def _gap(
    found: Products,
    before: Array,
    after: MotionFit,
    of: Products,
    kind: Literal["heldout", "crossvalidated"],
) -> TorqueGap:
    moved = of.moving[:, :, -1, -1].sum(axis=0)
    moving = after.squares(of, moving=True).sum(axis=0) / np.where(moved > 0.0, moved, np.nan)
    return TorqueGap(
        _shares(before, found), _shares(after.squares(found), found), np.sqrt(moving), kind
    )


def _causes(
    question: Question,
    before: Contest,
    state: Contest,
    whole: MotionFit,
    robot: Robot,
    chosen: bool,
) -> list[MotionCause]:
    """Every term that entered, the largest share first."""
    power = np.where(state.products.power > 0.0, state.products.power, np.inf)
    excess = float(((before.squares - state.squares) / power).sum())
    found = []
    for (kind, j), own in judged(state, question).items():
        without = state.of_joint(j, taken(state.model, j, kind))
        grown = float((without - state.squares[:, j]).sum() / power[j])
        rivals = [] if chosen else _rivals(question, state, kind, j)
        odds = [1.0, *(weight for _, weight in rivals)]
        sure = (1.0 - min(1.0, own.p)) / sum(odds)
        found.append(MotionCause(
            kind, robot.joints[j], own, sure,
            tuple((name, robot.joints[j], weight * sure) for name, weight in rivals),
            _parameters(state, whole, kind, j), max(grown / excess, 0.0) if excess > 0.0 else 0.0,
        ))  # fmt: skip
    if state.model.inertials != "none" and (chosen or question.may(INERTIALS, 0)):
        found.append(_of_links(state, whole, robot, excess))
    return sorted(found, key=lambda cause: -cause.share)


def _rivals(question: Question, state: Contest, kind: str, j: int) -> list[tuple[str, float]]:
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
            if worse.gain < LEAST or worse.p > ALPHA:
                found.append((name, float(np.clip(2.0 * worse.p, 0.05, 1.0))))
    return found


def _parameters(state: Contest, whole: MotionFit, kind: str, j: int) -> tuple[MotionParameter, ...]:
    """Values of a term, with deviations by the jackknife over runs."""
    if kind == SCALE:
        return (
            _jackknifed("scale", "1", whole.g[j] - 1.0, [own.g[j] - 1.0 for own in state.fits]),
        )
    begin = 0
    for name, variant in state.model.terms[j]:
        count = len(EFFECTS[name].unknowns)
        if name == kind:
            each = enumerate(EFFECTS[name].unknowns, begin)
            found = [_jackknifed(u[0], u[1], whole.b[j][i], [own.b[j][i] for own in state.fits])
                     for i, u in each]  # fmt: skip
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


def _of_links(state: Contest, whole: MotionFit, robot: Robot, excess: float) -> MotionCause:
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
                [f.x[at] * S[at] for f in state.fits],
            ))  # fmt: skip
    kind = PAYLOAD if payload else INERTIALS
    return MotionCause(kind, PAYLOAD if payload else "arm", own, 1.0 - min(1.0, own.p), (),
                       tuple(parameters), grown / excess if excess > 0.0 else 0.0)  # fmt: skip


def _constants(state: Contest, whole: MotionFit) -> Array:
    """Torque for one ampere and its deviation, (n, 2), NaN where the deviation is half of it."""
    found = []
    for j, g in enumerate(whole.g):
        own = _jackknifed("", "", g, [f.g[j] for f in state.fits])
        known = own.std < 0.5 * abs(g)
        found.append((1.0 / g, own.std / g**2) if known else (np.nan, np.nan))
    return np.array(found)


def _hidden(question: Question, state: Contest, whole: MotionFit, robot: Robot) -> list[UnseenTerm]:
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


def parameters_of(
    causes: Sequence[MotionCause],
) -> Mapping[tuple[str, str], tuple[MotionParameter, ...]]:
    """Values of all causes by effect and place."""
    return {(cause.effect, cause.where): cause.parameters for cause in causes}
