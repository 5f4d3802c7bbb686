"""The estimate: a fit weighed by the noise that it shows, with variances, and with sizes of errors.

Several instruments are weighed by the noise of their own; then come the variance components; what is
known of the size of errors is weighed in last, by how noisy the readings turned out to be.

Every joint, and the tip, has a variance by approaches and by configurations (:mod:`calib.scatter`).
None enters or leaves alone: restricted likelihood estimates all together, and data sheets say how large
they are where the readings do not (:mod:`calib.inference.reml`).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from calib import inference
from calib.arm.repeatability import usual_repeatability
from calib.arm.robot import Robot
from calib.arrays import Array, IntArray
from calib.cell import Cell, Repeatability
from calib.identification.checks import outnumbered
from calib.identification.fit import Fit, Method, of_poses, search
from calib.identification.noise import (
    LEAST_INSTRUMENT,
    NoiseLevel,
    noise_level,
    noise_scales,
    of_levels,
)
from calib.inference import Design, GaussianBlock, Marginal, Prior, RandomEffect
from calib.inference.restricted import RestrictedLikelihood
from calib.inference.widths import Elementary, SizePrior, Widths, widths_of
from calib.linear import LinearProblem, orthonormal
from calib.model import Model
from calib.model.covariance import Identifiable
from calib.observations import Observation, Points, points_of
from calib.result import fields_of
from calib.scatter import Scatter, ScatterLevel, Undetected, VarianceEstimate, Variances, scatter_of
from calib.solver import condensed

_ROUNDS = 4  # of fit and noise scales, or of fit and widths, in turn
_SETTLED = 0.05  # of a width
_LITTLE = 0.01  # of the degrees of freedom of the residuals
# Decrease of -2 log likelihood: half a chi-square at the bound, so once in seventy by chance.
_PAYS = 6.0
_SMALL = 1e-9  # of the largest singular value of what is known beforehand


@dataclass(frozen=True, eq=False)
class Estimation(Fit):
    """A fit with its variances; its observation is that under them.

    levels : VarianceEstimate, how whole poses err together
    sizes : Widths of errors, where they hold what the readings leave open
    """

    levels: VarianceEstimate
    sizes: Widths | None = None

    @cached_property
    def noise(self) -> NoiseLevel:
        """Noise scale of the readings, from the poses that were kept."""
        data, weights = self.observation.data.take(self.kept), self.observation.weights[self.kept]
        alone = noise_level(*self.left, data, weights, self.model.readout)
        return alone if self.observation.mixing is None else of_levels(self.levels, alone)

    @property
    def noise_scale(self) -> float:
        """Actual over believed noise of the rows that the estimate is made of."""
        if self.observation.mixing is None:
            return self.noise.factor
        r, _ = self.counted.linearise(self.values)
        spent = int(self.counted.numbers.sum()) - self.left[1]
        dof = int(np.count_nonzero(r)) - spent
        return max(1.0, float(np.sqrt((r**2).sum() / max(dof, 1))))


def estimated(
    cell: Cell,
    method: Method,
    observation: Observation,
    start: Array,
    errors: Elementary | None = None,
) -> Estimation:
    """The estimate from ``start`` (p,) on, with the sizes of errors that the cell states.

    errors : whose sizes are found from the readings, and hold what those leave open
    """
    prior = observation.model.own_prior
    bare = replace(observation, model=replace(observation.model, prior=None))
    alone = with_variances(cell, _by_instruments(method, bare, start))
    if prior is not None:
        return with_variances(cell, _held(alone, prior), alone.choice)
    return alone if errors is None else _with_sizes(cell, alone, errors)


def _by_instruments(method: Method, observation: Observation, start: Array) -> Fit:
    """The fit with each of several instruments weighed by the noise of its own readings."""
    fit = search(method, observation, start)
    several = isinstance(observation, Points) and len(fit.model.instruments) > 1
    for _ in range(_ROUNDS if several else 0):
        counted = points_of(fit.counted)
        r, J = counted.whitened(fit.values)
        if not (scales := noise_scales(counted, arm_scatter(fit), r, J @ fit.span)):
            break
        known = fit.model.noise_scales
        whole = {n: known.get(n, 1.0) * scales.get(n, 1.0) for n in {**known, **scales}}
        weights = observation.model.readout.rescaled(observation.weights, scales)
        model = replace(observation.model, noise_scales=whole)
        observation = replace(observation, model=model, weights=weights)
        fit = search(method, observation, fit.values, fit.kept)
    return fit


# -- sizes of errors -------------------------------------------------------------------------------


def _held(alone: Estimation, prior: SizePrior, lost: tuple[int, ...] = ()) -> Fit:
    """The fit with a prior of sizes; values at the positions ``lost`` stay where they are."""
    observation = replace(
        alone.observation,
        model=replace(alone.model, prior=prior),
        scatter=None,
        prior_weight=alone.noise_scale,
        lost=lost,
    )
    return search(alone.method, observation, alone.values, alone.kept)


def _with_sizes(cell: Cell, alone: Estimation, errors: Elementary) -> Estimation:
    """The estimate with a prior of the sizes that errors have by the readings themselves.

    Fit and sizes follow from each other. Where the readings leave nothing open, as it is. What such
    poses do not show at all stays where it was, unless there are fewer readings than parameters.
    """
    result, known = alone, alone.model
    lost: tuple[int, ...] = ()
    if alone.choice.unidentifiable and not outnumbered(known, alone.observation.data):
        names = {name for entry in alone.choice.unidentifiable for name in entry.names}
        lost = tuple(i for i, p in enumerate(known.parameters) if p.id in names)
        errors = errors.without(lost)
    for _ in range(_ROUNDS if errors.keys else 0):
        sizes = _sizes(result, errors, known)
        if not sizes.shows:
            return result
        if result.sizes and np.allclose(sizes.widths, result.sizes.widths, rtol=_SETTLED):
            break
        # Where the prior holds much, each round is another fit, and its variances are sought anew.
        before = result.levels if sizes.saved < _LITTLE * result.left[1] else None
        result = with_variances(cell, _held(result, sizes.prior, lost), alone.choice, before, sizes)
    return result


def _sizes(result: Estimation, of: Elementary, known: Model) -> Widths:
    """How large errors are by the readings of an estimate, at its noise.

    known : Model, without sizes: what it knows beside the readings counts as they do
    """
    observation, values = result.counted, result.values
    scale = result.noise.divisor if observation.mixing is None else 1.0
    r, J = (rows / scale for rows in observation.whitened(values))
    prior = known.prior_residuals(values)
    y, J = LinearProblem(r, J, result.span, *prior, observation.mixing).independent
    used = int(np.count_nonzero(J.any(axis=1)))
    rows = condensed(np.column_stack([J, y + J @ values]))
    Q = orthonormal(np.delete(rows[:, :-1], of.at, axis=1))
    rows = rows[:, [*of.at, -1]]
    left = rows - Q @ (Q.T @ rows)
    return widths_of(of, left[:, :-1], left[:, -1], used - Q.shape[1])


# -- variance components ---------------------------------------------------------------------------


def with_variances(
    cell: Cell,
    fit: Fit,
    choice: Identifiable | None = None,
    before: VarianceEstimate | None = None,
    sizes: Widths | None = None,
) -> Estimation:
    """The estimate of a fit, with the variances that its kept poses show.

    choice : what the readings determine without sizes; before : variances to begin with
    """
    scatter, robot = arm_scatter(fit), fit.model.robot
    levers, readings = points_of(fit.counted).rows(scatter.levers), of_poses(fit.readings, fit.kept)
    levels = variance_components(scatter, levers, readings, robot, cell.repeatability, before)
    under = replace(fit.observation, scatter=scatter.at(levels.variances))
    directions = replace(fit.directions, choice=choice or fit.choice)
    fields = fields_of(fit) | {"observation": under, "directions": directions}
    return Estimation(**fields, levels=levels, sizes=sizes)


def arm_scatter(fit: Fit) -> Scatter:
    """How the poses of a fit may err together, of no size yet."""
    none = Variances.none(fit.model.robot.dof)
    return scatter_of(fit.model, fit.values, fit.observation.data.poses, none)


def variance_components(
    scatter: Scatter,
    levers: Array,
    linear: LinearProblem,
    robot: Robot,
    known: Repeatability | None = None,
    before: VarianceEstimate | None = None,
) -> VarianceEstimate:
    """Estimate the variances of a fit by restricted likelihood.

    Scatter by approaches, by configurations, or both is stated where each pays for itself.

    levers : ndarray, shape (m, R, n + 6), of the scatter, whitened as the rows of the problem are
    known : the arm's repeatability where the cell states it
    before : of an earlier fit to the same readings, where the search of the levels begins that paid
    """
    stated = stated_effects(scatter, levers, known)
    arm = arm_effects(scatter, levers, robot, known is None and scatter.has_approaches)
    prior, design = _prior(robot, stated), design_of(linear, tuple(e for e, _ in stated))
    levels = tuple(dict.fromkeys(e.level for e in arm))
    models = {}
    for some in dict.fromkeys(((), *((one,) for one in levels), levels)):
        effects = (*design.effects, *(e for e in arm if e.level in some))
        start = before.mixed if before and before.levels == some else None
        models[some] = Marginal.fitted(replace(design, effects=effects), prior, start)
    choice = 2.0 * float(np.log(1 + len(arm)))  # the first pays for the choice among all

    def value(some: tuple[ScatterLevel, ...]) -> float:
        price = _PAYS * len(some) + choice * bool(some)
        return price - 2.0 * models[some].log_likelihood

    best, whole, noise = min(models, key=value), models[levels], models[()]
    as_stated = noise.design.theta(replace(noise.variances, instrument=np.ones(1)))
    rise = RestrictedLikelihood(noise.likelihood.model, as_stated).value - noise.likelihood.value
    louder = rise > _PAYS + choice
    variances = Variances.of_arm(scatter.joints, known)
    if best or louder:
        variances = as_variances(scatter.joints, models[best].design, models[best].variances, known)
    return VarianceEstimate(
        variances,
        levels=best,
        scale_estimated=bool(best) or louder,
        instrument_rows=int(whole.likelihood.model.turned.outside.sum()),
        approaches=scatter.has_approaches,
        undetected=_undetected(scatter, whole) if arm and known is None and not best else None,
        mixed=models[best].variances,
    )


def design_of(linear: LinearProblem, stated: tuple[RandomEffect, ...]) -> Design:
    """Rows of a fit, and what is known of its directions beside the readings as a block."""
    J = linear.J @ linear.span
    held = linear.held @ linear.span if len(linear.off) else np.zeros((0, J.shape[-1]))
    U, s, Vt = np.linalg.svd(held, full_matrices=True)
    s = s[s > _SMALL * s.max(initial=0.0)]
    shown, left = Vt[: len(s)].T, Vt[len(s) :].T
    mean = (U[:, : len(s)].T @ linear.off) / s if len(s) else np.zeros(0)
    block = GaussianBlock("known", J @ shown, np.diag(1.0 / s), mean)
    present = np.where(linear.J.any(axis=-1), 0, -1)
    return Design(linear.r, J, left, (block,) if len(s) else (), stated, present)


def stated_effects(
    scatter: Scatter, levers: Array, known: Repeatability | None
) -> list[tuple[RandomEffect, float]]:
    """What the cell states that the tip does at each approach, with its variance."""
    if known is None:
        return []
    n = scatter.joints
    sizes = (("translation", n, known.translation), ("rotation", n + 3, known.rotation))
    return [
        (RandomEffect(name, levers[..., a : a + 3], name, scatter.approach), size**2)
        for name, a, size in sizes
        if size > 0.0
    ]


@dataclass(frozen=True, eq=False)
class ArmEffect(RandomEffect):
    """Scatter of a joint, or of the tip, whose variance is number ``part`` of its level.

    part : int, as in :class:`~calib.scatter.Variances`: joints first, then translation and rotation
    """

    level: ScatterLevel
    part: int


def arm_effects(
    scatter: Scatter, levers: Array, robot: Robot, approaches: bool
) -> tuple[ArmEffect, ...]:
    """What moves some reading, by configuration and, where asked, by approach: joints and tip."""
    kinds = [*np.where(robot.prismatic, "slides", "turns"), "slides", "turns"]
    groups: dict[ScatterLevel, IntArray] = {"approach": scatter.approach} if approaches else {}
    groups["configuration"] = scatter.configuration
    parts = [levers[..., scatter.kinds == part] for part in range(len(kinds))]
    return tuple(
        ArmEffect(f"{level} {part}", columns, kind, group, level, part)
        for level, group in groups.items()
        for part, (columns, kind) in enumerate(zip(parts, kinds, strict=True))
        if columns.any()
    )


def _prior(robot: Robot, stated: list[tuple[RandomEffect, float]]) -> Prior:
    """Joints, at half the reach, and tip scatter together as the tips of the best arms of that size."""
    usual = usual_repeatability(robot.reach).best / float(np.sqrt(robot.dof + 2))
    scales = {"slides": usual, "turns": usual / max(robot.reach / 2.0, 1e-3)}
    known = {effect.kind: variance for effect, variance in stated}
    return Prior(scales, known, instrument_least=LEAST_INSTRUMENT)


def as_variances(
    joints: int, design: Design, mixed: inference.Variances, known: Repeatability | None = None
) -> Variances:
    """Variances of joints and tip by approach and configuration, from those of a design."""
    stated = Variances.of_arm(joints, known)
    levels = {"approach": stated.approach.copy(), "configuration": stated.configuration.copy()}
    for effect, variance in zip(design.effects, mixed.effects, strict=True):
        if isinstance(effect, ArmEffect):
            levels[effect.level][effect.part] = variance
    return Variances(float(np.sqrt(mixed.instrument[0])), **levels)


def _undetected(scatter: Scatter, mixed: Marginal) -> Undetected:
    """The variances as an arm may have them all the same, and the freedom of what the tip does.

    By Satterthwaite: ``2 v^2 / (g^T C g)``, g the parts of the tip's variance v and C the covariance of
    the logarithms of the variances.
    """
    unit, design = np.eye(scatter.joints + 2), mixed.design
    g = np.array([
        scatter.of_tip(variance * unit[effect.part]).translation ** 2
        for effect, variance in zip(design.effects, mixed.variances.effects, strict=True)
        if isinstance(effect, ArmEffect)
    ])  # fmt: skip
    own = slice(design.instruments, design.instruments + len(g))
    spread = float(g @ mixed.log_covariance[own, own] @ g)
    freedom = 2.0 * float(g.sum()) ** 2 / spread if spread > 0.0 else np.inf
    return Undetected(as_variances(scatter.joints, design, mixed.variances), max(1.0, freedom))
