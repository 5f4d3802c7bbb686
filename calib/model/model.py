"""The forward model: robot, markers and active effects -> predicted readings and their Jacobian.

A marker j at pose i is at ``arm(q_i, effects) * p_j`` in base axes, ``arm`` the frame of the tip on
which it rides, and an instrument makes a row of it (:mod:`calib.model.readout`): a tracker
``T_station_base(i) * arm(q_i, effects) * p_j`` (paper, equation 6). The arm is displaced frame by
frame by its effects; elastic ones follow the wrench that the displaced arm transmits, found by
fixed-point iteration. Derivatives are those of :mod:`calib.model.arm_jacobian`.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, TypeVar

import numpy as np

from calib.arm import statics
from calib.arm.kinematics import Frames, forward, link_origins, point_levers
from calib.arm.robot import Robot
from calib.arm.se3 import rotate
from calib.arrays import Array, IntArray, in_parts, room
from calib.effects.loads import SpringEffect
from calib.effects.protocol import (
    Constant,
    Displacement,
    Effect,
    ElasticEffect,
    LoadEffect,
    Parameter,
    PoseEffect,
    State,
    TwistEffect,
    WeightEffect,
    displaced,
)
from calib.effects.readings import MarkerEffect, PartEffect, ReadingEffect
from calib.effects.tool_base import Base, Tool
from calib.effects.tuned import Tuned, at_rest
from calib.errors import NoEquilibrium
from calib.inference.widths import Key, SizePrior
from calib.instruments import Channels, Instrument, KnownDistance, Tracker
from calib.model.arm_jacobian import arm_jacobian
from calib.model.readout import Readout
from calib.poses import Measurements, Poses

E = TypeVar("E", bound=Effect)
_EQUILIBRIUM_M = 1e-10  # markers at rest: a tenth of a nanometre
_UNSTABLE_M = 1e-7
_MAX_ROUNDS = 30


@dataclass(frozen=True, eq=False)
class Model:
    """A robot with markers and active effects. At :attr:`initial` values it is the nominal model.

    robot : Robot
    marker_names : tuple of str; markers : ndarray, shape (M, 3), m, each in the frame of its tip
    effects : tuple of Effect; their parameters, one after the other, are the vector of values
    payload : Payload
    gravity : ndarray, shape (3,), m/s^2, base axes
    instruments : tuple of Instrument, that read the markers: C channels, r numbers each at most
    lengths : tuple of KnownDistance, that are known beside all readings
    prior : SizePrior or None, what is believed beforehand of how large errors are; it counts of the
        model's parameters alone
    noise_scales : dict, instrument -> actual over stated noise, where it is known to differ
    marker_frames : ndarray of int, shape (M,), frames of these tips; without, that of ``robot.tip``
    """

    robot: Robot
    marker_names: tuple[str, ...]
    markers: Array
    effects: tuple[Effect, ...]
    payload: statics.Payload
    gravity: Array
    instruments: tuple[Instrument, ...]
    lengths: tuple[KnownDistance, ...] = field(default=(), kw_only=True)
    prior: SizePrior | None = field(default=None, kw_only=True)
    noise_scales: Mapping[str, float] = field(default_factory=dict, kw_only=True)
    marker_frames: IntArray = field(default_factory=lambda: np.zeros(0, dtype=int), kw_only=True)
    # The last linearisation: a fit, its judgement and its covariance ask for the same one.
    _last: dict[str, Any] = field(default_factory=dict, init=False, repr=False)

    def __post_init__(self) -> None:
        if not len(self.marker_frames):
            object.__setattr__(self, "marker_frames", self.robot.on_tip(len(self.markers)))

    @cached_property
    def by_tip(self) -> tuple[tuple[int, IntArray], ...]:
        """Frame of each tip that carries markers, and positions of these markers."""
        own = self.marker_frames
        tips = np.unique(own).tolist() or [self.robot.tip_frame]
        return tuple((frame, np.flatnonzero(own == frame)) for frame in tips)

    @property
    def scattered(self) -> bool:
        """Whether markers ride on several tips, so that they are no rigid body."""
        return len(self.by_tip) > 1

    @cached_property
    def parameters(self) -> tuple[Parameter, ...]:
        """The p parameters in the order of all value vectors and columns."""
        return tuple(p for e in self.effects for p in e.parameters)

    @cached_property
    def slices(self) -> tuple[slice, ...]:
        """Where each effect's parameters stand."""
        ends = np.cumsum([0, *(len(e.parameters) for e in self.effects)])
        return tuple(slice(int(a), int(b)) for a, b in itertools.pairwise(ends))

    @property
    def parts(self) -> Iterator[tuple[Effect, slice]]:
        """Each effect and where its parameters stand."""
        return zip(self.effects, self.slices, strict=True)

    def of(self, kind: type[E]) -> list[tuple[E, slice]]:
        """The effects of a kind, each with where its parameters stand."""
        return [(effect, part) for effect, part in self.parts if isinstance(effect, kind)]

    @cached_property
    def keys(self) -> tuple[Key, ...]:
        """Effect, where and name of every parameter."""
        return tuple(p.key for p in self.parameters)

    def positions(self, effect: Effect) -> IntArray:
        """Where the parameters of one of its effects stand, shape (k,)."""
        return next(np.arange(s.start, s.stop) for e, s in self.parts if e is effect)

    def amounts(self, effect: Effect) -> IntArray:
        """The same without a tuning, which is no amount."""
        return np.setdiff1d(self.positions(effect), self.tunings)

    def where(self, *kinds: type[Effect]) -> np.ndarray[tuple[int], np.dtype[np.int_]]:
        """Positions of the parameters of some kinds of effect."""
        found = [np.arange(s.start, s.stop) for e, s in self.parts if isinstance(e, kinds)]
        return np.concatenate(found) if found else np.zeros(0, dtype=int)

    def with_effects(self, effects: tuple[Effect, ...]) -> Model:
        """The same robot under other effects."""
        return replace(self, effects=effects)

    def extended(self, values: Array, effects: Iterable[Effect]) -> tuple[Model, Array]:
        """The model with those of the effects that it lacks, and its values with their initial ones.

        values : ndarray, shape (p,), SI
        """
        present = {id(effect) for effect in self.effects}
        extra = tuple(e for e in dict.fromkeys(effects) if id(e) not in present)
        model = self.with_effects((*self.effects, *extra))
        return model, np.concatenate([values, *(effect.initial for effect in extra)])

    @property
    def initial(self) -> Array:
        """Values of the nominal model, shape (p,), SI: zero, but where a search for tunings begins."""
        return np.concatenate([np.zeros(0), *(effect.initial for effect in self.effects)])

    @cached_property
    def tunings(self) -> IntArray:
        """Positions of the parameters that are tunings."""
        return np.array([part.start for _, part in self.of(Tuned)], dtype=np.int_)

    @cached_property
    def still(self) -> IntArray:
        """Positions of the tunings by which readings have no derivative: a scan alone finds them."""
        return np.array([s.start for e, s in self.of(Tuned) if not e.smooth], dtype=np.int_)

    def without(self, effects: Iterable[Effect], values: Array) -> tuple[Model, Array]:
        """The model without some of its effects, and its values (p,) without theirs."""
        gone = {id(effect) for effect in effects}
        kept = [(e, s) for e, s in self.parts if id(e) not in gone]
        own = [values[s] for _, s in kept]
        return self.with_effects(tuple(e for e, _ in kept)), np.concatenate([np.zeros(0), *own])

    @cached_property
    def sizes(self) -> Array:
        """Plausible sizes of the parameters, shape (p,), SI."""
        return np.array([p.size for p in self.parameters])

    # -- state ---------------------------------------------------------------------------------

    def state(self, values: Array, poses: Poses) -> State:
        """Equilibrium of the arm under its loads; NaN where there is none, the arm being too soft.

        values : ndarray, shape (..., p), SI; leading axes are independent models (trials)
        """
        loads = self.loads(values, poses)
        extra = self._springs(values, poses)
        constant, given = self.constant_displacements(values), self._given(values, poses)
        frames = forward(self.robot, poses.q, constant, given)
        yields = bool(np.take(values, self.where(ElasticEffect), axis=-1).any())
        tips: Array | None = None
        for _ in range(_MAX_ROUNDS):
            carriers = link_origins(self.robot, frames, poses.q)
            wrench = statics.transmitted(self.robot, loads, frames, carriers).with_extra(extra)
            state = State(poses, frames, wrench)
            points = self.tip_points(frames, values, poses)
            if tips is not None and np.abs(points - tips).max(initial=0.0) < _EQUILIBRIUM_M:
                break
            if not yields:
                break
            moved = np.abs(points - tips) if tips is not None else np.full_like(points, np.inf)
            tips = points
            present = self._deflections(values, state)
            present = present if given is None else present + given
            frames = forward(self.robot, poses.q, constant, present)
        else:
            lost = moved.max(axis=(-1, -2, -3), initial=0.0) > _UNSTABLE_M
            state.frames.present.o[np.broadcast_to(lost, moved.shape[:-3])] = np.nan
        return state

    def loads(self, values: Array, poses: Poses) -> statics.Loads:
        """What pulls on the arm at each pose, the errors of weights and wrenches included.

        values : ndarray, shape (..., p), SI
        """
        loads = statics.loads_of(self.robot, poses, self.payload, self.gravity)
        changed = loads
        for effect, part in self.of(WeightEffect):
            if values[..., part].any():
                changed = changed.changed(effect.changes(poses, loads), values[..., part])
        return changed

    def _springs(self, values: Array, poses: Poses) -> Array:
        """Wrenches of springs beside the joints, shape (..., m, F, 6), in frame axes."""
        total = np.zeros((len(poses), self.robot.frame_count, 6))
        for effect, part in self.of(SpringEffect):
            basis = effect.wrench_basis(poses, self.robot.frame_count)
            total = total + np.einsum("mfip,...p->...mfi", basis, values[..., part])
        return total

    def _given(self, values: Array, poses: Poses) -> Array | None:
        """Displacements known before the arm bends, (..., m, F, 6), None where there are none."""
        moved = [
            own
            for e, part in self.of(PoseEffect)
            if not at_rest(e, values[..., part])
            for own in e.displacements(poses, values[..., part])
        ]
        return self._summed(values, poses, moved) if moved else None

    def _deflections(self, values: Array, state: State) -> Array:
        """Displacements of what is elastic, shape (..., m, F, 6)."""
        moved = [
            own
            for e, part in self.of(ElasticEffect)
            for own in displaced(e.twists(state, values[..., part]), values[..., part])
        ]
        return self._summed(values, state.poses, moved)

    def _summed(self, values: Array, poses: Poses, moved: list[Displacement]) -> Array:
        xi = room((*values.shape[:-1], len(poses)), self.robot.frame_count, 6)
        xi[...] = 0.0
        for frame, own in moved:
            xi[..., frame, :] += own
        return xi

    def constant_displacements(self, values: Array) -> Array:
        """Displacement of each frame that holds at every pose, shape (..., F, 6), m and rad."""
        xi = np.zeros((*values.shape[:-1], self.robot.frame_count, 6))
        for effect, part in self.of(Constant):
            xi[..., effect.frame, :] += values[..., part] @ effect.columns.T
        return xi

    # -- points --------------------------------------------------------------------------------

    def marker_positions(self, values: Array) -> Array:
        """Markers in the tip frame, shape (..., M, 3), m."""
        offsets = np.zeros((*values.shape[:-1], *self.markers.shape))
        for effect, part in self.of(Tool):
            offsets[..., effect.markers, :] = effect.offsets(values[..., part])
        return self.markers + offsets

    @cached_property
    def marker_columns(self) -> Array:
        """How they follow the parameters from the first guess, shape (M, 3, p)."""
        J = np.zeros((*self.markers.shape, len(self.parameters)))
        for effect, part in self.of(Tool):
            J[effect.markers, :, part] = effect.columns(effect.initial)
        return J

    @cached_property
    def readout(self) -> Readout:
        """What makes readings of points."""
        return Readout(
            Channels(self.instruments, len(self.markers)),
            tuple(self.of(Base)),
            tuple(sorted(self.of(ReadingEffect), key=lambda own: not own[0].first)),
            tuple((e, part) for e, part in self.of(PartEffect) if e.body is None),
            self.noise_scales,
        )

    def tip_points(self, frames: Frames, values: Array, poses: Poses) -> Array:
        """Markers in base axes, shape (..., m, M, 3), m."""
        markers = self._fixed_on_tip(values, poses)
        for effect, part in self._bodies:
            own, by = effect.body, values[..., part]
            if not at_rest(effect, by):
                markers[..., own, :] = effect.moved(poses, by, markers[..., own, :])[0]
        R, o = self.under_markers(frames)
        return rotate(R, markers) + o

    def under_markers(self, frames: Frames) -> tuple[Array, Array]:
        """Axes (..., m, M or 1, 3, 3) and origins (..., m, M or 1, 3), m, of the tips under markers."""
        if self.scattered:
            return frames.R[..., self.marker_frames, :, :], frames.o[..., self.marker_frames, :]
        tip = self.by_tip[0][0]
        return frames.R[..., tip, None, :, :], frames.o[..., tip, None, :]

    def _axes_under(self, frames: Frames, markers: slice | None) -> Array:
        """Axes (..., m, 3, 3) of the tip that carries some markers, all of them the same."""
        own = self.marker_frames[markers or slice(0)]
        return frames.R[..., own[0] if len(own) else -1, :, :]

    def _fixed_on_tip(self, values: Array, poses: Poses) -> Array:
        """Markers in the tip frame, (..., m or 1, M, 3), m, before a body of several comes loose."""
        markers = self.marker_positions(values)[..., None, :, :]
        moved = self.of(MarkerEffect)
        if moved or self._bodies:
            markers = np.repeat(markers, len(poses), axis=-3)
        for effect, part in moved:
            offset = effect.amounts(poses, values[..., part])
            markers[..., effect.marker(self.marker_names), :] += offset[..., None, :]
        return markers

    @property
    def _bodies(self) -> list[tuple[PartEffect, slice]]:
        """Effects that displace several markers on the tip as one."""
        return [(e, part) for e, part in self.of(PartEffect) if e.body is not None]

    def _follow_bodies(self, values: Array, poses: Poses, frames: Frames, J: Array) -> None:
        """Derivatives (..., m, M, 3, p) of points that come loose of the tip together; overwritten."""
        markers = self._fixed_on_tip(values, poses)
        on_tip = self.where(Tool, MarkerEffect, PartEffect)
        for effect, part in self._bodies:
            own = J[..., effect.body, :, :]
            here = markers[..., effect.body, :]
            placed, columns = effect.moved(poses, values[..., part], here)
            R = self._axes_under(frames, effect.body)[..., None, :, :]
            before = np.swapaxes(R, -1, -2) @ own[..., on_tip]
            own[..., on_tip] = R @ effect.carried(poses, values[..., part], before)
            markers[..., effect.body, :] = placed
            own[..., part] = R @ columns

    def predict(self, values: Array, poses: Poses) -> Array:
        """Readings of the markers, shape (..., m, C, r); of a tracker its points in station axes, m."""
        points = self.tip_points(self.state(values, poses).frames, values, poses)
        return self.readings(values, poses, points)

    def readings(self, values: Array, poses: Poses, points: Array) -> Array:
        """What the instruments read of points (..., m, M, 3), m, in base axes."""
        return self.readout.read(values, poses, points)

    def off(self, values: Array, data: Measurements) -> Array:
        """What is measured beyond what is predicted, shape (..., m, C, r), zero where hidden."""
        return (data.readings - self.predict(values, data.poses)) * data.seen[..., None]

    def footprint(self, values: Array, data: Measurements) -> float:
        """Metres to one unit of the readings: 1 where any is a length, else those of a pixel."""
        if self.readout.channels.metric:
            return 1.0
        points = self.tip_points(self.state(values, data.poses).frames, values, data.poses)
        return self.readout.footprint(values, data.poses, points, data.seen)

    @property
    def channel_names(self) -> tuple[str, ...]:
        """What a table calls the reading of each channel."""
        return self.readout.channels.names(self.marker_names)

    @property
    def scaleless(self) -> bool:
        """Whether nothing here knows a length but the nominal arm."""
        return not self.lengths and not any(i.metric for i in self.instruments)

    @property
    def known_rows(self) -> int:
        """How many rows :meth:`beside` has."""
        return len(self.lengths) + len(self._believed)

    @property
    def prior_rows(self) -> int:
        """How many of these say what is believed of the parameters; they come last."""
        return len(self.by_prior)

    @cached_property
    def own_prior(self) -> SizePrior | None:
        """What is believed beforehand of the parameters that the model has."""
        return None if self.prior is None else self.prior.only(self.keys)

    @cached_property
    def by_prior(self) -> Array:
        """The same as rows of unit variance: derivatives, shape (k, p)."""
        known = self.own_prior
        rows = np.zeros((0 if known is None else len(known.keys), len(self.parameters)))
        if known is not None and len(rows):
            rows[:, known.positions(self.keys)] = known.whitening
        return rows

    @cached_property
    def _believed(self) -> Array:
        """What is known of the values about zero beforehand, as rows of unit variance (k, p)."""
        found = []
        for effect, part in self.of(Base):
            own = effect.of.belief
            found.append(np.zeros((len(own), len(self.parameters))))
            found[-1][:, part] = own
        return np.concatenate([*found, self.by_prior])

    def prior_residuals(self, values: Array) -> tuple[Array, Array]:
        """What is known beside all readings, as rows of unit variance: residuals and derivatives.

        values : ndarray, shape (..., p), SI; returns shapes (..., K) and (..., K, p)
        """
        residuals = np.zeros((*values.shape[:-1], self.known_rows))
        J = np.zeros((*residuals.shape, len(self.parameters)))
        for k, known in enumerate(self.lengths):
            (a, of_a), (b, of_b) = (self._place_of(name, values) for name in known.between)
            apart = np.linalg.norm(a - b, axis=-1)
            residuals[..., k] = (known.length - apart) / known.sigma
            along = (a - b) / np.where(apart > 0.0, apart, 1.0)[..., None] / known.sigma
            J[..., k, :] = (along[..., None, :] @ (of_a - of_b))[..., 0, :]
        residuals[..., len(self.lengths) :] = -values @ self._believed.T
        J[..., len(self.lengths) :, :] = self._believed
        return residuals, J

    def _place_of(self, name: str, values: Array) -> tuple[Array, Array]:
        """A marker on its tip or a socket in base axes, (..., 3), and its derivative (3, p)."""
        if name in self.marker_names:
            marker = self.marker_names.index(name)
            return self.marker_positions(values)[..., marker, :], self.marker_columns[marker]
        J = np.zeros((3, len(self.parameters)))
        for base, part in self.of(Base):
            if base.where == name:
                J[:, part] = np.eye(3)
                return values[..., part], J
        raise KeyError(name)

    def tracked(self, data: Measurements) -> tuple[Model, Measurements] | None:
        """Model and data of a tracker that reads every marker, alone; None where there is none."""
        for instrument, part in self.readout.channels.blocks:
            if isinstance(instrument, Tracker) and instrument.markers is None:
                if len(self.instruments) == 1:
                    return self, data
                return replace(self, instruments=(instrument,)), data.only(part, instrument.rows)
        return None

    # -- derivatives ---------------------------------------------------------------------------

    def jacobian(self, values: Array, poses: Poses) -> tuple[Array, Array]:
        """Predicted readings (..., m, C, r) and their derivatives (..., m, C, r, p), SI, read-only."""
        last = self._last.get("found")  # one read and one write: threads may share a model
        if last is None or last[0] is not poses or not np.array_equal(last[1], values):
            readings, J = self._jacobian(values, poses)
            readings.flags.writeable = J.flags.writeable = False
            last = self._last["found"] = (poses, values.copy(), readings, J)
        return last[2], last[3]

    def jacobian_at_rest(self, values: Array, targets: Poses) -> tuple[Array, Array]:
        """The same at targets. Raises NoEquilibrium where the arm is too soft to stand there."""
        readings, J = self.jacobian(values, targets)
        if not np.isfinite(readings).all():
            raise NoEquilibrium(" at the targets")
        return readings, J

    def __getstate__(self) -> dict[str, Any]:
        return {**self.__dict__, "_last": {}}  # the memo does not travel

    def _jacobian(self, values: Array, poses: Poses) -> tuple[Array, Array]:
        """In blocks of poses that the processor's cache holds: what is between is many times larger."""
        channels, m = self.readout.channels, len(poses)
        batch, shape = values.shape[:-1], (len(channels), channels.width)
        parts = in_parts(m, math.prod((*batch, *shape, values.shape[-1])))
        if len(parts) < 2:
            return self._jacobian_at(values, poses)
        readings = np.empty((*batch, m, *shape))
        J = np.empty((*readings.shape, values.shape[-1]))
        for own in parts:
            found = self._jacobian_at(values, poses.take(own))
            readings[..., own, :, :], J[..., own, :, :, :] = found
        return readings, J

    def _jacobian_at(self, values: Array, poses: Poses) -> tuple[Array, Array]:
        state = self.state(values, poses)
        points = self.tip_points(state.frames, values, poses)
        J = self._by_arm(values, state, points)
        for tool, part in self.of(Tool):
            R_tip = self._axes_under(state.frames, tool.markers)
            by_values = tool.columns(values[..., part])[..., None, :, :, :]
            J[..., tool.markers, :, part] = R_tip[..., None, :, :] @ by_values
        for effect, part in self.of(MarkerEffect):
            marker = effect.marker(self.marker_names)
            R_tip = self._axes_under(state.frames, marker)
            by_values = effect.response(poses, values[..., part])
            J[..., marker, :, part] = (R_tip @ by_values)[..., None, :, :]
        if self._bodies:
            self._follow_bodies(values, poses, state.frames, J)
        return self.readout.linearise(values, poses, points, J)

    def _by_arm(self, values: Array, state: State, points: Array) -> Array:
        """Derivatives (..., m, M, 3, p) of points by what moves the arm, those by all else zero."""
        p = len(self.parameters)
        if not len(self.where(TwistEffect, LoadEffect)):
            return np.zeros((*points.shape, p))
        poses = state.poses
        given = statics.loads_of(self.robot, poses, self.payload, self.gravity)
        soft, loads = self._flexibilities(values, poses), self.loads(values, poses)
        tips = [frame for frame, _ in self.by_tip]
        fields = arm_jacobian(
            self.robot, tuple(self.parts), values, state, given, loads, soft, tips
        )
        if len(tips) == 1:
            return _moved_by(fields[0], points)
        J = np.empty(
            (*np.broadcast_shapes(*(f.shape[:-2] for f in fields)), len(self.markers), 3, p)
        )
        for field_of_tip, (_, own) in zip(fields, self.by_tip, strict=True):
            J[..., own, :, :] = _moved_by(field_of_tip, points[..., own, :])
        return J

    def _flexibilities(self, values: Array, poses: Poses) -> dict[tuple[int, int], Array]:
        """What is elastic at the present values, by frames that are displaced and that feel a wrench.

        Shapes (..., m, 6, 6).
        """
        total: dict[tuple[int, int], Array] = {}
        for effect, part in self.of(ElasticEffect):
            if values[..., part].any():
                for frames, own in effect.flexibilities(poses).items():
                    K = np.einsum("mijp,...p->...mij", own, values[..., part])
                    total[frames] = total.get(frames, 0.0) + K
        return {frames: K for frames, K in total.items() if K.any()}


def _moved_by(fields: Array, points: Array) -> Array:
    """How points (..., m, M, 3) follow velocity fields (..., m, 6, p), shape (..., m, M, 3, p)."""
    levers = point_levers(points).reshape((*points.shape[:-2], -1, 6))
    J = levers @ fields
    return np.asarray(J.reshape((*J.shape[:-2], *points.shape[-2:], fields.shape[-1])))
