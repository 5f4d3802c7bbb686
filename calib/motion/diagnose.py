"""Which unmodelled cause makes the measured joint torques differ from those of the model."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from calib.arrays import Array
from calib.cell import Cell
from calib.errors import CalibError, UnknownEffect
from calib.motion.causes import (
    MotionCause,
    UnseenTerm,
    causes_of,
    torque_constants,
    unseen_terms,
)
from calib.motion.contest import (
    DELAY,
    Contest,
    Question,
    contest,
    given,
    holds,
    tuned,
)
from calib.motion.effects import EFFECTS, INERTIALS, KINDS, NAMES, PAYLOAD, SCALE, Stated
from calib.motion.encoders import GearFit, gear_fits
from calib.motion.fit import MotionFit, MotionModel, fit
from calib.motion.gram import Products, products
from calib.motion.motions import Motions, Unit
from calib.motion.stretches import correlation_time_of

Verdict = Literal["no_gap", "explained", "partly", "ambiguous", "unknown"]
LADDER: tuple[tuple[str, ...], ...] = (
    ("torque_offset",),
    ("coulomb_friction", "viscous_friction"),
    ("armature",),
    ("gravity_compensator",),
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


@dataclass(frozen=True, eq=False)
class TorqueGap:
    """Errors as shares of the RMS of each joint's torque.

    before, after, moving : ndarray, shape (n,); moving : after, where the joint moves
    """

    before: Array
    after: Array
    moving: Array

    @staticmethod
    def overall(shares: Array) -> float:
        """Quadratic mean over joints."""
        return float(np.sqrt(np.nanmean(shares**2)))


@dataclass(frozen=True, eq=False)
class MotionDiagnosis:
    """Result of :func:`diagnose_motions`.

    causes, possible : terms that were found, and those with which left-out stretches are predicted
        better by no more than chance may: all are fitted
    runs : of each part that evidence stands on its run; blocks : whether parts are stretches of runs
    fitted, heldout, crossed : TorqueGap, heldout None where nothing was
    floor : share of the torque that the sensors' noise is, quadratic mean over joints
    constants : ndarray, shape (n, 2), torque at the joint for one ampere and its deviation; NaN where a
        joint's torque does not tell; None where efforts are torques
    gears : what second encoders say of each gear
    """

    cell: Cell
    verdict: Verdict
    causes: tuple[MotionCause, ...]
    possible: tuple[MotionCause, ...]
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

    @property
    def fitted_causes(self) -> tuple[MotionCause, ...]:
        """All terms that the model was fitted with."""
        return self.causes + self.possible


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
    state = Contest.of(found, user)
    state = Contest.of(found, tuned(state, user, NAMES))
    return _concluded(cell, motions, heldout, everything, Contest.of(found, nothing), state,
                      chosen=True)  # fmt: skip


def products_of(cell: Cell, motions: Motions, whole: bool = False) -> Products:
    """The products of runs, or of stretches where these are few. Raises CalibError for no motion."""
    cut: dict[str, float] = {}
    if len(motions.runs) < _RUNS and not whole:
        time = correlation_time_of(cell, motions)
        cut = {"stretch": _STRETCH * time}
        cut |= {"left_out": _LEFT_OUT * time} if len(motions.runs) == 1 else {}
    return products(
        cell.robot, motions, KINDS, gravity=cell.gravity, stated=Stated(cell.gear_ratios, cell.anchors),
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
                own |= {PAYLOAD, INERTIALS}
            continue
        for where in places:
            if where not in cell.robot.joints:
                raise UnknownEffect(
                    f"{kind} cannot act at {where!r}; joints are {', '.join(cell.robot.joints)}"
                )
            j = cell.robot.joints.index(where)
            terms = [(SCALE, 0.0)] if kind == SCALE else found.columns.variants(j, kind)
            if not terms:
                raise UnknownEffect(
                    f"{kind} cannot act at {where!r}; state its [robot.{EFFECTS[kind].needs}]"
                )
            model = given(model, j, terms[len(terms) // 2])
            kept[j].add(kind)
    excluded = frozenset((kind, j) for kind, j in _excluded(cell))
    return model, Question(LADDER, tuple(map(frozenset, kept)), excluded)


def _excluded(cell: Cell) -> list[tuple[str, int]]:
    """Kinds and joints that the cell excludes."""
    joints, found = cell.robot.joints, []
    for text in cell.motion.excluded:
        kind, _, where = text.partition(":")
        of_links = kind in (PAYLOAD, INERTIALS)
        found += [(kind, j) for j, name in enumerate(joints) if of_links or where in ("", name)]
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
    values = _values(cell, motions, state, whole)
    fitted_causes = causes_of(question, before, state, values, cell.robot, chosen)
    causes = tuple(c for c in fitted_causes if chosen or c.evidence.stands())
    possible = tuple(c for c in fitted_causes if c not in causes)
    held = None
    if heldout is not None:
        kept_out = products_of(cell, heldout, whole=True)
        held = _gap(kept_out, first, whole)
    fitted = _gap(found, first, whole)
    crossed = replace(
        fitted, before=_shares(before.squares, found), after=_shares(state.squares, found)
    )
    power = np.where(found.power > 0.0, found.power, np.nan)
    floor = TorqueGap.overall(np.sqrt((found.noise**2).mean(axis=0) / power))
    after = TorqueGap.overall(fitted.after)
    rest: Literal["none", "structure"] = "none" if after < _NOISE * floor else "structure"
    return MotionDiagnosis(
        cell=cell,
        verdict=_verdict(causes, "structure" if possible else rest),
        causes=causes,
        possible=possible,
        fitted=fitted,
        crossed=crossed,
        heldout=held,
        floor=floor,
        rest=rest,
        hidden=tuple(unseen_terms(question, state, whole, cell.robot)),
        runs=found.names,
        blocks=found.in_stretches,
        unit=motions.unit,
        constants=torque_constants(state, whole) if motions.unit == "A" else None,
        gears=gear_fits(cell, motions),
        state=state,
        fit=whole,
    )


def _values(
    cell: Cell, motions: Motions, state: Contest, whole: MotionFit
) -> tuple[Contest, MotionFit, float]:
    """The model of a contest beside efforts whose delay is taken out, with the fit and that delay.

    The slope of an effort has the slope of its noise, which makes a delay too short.
    """
    late = [
        combination[state.products.columns.of(j, (DELAY, 0.0))[0]]
        for j, combination in enumerate(whole.combination)
        if holds(state.model, j, DELAY)
    ]
    if not late:
        return state, whole, 0.0
    delay = -float(np.median(late))
    values = Contest.of(products_of(cell, motions.earlier(delay)), state.model)
    return values, fit(values.products, state.model, values.weights), delay


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


def _gap(found: Products, before: MotionFit, after: MotionFit) -> TorqueGap:
    """Errors of two fits at some runs."""
    moved = found.moving[:, :, -1, -1].sum(axis=0)
    moving = after.squares(found, moving=True).sum(axis=0) / np.where(moved > 0.0, moved, np.nan)
    first, last = (_shares(own.squares(found), found) for own in (before, after))
    return TorqueGap(first, last, np.sqrt(moving))
