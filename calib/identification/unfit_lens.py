"""Whether what an identification leaves is what another lens would read: then the lens is wrong.

To first order about the fit, the fixed values of a camera's lens are freed beside all that was
identified. A wrong lens takes nearly all of the misfit with it, an error of the arm or of the board
hardly any: of 24 days of ``studies.research.benchmarks.lenses`` at least 0.85 against at most 0.23.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np

from calib.arrays import Array, stacked
from calib.effects.lens import Distortion, Focal, LensEffect, PrincipalPoint
from calib.identification.identification import Identification
from calib.instruments import Camera
from calib.linear import orthonormal
from calib.observations import Points

_PARTS: dict[str, type[LensEffect]] = {
    "focal": Focal,
    "center": PrincipalPoint,
    "distortion": Distortion,
}
_MOST = 0.6  # of what is left beyond noise, that another lens must explain
_BY_CHANCE = 1e-6
_WORTH = 1.15  # times what another lens leaves


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

    asked = {
        camera: own
        for camera in found.model.readout.channels.instruments
        if isinstance(camera, Camera) and (own := _known_of(found, camera))
    }
    if not asked:
        return
    left = _left(found, asked)
    before, after, dof = left.sum_of(()), left.sum_of(asked), left.freedom
    if dof <= 0 or not after or before < _WORTH**2 * after:
        return
    share = (before - after) / (before - min(after, float(dof)))
    if share < _MOST:
        return
    for camera, effects in asked.items():
        without = left.sum_of(other for other in asked if other is not camera)
        more = left.ranks[camera]
        if not more or without < _WORTH**2 * after:
            continue
        if float(fdtrc(more, dof, (without - after) / more / (after / dof))) > _BY_CHANCE:
            continue
        shown = found.by_instrument[camera.name, "px"]["fitted"]
        freed_px = shown * float(np.sqrt(after / before))
        pixel = None if found.model.readout.channels.metric else found.footprint
        free = tuple(n for n, kind in _PARTS.items() if any(isinstance(e, kind) for e in effects))
        yield UnfitLens(camera.name, free, shown, freed_px, pixel, share)


def _known_of(found: Identification, camera: Camera) -> list[LensEffect]:
    """What of a camera's lens is held for known, nothing where a part of it is identified."""
    if any(isinstance(e, LensEffect) and e.changes(camera) for e in found.model.effects):
        return []
    known = [kind(f"camera:{camera.name}", camera.lens) for kind in _PARTS.values()]
    return [effect for effect in known if effect.acts(camera)]


@dataclass(frozen=True, eq=False)
class _Left:
    """Whitened residuals (rows,), and columns of lenses, both beside all that was identified.

    columns : dict, camera -> ndarray, shape (rows, k); freedom : int, degrees with all lenses free
    """

    r: Array
    columns: dict[Camera, Array]
    freedom: int

    @property
    def ranks(self) -> dict[Camera, int]:
        """Directions of each lens that nothing identified imitates."""
        return {camera: orthonormal(own).shape[1] for camera, own in self.columns.items()}

    def sum_of(self, free: Iterable[Camera]) -> float:
        """Sum of squares that these lenses leave where they are free."""
        columns = [self.columns[camera] for camera in free]
        Q = orthonormal(np.concatenate([np.zeros((len(self.r), 0)), *columns], axis=1))
        left = self.r - Q @ (Q.T @ self.r)
        return float(left @ left)


def _left(found: Identification, asked: dict[Camera, list[LensEffect]]) -> _Left:
    model, values = found.model.extended(found.values, [e for own in asked.values() for e in own])
    data, weights = found.fit.data.take(found.kept), found.weights[found.kept]
    r, J = Points(model, data, weights).linearise(values)
    flat, own = stacked(J), len(found.values)
    Q = orthonormal(flat[:, :own] @ found.span)
    beside = flat[:, own:] - Q @ (Q.T @ flat[:, own:])
    counts = [sum(len(effect.initial) for effect in effects) for effects in asked.values()]
    parts = np.split(beside, np.cumsum(counts)[:-1], axis=1)
    rows = int(np.count_nonzero(np.abs(flat).any(axis=1)))
    return _Left(
        r.ravel() - Q @ (Q.T @ r.ravel()),
        dict(zip(asked, parts, strict=True)),
        rows - Q.shape[1] - orthonormal(beside).shape[1],
    )
