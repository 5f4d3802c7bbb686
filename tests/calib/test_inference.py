"""The mixed model against dense matrices and MixedLM: likelihood, roots, variances, posteriors."""

from __future__ import annotations

import tracemalloc
import warnings
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import pytest

from calib.arrays import Array, IntArray
from calib.errors import Unsolvable
from calib.inference import Design, GaussianBlock, Marginal, Prior, RandomEffect, Variances
from calib.inference.decorrelation import Groups, InverseRoot
from calib.inference.restricted import MixedModel, RestrictedLikelihood

POSES, ROWS = 14, 5
PLACE = np.repeat(np.arange(7), 2)
APPROACH = np.where(np.arange(POSES) == 1, 0, np.arange(POSES))
GROUPS: dict[str, tuple[IntArray, ...]] = {
    "none": (),
    "one a pose": (np.arange(POSES),),
    "places": (PLACE,),
    "approaches within places": (APPROACH, PLACE, PLACE),
    "one group": (APPROACH, 0 * PLACE),
}
every_grouping = pytest.mark.parametrize("groups", GROUPS)


# -- Small random designs, and every quantity of theirs by plain dense matrices


def random_design(groups: str = "approaches within places", seed: int = 0) -> Design:
    """Two instruments, absent rows, an absent pose, a stated and a free block."""
    rng = np.random.default_rng(seed)
    levers = rng.normal(size=(POSES, ROWS, 4))
    instrument = np.zeros((POSES, ROWS), dtype=int)
    instrument[:, 3:] = 1
    instrument[3, 2:] = instrument[5] = -1
    columns = rng.normal(size=(POSES, ROWS, 6))
    free = rng.normal(size=(4, 3)), rng.normal(size=4), None
    blocks = (
        GaussianBlock("free", columns[..., :4], *free),
        GaussianBlock("stated", columns[..., 4:], np.eye(2), np.zeros(2), 0.7),
    )
    effects = tuple(
        RandomEffect(f"v{j}", levers[..., j : j + 2], "joint", group)
        for j, group in enumerate(GROUPS[groups])
    )
    J = rng.normal(size=(POSES, ROWS, 3))
    return Design(rng.normal(size=(POSES, ROWS)), J, np.eye(3), blocks, effects, instrument)


def random_theta(design: Design, seed: int = 0) -> Array:
    count = design.instruments + len(design.effects) + len(design.free_blocks)
    return np.random.default_rng(seed).uniform(0.3, 2.0, count)


def simple_design(levers: Array, J: Array, r: Array, *groups: IntArray) -> Design:
    """One instrument, no block, the same levers in groups and in larger ones."""
    effects = (RandomEffect(f"effect{k}", levers, "joint", own) for k, own in enumerate(groups))
    return Design(r, J, np.eye(J.shape[-1]), (), tuple(effects), np.zeros(r.shape, dtype=int))


@dataclass(frozen=True, eq=False)
class Dense:
    """Matrices N x N of a design: parts of the covariance by variance, and what follows."""

    design: Design
    theta: Array

    @property
    def parts(self) -> list[Array]:
        """Derivatives of the covariance by instruments, effects and free squared amplitudes."""
        d = self.design
        found = [np.diag(1.0 * (d.instrument == i)) for i in range(d.instruments)]
        for effect in d.effects:
            Z, group = d.flat(effect.levers), effect.group[d.pose]
            found.append((Z @ Z.T) * (group[:, None] == group))
        return found + [self._spread(d.blocks[g]) for g in d.free_blocks]

    def _spread(self, block: GaussianBlock) -> Array:
        X = self.design.flat(block.columns @ block.root)
        return X @ X.T

    @property
    def V(self) -> Array:
        """Of the response, blocks integrated out."""
        stated = [b for b in self.design.blocks if b.amplitude is not None]
        own = sum(t * V for t, V in zip(self.theta, self.parts, strict=True))
        return own + sum((b.amplitude**2 * self._spread(b) for b in stated), np.zeros_like(own))

    @property
    def F(self) -> Array:
        return self.design.flat(self.design.J @ self.design.directions)

    @property
    def P(self) -> Array:
        inverse, F = np.linalg.inv(self.V), self.F
        return inverse - inverse @ F @ np.linalg.solve(F.T @ inverse @ F, F.T @ inverse)

    @property
    def value(self) -> float:
        F, V, y = self.F, self.V, self.design.response
        N = F.T @ np.linalg.solve(V, F)
        logs = np.linalg.slogdet(V)[1] + np.linalg.slogdet(N)[1]
        return (len(F) - F.shape[1]) * np.log(2.0 * np.pi) + logs + y @ self.P @ y

    @property
    def gradient(self) -> Array:
        P, y = self.P, self.design.response
        own = [np.trace(P @ V) - y @ P @ V @ P @ y for V in self.parts]
        return self.theta * np.array(own)

    @property
    def information(self) -> Array:
        """Mean of the observed and the expected second derivatives by log variances."""
        P, parts = self.P, zip(self.theta, self.parts, strict=True)
        moved = np.column_stack([t * V @ P @ self.design.response for t, V in parts])
        return moved.T @ P @ moved


