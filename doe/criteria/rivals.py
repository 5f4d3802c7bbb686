"""T-optimality: poses that separate two effects."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar, Self

import numpy as np

from calib.arrays import Array
from calib.errors import CalibError
from doe.criteria.protocol import Conic, Question, solved
from doe.criteria.smallest import Smallest


@dataclass(frozen=True, eq=False)
class Rivals(Smallest):
    """Two effects are separated, whichever of them is the true one.

    Each effect in turn is taken as true, with its usual size, and everything else is fitted, the rival
    included. The residual that remains is ``delta^T K delta``, in noise variances, where K is the Schur
    complement of M (T-optimality of Atkinson and Fedorov, Biometrika 62(1), 1975, for linear rivals).

    V : tuple of two ndarray, shape (s_k, p), the parameters of either effect in plausible sizes
    """

    V: tuple[Array, Array]

    @property
    def whole(self) -> bool:
        return False

    name: ClassVar[str] = "discriminate"
    unit: ClassVar[str] = "squared residual of the worse rival, in noise variances"
    larger_is_better: ClassVar[bool] = True

    @classmethod
    def of(cls, question: Question) -> Self:
        if question.rivals is None:
            raise CalibError("two rival effects are needed; name those to discriminate")
        first, second = (question.sized[rows] for rows in question.rivals)
        return cls((first, second))

    def _directions(self, M: Array) -> list[Array]:
        """``M^-1 V^T K delta`` of both, shape (..., p, 1); delta is one size of every parameter."""
        found: list[Array] = []
        for V in self.V:
            W = solved(M, V.T)
            delta = np.full((len(V), 1), len(V) ** -0.5)
            found.append(np.asarray(W @ solved(V @ W, delta)))
        return found

    def members(self, M: Array) -> Array:
        values = [np.swapaxes(d, -1, -2) @ M @ d for d in self._directions(M)]
        return np.concatenate(values, axis=-1)[..., 0, :]

    def member_gradient(self, M: Array, weights: Array) -> Array:
        first, second = self._directions(M)
        return np.asarray(weights[0] * first @ first.T + weights[1] * second @ second.T)

    def conic(self, M: Any, at: Array) -> Conic:
        import cvxpy as cp

        smallest = cp.Variable()
        scale = max(float((V**2).sum()) for V in self.V)
        above, rest = [], []
        for V in self.V:
            K = cp.Variable((len(V), len(V)), symmetric=True)
            above.append(cp.sum(K) / len(V) >= smallest)
            rest.append(M - V.T @ K @ V / scale >> 0)

        def witness() -> Array:
            weights = np.maximum([float(c.dual_value) for c in above], 0.0)
            return self.member_gradient(M.value, weights / weights.sum())

        return Conic(smallest, [*above, *rest], witness)
