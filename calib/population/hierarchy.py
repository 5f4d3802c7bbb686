"""The hierarchical normal model of a type: ``t_i ~ N(theta_i, C_i)``, ``theta_i ~ N(mu, Sigma)``.

In plausible sizes. ``mu`` is N(0, 1); the deviations of Sigma are half-t about one size with four
degrees of freedom, each integrated over with its mean (Gelman, Bayesian Analysis 1(3), 2006): few
robots stay near the plausible sizes, ten are enough to leave them far. A robot speaks of one parameter
by its estimate given its others, of variance ``1 / Q_kk - Sigma_kk`` with ``Q = (C_i + Sigma)^-1``:
what it could not determine says nothing, and what it knows together counts together. Correlations
between robots are shrunk to none by as much as chance makes of them (Schaefer and Strimmer, Stat. Appl.
Genet. Mol. Biol. 4(1), 2005).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from calib.arrays import Array
from calib.population.prior import Key, Prior

_OPEN = 1e3  # plausible sizes: as uncertain as what a robot could not determine
_FREEDOM = 4.0  # of the half-t
_GRID = np.geomspace(1e-4, 30.0, 120)
_ROUNDS = 60
_SETTLED = 1e-4
_FEWEST = 4  # robots among which one can be told from the others
_ALARM = 0.01  # over all robots
_MOST = 4  # one robot in so many may be of another type


@dataclass(frozen=True, eq=False)
class RobotEstimate:
    """Estimates of one robot's k parameters, SI.

    values : ndarray, shape (k,); noise : ndarray, shape (k, k); open : ndarray, shape (k, u), how the
        values follow what was not determined, each column for an error of the plausible size
    """

    name: str
    values: Array
    noise: Array
    open: Array


@dataclass(frozen=True)
class Aside:
    """A robot that is not of the type, with the chance of one so far off."""

    name: str
    p_value: float


@dataclass(frozen=True, eq=False)
class Population:
    """Result of :func:`population`.

    prior : Prior, of one robot more
    spread : ndarray, shape (k,), SI, standard deviations between robots
    aside : tuple of Aside, robots that did not count
    """

    prior: Prior
    spread: Array
    aside: tuple[Aside, ...]


@dataclass(frozen=True, eq=False)
class _TypeFit:
    """mu (k,) with its covariance (k, k), and Sigma (k, k), in plausible sizes."""

    mean: Array
    doubt: Array
    sigma: Array


def population(
    type_: str, keys: tuple[Key, ...], sizes: Array, robots: Sequence[RobotEstimate]
) -> Population:
    """Learn what a type has in common from its robots, none among them as well.

    sizes : ndarray, shape (k,), SI, plausible sizes
    """
    t = np.array([robot.values / sizes for robot in robots]).reshape(-1, len(sizes))
    open_ = [_OPEN * robot.open / sizes[:, None] for robot in robots]  # as good as unknown
    C = np.array(
        [r.noise / np.outer(sizes, sizes) + V @ V.T for r, V in zip(robots, open_, strict=True)]
    ).reshape(-1, *2 * sizes.shape)
    kept, aside = np.arange(len(robots)), list[Aside]()
    fit = _fit(t, C)
    while len(kept) - 1 >= max(_FEWEST - 1, (_MOST - 1) * (len(aside) + 1)):
        worst = int(_squares(t[kept], C[kept], fit).argmax())
        others = np.delete(kept, worst)
        without = _fit(t[others], C[others])
        own = kept[worst]
        p = _chance(t[own], C[own], without, len(others)) * len(kept)
        if p > _ALARM:
            break
        aside.append(Aside(robots[own].name, min(p, 1.0)))
        kept, fit = others, without
    scale = np.outer(sizes, sizes)
    prior = Prior(type_, keys, fit.mean * sizes, (fit.sigma + fit.doubt) * scale, len(kept))
    return Population(prior, np.sqrt(np.diag(fit.sigma)) * sizes, tuple(aside))


def _fit(t: Array, C: Array) -> _TypeFit:
    k = t.shape[1]
    variance = np.full(k, _variances(np.zeros((0, 1)), np.ones((0, 1)))[0])
    mean, doubt = np.zeros(k), np.eye(k)
    for _ in range(_ROUNDS if len(t) else 0):
        Q = np.asarray(np.linalg.inv(C + np.diag(variance)))
        mean, doubt = _mean(t, Q)
        single = np.diagonal(Q, axis1=1, axis2=2)
        seen = mean + np.einsum("ikl,il->ik", Q, t - mean) / single
        fresh = _variances(seen, np.maximum(1.0 / single - variance, 0.0))
        settled = np.allclose(fresh, variance, rtol=_SETTLED, atol=0.0)
        variance = np.sqrt(fresh * variance)  # half-way, so that pairs do not swing
        if settled:
            break
    sigma = _correlated(t, C, mean, variance)
    if len(t):
        mean, doubt = _mean(t, np.asarray(np.linalg.inv(C + sigma)))
    return _TypeFit(mean, doubt, sigma)


def of_known(t: Array) -> tuple[Array, Array]:
    """Mean (k,) and covariance (k, k) of one robot more, by robots (N, k) whose values are known.

    In plausible sizes: what the hierarchy makes of estimates without noise, in one round.
    """
    N, k = t.shape
    s = _GRID**2
    sums = (
        power[:, None] / s for power in (np.full(k, float(N)), t.sum(axis=0), (t**2).sum(axis=0))
    )
    variance = _on_grid(-0.5 * N * np.log(s), *sums)
    mean = t.sum(axis=0) / (N + variance)
    y = (t - mean) / np.sqrt(variance)
    sigma = _shrunk(y.T @ y, np.full((k, k), float(N))) * np.sqrt(np.outer(variance, variance))
    doubt = np.linalg.inv(np.eye(k) + N * np.linalg.inv(sigma))
    return doubt @ np.linalg.solve(sigma, t.sum(axis=0)), sigma + doubt


def _mean(t: Array, Q: Array) -> tuple[Array, Array]:
    """Posterior mean and covariance of mu, given the estimates' precisions Q (N, k, k)."""
    doubt = np.linalg.inv(np.eye(t.shape[1]) + Q.sum(axis=0))
    return doubt @ np.einsum("ikl,il->k", Q, t), doubt