def of(design: Design, theta: Array) -> RestrictedLikelihood:
    return RestrictedLikelihood(MixedModel.of(design), theta)


# -- Value, gradient and information


@pytest.mark.parametrize("seed", range(3))
@every_grouping
def test_value_gradient_and_information_are_those_of_dense_matrices(groups: str, seed: int) -> None:
    """And turned rows keep all products: the rest has as many rows as the turn says."""
    design = random_design(groups, seed)
    theta = random_theta(design, seed)
    found, dense = of(design, theta), Dense(design, theta)
    gradient, information = found.derivatives
    assert found.value == pytest.approx(dense.value, rel=1e-11)
    np.testing.assert_allclose(gradient, dense.gradient, rtol=1e-9, atol=1e-10)
    np.testing.assert_allclose(information, dense.information, rtol=1e-9, atol=1e-11)
    turned, rows = found.model.turned, design.columns
    inside, outside = turned.inside(rows).reshape(-1, rows.shape[1]), turned.outside_rows(rows)
    np.testing.assert_allclose(inside.T @ inside + outside.T @ outside, rows.T @ rows, atol=1e-10)
    assert np.count_nonzero(outside.any(axis=1)) == turned.outside.sum()


@pytest.mark.parametrize("variance", range(2, 6))
def test_a_variance_of_zero_is_no_effect(variance: int) -> None:
    """Value as without it, and no slope of its logarithm."""
    design = random_design()
    theta = random_theta(design)
    theta[variance] = 0.0
    found = of(design, theta)
    gradient, information = found.derivatives
    assert found.value == pytest.approx(Dense(design, theta).value, rel=1e-11)
    assert gradient[variance] == pytest.approx(0.0, abs=1e-12)
    np.testing.assert_allclose(information[variance], 0.0, atol=1e-12)


def test_order_of_poses_and_dependent_columns_change_nothing() -> None:
    design, rng = random_design(), np.random.default_rng(9)
    theta, poses, rows = random_theta(design), rng.permutation(POSES), rng.permutation(ROWS)

    def moved(a: Array) -> Array:
        return a[poses][:, rows]

    shuffled = replace(
        design,
        r=moved(design.r),
        J=moved(np.concatenate([design.J, design.J[..., :1] + design.J[..., 1:2]], axis=-1)),
        span=np.eye(4),
        blocks=tuple(replace(b, columns=moved(b.columns)) for b in design.blocks),
        effects=tuple(
            replace(e, levers=moved(e.levers), group=100 - 7 * e.group[poses])
            for e in design.effects
        ),
        instrument_of_row=moved(design.instrument_of_row),
    )
    assert shuffled.directions.shape == (4, 3)
    for one, other in zip(
        of(design, theta).derivatives, of(shuffled, theta).derivatives, strict=True
    ):
        np.testing.assert_allclose(one, other, rtol=1e-8, atol=1e-9)


def test_groups_that_cross_and_numbers_that_are_none_are_refused() -> None:
    design = random_design()
    across = replace(design.effects[0], group=np.arange(POSES) % 2)
    with pytest.raises(ValueError, match="nested"):
        MixedModel.of(replace(design, effects=(*design.effects, across)))
    r = design.r.copy()
    r[0, 0] = np.nan
    with pytest.raises(Unsolvable):
        MixedModel.of(replace(design, r=r))


