"""The lens that an identification found, and whether what it leaves is what another lens would read.

To first order about the fit, the fixed values of a camera's lens are freed beside all that was
identified. A wrong lens takes nearly all of the misfit with it, an error of the arm or of the board
hardly any: of 24 days of ``studies.research.benchmarks.lenses`` at least 0.85 against at most 0.23.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from calib.arrays import Array, Mask
from calib.effects.base import Base
from calib.effects.focal import FocalScale
from calib.effects.lens import Distortion, Focal, LensEffect, PrincipalPoint
from calib.identification.identification import Identification
from calib.instruments import Camera
from calib.instruments.lens import FOCAL
from calib.linear import LinearProblem
from calib.observations import Points

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
    for effect, part in zip(result.model.effects, result.model.slices, strict=True):
        if isinstance(effect, Base) and effect.of.name == camera.name:
            by[camera.free, np.arange(part.stop - len(camera.free), part.stop)] = 1.0
        elif isinstance(effect, LensEffect) and effect.changes(camera):
            by[effect.values, part] = np.eye(part.stop - part.start)
        elif isinstance(effect, FocalScale) and effect.changes(camera):
            by[FOCAL, part.start] = camera.lens.values[FOCAL]
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
    """Cameras whose misfit would mostly go with another lens, by the readings that were kept."""
    for camera in found.model.readout.channels.instruments:
        if isinstance(camera, Camera) and (judged := _judged(found, camera)) is not None:
            yield judged


def _judged(found: Identification, camera: Camera) -> UnfitLens | None:
    from scipy.special import fdtrc

    known = [kind(f"camera:{camera.name}", camera.lens) for kind in _PARTS.values()]
    asked = [effect for effect in known if effect.acts(camera)]
    if not asked or any(
        isinstance(e, LensEffect) and e.changes(camera) for e in found.model.effects
    ):
        return None
    model, values = found.model.extended(found.values, asked)
    data, weights = found.fit.data.take(found.kept), found.weights[found.kept]
    r, J = Points(model, data, weights).linearise(values)
    own = len(found.values)
    beside = LinearProblem(r, J[..., :own], found.span).complement
    freed = beside.without(beside.columns(J[..., own:]))
    more = freed.Q.shape[1] - beside.Q.shape[1]
    dof = int(np.count_nonzero(np.abs(J).any(axis=-1))) - freed.Q.shape[1]
    before, after = (float(one.left @ one.left) for one in (beside, freed))
    if dof <= 0 or not more or not after or before < _WORTH**2 * after:
        return None
    share = (before - after) / (before - min(after, float(dof)))
    if (
        share < _MOST
        or float(fdtrc(more, dof, (before - after) / more / (after / dof))) > _BY_CHANCE
    ):
        return None
    shown = found.by_instrument[camera.name, "px"]["fitted"]
    freed_px = shown * float(np.sqrt(after / before))
    pixel = None if found.model.readout.channels.metric else found.footprint
    free = tuple(name for name, kind in _PARTS.items() if any(isinstance(e, kind) for e in asked))
    return UnfitLens(camera.name, free, shown, freed_px, pixel, share)
