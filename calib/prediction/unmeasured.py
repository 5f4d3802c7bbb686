"""What was never measured: errors of the arm that targets may show and that no reading could.

A model lacks effects because the readings did not show them: a compliance without a load, growth at
one temperature, drift within an hour, lost motion where every move came from one side. Each is off by
its plausible size D, less what the readings say. With X the whitened columns of an effect, Z what the
fitted parameters leave of them and f the actual over the stated noise,

    cov = (Z^T Z / f^2 + D^-2)^-1 ,  mean = cov Z^T r / f^2 ,  error at a target = (X_t - J_t J^+ X) c .

The model takes c for zero, so its mean square ``cov + mean mean^T`` counts.

At poses like those measured, left-out readings show that error already. So a target pays where its
load, temperature or time lies outside those of the readings, or a joint comes from a side from which it
never came, and for what goes beyond the largest error at any reading.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import groupby

import numpy as np

from calib.arm.statics import STANDARD_GRAVITY
from calib.arrays import Array, in_parts
from calib.cell import Cell
from calib.diagnosis.columns import columns_at
from calib.effects import catalogue
from calib.effects.context import ARM, Context, softest
from calib.effects.protocol import Effect
from calib.effects.tuned import amounts_of
from calib.errors import CalibError
from calib.model import Model
from calib.model.build import context_of, place_effect
from calib.model.covariance import half, working_points
from calib.poses import Poses
from calib.prediction.discrepancy import FittedModel

_KINDS = ("joint_compliance", "thermal_expansion", "base_drift", "backlash")
"""Effects that any arm has, and that readings show only under a load, in heat, in time or by moves."""
_SIZES = {
    "thermal_expansion": 1.9e-5,  # m/(m K): of steel 1.2e-5, of aluminium 2.4e-5
    "backlash": 9e-5,  # rad or m: gears of arms in order have 20 to 200 urad
}
"""Of any arm; a cause that a diagnosis looks for is expected larger."""
_GUESSED = 4.5  # degrees of freedom of a size that is known to a third: 1 / (2 (1/3)^2)
_WIDER = 0.05  # of the range of loads, temperatures or times


@dataclass(frozen=True, eq=False)
class Unmeasured:
    """Effects of one kind that the model lacks, h parameters in all.

    square : ndarray, shape (h, h), SI, mean square of their values
    absorbed : ndarray, shape (p, h), SI, what the parameters of the model took up of each
    largest : float, m, 3-D RMS per point that they add at the reading where they add most
    within : (float, float), range of the load [N], temperature [degC] or time [s] of the readings; none
        of sides, as only joints that always came from one are asked
    time : float or None, s, at which targets that give no time count: later than the last reading
    """

    effects: tuple[Effect, ...]
    square: Array
    absorbed: Array
    largest: float
    within: tuple[float, float]
    time: float | None

    @property
    def kind(self) -> str:
        """Of the effects."""
        return self.effects[0].kind

    @property
    def freedom(self) -> float:
        """Degrees of freedom of its size: how drives yield is guessed (JCGM 100, G.4.2)."""
        return _GUESSED if self.kind == "joint_compliance" else np.inf

    def beyond(self, model: Model, values: Array, targets: Poses) -> Array:
        """What they add at targets beyond what they add at any reading, m.

        Spread of shape (m, 3 M, k): by its norm over the last two axes the RMS over the M points.
        """
        if targets.time is None and self.time is not None:
            targets = replace(targets, time=np.full(len(targets), self.time))
        if any(getattr(targets, name) is None for name in self.effects[0].uses):
            # Nothing says that they differ from the readings.
            return np.zeros((len(targets), 3 * len(model.markers), 1))
        asked, (low, high) = _condition(self.effects[0], targets), self.within
        outside = (asked < low) | (asked > high)
        moved = _moved(model, values, targets, self)
        squares = (moved**2).sum(axis=(-1, -2))
        kept = np.where(outside, np.maximum(squares - self.largest**2, 0.0), 0.0)
        share = np.sqrt(kept / np.where(squares > 0.0, squares, 1.0))
        return np.asarray(moved * share[:, None, None])

    def condition(self, targets: Poses) -> str:
        """Under what condition of the targets nothing was read."""
        match self.effects[0].depends_on.partition(":")[0]:
            case "load":
                force = float(_condition(self.effects[0], targets).max())
                return f"the targets' load, up to {force:.3g} N, was never measured"
            case "temperature":
                return "the targets' temperatures were never measured"
            case "time":
                return "the targets come later than any reading"
            case _:
                return "joints come to the targets from sides that were never measured"


def unmeasured(cell: Cell, fit: FittedModel, after: float, drifts: bool) -> Iterator[Unmeasured]:
    """What a fit leaves unmeasured, kind by kind.

    after : s after the last reading, of targets that give no time; drifts : whether a trend of the day
        is shown, which is carried on to them
    """
    poses = fit.data.poses
    later = float(poses.clock.max()) + after if after and not drifts else None
    for _, alike in groupby(_lacking(cell, fit.model, poses), key=lambda e: e.kind):
        effects = tuple(alike)
        _, columns = columns_at(fit.model, fit.values, poses, effects)
        rows = fit.points.rows(np.concatenate(columns, axis=-1))
        left, r = fit.linear.complement.columns(rows), fit.linear.complement.left
        factor = max(1.0, float(r @ r) / max(1, len(r) - fit.span.shape[1]))
        sizes, prior = _plausible(cell, effects)
        Z = left * sizes
        cov = np.linalg.inv(Z.T @ Z / factor + np.linalg.inv(prior))
        mean = cov @ (Z.T @ r) / factor
        found = Unmeasured(
            effects,
            (cov + np.outer(mean, mean)) * np.outer(sizes, sizes),
            fit.linear.followed(rows),
            0.0,
            _range(_condition(effects[0], poses)),
            later if "time" in effects[0].uses else None,
        )
        moved = np.linalg.norm(_moved(fit.model, fit.values, poses, found), axis=(-1, -2))
        yield replace(found, largest=float(moved.max()))


def _plausible(cell: Cell, effects: tuple[Effect, ...]) -> tuple[Array, Array]:
    """Plausible sizes (h,), SI, of effects of one kind, and their mean squares (h, h) in these.

    Drives yield all to one side: of half normal numbers the mean square is ``1 - 2 / pi`` about the
    mean, and ``2 / pi`` common to all.
    """
    kind, each = effects[0].kind, [p.size for effect in effects for p in amounts_of(effect)]
    sizes = np.array([_SIZES.get(kind, size) for size in each])
    if kind != "joint_compliance":
        return sizes, np.eye(len(sizes))
    share = 2.0 / np.pi
    common = np.full((len(sizes), len(sizes)), share)
    sizes[:] = softest(unmeasured_context(cell))
    return sizes, common + (1.0 - share) * np.eye(len(sizes))


def unmeasured_context(cell: Cell) -> Context:
    """What effects may ask for where nothing that targets may have is lacking."""
    return replace(context_of(cell, None), measured_load=True, lacking=frozenset())


def _lacking(cell: Cell, model: Model, poses: Poses) -> Iterator[Effect]:
    """Effects of these kinds that the model lacks and this robot may have, kind by kind."""
    context = unmeasured_context(cell)
    if poses.time is None:  # nothing tells when the targets come
        context = replace(context, lacking=frozenset({"time"}))
    one_sided = _from_one_side(poses, context.robot.joints)
    for kind in _KINDS:
        places = catalogue()[kind].places(context)
        for where in (ARM,) if ARM in places else places:
            there = any(
                (e.kind, e.where) == (kind, where) or e.contains(kind, where) for e in model.effects
            )
            if kind == "backlash" and where not in one_sided:
                continue
            if there or kind in cell.excluded or f"{kind}:{where}" in cell.excluded:
                continue
            try:
                yield place_effect(kind, where, context)
            except CalibError:
                continue


def _from_one_side(poses: Poses, joints: tuple[str, ...]) -> set[str]:
    """Joints that always came from the same side, as far as the readings say it."""
    if poses.approach is None:
        return set()
    sides = poses.approach.T
    return {j for j, own in zip(joints, sides, strict=True) if not (own.min() < 0.0 < own.max())}


def _condition(effect: Effect, poses: Poses) -> Array:
    """Load [N], temperature [degC] or time [s] of poses, as an effect asks, (m,); else infinite."""
    match effect.depends_on.partition(":")[0]:
        case "load":
            hung = poses.load_mass * float(np.linalg.norm(STANDARD_GRAVITY))
            return np.asarray(np.linalg.norm(poses.wrench[:, :3], axis=-1) + hung)
        case "temperature" if poses.temperature is not None:
            return poses.temperature
        case "time" if poses.time is not None:
            return poses.time
    return np.full(len(poses), np.inf)


def _range(values: Array) -> tuple[float, float]:
    """Of finite values, a little wider, as what is read is rounded; none where there are none."""
    known = values[np.isfinite(values)]
    if not len(known):
        return 0.0, 0.0
    wider = _WIDER * float(np.ptp(known))  # times may count from 1970
    return float(known.min()) - wider, float(known.max()) + wider


def _moved(model: Model, values: Array, poses: Poses, found: Unmeasured) -> Array:
    """Spread (m, 3 M, k), m, that unmeasured effects add at poses, by its norm the RMS per point."""
    working, root = working_points(model), half(found.square)
    each = []
    for part in in_parts(len(poses), 3 * len(model.markers) * (len(values) + len(root))):
        J, columns = columns_at(working, values, poses.take(part), found.effects)
        moved = (np.concatenate(columns, axis=-1) - J @ found.absorbed) @ root
        each.append(moved.reshape(len(moved), -1, root.shape[1]) / np.sqrt(moved.shape[1]))
    return np.concatenate(each)
