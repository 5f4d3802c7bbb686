"""Variance components of an estimate: the instrument's noise, and the scatter of the arm.

A reading of approach a in configuration k errs by ``J_k (c_k + u_a) + e``: e is the instrument's and
new at every point, u_a the arm's repeatability and new at every approach, c_k what no model follows
from one configuration to the next. Every joint, and the tip, has a variance of each. None enters or
leaves alone: restricted likelihood estimates all together, and data sheets say how large they are where
the readings do not (:mod:`calib.inference.reml`). Whether the readings show scatter is asked of
approaches and of configurations as a whole.
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
from calib.identification.fit import Fit, of_poses
from calib.identification.noise_level import NoiseLevel, noise_level, of_levels
from calib.inference import Design, GaussianBlock, Marginal, Prior, RandomEffect
from calib.inference.restricted import RestrictedLikelihood
from calib.inference.widths import Widths
from calib.linear import LinearProblem
from calib.model.covariance import Identifiable
from calib.observations import points_of
from calib.result import fields_of
from calib.scatter import Scatter, ScatterLevel, Undetected, VarianceEstimate, Variances, scatter_of

# Decrease of -2 log likelihood: half a chi-square at the bound, so once in seventy by chance.
_PAYS = 6.0
LEAST_INSTRUMENT = 0.2**2
"""Variance of an instrument in the maker's: nobody's is five times better than stated."""
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
    given = fields_of(fit) | {"observation": under, "choice": choice or fit.choice}
    return Estimation(**given, levels=levels, sizes=sizes)


def arm_scatter(fit: Fit) -> Scatter:
    """How the poses of a fit may err together, of no size yet."""
    none = Variances.none(fit.model.robot.dof)
    return scatter_of(fit.model, fit.values, fit.observation.data.poses, none)


@dataclass(frozen=True, eq=False)
class ArmEffect(RandomEffect):
    """Scatter of a joint, or of the tip, whose variance is number ``part`` of its level.

    part : int, as in :class:`~calib.scatter.Variances`: joints first, then translation and rotation
    """

    level: ScatterLevel
    part: int


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
    prior = _prior(robot, stated)
    design = design_of(linear, tuple(e for e, _ in stated))
    levels = tuple(dict.fromkeys(e.level for e in arm))
    sets = dict.fromkeys(((), *((one,) for one in levels), levels))
    models = {}
    for own in sets:
        chosen = tuple(e for e in arm if e.level in own)
        whole = replace(design, effects=(*design.effects, *chosen))
        start = before.mixed if before and before.levels == own else None
        models[own] = Marginal.fitted(whole, prior, start)
    choice = 2.0 * float(np.log(1 + len(arm)))  # the first pays for the choice among all

    def value(own: tuple[ScatterLevel, ...]) -> float:
        price = _PAYS * len(own) + choice * bool(own)
        return price - 2.0 * models[own].log_likelihood

    best = min(models, key=value)
    noise = models[()]
    louder = _as_stated(noise) - noise.likelihood.value > _PAYS + choice
    found = as_variances(scatter.joints, models[best].design, models[best].variances, known)
    asked = known is None and len(arm) > 0
    return VarianceEstimate(
        found if best or louder else Variances.of_arm(scatter.joints, known),
        levels=best,
        scale_estimated=bool(best) or louder,
        instrument_rows=int(models[levels].likelihood.model.turned.outside.sum()),
        approaches=scatter.has_approaches,
        undetected=_undetected(scatter, models[levels]) if asked and not best else None,
        mixed=models[best].variances,
    )


def _as_stated(noise: Marginal) -> float:
    """-2 log likelihood of the instrument alone, as its maker states it."""
    stated = replace(noise.variances, instrument=np.ones(1))
    return RestrictedLikelihood(noise.likelihood.model, noise.design.theta(stated)).value


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
    blocks = (block,) if len(s) else ()
    return Design(linear.r, J, left, blocks, stated, present)


def stated_effects(
    scatter: Scatter, levers: Array, known: Repeatability | None
) -> list[tuple[RandomEffect, float]]:
    """What the cell states that the tip does at each approach, with its variance."""
    if known is None:
        return []
    n = scatter.joints
    sizes = {"translation": known.translation, "rotation": known.rotation}
    return [
        (RandomEffect(name, levers[..., n + a : n + a + 3], name, scatter.approach), size**2)
        for a, (name, size) in zip((0, 3), sizes.items(), strict=True)
        if size > 0.0
    ]


def arm_effects(
    scatter: Scatter, levers: Array, robot: Robot, approaches: bool
) -> tuple[ArmEffect, ...]:
    """What moves some reading, by configuration and, where asked, by approach: joints and tip."""
    kinds = [*np.where(robot.prismatic, "slides", "turns"), "slides", "turns"]
    by: dict[ScatterLevel, IntArray] = {"approach": scatter.approach} if approaches else {}
    by["configuration"] = scatter.configuration
    parts = [levers[..., scatter.kinds == part] for part in range(len(kinds))]
    return tuple(
        ArmEffect(f"{level} {part}", own, kind, group, level, part)
        for level, group in by.items()
        for part, (own, kind) in enumerate(zip(parts, kinds, strict=True))
        if own.any()
    )


def _prior(robot: Robot, stated: list[tuple[RandomEffect, float]]) -> Prior:
    """Joints, at half the reach, and tip scatter together as the tips of the best arms of that size."""
    usual = usual_repeatability(robot.reach).best / float(np.sqrt(robot.dof + 2))
    scales = {"slides": usual, "turns": usual / max(robot.reach / 2.0, 1e-3)}
    known = {effect.kind: variance for effect, variance in stated}
    return Prior(scales, known, instrument_least=LEAST_INSTRUMENT)


def as_variances(
    joints: int, design: Design, found: inference.Variances, known: Repeatability | None = None
) -> Variances:
    """Variances of joints and tip by approach and configuration, from those of a design."""
    stated = Variances.of_arm(joints, known)
    own = {"approach": stated.approach.copy(), "configuration": stated.configuration.copy()}
    for effect, variance in zip(design.effects, found.effects, strict=True):
        if isinstance(effect, ArmEffect):
            own[effect.level][effect.part] = variance
    return Variances(float(np.sqrt(found.instrument[0])), **own)


def _undetected(scatter: Scatter, found: Marginal) -> Undetected:
    """The variances as an arm may have them all the same, and the freedom of what the tip does.

    By Satterthwaite: ``2 v^2 / (g^T C g)``, g the parts of the tip's variance v and C the covariance of
    the logarithms of the variances.
    """
    unit = np.eye(scatter.joints + 2)
    effects = zip(found.design.effects, found.variances.effects, strict=True)
    parts = [
        scatter.of_tip(variance * unit[effect.part]).translation ** 2
        for effect, variance in effects
        if isinstance(effect, ArmEffect)
    ]
    g, own = np.array(parts), slice(found.design.instruments, found.design.instruments + len(parts))
    spread = float(g @ found.log_covariance[own, own] @ g)
    freedom = 2.0 * float(g.sum()) ** 2 / spread if spread > 0.0 else np.inf
    return Undetected(
        as_variances(scatter.joints, found.design, found.variances), max(1.0, freedom)
    )
