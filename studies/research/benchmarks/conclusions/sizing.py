"""Sizes by noncentrality: how far a cause stands out of noise, arm and free parameters."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from studies.research.benchmarks.conclusions.true_causes import TrueCause
from studies.research.withheld.actions import State
from studies.research.withheld.robots import Array
from studies.research.withheld.scene import Scene
from studies.research.withheld.truth import Mechanism
from studies.research.withheld.visible import Projector, at_rest

NONCENTRALITY = (60.0, 3000.0)
VISIBLE = 60.0
_ROUNDS = 4
_NEAR = 0.01


class NoSuchDay(Exception):
    """A cause that would have to be absurdly large to be seen."""


class Visibility:
    """Of causes on one day."""

    def __init__(self, scene: Scene, mechanism: Mechanism, still: State) -> None:
        self._scene, self._mechanism, self._still = scene, mechanism, still
        seen = np.ones(still.readings.shape[:2], dtype=bool)
        self._projector = Projector(scene, still, seen)

    def moved(self, causes: Sequence[TrueCause]) -> Array:
        """Displacement of the readings by some causes, shape (N, M, 3), m."""
        try:
            state = at_rest(self._scene, self._mechanism, causes)
        except RuntimeError as error:
            raise NoSuchDay from error
        return np.asarray(state.readings - self._still.readings)

    def alone(self, cause: TrueCause) -> float:
        """Noncentrality of one cause."""
        rest = self._projector.left(self.moved([cause]))
        return float(rest @ rest)

    def beside(self, causes: Sequence[TrueCause]) -> list[float]:
        """Noncentrality of each where the sizes of all others are free."""
        rests = np.array([self._projector.left(self.moved([cause])) for cause in causes])
        return [_left(rests[i], np.delete(rests, i, axis=0)) for i in range(len(rests))]

    def sized(self, cause: TrueCause, wanted: float) -> TrueCause:
        """A cause of a noncentrality. Raises NoSuchDay."""
        return self.all_sized([cause], wanted)[0]

    def all_sized(self, causes: Sequence[TrueCause], wanted: float) -> list[TrueCause]:
        """Causes scaled alike until all together have a noncentrality. Raises NoSuchDay."""
        found = list(causes)
        for _ in range(_ROUNDS):
            moved = self.moved(found)
            rest = self._projector.left(moved)
            factor = float(np.sqrt(wanted / max(float(rest @ rest), 1e-12)))
            size = float(np.sqrt(np.mean(np.sum(moved**2, axis=-1))))
            if factor * size > self._scene.arm.largest:
                raise NoSuchDay
            if abs(factor - 1.0) < _NEAR:
                return found
            found = [one.sized(factor) for one in found]
        raise NoSuchDay


def drawn_noncentrality(
    rng: np.random.Generator, within: tuple[float, float] = NONCENTRALITY
) -> float:
    """Evenly in its logarithm."""
    return float(np.exp(rng.uniform(*np.log(within))))


def _left(rest: Array, others: Array) -> float:
    if len(others):
        rest = rest - others.T @ np.linalg.lstsq(others.T, rest, rcond=None)[0]
    return float(rest @ rest)
