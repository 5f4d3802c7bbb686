"""How far a robot left its type, and what of the type is still believed of it.

With the estimate ``t`` under a prior of mean m and covariance S, and ``e = t - m``, the score test of a
shift in one parameter is ``g_j / sqrt(Q_jj)`` with ``g = S^-1 e`` and Q its covariance: it holds beside
whatever the others do. All together, ``g^T Q^+ g`` is a chi-square of as many rows as the data tell,
if S is known. It was learnt from few robots, and where parameters go together its narrow directions are
too narrow by luck. So a robot that looks strange is held against as many more types, each learnt anew
from robots drawn of this one, each with a robot more (parametric bootstrap).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calib.arrays import Array, IntArray
from calib.population.hierarchy import of_known
from calib.population.prior import Key, Prior

_TOLD = 1e-3  # share of a prior's variance that the data must tell
_SURELY = 0.005  # of each of two tests: all parameters together, and each of them
_DRAWN = 399  # types that are learnt anew
_PLENTY = 8  # robots farther out that settle it (Besag and Clifford, Biometrika 78(2), 1991)
_FEWEST = 2  # robots from which a type can be
_RELEASED = 10.0  # plausible sizes
_UP_TO = 0.75  # probability with which a robot stands no farther out than is believed of it
_AS_OTHERS = 4.0  # rows that say that it stands as others do


@dataclass(frozen=True, eq=False)
class Departure:
    """How far a robot deviates from its type.

    prior : Prior, of this model's parameters, as the type has it
    scores : ndarray, shape (k,), how far each leaves the mean if the type is believed, in standard
        deviations of how far it would in a robot of the type; NaN where the data say nothing of it
    statistic : float; rows : int; p_value : float, of so large a one in a robot of the type
    released : tuple of Key, parameters that the type is not believed for
    factor : float, by which the type's deviations are widened for all others
    """

    prior: Prior
    scores: Array
    statistic: float
    rows: int
    p_value: float
    released: tuple[Key, ...]
    factor: float

    @property
    def of_the_type(self) -> bool:
        """Whether nothing speaks against it."""
        return self.p_value >= _SURELY and not self.released


def departure(prior: Prior, values: Array, covariance: Array, sizes: Array) -> Departure:
    """How far a robot left its type, by an estimate that the type hardly held.

    values : ndarray, shape (k,), SI; covariance : ndarray, shape (k, k), SI, of an estimate that was
        made with the prior :func:`loosened`; sizes : ndarray, shape (k,), SI, plausible sizes
    """
    from scipy.special import chdtrc

    certain = np.linalg.inv(covariance)
    data = certain - np.linalg.inv(loosened(prior, sizes).covariance)
    W = prior.whitening
    u, K = _scored(W, data, certain @ (values - prior.mean))
    back = np.linalg.inv(W)
    left, moved = back @ u, np.diag(back @ K @ back.T)
    seen = moved > _TOLD * prior.std**2
    scores = np.full(len(values), np.nan)
    scores[seen] = left[seen] / np.sqrt(moved[seen])
    statistic, rows = _square(u, K)
    share = prior.share
    p_value = float(chdtrc(share * rows, share * statistic)) if rows else 1.0
    if p_value < _SURELY and prior.robots >= _FEWEST:
        p_value = max(p_value, _by_types_drawn(prior, sizes, data, statistic))
    # Of the prior's own coordinates: a shift of one parameter by its deviation.
    g, Q = prior.std * (W.T @ u), np.outer(prior.std, prior.std) * (W.T @ K @ W)
    out, rest = _released(prior, g, Q)
    factor = _widening(max(statistic - rest, 0.0), max(rows - len(out), 1))
    released = tuple(prior.keys[i] for i in out)
    return Departure(prior, scores, statistic, rows, p_value, released, factor)


def _scored(W: Array, data: Array, pull: Array) -> tuple[Array, Array]:
    """Whitened estimate under a prior, (k,), and its covariance in robots of it, (k, k).

    W : ndarray, shape (k, k), whitening of the prior; data : ndarray, shape (k, k), information of the
        readings; pull : ndarray, shape (k,), the same times how far they are from the prior's mean
    """
    back = np.linalg.inv(W)
    after = np.linalg.inv(back.T @ data @ back + np.eye(len(W)))
    return after @ back.T @ pull, np.eye(len(W)) - (after + after.T) / 2.0


def _by_types_drawn(prior: Prior, sizes: Array, data: Array, statistic: float) -> float:
    """How often a robot of a type, read as well, stands as far out of what is learnt of that type."""
    rng, k, farther = np.random.default_rng(0), len(sizes), 0
    half = np.linalg.cholesky(prior.covariance / np.outer(sizes, sizes))
    values, vectors = np.linalg.eigh(data * np.outer(sizes, sizes))
    noise = vectors * np.sqrt(np.maximum(values, 0.0))
    for drawn in range(_DRAWN):
        if farther == _PLENTY:
            return farther / drawn
        *others, robot = prior.mean / sizes + rng.normal(size=(prior.robots + 1, k)) @ half.T
        about, covariance = of_known(np.array(others))
        read = noise @ (noise.T @ (robot - about) + rng.normal(size=k))
        W = np.linalg.inv(np.linalg.cholesky(covariance))
        farther += _square(*_scored(W, noise @ noise.T, read))[0] >= statistic
    return (1.0 + farther) / (1.0 + _DRAWN)


def loosened(prior: Prior, sizes: Array) -> Prior:
    """So wide that it pulls nothing, and yet leaves nothing open; sizes as of :func:`adapted`."""
    return prior.widened(1.0, (_RELEASED * sizes) ** 2)


def adapted(found: Departure, sizes: Array) -> Prior:
    """The prior of the type, widened for a robot that deviates from it.

    sizes : ndarray, shape (k,), SI, plausible sizes of the prior's parameters

    What left it alone is released to ten plausible sizes. All others keep their shape, as much wider as
    they may stand out together: a robot of the type's tail is no exception, and yet nearer to its own
    readings.
    """
    extra = np.array(
        [_RELEASED**2 * s**2 if key in found.released else 0.0
         for key, s in zip(found.prior.keys, sizes, strict=True)]
    )  # fmt: skip
    return found.prior.widened(found.factor, extra)


def _widening(square: float, rows: int) -> float:
    """By how much a robot may stand farther out than others, one at least.

    Its own spread s over the type's makes the sum of squares ``s^2 chi^2``: few rows leave s open, so
    it is an upper bound of s that counts, by these rows against those that say it is one. The ratio
    itself (Birge's) is half the time too small, and intervals of robots far out then miss.
    """
    from scipy.special import chdtri

    shown = square / float(chdtri(rows, _UP_TO))
    return float(np.sqrt(max(1.0, (rows * shown + _AS_OTHERS) / (rows + _AS_OTHERS))))


def _square(u: Array, K: Array) -> tuple[float, int]:
    """``u^T K^+ u`` and its rows, in the directions that are told."""
    values, vectors = np.linalg.eigh(K)
    told = values > _TOLD
    return float(((vectors[:, told].T @ u) ** 2 / values[told]).sum()), int(told.sum())


def _released(prior: Prior, g: Array, Q: Array) -> tuple[IntArray, float]:
    """Parameters that left alone, the farthest first, and the sum of squares that go with them."""
    from scipy.special import stdtr

    out: list[int] = []
    gone, least = 0.0, _TOLD * np.maximum(np.diag(Q), 1.0)
    while len(out) < len(g) // 2:
        variance = np.diag(Q)
        known = variance > least
        z = np.where(known, np.abs(g) / np.sqrt(np.where(known, variance, 1.0)), 0.0)
        worst = int(z.argmax())
        if 2.0 * stdtr(prior.freedom, -z[worst]) * len(g) > _SURELY:
            break
        out.append(worst)
        gone += float(z[worst] ** 2)
        column = Q[:, worst] / variance[worst]
        g, Q = g - column * g[worst], Q - np.outer(column, Q[worst])
    return np.array(out, dtype=int), gone