@pytest.mark.parametrize("approaches", [1, 400])
def test_many_poses_of_one_place_make_no_square(approaches: int) -> None:
    """Cells keep as few rows as levers have rank; cost grows as poses or as approaches do."""
    rng, poses, rows = np.random.default_rng(0), 4000, 6
    levers = np.broadcast_to(rng.normal(size=(rows, 3)), (poses, rows, 3))
    J, r = rng.normal(size=(poses, rows, 2)), rng.normal(size=(poses, rows))
    groups = np.arange(poses) * approaches // poses, np.zeros(poses, dtype=int)
    tracemalloc.start()
    found = of(simple_design(levers, J, r, *groups), np.ones(3))
    found.derivatives  # noqa: B018
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert found.model.inside.shape == (approaches, 3, 3)
    assert found.model.turned.outside.tolist() == [poses * rows - 3 * approaches]
    assert peak < 60 * poses * rows * 8


# -- Inverse roots of covariances with shared errors

M = 12
ALONE, PAIRS, THIRDS = np.arange(M), np.arange(M) // 2, np.arange(M)[::-1] // 4
LEVELS: list[tuple[tuple[IntArray, int], ...]] = [
    (), ((ALONE, 3),), ((THIRDS, 3),), ((ALONE, 3), (THIRDS, 2)), ((PAIRS, 9), (THIRDS, 2)),
]  # fmt: skip


@pytest.mark.parametrize("rows", [1, 5, 40])
@pytest.mark.parametrize("levels", LEVELS)
def test_a_root_is_that_of_dense_matrices(
    levels: Sequence[tuple[IntArray, int]], rows: int
) -> None:
    """The map, its transpose, the inverse in parts, and covariances."""
    rng, scale, size = np.random.default_rng(rows), 1.7, M * rows
    K = [rng.normal(size=(M, rows, k)) * 3.0 for _, k in levels]
    parts = [(Groups.of(group), own) for (group, _), own in zip(levels, K, strict=True)]
    root, unit = InverseRoot.of(scale, parts), np.eye(size)
    V = unit.copy()
    for (group, _), own in zip(levels, K, strict=True):
        flat, of_row = own.reshape(size, -1), np.repeat(group, rows)
        V += (flat @ flat.T) * (of_row[:, None] == of_row)
    V *= scale**2
    W = root(unit.reshape(M, rows, size)).reshape(size, size)
    np.testing.assert_allclose(W @ V @ W.T, unit, atol=1e-9)
    np.testing.assert_allclose(root.back(unit.reshape(M, rows, size)).reshape(size, size), W.T)
    inverse = unit.copy()
    for groups, G in root.shared:
        flat, of_row = G.reshape(size, -1), np.repeat(groups.number, rows)
        inverse -= (flat @ flat.T) * (of_row[:, None] == of_row)
    np.testing.assert_allclose(inverse / scale**2, np.linalg.inv(V), atol=1e-9)
    gains = rng.normal(size=(M, rows, 3))
    flat = gains.reshape(size, 3)
    np.testing.assert_allclose(root.covariance(gains), flat.T @ V @ flat, rtol=1e-9)


# -- Variances: at the maximum, at the boundary, from any start

JOINT = Prior({"joint": 0.3})


def reml(design: Design, prior: Prior | None = None, start: Variances | None = None) -> Variances:
    return Marginal.fitted(design, prior, start).variances


def intercepts(seed: int, between: float) -> Design:
    """A random intercept a group of four poses with one row, and two fixed columns."""
    rng, group = np.random.default_rng(seed), np.arange(48) // 4
    J = np.stack([np.ones(48), rng.normal(size=48)], axis=-1)[:, None]
    r = J @ np.array([1.0, -2.0]) + between * rng.normal(size=(12, 1))[group]
    return simple_design(np.ones((48, 1, 1)), J, r + 0.5 * rng.normal(size=(48, 1)), group)


@pytest.mark.parametrize("seed", range(4))
def test_variances_value_and_deviations_are_those_of_statsmodels(seed: int) -> None:
    smf = pytest.importorskip("statsmodels.regression.mixed_linear_model")
    design = intercepts(seed, 0.8)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        model = smf.MixedLM(design.r[:, 0], design.J[:, 0], design.effects[0].group)
        peer = model.fit(reml=True, method="lbfgs", tol=1e-12)
    found = reml(design)
    assert found.instrument[0] == pytest.approx(peer.scale, rel=1e-3)
    assert found.effects[0] == pytest.approx(float(peer.cov_re[0, 0]), rel=2e-3)
    own = of(design, design.theta(found))
    assert -0.5 * own.value == pytest.approx(peer.llf, abs=1e-5)
    np.testing.assert_allclose(own.coefficients, peer.fe_params, rtol=1e-4)
    np.testing.assert_allclose((own.inverse**2).sum(axis=1) ** 0.5, peer.bse_fe, rtol=0.02)


