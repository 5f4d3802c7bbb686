"""What a robot's file can hold of the terms that were found, and how well torques follow from it.

A file has damping, dry friction and armature of each joint, and links that bodies can have. These are
fitted anew beside the links: dry friction and damping stand for friction of all other kinds. What belongs
to sensors, or to no file, is fitted beside them and is not written.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from calib.arrays import Array, Mask
from calib.motion.causes import torque_constants
from calib.motion.diagnose import MotionDiagnosis, TorqueGap
from calib.motion.effects import EFFECTS, SCALE
from calib.motion.fit import (
    MotionFit,
    MotionModel,
    chosen,
    fit,
    information,
    left_out,
    rigid_torque,
    sizes_of,
)
from calib.motion.gram import LOSSES, Products, Term
from calib.motion.physical import physical
from calib.motion.regressor import PER_LINK

_DRY, _DAMPING = "coulomb_friction", "viscous_friction"


@dataclass(frozen=True, eq=False)
class Held:
    """What is written.

    links : ndarray, shape (n, 10), changes of the inertial parameters of each joint's link, SI
    losses : ndarray, shape (n, 3), damping, dry friction and armature, SI
    open : ndarray of bool, shape (n,), joints whose losses stay, as their torque constant is not known
    lacking : kinds that no file holds
    before, after : error of the torque with the file as it was and with what is written, as shares, at
        held-out runs, or at runs left out in turn; over joints that are not open
    """

    links: Array
    losses: Array
    open: Mask
    lacking: tuple[str, ...]
    before: float
    after: float

    @property
    def better(self) -> bool:
        """Whether the error fell."""
        return self.after < self.before


def held_by_file(found: MotionDiagnosis, own: Array, heldout: Products | None = None) -> Held:
    """What a file can hold of a diagnosis.

    own : ndarray, shape (n, 10), inertial parameters of the links that may change; NaN where a joint
        has none
    heldout : of runs that took no part

    Raises CalibError where no bodies are near the estimate.
    """
    state, whole = found.state, found.fit
    products, model, weights = state.products, whole.model, state.weights
    constants = torque_constants(state, whole)[:, 0]
    unknown = np.array(model.scaled) & ~(constants > 0.0)  # NaN is not above
    x, made = _refitted(products, model, weights, own, unknown)
    beside = [[t for t in terms if not _of_file(t[0])] for terms in model.terms]
    plain = MotionModel(tuple(map(tuple, beside)), model.scaled)
    if heldout is not None:
        tested = heldout
        first = fit(products, plain, weights).squares(heldout)
        last = made.squares(heldout)
    else:
        tested, (first, _) = products, left_out(products, plain, weights)
        last = np.zeros_like(first)
        for f in products.folds:
            out = np.flatnonzero(products.fold == f)
            rest = products.take(np.flatnonzero(products.fold != f))
            last[out] = _refitted(rest, model, weights, own, unknown)[1].squares(products.take(out))
    kinds = {kind for terms in model.terms for kind, _ in terms}
    kinds |= {SCALE} if found.unit == "Nm" and any(model.scaled) else set()
    return Held(
        (sizes_of(products) * x).reshape(-1, PER_LINK),
        _losses(products, made),
        unknown,
        tuple(sorted(kinds - {*LOSSES})),
        *(_overall(squares[:, ~unknown], tested.total[~unknown, -1, -1]) for squares in (first, last)),
    )


def _overall(squares: Array, power: Array) -> float:
    """Quadratic mean over joints of errors (r, n) as shares of their torques' squares (n,)."""
    return TorqueGap.overall(np.sqrt(squares.sum(axis=0) / np.where(power > 0.0, power, np.nan)))


def _of_file(kind: str) -> bool:
    """Whether a kind is a loss, or friction for which losses stand."""
    return kind in LOSSES or EFFECTS[kind].sharp


def _refitted(
    products: Products, model: MotionModel, weights: Array, own: Array, unknown: Mask
) -> tuple[Array, MotionFit]:
    """Changes of the links that make them bodies, and the fit of the losses beside these."""
    free = fit(products, model, weights)
    places = chosen(products, model.inertials)
    places = places[np.isfinite(np.repeat(own[:, 0], PER_LINK)[places])]
    x = physical(own, sizes_of(products), free.x, information(products, free, weights), places)
    terms, nominal = list(model.terms), rigid_torque(products, x)
    for j, kept in enumerate(model.terms):
        terms[j] = tuple(t for t in kept if not _of_file(t[0]))
        for kind in () if unknown[j] else _losses_of(kept):
            _, terms[j] = _emptied(products, nominal, j, kind), (*terms[j], _loss(products, j, kind))
    while True:
        plain = MotionModel(tuple(terms), model.scaled)
        made = fit(replace(products, nominal=nominal), plain, weights)
        negative = _losses(products, made) < 0.0
        if not negative.any():
            return x, made
        for j in np.flatnonzero(negative.any(axis=1)).tolist():
            kind = LOSSES[int(negative[j].argmax())]
            _emptied(products, nominal, j, kind)
            terms[j] = tuple(t for t in terms[j] if t[0] != kind)


def _losses_of(terms: tuple[Term, ...]) -> list[str]:
    """Losses that stand for the terms of a joint."""
    kinds = {kind for kind, _ in terms}
    rubs = any(EFFECTS[kind].sharp for kind in kinds)
    return [own for own in LOSSES if own in kinds or (rubs and own in (_DRY, _DAMPING))]


def _loss(products: Products, joint: int, kind: str) -> Term:
    """A loss as files have it."""
    return products.columns.variants(joint, kind)[-1]


def _emptied(products: Products, nominal: Array, joint: int, kind: str) -> None:
    """Take a loss of the robot's file out of the torques (n, K) that it gives."""
    nominal[joint, products.columns.of(joint, _loss(products, joint, kind))] = 0.0


def _losses(products: Products, made: MotionFit) -> Array:
    """Damping, dry friction and armature (n, 3), those of the file where they are not fitted."""
    places = [
        [int(products.columns.of(j, _loss(products, j, kind))[0]) for kind in LOSSES]
        for j in range(len(made.g))
    ]
    values = -np.take_along_axis(made.combination, np.array(places), axis=1)
    return np.asarray(values / made.g[:, None])
