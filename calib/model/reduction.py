"""A complete and irreducible set of constant parameters, for a chain of any kind.

Six errors of every segment, together with base and markers, describe each error in many ways. At
generic poses the columns that others can imitate are found and dropped: base first, then markers,
then joint offsets are kept, of the rest what adds most (QR with pivoting on columns scaled to one;
of equals the one nearest the base), and the instrument's scale if lengths leave it anything. Nothing
about the robot's architecture is assumed, so parallel or intersecting axes and prismatic joints need
no table of their own.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from calib.arm.robot import Robot
from calib.arrays import Array, stacked
from calib.effects.geometry import Geometry
from calib.effects.protocol import Constant, Effect
from calib.effects.readings import TrackerScale
from calib.effects.tool_base import Base, Tool
from calib.inference.widths import Key
from calib.instruments import TRACKER, Instrument, Tracker
from calib.model import Model
from calib.poses import Poses, poses_at

_DEPENDENT = 3e-3
"""Sine of the angle to the span of the others below which a column is dropped.

Axes that are parallel by design are so to some 1e-3 in a real, corrected robot. What a column at this
angle would show of a millimetre is three micrometres, at three hundred times the usual uncertainty.
"""
_NOTHING = 1e-9  # norm of a column that moves no marker, relative to the largest
_TIE = 1e-9
"""Share of its length by which each column yields to the one before it.

