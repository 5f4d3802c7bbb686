"""task: accuracy at the target poses."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Self

import numpy as np

from calib.arrays import Array, stacked
from calib.errors import CalibError
from doe.criteria.protocol import Criterion, Question
from doe.criteria.trace import Trace

_UNNEEDED = 1e-7  # share of the mean that every direction counts, needed at the targets or not


@dataclass(frozen=True, eq=False)
class Task(Trace):
    """Expected squared position error after compensation, averaged over the target poses.

    This is the test-pose criterion ``rho_0^2 = tr(J_0 cov J_0^T)`` (Wu, Klimchik, Caro, Furet and
    Pashkevich, 2012), shown as its root in mm. Parameter directions that the targets do not need count
    too, with a ten-millionth of the mean. Of equal plans the one that determines them is then better.
    Without this, a single target is best measured at itself, with a singular M.

    without : Task without that share, by which plans are judged
    """

    without: Task | None = None
    name: ClassVar[str] = "task"
    unit: ClassVar[str] = "mm RMS at the targets"

    @property
    def whole(self) -> bool:
        return True

    @classmethod
    def of(cls, question: Question) -> Self:
        rows = question.targets() * np.sqrt(question.target_weights)[:, None, None]
        if not rows.any():
            raise CalibError(
                "nothing in the model moves the targets, so that every plan is as good there; add "
                "effects to [model] effects, or take another criterion"
            )
        return cls.of_rows(stacked(rows))

    @classmethod
    def of_rows(cls, rows: Array) -> Self:
        """The criterion ``tr(rows cov rows^T)``, rows : ndarray, shape (k, p), m per y.

        Where they are nothing all directions count alike.
        """
        p = rows.shape[1]
        least = np.sqrt(_UNNEEDED * (rows**2).sum() / p) or 1.0
        return cls(
            _root(np.vstack([rows, least * np.eye(p)])), cls(_root(rows)) if rows.any() else None
        )

    @property
    def plain(self) -> Criterion:
        return self if self.without is None else self.without

    def shown(self, value: float) -> float:
        return 1e3 / float(np.sqrt(value))


def _root(rows: Array) -> Array:
    """F of as few columns as can be with ``F F^T = rows^T rows``."""
    _, singular, Vt = np.linalg.svd(rows, full_matrices=False)
    kept = singular > 1e-12 * singular[0]
    return np.asarray(Vt[kept].T * singular[kept])
