"""What follows from a design at some variances: estimate, covariance, freedom, evidence.

The estimate is least squares by the noise of the instruments and the priors of blocks; random effects
do not weigh it. Its covariance, tests and degrees of freedom count them.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from calib.arrays import Array, IntArray, by_size, stacked
from calib.inference.design import Design, GaussianBlock, Variances
from calib.inference.evidence import Evidence, block_evidence
from calib.inference.prior import Prior, penalty
from calib.inference.reml import search
from calib.inference.restricted import MixedModel, RestrictedLikelihood

_OWN = 1e-8  # share of its noise by which rows of a pose must be predicted from others


@dataclass(frozen=True, eq=False)
class Marginal:
    """A design at some variances.

    likelihood : RestrictedLikelihood; prior : of the variances, for :meth:`freedom` and ``refind``
    """

    design: Design
    variances: Variances
    prior: Prior
    likelihood: RestrictedLikelihood

    @classmethod
    def at(cls, design: Design, variances: Variances, prior: Prior | None = None) -> Marginal:
        """The marginal model of a design."""
        model = MixedModel.of(design)
        likelihood = RestrictedLikelihood(model, design.theta(variances))
        return cls(design, variances, prior or Prior(), likelihood)

    @classmethod
    def fitted(cls, design: Design, prior: Prior, start: Variances | None = None) -> Marginal:
        """The same at the variances that restricted likelihood finds."""
        model = MixedModel.of(design)
        theta = search(model, prior, start).theta
        likelihood = RestrictedLikelihood(model, theta)
        return cls(design, design.variances(theta), prior, likelihood)

    @property
    def log_likelihood(self) -> float:
        """Restricted log likelihood."""
        return -0.5 * self.likelihood.value

    # -- estimate and covariance ----------------------------------------------------------------

    @cached_property
    def _by_noise(self) -> RestrictedLikelihood:
        """The same without random effects: its root W and coefficients are those of least squares."""
        theta, i = self.likelihood.theta.copy(), self.design.instruments
        theta[i : i + len(self.design.effects)] = 0.0
        return RestrictedLikelihood(self.likelihood.model, theta)

    @cached_property
    def _effects(self) -> tuple[Array, IntArray]:
        """How draws of unit variance move the coefficients in units of W, (d, f), and their effects."""
        own, turned = self.likelihood.decorrelation, self.likelihood.model.turned
        by_variance = self._by_noise.weighted[..., :-1]
        cells = np.swapaxes(own.own, -1, -2) @ by_variance
        shared = turned.sums(np.swapaxes(own.shared, -1, -2) @ by_variance)
        effect = np.concatenate([np.tile(turned.own_of, len(cells)), turned.shared_of.ravel()])
        moved = np.concatenate([stacked(cells), stacked(shared)])
        return moved[effect >= 0], effect[effect >= 0]

    @property
    def estimate(self) -> Array:
        """Least-squares values of b, shape (p,)."""
        directions = self.design.directions
        return np.asarray(directions @ self._by_noise.coefficients[: directions.shape[1]])

    @cached_property
    def covariance(self) -> Array:
        """Covariance (p, p) of :attr:`estimate` by noise, random effects and priors of blocks."""
        moved, _ = self._effects
        root = self._root
        return np.asarray(root @ (np.eye(root.shape[1]) + moved.T @ moved) @ root.T)

    @property
    def _root(self) -> Array:
        """``D W``, shape (p, f): values of b from coefficients in units of W."""
        directions = self.design.directions
        return np.asarray(directions @ self._by_noise.inverse[: directions.shape[1]])

    def freedom(self, direction: Array) -> float:
        """Satterthwaite's degrees of freedom of the variance of ``direction . b``, one at least.

        direction : ndarray, shape (p,)
        The variance is a sum of parts, each in proportion to one variance: ``2 v^2 / (g^T C g)`` with
        g the parts and C the covariance of the log variances, twice the inverse of their information
        and of the curvature of their prior (Giesbrecht and Burns, Biometrics 41(2), 1985).
        """
        parts = self._parts(self._root.T @ direction)
        v = float(direction @ self.covariance @ direction)
        spread = float(parts @ self.log_covariance @ parts)
        return max(1.0, 2.0 * v**2 / spread) if spread > 0.0 else np.inf

    def _parts(self, u: Array) -> Array:
        """Parts (t,) of the variance of a combination u (f,) of coefficients in units of W."""
        own, design = self._by_noise, self.design
        along = np.append(own.inverse @ u, 0.0)
        i, v = design.instruments, len(design.effects)
        parts = np.zeros(len(own.theta))
        parts[:i] = ((own.outside @ along) ** 2).sum(axis=1)
        slots = own.model.turned.instrument
        np.add.at(parts, slots[slots >= 0], ((own.inside @ along) ** 2)[slots >= 0])
        moved, effect = self._effects
        np.add.at(parts, i + effect, (moved @ u) ** 2)
        for j, block in enumerate(design.free_blocks):
            parts[i + v + j] = (along[:-1][design.block_of_column == block] ** 2).sum()
        return parts

    @cached_property
    def log_covariance(self) -> Array:
        """Covariance (t, t) of the estimated log variances: instruments, effects, amplitudes^2."""
        known = penalty(self.design, self.prior, self.likelihood.theta).information
        A = self.likelihood.derivatives[1] + np.diag(known)
        size = np.sqrt(np.maximum(np.diag(A), 1e-12))
        scaled = A / np.outer(size, size) + 1e-12 * np.eye(len(A))
        return np.asarray(2.0 * np.linalg.inv(scaled) / np.outer(size, size))

    def posterior(self, name: str) -> tuple[Array, Array]:
        """Mean (k,) and covariance (k, k) of the coefficients of a block, given all rows."""
        own, names = self.likelihood, [block.name for block in self.design.blocks]
        block = self.design.blocks[names.index(name)]
        mine = self.design.block_of_column == names.index(name)
        root = block.root * self.variances.amplitudes[names.index(name)]
        half = root @ own.inverse[mine]
        return block.mean + root @ own.coefficients[mine], np.asarray(half @ half.T)

    # -- rows made independent ------------------------------------------------------------------

    def whitened(self, rows: Array) -> Array:
        """Independent rows (n, w) of unit variance of live rows (N, w), in more rows than N."""
        turned, own = self.likelihood.model.turned, self.likelihood.decorrelation
        inside = turned.inside(rows)
        left = (rows - turned.spread(inside)) / self._deviation[:, None]
        return np.concatenate([left, own(inside).reshape(-1, rows.shape[1])])

    def projected(self, rows: Array) -> Array:
        """The same with all columns of the design projected out: products of these are ``x^T P z``.

        Prior rows of the blocks follow the whitened ones.
        """
        white, Q = self.whitened(rows), self._basis
        return np.pad(white, ((0, len(Q) - len(white)), (0, 0))) - Q @ (Q[: len(white)].T @ white)

    @cached_property
    def _deviation(self) -> Array:
        return np.sqrt(self.likelihood.theta[self.design.instrument])

    @cached_property
    def _basis(self) -> Array:
        """Orthonormal basis (n + h, f) of whitened columns and their prior rows."""
        own = self.likelihood
        white = self.whitened(self.design.columns * own.scale[:-1])
        return np.concatenate([white, own.prior[:, :-1]]) @ own.inverse

    def _solved(self, rows: Array) -> Array:
        """Product of the inverse covariance with live rows (N, w)."""
        turned, own = self.likelihood.model.turned, self.likelihood.decorrelation
        inside = turned.inside(rows)
        left = (rows - turned.spread(inside)) / self._deviation[:, None] ** 2
        return np.asarray(left + turned.spread(own.back(own(inside))))

    # -- tests ----------------------------------------------------------------------------------

    def evidence(self, block: GaussianBlock, refind: bool = False) -> Evidence:
        """How much a block that is not in the design would gain.

        refind : estimate all variances anew beside the block; the gain is then that of the penalised
            likelihood over the present variances
        """
        rows = self.design.flat(block.columns @ block.root)
        mean = self.design.flat((block.columns @ block.mean)[..., None])
        shown = self.projected(np.column_stack([rows, self.design.response, mean]))
        lengths = np.linalg.norm(self.whitened(rows), axis=0)
        found = block_evidence(
            shown[:, :-2],
            lengths,
            shown[:, -2],
            shown[:, -1],
            block.amplitude,
            self.design.freedom,
        )
        if not refind:
            return found
        wider = replace(self.design, blocks=(*self.design.blocks, block))
        amplitudes = np.append(self.variances.amplitudes, found.amplitude or 1.0)
        start = replace(self.variances, amplitudes=amplitudes)
        best = search(MixedModel.of(wider), self.prior, start)
        now = self.likelihood.value + penalty(self.design, self.prior, self.likelihood.theta).value
        amplitude = float(wider.variances(best.theta).amplitudes[-1])
        return replace(found, gain=now - best.objective, amplitude=amplitude)

    def pose_statistics(self) -> tuple[Array, IntArray]:
        """Squared error of each pose as the others predict it, in units of its variance, and its rows.

        Shapes (m,), zero for poses without part. The variance is that of a pose of weight one, so
        the statistic is chi-square with as many degrees of freedom as rows, whatever the weights are.
        Directions that no other pose predicts do not count.
        """
        own, turned, design = self.likelihood, self.likelihood.model.turned, self.design
        f = len(own.coefficients)
        rows = np.column_stack([design.columns, design.response]) * own.scale
        G = self._solved(rows @ own.combined) * self._deviation[:, None]
        inverse = own.decorrelation.inverse
        inverse = inverse - np.eye(inverse.shape[-1]) / own.decorrelation.slot_variance[..., None]
        U = turned.U * self._deviation[:, None]
        statistic, count = np.zeros(len(design.r)), np.zeros(len(design.r), dtype=np.int_)
        for index in by_size(design.pose):
            pose = design.pose[index[:, 0]]
            columns, left = G[index][..., :f], G[index][..., f]
            P = U[index] @ inverse[turned.cell[index[:, 0]]] @ np.swapaxes(U[index], -1, -2)
            P = P + np.eye(index.shape[1]) - columns @ np.swapaxes(columns, -1, -2)
            d, axes = np.linalg.eigh(P)
            seen = d > _OWN
            size = np.where(seen, d * (1.0 - d * (1.0 - design.pose_weight[pose, None] ** 2)), 1.0)
            along = (np.swapaxes(axes, -1, -2) @ left[..., None])[..., 0]
            statistic[pose] = (seen * along**2 / size).sum(axis=1)
            count[pose] = seen.sum(axis=1)
        return statistic, count
