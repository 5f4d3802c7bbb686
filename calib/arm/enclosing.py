"""A capsule around points, and so around all that they span: a capsule is convex."""

from __future__ import annotations

import numpy as np

from calib.arm.se3 import even_directions
from calib.arrays import Array

_SUPPORTS, _AXES = 300, 120  # directions: for the outer points, and tried as axis
_COARSE, _FINE = 20, 100  # steps towards the centre of the smallest circle
_WIDER = (1.0, 1.03, 1.1, 1.2, 1.4)  # a wider capsule of flat points is shorter
_MARGIN = 1e-9  # m: rounding leaves no point outside


def enclosing_capsule(points: Array) -> tuple[Array, Array, float]:
    """Ends of the axis (3,) and radius [m] of a small capsule that holds points (n, 3), m.

    The axis is the best by volume of many directions and of the points' principal ones; the circle
    about it is centred by Badoiu and Clarkson's steps (2003). All points are inside whatever the
    search found: radius and ends are taken from them last.
    """
    outer = points[np.unique(np.argmax(points @ even_directions(_SUPPORTS).T, axis=0))]
    principal = np.linalg.svd(outer - outer.mean(axis=0), full_matrices=False)[2]
    sphere = even_directions(_AXES)
    axes = np.concatenate([principal, np.eye(3), sphere[sphere[:, 2] >= 0.0]])
    centres = _centres(outer, axes, _COARSE)
    tried = [_about(outer, axis, centre) for axis, centre in zip(axes, centres, strict=True)]
    best = axes[[int(np.argmin([_volume(own) for own in tried]))]]
    (centre,) = _centres(outer, best, _FINE)
    start, end, radius = min((_about(points, best[0], centre, f) for f in _WIDER), key=_volume)
    return start, end, radius + _MARGIN


def _about(
    points: Array, axis: Array, centre: Array, factor: float = 1.0
) -> tuple[Array, Array, float]:
    """The shortest capsule along an axis (3,) about a centre, its circle widened by a factor."""
    along = points @ axis
    away = np.linalg.norm(points - centre - np.outer(along, axis), axis=1)
    radius = float(away.max()) * factor
    cap = np.sqrt(np.maximum(radius**2 - away**2, 0.0))
    low, high = float((along + cap).min()), float((along - cap).max())
    if low > high:
        low = high = 0.5 * (low + high)
    return centre + low * axis, centre + high * axis, radius


def _centres(points: Array, axes: Array, steps: int) -> Array:
    """Nearly the centre of the smallest circle about points (n, 3), seen along axes (a, 3)."""
    flat = points - (points @ axes.T).T[..., None] * axes[:, None]
    centres = flat.mean(axis=1)
    for step in range(1, steps):
        farthest = ((flat - centres[:, None]) ** 2).sum(axis=2).argmax(axis=1)
        centres += (flat[np.arange(len(axes)), farthest] - centres) / (step + 1)
    return np.asarray(centres)


def _volume(capsule: tuple[Array, Array, float]) -> float:
    start, end, radius = capsule
    return float(np.pi * radius**2 * (np.linalg.norm(end - start) + 4.0 / 3.0 * radius))
