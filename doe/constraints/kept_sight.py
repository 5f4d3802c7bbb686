"""One marker that a tracker sees all along a motion: where the beam is broken, the lock is lost."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from calib.arrays import Array, Mask
from calib.cell import Cell
from calib.instruments import Tracker
from doe.constraints.clearance import JointLevers, Lasting, lasting
from doe.constraints.distances import point_segment, segment_segment
from doe.constraints.obstacles import obstacles_of
from doe.constraints.scene import Scene
from doe.constraints.sight import SKIN, incidence, visible

_CUTS = np.array([0.0, 1.0 / 16.0, 0.25, 1.0])  # of the beam, from the instrument


@dataclass(frozen=True, eq=False)
class KeptSight(Lasting):
    """The beam from an instrument to one marker stays whole.

    marker : int, its position on the arm; channel : int, the reading that it stands for
    instrument : ndarray, shape (3,), m, where the beam starts
    """

    marker: int
    channel: int
    instrument: Array
    name: str

    def allows(self, scene: Scene) -> Mask:
        return visible(scene)[:, self.channel]

    def lasts(self, scene: Scene, rates: Array, levers: JointLevers) -> Array:
        return np.asarray(np.min(list(self._lasting(scene, rates, levers)), axis=0))

    def _lasting(self, scene: Scene, rates: Array, levers: JointLevers) -> Iterator[Array]:
        """For how long nothing hides the marker, thing by thing, each (n,)."""
        at, own = scene.markers[:, self.marker], levers.markers[self.marker]
        frame = int(scene.cell.marker_frames[self.marker])
        yield np.full(len(scene), np.inf)
        if not np.isnan(scene.cell.marker_normals[self.marker]).any():
            yield self._facing(scene, rates, own)
        # What is near the instrument moves less than the marker does: the beam is cut in parts.
        moved = (rates @ own)[:, None] * _CUTS[1:]
        cuts = self.instrument + _CUTS[:, None] * (at - self.instrument)[:, None]
        near, far = cuts[:, :-1], cuts[:, 1:]
        for capsule, reach in zip(scene.capsules, levers.capsules, strict=True):
            start, end = capsule.start[:, None], capsule.end[:, None]
            across = segment_segment(near, far, start, end) - capsule.radius
            clear = lasting(across, moved + (rates @ reach)[:, None]).min(axis=1)
            inside = capsule.radius + SKIN - point_segment(at, capsule.start, capsule.end)
            slopes = levers.between(own, frame, reach, capsule.body)
            yield np.maximum(clear, lasting(inside, rates @ slopes))
        for obstacle in obstacles_of(scene.cell):
            stands_in = obstacle.from_point(self.instrument[None])[0] == 0.0
            if obstacle.ball is not None and not stands_in:
                yield lasting(obstacle.from_segment(near, far) - SKIN, moved).min(axis=1)

    def _facing(self, scene: Scene, rates: Array, own: Array) -> Array:
        """For how long the beam is within the marker's acceptance, (n,).

        Over half of the motion the beam grows by no more than the marker goes in it.
        """
        robot, frame = scene.cell.robot, scene.cell.marker_frames[self.marker]
        gap, size, least = incidence(scene, self.marker, self.instrument)
        turning = ~robot.prismatic & robot.moving(frame)
        moved, turns = rates @ own, rates[:, turning].sum(axis=1)
        speed = moved * (1.0 + abs(least)) + turns * (size + 0.5 * moved)
        return lasting(gap, speed)


def kept_sights(cell: Cell) -> tuple[KeptSight, ...]:
    """Every marker by which a tracker of the cell can keep its lock, where it is to."""
    found = []
    for instrument, part in cell.channels.blocks:
        if isinstance(instrument, Tracker) and instrument.keeps_sight:
            for channel in range(part.start, part.stop):
                marker, at = int(cell.channels.marker[channel]), instrument.position
                if at is not None:
                    name = cell.marker_names[marker]
                    found.append(KeptSight(marker, channel, at, f"sight of {name}"))
    return tuple(found)
