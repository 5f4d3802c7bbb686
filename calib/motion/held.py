"""What a robot's file can hold of the terms that were found, and how well torques follow from it.

A file has damping, dry friction and armature, and links that bodies can have. Losses are fitted anew
beside these links: dry friction and damping stand for friction of all other kinds. What belongs to
sensors, or to no file, is fitted beside them and is not written.
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
    rigid_torque,
    sizes_of,
)
from calib.motion.gram import FILE, LOSSES, Products, Term
from calib.motion.physical import physical
from calib.motion.regressor import PER_LINK


@dataclass(frozen=True, eq=False)
class Held:
    """What is written.

    links : ndarray, shape (n, 10), changes of the inertial parameters of each joint's link, SI
    losses : ndarray, shape (n, 3), damping, dry friction and armature, SI
    unknown : ndarray of bool, shape (n,), joints whose torque constant is, so that their losses stay
    lacking : kinds that no file holds
    before, after : error of the torque with the file as it was and with what is written, as shares, at
        held-out runs, or at runs left out in turn; over joints that are known, if any is
    """

    links: Array
    losses: Array
    unknown: Mask
    lacking: tuple[str, ...]
    before: float
    after: float


def held_by_file(found: MotionDiagnosis, own: Array, heldout: Products | None = None) -> Held:
    """What a file can hold of a diagnosis.

    own : ndarray, shape (n, 10), inertial parameters of links; NaN of those that may not change
    heldout : of runs that took no part

    Raises CalibError where no bodies are near the estimate.
    """
    model, products = found.fit.model, found.state.products
    weights, unknown = found.state.weights, np.array(model.scaled)
    unknown &= ~(torque_constants(found.state, found.fit)[:, 0] > 0.0)  # NaN is not above
    beside = [tuple(t for t in terms if not _of_file(t[0])) for terms in model.terms]
    plain = MotionModel(tuple(beside), model.scaled)
    parts = (
        [(products, heldout)] if heldout is not None else list(map(products.parted, products.folds))
    )
    squares = np.zeros((3, len(own)))
    for kept, out in parts:
        made = _refitted(kept, model, weights, own, unknown)[1]
        each = fit(kept, plain, weights).squares(out), made.squares(out), out.G[:, :, -1, -1]
        squares += np.sum(each, axis=1)
    power, known = np.where(squares[2] > 0.0, squares[2], np.nan), ~unknown | unknown.all()
    before, after = map(TorqueGap.overall, np.sqrt(squares[:2] / power)[:, known])
    x, made = _refitted(products, model, weights, own, unknown)
    kinds = {kind for terms in model.terms for kind, _ in terms}
    kinds |= {SCALE} if found.unit == "Nm" and any(model.scaled) else set()
    links = (sizes_of(products) * x).reshape(-1, PER_LINK)
    lacking = tuple(sorted(kinds - {*LOSSES}))
    return Held(links, _losses(products, made), unknown, lacking, before, after)


def _of_file(kind: str) -> bool:
    """Whether a kind is a loss, or friction for which losses stand."""
    return kind in LOSSES or EFFECTS[kind].sharp


def _refitted(
    products: Products, model: MotionModel, weights: Array, own: Array, unknown: Mask
) -> tuple[Array, MotionFit]:
    """Changes of the links that leave them bodies, and the fit of the losses beside these."""
    free, places = fit(products, model, weights), chosen(products, model.inertials)
    places = places[np.isfinite(own.ravel()[places])]
    x = physical(own, sizes_of(products), free.x, information(products, free, weights), places)
    terms, nominal = list(model.terms), rigid_torque(products, x)

    def emptied(j: int, kind: str) -> Term:
        """The term of a loss, in the place of the file's value."""
        term = kind, FILE
        nominal[j, products.columns.of(j, term)] = 0.0
        return term

    for j, kept in enumerate(model.terms):
        terms[j] = tuple(t for t in kept if not _of_file(t[0]))
        if not unknown[j]:
            terms[j] += tuple(emptied(j, kind) for kind in _losses_for({kind for kind, _ in kept}))
    while True:
        rest = MotionModel(tuple(terms), model.scaled)
        made = fit(replace(products, nominal=nominal), rest, weights)
        negative = _losses(products, made) < 0.0
        if not negative.any():
            return x, made
        for j in np.flatnonzero(negative.any(axis=1)).tolist():
            out = emptied(j, LOSSES[int(negative[j].argmax())])
            terms[j] = tuple(t for t in terms[j] if t != out)


def _losses_for(kinds: set[str]) -> list[str]:
    """Losses that stand for the terms of a joint; those that rub are the ones that a URDF has, too."""
    rubs = any(EFFECTS[kind].sharp for kind in kinds)
    return [loss for loss in LOSSES if loss in kinds or (rubs and EFFECTS[loss].urdf)]


def _losses(products: Products, made: MotionFit) -> Array:
    """Damping, dry friction and armature (n, 3), those of the file where they are not fitted."""
    of, joints = products.columns, range(len(made.g))
    places = [[int(of.of(j, (kind, FILE))[0]) for kind in LOSSES] for j in joints]
    return np.asarray(-np.take_along_axis(made.combination, np.array(places), 1) / made.g[:, None])
