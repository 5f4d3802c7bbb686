"""Widths of the size prior: amplitudes of blocks by expectation and maximisation.

Each free block is a class of errors of one kind and unit (``geometry_mrad``, ``geometry_mm``,
``joint_zero``), its root the plausible sizes. With ``c = a R z``, and z and C the posterior mean and
covariance of a class of k errors at the present widths,

    a^2 <- (a^2 (|z|^2 + trace C) + n) / (k + n)

climbs to the maximum of the restricted likelihood (Dempster, Laird, Rubin, J. R. Stat. Soc. B 39(1),
1977), plausible sizes counting as n errors. It crosses no valley, and an error of a hundred plausible
sizes has one before it, so each class starts with the likeliest of a few widths.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from calib.arrays import Array
from calib.inference.design import Design, Variances
from calib.inference.least_squares import inverse_triangle, joined_triangle
from calib.inference.restricted import MixedModel, RestrictedLikelihood

_KNOWN = 0.5  # errors of a class for which its plausible sizes count
_STARTS = 10.0 ** np.arange(-1.0, 4.5, 0.5)
_ROUNDS = 500
_SETTLED = 1e-4  # of a width


@dataclass(frozen=True, eq=False)
class Widths:
    """Widths of a design's free blocks.

    variances : Variances, with their amplitudes; converged : bool
    by_prior : float, number of coefficients that the prior determines in place of the rows
    """

    variances: Variances
    by_prior: float
    converged: bool


def widths(design: Design, variances: Variances, known: float = _KNOWN) -> Widths:
    """Estimate the amplitudes of free blocks, all other variances as given.

    known : number of errors for which the plausible sizes of a class count
    """
    search = _search(design, variances, known)
    count = len(design.free_blocks)
    found = search.likeliest(np.tile(_STARTS[:, None], (1, count)))
    for j in range(count):
        tried = np.tile(found, (len(_STARTS), 1))
        tried[:, j] = _STARTS
        found = search.likeliest(tried)
    converged = False
    for _ in range(_ROUNDS):
        last, found = found, search.raised(found)
        converged = np.allclose(found, last, rtol=_SETTLED, atol=0.0)
        if converged:
            break
    by_prior = float(search.posterior(found)[1].sum())
    amplitudes = design.amplitudes(found)
    return Widths(replace(variances, amplitudes=amplitudes), by_prior, bool(converged))


def _search(design: Design, variances: Variances, known: float) -> _Search:
    unit = replace(variances, amplitudes=design.amplitudes(np.ones(len(design.free_blocks))))
    likelihood = RestrictedLikelihood(MixedModel.of(design), design.theta(unit))
    of, width = design.block_of_column, len(likelihood.scale)
    number = {block: j for j, block in enumerate(design.free_blocks)}
    column = np.array([number.get(int(block), -1) for block in of], dtype=np.int_)
    parts = (likelihood.outside.reshape(-1, width), likelihood.inside.reshape(-1, width))
    member = np.eye(len(number) + 1)[column][:, :-1]
    return _Search(joined_triangle(parts), likelihood.prior, member, known)


@dataclass(frozen=True, eq=False)
class _Search:
    """Reduced rows (f + 1, f + 1) at unit widths, prior rows, and blocks (f, b) of the columns."""

    rows: Array
    prior: Array
    member: Array
    known: float

    def _triangle(self, widths: Array) -> Array:
        scale = self.member @ widths + (self.member.sum(axis=1) == 0.0)
        return joined_triangle([self.rows * np.append(scale, 1.0), self.prior])

    def likeliest(self, tried: Array) -> Array:
        """The likeliest of some widths (n, b), with what is known of them."""
        values = []
        for one in tried:
            R = self._triangle(one)
            known = self.known * (one**-2 + 2.0 * np.log(one)).sum()
            values.append(2.0 * np.log(np.abs(np.diag(R)[:-1])).sum() + R[-1, -1] ** 2 + known)
        return np.asarray(tried[int(np.argmin(values))])

    def posterior(self, widths: Array) -> tuple[Array, Array]:
        """Sums of ``z^2`` and of their variances over each block, (b,) each."""
        R = self._triangle(widths)
        W = inverse_triangle(R[:-1, :-1])
        return (W @ R[:-1, -1]) ** 2 @ self.member, (W**2).sum(axis=1) @ self.member

    def raised(self, widths: Array) -> Array:
        """Widths (b,) of a larger likelihood."""
        squares, spread = self.posterior(widths)
        total = widths**2 * (squares + spread) + self.known
        return np.asarray(np.sqrt(total / (self.member.sum(axis=0) + self.known)))