@pytest.mark.parametrize("prior", [Prior(), JOINT])
@every_grouping
def test_no_variance_improves_the_penalised_likelihood(groups: str, prior: Prior) -> None:
    """Slopes vanish; where a variance is at its lower bound, it would only rise."""
    design = random_design(groups, 3)
    theta = design.theta(reml(design, prior))
    slope = of(design, theta).derivatives[0] + prior.penalty(design, theta).slope
    assert np.abs(slope).max() < 5e-3
    # From far below and from far above.
    for size in (0.01, 100.0) if prior is JOINT else ():
        start = design.variances(size * random_theta(design))
        found = design.theta(reml(design, prior, start))
        np.testing.assert_allclose(found, theta, rtol=5e-3, atol=1e-6)


@pytest.mark.parametrize("of_logarithm", [True, False])
def test_the_slope_of_a_prior_is_that_of_its_value(of_logarithm: bool) -> None:
    """Central differences by log variances."""
    design, prior = random_design("places", 3), Prior({"joint": 0.3}, of_logarithm=of_logarithm)
    theta = np.linspace(0.2, 1.5, len(random_theta(design)))
    for j, slope in enumerate(prior.penalty(design, theta).slope):
        step = np.exp(1e-5 * (np.arange(len(theta)) == j))
        up, down = (prior.penalty(design, t).value for t in (theta * step, theta / step))
        assert slope == pytest.approx((up - down) / 2e-5, abs=1e-6)


def test_a_variance_that_is_not_there_goes_to_its_bound_and_not_below() -> None:
    """Groups that agree better than noise allows: nothing without a prior, little with one."""
    design = intercepts(1, 0.0)
    left = (design.r[:, 0] - design.J[:, 0] @ np.array([1.0, -2.0])).reshape(12, 4)
    left = (left - left.mean(axis=1, keepdims=True)).reshape(48)
    design, noise = replace(design, r=left[:, None]), float(left.var())
    assert 0.0 < reml(design).effects[0] < 1e-5 * noise
    assert 1e-4 * noise < reml(design, Prior({"joint": 0.05})).effects[0] < noise / 4.0


def test_where_rows_say_nothing_the_data_sheet_stands() -> None:
    """A lever too short to show beside the noise."""
    rng = np.random.default_rng(0)
    levers, J = 1e-6 * rng.normal(size=(30, 3, 1)), rng.normal(size=(30, 3, 2))
    r = rng.normal(size=(30, 3))
    found = Marginal.fitted(simple_design(levers, J, r, np.arange(30)), Prior({"joint": 0.2}))
    assert np.sqrt(found.variances.effects[0]) == pytest.approx(0.2, rel=0.02)
    assert found.log_covariance[1, 1] == pytest.approx(4.0, rel=0.02)


def test_units_scale_the_variances() -> None:
    design = random_design("approaches within places", 3)
    design = replace(design, blocks=design.blocks[:1])
    other = replace(
        design,
        r=1e-4 * design.r,
        J=1e2 * design.J,
        blocks=(replace(design.blocks[0], columns=1e-4 * design.blocks[0].columns),),
        effects=tuple(replace(e, levers=10.0 * e.levers) for e in design.effects),
    )
    one, two = reml(design), reml(other)
    np.testing.assert_allclose(two.instrument, 1e-8 * one.instrument, rtol=1e-3)
    noise = one.instrument.mean()
    np.testing.assert_allclose(1e10 * two.effects, one.effects, rtol=5e-3, atol=1e-5 * noise)
    np.testing.assert_allclose(two.amplitudes, one.amplitudes, rtol=5e-3, atol=1e-3)


def test_posterior_of_a_block_is_that_of_dense_matrices() -> None:
    design = random_design()
    theta = random_theta(design)
    mean, covariance = Marginal.fitted(design).at(design.variances(theta)).posterior("free")
    dense, block = Dense(design, theta), design.blocks[0]
    spread, X = theta[-1] * block.root @ block.root.T, design.flat(block.columns)
    expected = block.mean + spread @ X.T @ dense.P @ design.response
    np.testing.assert_allclose(mean, expected, rtol=1e-9)
    left = spread - spread @ X.T @ dense.P @ X @ spread
    np.testing.assert_allclose(covariance, left, rtol=1e-8, atol=1e-10)
