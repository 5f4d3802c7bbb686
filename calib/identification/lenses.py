"""The lens that an identification found, and whether what it leaves is what another lens would read.

To first order about the fit, the fixed values of a camera's lens are freed beside all that was
identified. A wrong lens takes nearly all of the misfit with it, an error of the arm or of the board
hardly any: of 24 days of ``studies.research.benchmarks.lenses`` at least 0.85 against at most 0.23.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import TypeVar

import numpy as np

from calib.arrays import Array, Mask
from calib.effects.base import Base
from calib.effects.lens import Distortion, Focal, LensEffect, PrincipalPoint
from calib.effects.protocol import Effect
from calib.identification.identification import Identification
from calib.instruments import Camera
from calib.linear import Complement, LinearProblem
from calib.observations import Points

_Of = TypeVar("_Of")
_PARTS: dict[str, type[LensEffect]] = {
    "focal": Focal,
    "center": PrincipalPoint,
    "distortion": Distortion,
}
_MOST = 0.6  # of what is left beyond noise, that another lens must explain
_BY_CHANCE = 1e-6
_WORTH = 1.15  # times what another lens leaves


def lens_of(result: Identification, camera: Camera) -> tuple[Array, Array, Mask]:
    """Values (n,) of a camera's lens, their covariance (n, n), and which were asked for, (n,).

    In the order and the units of :class:`calib.instruments.lens.Lens`.
    """
    by = np.zeros((len(camera.lens.values), len(result.values)))
    for effect, part in result.model.parts:
        if isinstance(effect, Base) and effect.of.name == camera.name:
            by[camera.free, np.arange(part.stop - len(camera.free), part.stop)] = 1.0
        elif isinstance(effect, LensEffect) and effect.changes(camera):
            by[effect.values, part] = np.eye(part.stop - part.start)
    covariance = by @ result.covariance @ by.T
    return camera.lens.values + by @ result.values, covariance, np.asarray(by.any(axis=1))


@dataclass(frozen=True)
class UnfitLens:
    """A camera whose readings do not fit its lens.

    free : tuple of str, what of the lens is held for known
    left_px, freed_px : root mean square of a point's misfit as fitted, and with that free
    pixel_m : m of a pixel at the points, None where an instrument beside it reads lengths
    share : of what is left beyond noise that goes with another lens
    """

    camera: str
    free: tuple[str, ...]
    left_px: float
    freed_px: float
    pixel_m: float | None
    share: float


def unfit_lenses(found: Identification) -> Iterator[UnfitLens]:
    """Cameras whose misfit would mostly go with another lens, by the readings that were kept.

    All lenses are freed at once: the misfit of two wrong ones goes with neither by itself. Those are
    named without whose freedom it stays.
    """
    from scipy.special import fdtrc

    asked = _asked(found)
    if not asked:
        return
    complement, columns = _complement(found, asked)
    freed = _freed(complement, columns, asked)
    dof = complement.rows - freed.Q.shape[1]
    before, after = _squares(complement), _squares(freed)
    if dof <= 0 or not after or before < _WORTH**2 * after:
        return
    share = (before - after) / (before - min(after, float(dof)))
    if share < _MOST:
        return
    for camera, effects in asked.items():
        others = _freed(complement, columns, (other for other in asked if other is not camera))
        without, more = _squares(others), freed.Q.shape[1] - others.Q.shape[1]
        if not more or without < _WORTH**2 * after:
            continue
        if float(fdtrc(more, dof, (without - after) / more / (after / dof))) > _BY_CHANCE:
            continue
        shown = found.by_instrument[camera.name, "px"]["fitted"]
        freed_px = shown * float(np.sqrt(after / before))
        pixel = None if found.model.readout.channels.metric else found.footprint
        free = tuple(n for n, kind in _PARTS.items() if any(isinstance(e, kind) for e in effects))
        yield UnfitLens(camera.name, free, shown, freed_px, pixel, share)


def _asked(found: Identification) -> dict[Camera, list[LensEffect]]:
    """Cameras of whose lens nothing is identified, and what would free it."""
    identified = [e for e in found.model.effects if isinstance(e, LensEffect)]
    asked = {}
    for camera in found.model.instruments:
        if isinstance(camera, Camera) and not any(e.changes(camera) for e in identified):
            known = [kind(f"camera:{camera.name}", camera.lens) for kind in _PARTS.values()]
            asked[camera] = [effect for effect in known if effect.acts(camera)]
    return {camera: own for camera, own in asked.items() if own}


def _complement(
    found: Identification, asked: Mapping[_Of, Sequence[Effect]]
) -> tuple[Complement, dict[_Of, Array]]:
    """What the identification leaves, and columns (N, k) of effects therein, by whose they are."""
    model, values = found.model.extended(found.values, [e for own in asked.values() for e in own])
    data, weights = found.fit.data.take(found.kept), found.weights[found.kept]
    r, J = Points(model, data, weights).linearise(values)
    own = len(found.values)
    complement = LinearProblem(r, J[..., :own], found.span).complement
    counts = [sum(len(effect.initial) for effect in effects) for effects in asked.values()]
    parts = np.split(complement.columns(J[..., own:]), np.cumsum(counts)[:-1], axis=1)
    return complement, dict(zip(asked, parts, strict=True))


def _freed(
    complement: Complement, columns: dict[Camera, Array], free: Iterable[Camera]
) -> Complement:
    own = [columns[camera] for camera in free]
    return complement.without(np.concatenate(own, axis=1)) if own else complement


def _squares(complement: Complement) -> float:
    return float(complement.left @ complement.left)
