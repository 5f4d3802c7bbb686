"""Variances that the readings show: of the instrument, of the arm at approaches and configurations.

Every joint, and the tip, has a variance by approaches and by configurations
(:mod:`calib.observations.scatter`). None enters or leaves alone: restricted likelihood estimates all
together (:mod:`calib.inference.reml`), and data sheets give their sizes where the readings do not.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal, TypeAlias

import numpy as np

from calib import inference
from calib.arm.repeatability import usual_repeatability
from calib.arm.robot import Robot
from calib.arrays import Array, IntArray
from calib.cell import Repeatability
from calib.inference import Design, GaussianBlock, Marginal, Prior, RandomEffect
from calib.observations.linear import LinearProblem
from calib.observations.scatter import Scatter, Variances

LEAST_INSTRUMENT = 0.2**2
"""Variance of an instrument in the maker's: nobody's is five times better than stated."""
_FEWEST = 10  # rows that see the instrument alone, from which on it can be told from the arm
# Decrease of -2 log likelihood: half a chi-square at the bound, so once in seventy by chance.
_PAYS = 6.0
_SMALL = 1e-9  # of the largest singular value of what is known beforehand

ScatterLevel: TypeAlias = Literal["approach", "configuration"]


@dataclass(frozen=True, eq=False)
class Undetected:
    """Scatter of an arm that the readings do not show, as far as they allow it.

    variances : Variances; freedom : float, degrees of freedom of what the arm adds, one at least
    """

    variances: Variances
    freedom: float


@dataclass(frozen=True, eq=False)
class VarianceEstimate:
    """Variance components of instrument, approaches and configurations.

    variances : Variances
    levels : at which the arm's scatter pays for itself; none where the readings do not show it
    scale_estimated : bool, whether the instrument's noise is not as its maker states it
    instrument_rows : int, that nothing but the instrument moves
    approaches : bool, whether configurations were approached again: then ``approach`` is the arm's
        repeatability, else that counts with ``configuration``
    mixed : the variances in the mixed model, where a later search begins
    undetected : scatter of the arm that does not show; None where it shows, or is stated
    """

    variances: Variances
    levels: tuple[ScatterLevel, ...]
    scale_estimated: bool
    instrument_rows: int
    approaches: bool
    mixed: inference.Variances
    undetected: Undetected | None = None

    @property
    def estimated(self) -> bool:
        """Whether the readings show anything but what was known beforehand."""
        return bool(self.levels) or self.scale_estimated

    @property
    def instrument_seen(self) -> bool:
        """Whether the data separate the instrument's noise from the arm's."""
        return self.instrument_rows >= _FEWEST

    @property
    def instrument_only(self) -> bool:
        """Whether the readings say that the instrument, and nothing else, errs more than it should."""
        return self.instrument_seen and self.scale_estimated and not self.levels


@dataclass(frozen=True, eq=False)
class ArmEffect(RandomEffect):
    """Scatter of a joint, or of the tip, whose variance is number ``part`` of its level.

    part : int, as in :class:`~calib.observations.scatter.Variances`: joints first, then translation and
        rotation
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

    best, noise = min(models, key=value), models[()]
    as_stated = noise.at(replace(noise.variances, instrument=np.ones(1)))
    louder = 2.0 * (noise.log_likelihood - as_stated.log_likelihood) > _PAYS + choice
    variances = Variances.of_arm(scatter.joints, known)
    if best or louder:
        variances = as_variances(scatter.joints, models[best].design, models[best].variances, known)
    hidden = bool(arm) and known is None and not best
    return VarianceEstimate(
        variances,
        levels=best,
        scale_estimated=bool(best) or louder,
        instrument_rows=models[levels].rows_of_noise,
        approaches=scatter.has_approaches,
        mixed=models[best].variances,
        undetected=_undetected(scatter, models[levels]) if hidden else None,
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
