"""What is known now, and the rows that readings to come would add.

A model is linearised about what is known of it. The readings in hand, or those of a plan, are
independent rows of unit variance, ``V^-1/2 J`` with V the covariance by instrument and arm. A
configuration to come brings rows of the same kind, under the conditions in which it will be read. All
that is asked stands on these two: the error at the targets (:mod:`~doe.forecast.accuracy`), and which
causes are found (:mod:`~doe.forecast.foresee`).
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Self

import numpy as np

from calib.arrays import Array, in_parts
from calib.linear import LinearProblem
from calib.poses import Measurements, Poses, poses_at
from calib.poses.moves import in_order
from doe.constraints import constraints_of, scene_of, visible
from doe.problem.levels import levels_of
from doe.problem.linearisation import Linearisation
from doe.problem.pool import drawn

_DRAWN = 8192
_MANY = 2  # rows of a configuration for each parameter, beyond which their triangle stands for them


@dataclass(frozen=True, eq=False)
class Forecast(Linearisation):
    """A model to first order, and what is known of it.

    data : Measurements, the readings in hand; known : LinearProblem, of them and what is known beside
    """

    data: Measurements = field(kw_only=True)
    known: LinearProblem = field(kw_only=True)

    @classmethod
    def after(cls, at: Linearisation, known: LinearProblem, data: Measurements) -> Self:
        """With readings that are known to first order."""
        off, held = at.model.prior_residuals(at.values)
        known = replace(known, off=off, held=held)
        return cls(**vars(at), data=data, known=known)

    def offered(self, q: Array) -> Array:
        """Independent rows of configurations (m, dof), each read as a pose of a plan, (m, r, p).

        They are read where the data end. Where the arm stands no more, so soft would it be, they tell
        nothing.
        """
        load, station = self.cell.load, self.data.poses.station[in_order(self.data.poses)[-1]]
        masses = [0.0] if load is None else [0.0, load.mass]
        each, p = len(masses), len(self.values)
        poses = poses_at(
            np.repeat(q, each, axis=0),
            load_mass=np.tile(masses, len(q)),
            load_com=np.zeros(3) if load is None else np.asarray(load.com),
            station=np.full(len(q) * each, station),
            stations=self.data.poses.stations,
        )
        parts = in_parts(len(q), int(self.model.readout.channels.rows.sum()) * each * p)
        own = (poses.take(slice(part.start * each, part.stop * each)) for part in parts)
        read = [self._read(q[part], at, each) for part, at in zip(parts, own, strict=True)]
        return np.concatenate(read)

    def _read(self, q: Array, poses: Poses, each: int) -> Array:
        """Independent rows of configurations (m, dof), read so often as ``poses`` say, (m, r, p)."""
        seen = np.repeat(visible(scene_of(self.cell, q)), each, axis=0)
        visit = np.arange(len(poses)) // each
        given = self.data.sigma[np.isfinite(self.data.sigma) & self.data.seen]
        sigma = float(np.median(given)) if len(given) else np.nan
        rows = self.candidates(poses, seen, (visit, visit), sigma).by_reading
        rows = rows.reshape(len(q), -1, rows.shape[-1])
        rows = np.where(np.isfinite(rows).all(axis=(1, 2), keepdims=True), rows, 0.0)
        many = rows.shape[1] > _MANY * rows.shape[2]
        return np.asarray(np.linalg.qr(rows, mode="r")) if many else rows

    def feasible(self, count: int, seed: int) -> Array:
        """Up to ``count`` configurations that the cell allows, free and with its load, (m, dof).

        They keep to the levels of the cell's design where the readings in hand do.
        """
        levels, found = levels_of(self.cell, None, None), list[Array]()
        if levels is not None and (levels.of(self.data.poses.q) < 0).any():
            levels = None
        for q in drawn(self.cell, _DRAWN, levels, seed):
            found.append(self._allowed(q))
            if sum(map(len, found)) >= count:
                break
        return np.concatenate(found)[:count]

    def _allowed(self, q: Array) -> Array:
        """The configurations of (m, dof) that the cell allows, free and with its load."""
        for load in dict.fromkeys((None, self.cell.load)):
            for constraint in constraints_of(replace(self.cell, load=load)):
                q = q[constraint.allows(scene_of(self.cell, q))] if len(q) else q
        return q
