"""How visible each of many causes is beside the model and all the others."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.linalg import qr

from studies.research.withheld.actions import State
from studies.research.withheld.causes import Cause
from studies.research.withheld.outside import OUTSIDE
from studies.research.withheld.real.beyond import BEYOND
from studies.research.withheld.real.effects import TUNED
from studies.research.withheld.robots import Array
from studies.research.withheld.scene import Scene
from studies.research.withheld.truth import Mechanism
from studies.research.withheld.visible import Projector, at_rest

_SAME = 1e-3  # relative size of a diagonal of R below which a column is a sum of others


def tangents(scene: Scene, mechanism: Mechanism, still: State, cause: Cause) -> Array:
    """What each linear parameter of a cause moves alone, (N, M, 3, parameters), m, instrument frame.

    By differences of the simulator at the true size; cycles, time constants and moments stand at
    their true values.
    """
    if cause.effect in BEYOND or cause.effect in OUTSIDE:  # of which nobody fits a parameter
        return (at_rest(scene, mechanism, [cause]).readings - still.readings)[..., None]
    names = [name for name in cause.values if name not in TUNED]
    tuned = {name: value for name, value in cause.values.items() if name in TUNED}

    def moved(values: dict[str, float]) -> Array:
        one = Cause(cause.effect, cause.where, {**dict.fromkeys(names, 0.0), **values, **tuned})
        bent = at_rest(scene, mechanism, [one.sized(cause.size)])
        return np.asarray(bent.readings - still.readings)

    return np.stack([moved({name: cause.values[name]}) for name in names], axis=-1)


def projected(projector: Projector, columns: Array) -> Array:
    """Columns (N, M, 3, p) whitened and beside the model, shape (3 * points, p)."""
    return np.stack([projector.left(column) for column in np.moveaxis(columns, -1, 0)], axis=1)


def beside_others(rests: Sequence[Array], spans: Sequence[Array]) -> tuple[float, ...]:
    """Noncentrality of each displacement beside all that the others' parameters could do.

    rests : ndarrays, shape (P,), whitened and projected; spans : of each cause, shape (P, parameters)
    """
    found = []
    for i, rest in enumerate(rests):
        others = [span for k, span in enumerate(spans) if k != i]
        left = rest - _within(np.hstack(others), rest) if others else rest
        found.append(float(left @ left))
    return tuple(found)


def _within(columns: Array, rest: Array) -> Array:
    """Part of a displacement that lies in the span of columns."""
    lengths = np.linalg.norm(columns, axis=0)
    kept = columns[:, lengths > 0.0] / lengths[lengths > 0.0]
    if not kept.size:
        return np.zeros_like(rest)
    Q, R, _ = qr(kept, mode="economic", pivoting=True)
    Q = Q[:, np.abs(np.diag(R)) > _SAME]
    return np.asarray(Q @ (Q.T @ rest))