A shift along z of one frame and along y of the next may be the same one: rounding is not to choose.
"""
_SCALE = "scale"  # of all lengths, where none is known
_PLACES = ("base", "tool", "tracker_scale")
_CARRIED = 100  # configurations
_NAMED = 0.05  # smallest share of an absorbing parameter that is worth naming


@dataclass(frozen=True)
class Dropped:
    """A parameter left out because others move the markers in the same way.

    id : str
    absorbed_by : tuple of (id, coefficient): this much of each other parameter per unit, SI; empty
        where it changes no reading at all
    """

    id: str
    absorbed_by: tuple[tuple[str, float], ...]


def generic_configurations(robot: Robot, count: int) -> Array:
    """Joint values at which nothing is special, shape (count, n): fixed seed, limits ignored."""
    span = np.where(robot.prismatic, robot.reach, np.pi)
    draws = np.random.default_rng(0).uniform(-1.0, 1.0, (count, robot.dof))
    return robot.tied(np.asarray(draws * span))


def _generic_values(model: Model) -> Array:
    """Nominal values, but unknown markers anywhere: a first guess may lie on an axis."""
    values = model.initial
    tools = model.where(Tool)
    values[tools] = np.random.default_rng(1).uniform(-0.1, 0.1, len(tools)) * model.robot.reach
    return values


def irreducible(model: Model) -> tuple[Model, tuple[Dropped, ...]]:
    """Drop the constant parameters that base, markers and the other constants absorb."""
    rigid = _as_tracked(model)
    if not rigid.effects:
        return model, ()
    count = 20 + 2 * len(rigid.parameters) // int(rigid.readout.channels.rows.sum())
    poses = poses_at(generic_configurations(model.robot, count))
    X = _rows(rigid, _generic_values(rigid), poses)
    norms = np.linalg.norm(X, axis=0)
    X = X / np.where(norms <= _NOTHING * norms.max(), np.inf, norms)
    kept = _select(X, _priorities(rigid))
    dropped = _explain(rigid, X, norms, kept)
    gone = {d.id for d in dropped}
    effects = tuple(_without(e, gone) for e in model.effects)
    return model.with_effects(tuple(e for e in effects if e is not None)), dropped


def carried_over(full: Model, model: Model, keys: Sequence[Key]) -> Array:
    """What constants of a robot are in terms of those that a model keeps, shape (own, k), SI.

    full : Model with all constants, of which ``model`` keeps some
    keys : of k constants of ``full``

    Two cells of one robot may keep others of the constants that go together. Base and markers take up
    the rest: they stand anew in every cell.
    """
    rigid = _as_tracked(full)
    X = _rows(
        rigid, _generic_values(rigid), poses_at(generic_configurations(model.robot, _CARRIED))
    )
    there = rigid.keys
    own = [key for key in model.keys if key in there and key[0] not in _PLACES]
    placed = [i for i, key in enumerate(there) if key[0] in _PLACES]
    kept = [*(there.index(key) for key in own), *placed]
    norms = np.linalg.norm(X, axis=0)
    scale = np.where(norms > 0.0, norms, 1.0)
    wanted = [there.index(key) for key in keys]
    shares = np.linalg.lstsq(X[:, kept] / scale[kept], X[:, wanted] / scale[wanted], rcond=1e-9)[0]
    return np.asarray((shares * scale[wanted] / scale[kept][:, None])[: len(own)])


def _as_tracked(model: Model) -> Model:
    """The constant part of a model, read by a tracker that stands where nobody knows.

    An instrument that meets the arm at places of its own reads less at generic poses, or is not
    there: what its places absorb, all together, is what those of a tracker do, and the scale as well
    where no length is known.
    """
    effects = [e for e in model.effects if _is_constant(e)]
    if all(isinstance(i, Tracker) for i in model.instruments):
        return model.with_effects(tuple(e for e in effects if not _moved_on(e)))
    sought = {e.of.name for e in effects if isinstance(e, Base) and not e.of.anchored}
    stood_for = _trackers(model)
    stands: list[Effect] = [
        Base("base" if tracker.seat is None else tracker.name, None, tracker)
        for tracker, those in stood_for
        if all(i.name in sought for i in those)
    ]
    if model.scaleless:
        stands.append(TrackerScale(_SCALE))
    effects = [*stands, *(e for e in effects if not isinstance(e, Base))]
    tracked = replace(model, instruments=tuple(own for own, _ in stood_for), lengths=())
    return tracked.with_effects(tuple(effects))


def _trackers(model: Model) -> list[tuple[Tracker, list[Instrument]]]:
    """A tracker in the world, and one on each link under an instrument, with those it stands for."""
    if all(i.seat is None for i in model.instruments):
        return [(TRACKER, [*model.instruments])]
    by_seat: dict[int | None, list[Instrument]] = {}
    for own in model.instruments:
        by_seat.setdefault(None if own.seat is None else own.seat.start, []).append(own)
    found = []
    for those in by_seat.values():
        read = np.unique(np.concatenate([i.read_of(len(model.markers)) for i in those])).tolist()
        first = those[0]
        own = replace(TRACKER, name=first.name, markers=tuple(read), seat=first.seat)
        found.append((own, those))
    return found


def _moved_on(effect: Effect) -> bool:
    """Whether it is the place of a tracker at a station after its first."""
    return isinstance(effect, Base) and bool(effect.station)


def _rows(model: Model, values: Array, poses: Poses) -> Array:
    """Rows (N, p) of the Jacobian: as read where all have one unit, else in standard deviations."""
    readings, J = model.jacobian(values, poses)
    if len({n.unit for i in model.instruments for n in i.numbers}) > 1:
        unstated = np.full(readings.shape[:-1], np.nan)
        J = model.readout.whitening(values, poses, readings, unstated) @ J
    return stacked(J)


def _is_constant(effect: Effect) -> bool:
    return isinstance(effect, Base | Tool | Constant | TrackerScale)


def _priorities(model: Model) -> Array:
    """Group of each parameter: the lower is kept first."""
    groups: list[int] = []
    for effect in model.effects:
        if isinstance(effect, Base | Tool):
            groups += [0 if isinstance(effect, Base) else 1] * len(effect.parameters)
        elif isinstance(effect, Geometry):
            offset = axis_component(model.robot, effect)
            groups += [2 if c == offset else 3 for c in effect.components]
        elif isinstance(effect, TrackerScale):
            groups.append(0 if effect.where == _SCALE else 4)
        else:
            groups.append(2)
    return np.array(groups)


def axis_component(robot: Robot, effect: Geometry) -> int:
    """Component of a frame's displacement that is its joint's own variable, else -1."""
    if not 0 < effect.frame <= robot.dof:
        return -1
    joint = effect.frame - 1
    axis = np.abs(robot.axes[joint])
    largest = int(axis.argmax())
    if axis[largest] < 1.0 - 1e-9:
        return -1
    return largest if robot.prismatic[joint] else largest + 3


def _select(X: Array, groups: Array) -> list[int]:
    from scipy.linalg import qr

    basis = np.zeros((len(X), 0))
    kept: list[int] = []
    for group in np.unique(groups):
        members = np.flatnonzero(groups == group)
        rest = X[:, members]
        for _ in range(2):  # twice is enough for orthogonality to rounding
            rest = rest - basis @ (basis.T @ rest)
        first = 1.0 - _TIE * np.arange(len(members))
        Q, R, order = qr(rest * first, mode="economic", pivoting=True)
        rank = int((np.abs(np.diag(R)) > _DEPENDENT).sum())
        kept += sorted(members[order[:rank]])
        basis = np.column_stack([basis, Q[:, :rank]])
    return sorted(kept)


def _explain(model: Model, X: Array, norms: Array, kept: list[int]) -> tuple[Dropped, ...]:
    gone = [i for i in range(X.shape[1]) if i not in kept]
    shares = np.linalg.lstsq(X[:, kept], X[:, gone], rcond=None)[0]
    names = [p.id for p in model.parameters]
    return tuple(
        Dropped(
            names[i],
            tuple(
                (names[j], float(share * norms[i] / norms[j]))
                for j, share in zip(kept, column, strict=True)
                if abs(share) > _NAMED
            ),
        )
        for i, column in zip(gone, shares.T, strict=True)
    )


def _without(effect: Effect, gone: set[str]) -> Effect | None:
    kept = tuple(i for i, p in enumerate(effect.parameters) if p.id not in gone)
    if len(kept) == len(effect.parameters):
        return effect
    if not kept:
        return None
    return effect.only(kept) if isinstance(effect, Geometry | Tool) else effect