def _variances(seen: Array, noise: Array) -> Array:
    """Posterior mean of each variance, shape (k,), of values (N, k) seen with variances (N, k).

    mu is integrated over, normal about zero with unit variance.
    """
    s, shape = _GRID**2, (seen.shape[1], len(_GRID))
    each, weight, first, second = (np.zeros(shape) for _ in range(4))
    for y, v in zip(seen, noise, strict=True):
        w = 1.0 / (s + v[:, None])
        each = each + 0.5 * np.log(w)
        weight, first, second = (
            total + w * y[:, None] ** power for power, total in enumerate((weight, first, second))
        )
    return _on_grid(each, weight, first, second)


def _on_grid(each: Array, weight: Array, first: Array, second: Array) -> Array:
    """Posterior mean of each variance, shape (k,).

    each : half the log of all precisions on the grid; weight, first, second : sums of the precisions
        times powers of what is seen; (k, grid)
    """
    s, weight = _GRID**2, 1.0 + weight
    log_p = -0.5 * (_FREEDOM + 1.0) * np.log1p(s / _FREEDOM) + np.log(_GRID)  # the grid's own step
    each = each + log_p - 0.5 * np.log(weight) - 0.5 * (second - first**2 / weight)
    p = np.exp(each - each.max(axis=1, keepdims=True))
    return np.asarray(p @ s / p.sum(axis=1))


def _correlated(t: Array, C: Array, mean: Array, variance: Array) -> Array:
    """Sigma (k, k) of these variances, its correlations as far as the robots show them."""
    k, std = len(variance), np.sqrt(variance)
    R = np.eye(k)
    if len(t) < 2:
        return np.diag(variance)
    y, noise = (t - mean) / std, C / np.outer(std, std)
    for _ in range(_ROUNDS):
        gain = R @ np.linalg.inv(noise + R)
        own = np.einsum("ikl,il->ik", gain, y)
        # Of what each parameter is known by, as many robots count.
        seen = np.clip(np.diagonal(gain, axis1=1, axis2=2), 0.0, 1.0)
        squares = np.einsum("ik,il->kl", own, own) + (R - gain @ R).sum(axis=0)
        counted = np.maximum(np.einsum("ik,il->kl", seen, seen), 1.0)
        fresh = _shrunk(squares, counted)
        if np.abs(fresh - R).max() < _SETTLED:
            break
        R = fresh
    return np.asarray(R * np.outer(std, std))


def _shrunk(squares: Array, counted: Array) -> Array:
    """Correlations (k, k) as far as they are more than chance.

    squares : sums of products over the robots; counted : robots behind each, both (k, k)
    """
    scale = np.sqrt(np.diag(squares))
    shown, off = squares / np.outer(scale, scale), ~np.eye(len(scale), dtype=bool)
    chance, found = ((1.0 - shown**2) ** 2 / counted)[off].sum(), (shown**2)[off].sum()
    share = float(np.clip(1.0 - chance / max(found, 1e-12), 0.0, 1.0))
    return np.asarray(share * shown + (1.0 - share) * np.eye(len(scale)))


def _squares(t: Array, C: Array, fit: _TypeFit) -> Array:
    """How far each robot is off, as a square in its standard deviations, shape (N,)."""
    off = t - fit.mean
    solved = np.linalg.solve(C + fit.sigma + fit.doubt, off[..., None])[..., 0]
    return np.asarray((off * solved).sum(axis=1))


def _chance(t: Array, C: Array, fit: _TypeFit, robots: int) -> float:
    """Of one more robot with any parameter so far off, whatever goes together between robots.

    robots : of the fit
    """
    from scipy.special import stdtr

    z = np.abs(t - fit.mean) / np.sqrt(np.diag(C + fit.sigma + fit.doubt))
    return min(1.0, 2.0 * len(z) * float(stdtr(robots - 1.0, -z.max(initial=0.0))))
