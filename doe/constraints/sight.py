"""Which markers the instrument sees. A hidden marker is a missing row, it forbids no configuration."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from calib.arrays import Array, Mask
from doe.constraints.distances import point_segment, segment_segment
from doe.constraints.obstacles import Obstacle, obstacles_of
from doe.constraints.scene import PlacedCapsule, Scene, turned

_SKIN = 1e-6  # m; a marker this close to a surface is mounted on it
_SLACK = 1e-12


def visible(scene: Scene) -> Mask:
    """Whether each marker is seen at each configuration, shape (n, M).

    Hidden by a capsule across the beam, unless the marker itself sits in it; by a box or a ball
    across the beam, unless the instrument itself stands in it; and by turning away further than
    its acceptance, a quarter turn where only its normal is known. All are seen where nobody said
    where the instrument stands.
    """
    seen = np.ones((len(scene), len(scene.cell.markers)), dtype=bool)
    for _, j, hidden in _hidings(scene):
        seen[hidden, j] = False
    return seen


def hidden_by(scene: Scene) -> dict[tuple[int, int], str]:
    """What hides a marker, by configuration and marker: ``turned away`` or ``behind A3``.

    Of several causes the first one found. What is not in it, is seen (:func:`visible`).
    """
    return {(int(i), j): why for why, j, hidden in _hidings(scene) for i in np.flatnonzero(hidden)}


def _hidings(scene: Scene) -> Iterator[tuple[str, int, Mask]]:
    """Cause, marker, and the configurations (n,) where it is the first to hide that marker."""
    cell = scene.cell
    if cell.instrument is None:
        return
    obstacles = [o for o in obstacles_of(cell) if _stands_in_the_way(o, cell.instrument)]
    for j in range(len(cell.markers)):
        marker, free = scene.markers[:, j], _facing(scene, j)
        yield "turned away", j, ~free
        for capsule in scene.capsules:
            hidden = _behind_capsule(marker, capsule, cell.instrument, free)
            free &= ~hidden
            yield f"behind {capsule.name}", j, hidden
        for obstacle in obstacles:
            hidden = _behind_obstacle(marker, obstacle, cell.instrument, free)
            free &= ~hidden
            yield f"behind {obstacle.name}", j, hidden


def _facing(scene: Scene, j: int) -> Mask:
    """Whether the beam meets marker j within its acceptance, shape (n,)."""
    cell, normal = scene.cell, scene.cell.marker_normals[j]
    if np.isnan(normal).any() or cell.instrument is None:
        return np.ones(len(scene), dtype=bool)
    acceptance = cell.marker_acceptance[j]
    least = 0.0 if np.isnan(acceptance) else np.cos(acceptance)
    beam = cell.instrument - scene.markers[:, j]
    cosine = np.einsum("ni,ni->n", turned(scene.frames.R[:, -1], normal), beam)
    return np.asarray(cosine >= (least - _SLACK) * np.linalg.norm(beam, axis=1))


def _behind_capsule(marker: Array, capsule: PlacedCapsule, instrument: Array, among: Mask) -> Mask:
    near = point_segment(capsule.centre, instrument, marker) < capsule.reach
    at = np.flatnonzero(near & among)
    start, end = capsule.start[at], capsule.end[at]
    hidden = np.zeros(len(among), dtype=bool)
    crossed = segment_segment(instrument, marker[at], start, end) < capsule.radius
    hidden[at] = crossed & (point_segment(marker[at], start, end) > capsule.radius + _SKIN)
    return hidden


def _stands_in_the_way(obstacle: Obstacle, instrument: Array) -> bool:
    return obstacle.ball is not None and bool(obstacle.from_point(instrument[None])[0] > 0.0)


def _behind_obstacle(marker: Array, obstacle: Obstacle, instrument: Array, among: Mask) -> Mask:
    hidden = np.zeros(len(among), dtype=bool)
    if obstacle.ball is None:
        return hidden
    centre, radius = obstacle.ball
    at = np.flatnonzero(among & (point_segment(centre, instrument, marker) <= radius))
    start = np.broadcast_to(instrument, (len(at), 3))
    hidden[at] = obstacle.from_segment(start, marker[at]) <= _SKIN
    return hidden
