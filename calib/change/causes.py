"""The likeliest single cause of a difference: each explains it in a few directions, ``d ~ N(B c, C)``.

A cause acts from one day to the next. Where it is an effect of the model, its parameters show it. Else
they take up of it what least squares at the later day's poses put into them: a constant one, as a knock
of the base or a slipped belt, whole and at any poses; a worn gear in part. Causes are compared by their
marginal likelihood, c normal in plausible sizes times a factor from a thirtieth to thirty, which no
change of a given size need fit better than another; kinds are as likely as each other before, and so
are the places of one kind.

What a model lacks on both days alike shows otherwise at other poses (:func:`shown_otherwise`): with T
how the parameters take up errors u of the drives, ``d = e + (T_after - T_before) u``, u as large as
what the fits leave beyond the instrument. At equal poses it adds nothing, in a model that lacks nothing
neither.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from calib.arm.statics import loads_of
from calib.arrays import Array, stacked
from calib.change.difference import Difference, tail
from calib.effects import Context, Effect, catalogue
from calib.effects.context import ARM
from calib.effects.geometry import Geometry, LinkGeometry
from calib.effects.protocol import Parameter
from calib.effects.tool import Tool
from calib.evidence import along_prior, marginal_gain
from calib.model import Model
from calib.poses import Poses

_FACTORS = np.geomspace(1 / 30, 30.0, 9)
_KNOCK = 1e-3  # m and rad
_LEFT = 0.01  # p value below which a cause does not explain the difference
_LIKELY = 0.05  # probability at which another cause is still named
_SAME = 1e-3  # of a direction outside what another cause can do
_NOTHING = 0.01  # standard deviations: a plausible size that moves less is not asked
_FELT = 3.0  # standard deviations: a plausible size that moves less stays hidden
_DRIVES = ("transmission_scale", "transmission_harmonic", "backlash", "joint_compliance")
_LACKED = ("transmission_scale", "transmission_harmonic", "backlash", "gravity_sag")


@dataclass(frozen=True, eq=False)
class ChangeCause:
    """A single event that may explain the difference between two days.

    kind : "base", "tool", "marker", or a kind of effect; where : its place
    parameters : tuple of Parameter, its r sizes
    columns : ndarray, shape (k, r), SI, how the compared parameters follow
    sizes : ndarray, shape (r,), SI, plausible
    """

    kind: str
    where: str
    parameters: tuple[Parameter, ...]
    columns: Array
    sizes: Array


@dataclass(frozen=True, eq=False)
class Explanation:
    """A cause beside the difference.

    probability : float, among all that were asked; share : float, of the squared difference
    p_left : float, of what it leaves by chance
    values, std : ndarray, shape (r,), SI, its sizes; NaN where the difference does not tell one
    hidden : whether a plausible size would not show
    """

    cause: ChangeCause
    probability: float
    share: float
    p_left: float
    values: Array
    std: Array
    hidden: bool

    @property
    def explains(self) -> bool:
        """Whether the difference that remains beside the cause may be noise."""
        return self.p_left > _LEFT

    @property
    def likely(self) -> bool:
        """Whether it is worth naming beside others."""
        return self.explains and self.probability > _LIKELY


def explanations(found: Difference, causes: Sequence[ChangeCause]) -> tuple[Explanation, ...]:
    """All causes, those that explain the difference first, each by its probability."""
    whitened = [found.half @ (cause.columns * cause.sizes) for cause in causes]
    score = np.array([_evidence(found.whitened, Y) for Y in whitened])
    kinds = [cause.kind for cause in causes]
    score -= np.log([kinds.count(kind) for kind in kinds])
    weight = np.exp(score - score.max(initial=-np.inf))
    probability = weight / weight.sum()
    told = [
        _explained(found, cause, Y, float(p))
        for cause, Y, p in zip(causes, whitened, probability, strict=True)
    ]
    return tuple(sorted(told, key=lambda e: (not e.explains, -e.probability)))


def _evidence(y: Array, Y: Array) -> float:
    """Logarithm of the marginal likelihood over that of no cause, mean over the factors of size."""
    variances, along = along_prior(Y.T @ Y, Y.T @ y, np.eye(Y.shape[1]))
    fall, price = marginal_gain(np.maximum(variances, 0.0), along, _FACTORS[:, None] ** 2)
    each = 0.5 * (fall - price)
    return float(np.logaddexp.reduce(each) - np.log(len(each)))


def _basis(Y: Array) -> Array:
    U, s, _ = np.linalg.svd(Y, full_matrices=False)
    return np.asarray(U[:, s > 1e-6 * max(s.max(initial=0.0), 1e-12)])


def _explained(found: Difference, cause: ChangeCause, Y: Array, probability: float) -> Explanation:
    y, U = found.whitened, _basis(Y)
    along = float(((U.T @ y) ** 2).sum())
    left, rows = float(y @ y) - along, len(y) - U.shape[1]
    inverse = np.linalg.pinv(Y)
    determined = np.abs(np.diag(inverse @ Y) - 1.0) < 1e-6
    return Explanation(
        cause,
        probability,
        along / max(float(y @ y), 1e-300),
        tail(max(left, 0.0), rows, found.dof),
        np.where(determined, inverse @ y, np.nan) * cause.sizes,
        np.where(determined, np.linalg.norm(inverse, axis=1), np.nan) * cause.sizes,
        bool(np.linalg.norm(Y) < _FELT),
    )


def same_as(
    found: Difference, cause: ChangeCause, others: Iterable[ChangeCause]
) -> tuple[ChangeCause, ...]:
    """Causes whose effect on the parameters includes that of a given cause."""
    own = _basis(found.half @ (cause.columns * cause.sizes))
    bases = ((other, _basis(found.half @ (other.columns * other.sizes))) for other in others)
    return tuple(
        other
        for other, U in bases
        if other is not cause and np.linalg.norm(own - U @ (U.T @ own)) < _SAME
    )


def candidates(
    found: Difference, model: Model, values: Array, poses: Poses, context: Context
) -> tuple[ChangeCause, ...]:
    """Every cause that this model and these poses can show.

    model, values : of the later day; poses : that it was identified at
    """
    rows = np.array([model.keys.index(key) for key in found.keys])
    suspects = tuple(_suspects(model, poses, context))
    taken, _ = taken_up(model, values, poses, tuple(effect for _, effect in suspects))
    causes = [*_of_the_model(found, model)]
    start = 0
    for kind, effect in suspects:
        part = slice(start, start := start + len(effect.parameters))
        sizes = np.array([p.size for p in effect.parameters])
        if kind in ("base", "tool"):
            sizes = np.full(len(sizes), _KNOCK)
        causes.append(_cause(kind, effect, taken[rows, part], sizes))
    return tuple(
        cause
        for cause in causes
        if np.linalg.norm(found.half @ (cause.columns * cause.sizes)) > _NOTHING
    )


def _cause(kind: str, effect: Effect, columns: Array, sizes: Array) -> ChangeCause:
    where = effect.where.removeprefix("marker:")
    return ChangeCause(kind, where, effect.parameters, columns, sizes)


def _of_the_model(found: Difference, model: Model) -> Iterator[ChangeCause]:
    """Effects whose parameters are compared, each by itself; of the geometry nothing."""
    for effect in model.effects:
        if isinstance(effect, Geometry) or effect.kind == "base":
            continue
        keys = [p.key for p in effect.parameters]
        columns = np.array([[float(key == own) for own in keys] for key in found.keys])
        if not columns.any():
            continue
        marker = isinstance(effect, Tool)
        sizes = np.array([_KNOCK if marker else p.size for p in effect.parameters])
        yield _cause("marker" if marker else effect.kind, effect, columns, sizes)


def _suspects(model: Model, poses: Poses, context: Context) -> Iterator[tuple[str, Effect]]:
    """Kinds and effects that the model lacks, base and tool moved as a whole among them."""
    robot = model.robot
    yield "base", LinkGeometry(robot.base, 0)
    yield "tool", LinkGeometry(robot.tip, robot.tip_frame)
    yield from (("joint_offset", e) for e in lacked(model, context, ("joint_offset",)))
    for joint in robot.joints[1:]:  # the first segment is the base's
        yield "link_geometry", LinkGeometry.at(context, joint)
    by_angle = any(effect.kind == "stiffness_vs_angle" for effect in model.effects)
    idle = loads_of(model.robot, poses, model.payload, model.gravity).absent
    drives = [kind for kind in _DRIVES if kind != "joint_compliance" or not (by_angle or idle)]
    yield from ((effect.kind, effect) for effect in lacked(model, context, drives))


def taken_up(
    model: Model, values: Array, poses: Poses, effects: tuple[Effect, ...]
) -> tuple[Array, float]:
    """How the p parameters take up effects that the model lacks, shape (p, h), SI, by least squares.

    Beside it what is left of all of them together at plausible sizes, RMS per reading, m.
    """
    whole, everything = model.extended(values, effects)
    _, J = whole.jacobian(everything, poses)
    readings, own = J.shape[0] * J.shape[1], len(model.parameters)
    J = stacked(J)
    scale = np.linalg.norm(J[:, :own], axis=0)
    moving = scale > 0.0
    kept = J[:, :own][:, moving] / scale[moving]
    taken = np.zeros((own, J.shape[1] - own))
    taken[moving] = np.linalg.lstsq(kept, J[:, own:], rcond=1e-8)[0] / scale[moving, None]
    left = (J[:, own:] - J[:, :own] @ taken) * whole.sizes[own:]
    return taken, float(np.sqrt((left**2).sum() / readings))


def lacked(model: Model, context: Context, kinds: Iterable[str]) -> Iterator[Effect]:
    """Effects of some kinds at every place where the model does not have them and they can act."""
    known = {(effect.kind, effect.where) for effect in model.effects}
    for kind in kinds:
        effect = catalogue()[kind]
        if any(name in context.lacking for name in effect.uses):
            continue
        for where in effect.places(context):
            if (kind, where) not in known and where != ARM:
                yield effect.at(context, where)


def shown_otherwise(
    model: Model,
    values: Array,
    days: tuple[Poses, Poses],
    context: Context,
    excess: float,
) -> Array:
    """How the difference of all p values follows what the model lacks, shape (p, h), SI.

    days : the poses of both; excess : float, m, RMS that the fits leave beyond the instrument
    """
    effects = tuple(lacked(model, context, _LACKED))
    if excess <= 0.0 or not effects:
        return np.zeros((len(values), 0))
    (before, one), (after, other) = (taken_up(model, values, poses, effects) for poses in days)
    sizes = np.concatenate([[p.size for p in effect.parameters] for effect in effects])
    return np.asarray((after - before) * sizes * excess / max(one, other, 1e-12))
