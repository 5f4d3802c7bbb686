"""Small random designs, and every quantity of theirs by plain dense matrices."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calib.arrays import Array, IntArray
from calib.inference import Design, GaussianBlock, RandomEffect, Variances

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


def random_design(groups: str = "approaches within places", seed: int = 0) -> Design:
    """Two instruments, absent rows, an absent pose, a stated and a free block."""
    rng = np.random.default_rng(seed)
    levers = rng.normal(size=(POSES, ROWS, 4))
    instrument = np.zeros((POSES, ROWS), dtype=int)
    instrument[:, 3:] = 1
    instrument[3, 2:] = -1
    instrument[5] = -1
    columns = rng.normal(size=(POSES, ROWS, 6))
    blocks = (
        GaussianBlock("free", columns[..., :4], rng.normal(size=(4, 3)), rng.normal(size=4), None),
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


def simple_design(
    levers: Array, group: IntArray, J: Array, r: Array, kind: str = "joint"
) -> Design:
    """One instrument, one effect, no block."""
    effect = RandomEffect("effect", levers, kind, group)
    instrument = np.zeros(r.shape, dtype=int)
    return Design(r, J, np.eye(J.shape[-1]), (), (effect,), instrument)


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
        free = [d.blocks[g] for g in d.free_blocks]
        return found + [self._spread(block) for block in free]

    def _spread(self, block: GaussianBlock) -> Array:
        X = self.design.flat(block.columns @ block.root)
        return X @ X.T

    @property
    def noise(self) -> Array:
        count = self.design.instruments
        return sum(t * V for t, V in zip(self.theta[:count], self.parts[:count], strict=True))

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

    @property
    def variances(self) -> Variances:
        return self.design.variances(self.theta)
