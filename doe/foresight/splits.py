"""What would tell twins apart: the same plan, measured in another way.

No list says which cause has which remedy: each way is tried on the plan, and the twins compared again.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from calib.arm.robot import Robot
from calib.arrays import Array
from calib.diagnosis.alike import likeness
from calib.effects.base import Base
from calib.errors import CalibError
from calib.model.build import build
from calib.poses import Poses
from calib.poses.moves import with_moves
from calib.threads import one_blas_thread
from doe.foresight.foresee import Foresight
from doe.foresight.sight import sight_of
from doe.foresight.view import View, linearised
from doe.problem.nominal import soft

_WORTH = 5.0  # times its smallest size at which a cause must be told apart for a way to be named
_PULL = 200.0  # N
_ASIDE = np.array(
    [2.0, -1.0, 0.0, 0.0, 0.0, 1.5]
)  # second station: m and rad, well aside and turned
_SWING = 5.0  # K


def _ways(poses: Poses, robot: Robot) -> Iterator[tuple[str, Poses]]:
    """The same readings measured otherwise, each way with its name."""
    rng = np.random.default_rng(0)
    low, high = robot.sample_limits().T
    q = rng.uniform(low, high, (int(poses.configuration.max()) + 1, robot.dof))
    yield "other poses", with_moves(replace(poses, q=q[poses.configuration]))
    turn, pull = rng.uniform(0.0, 2.0 * np.pi, len(poses)), np.zeros((len(poses), 6))
    pull[:, 0], pull[:, 1] = _PULL * np.cos(turn), _PULL * np.sin(turn)
    yield "a sideways pull at the tool", replace(poses, wrench=poses.wrench + pull)
    there = (poses.configuration % 2).astype(int)
    two = replace(poses, station=there, stations=("first", "second"))
    yield "every second configuration read from a second station", two
    if poses.temperature is not None:
        swing = poses.temperature + rng.uniform(-_SWING, _SWING, len(poses))
        yield "a temperature that rises and falls", replace(poses, temperature=swing)


@one_blas_thread
def splits(found: Foresight) -> tuple[tuple[str, ...], ...]:
    """Ways by which each group of twins would be told apart, none where none of them does.

    A way counts if every two of the group are told apart from five times their smallest size on.
    """
    groups, view = found.twins, found.view
    named: list[list[str]] = [[] for _ in groups]
    for name, poses in _ways(view.data.poses, view.cell.robot) if groups else ():
        other = _measured(view, poses)
        for group, remedies in zip(groups, named, strict=True):
            keys = [found.seen[i].key for i in group]
            if other is not None and _worst_times(other, keys) < _WORTH:
                remedies.append(name)
    return tuple(map(tuple, named))


def _measured(view: View, poses: Poses) -> View | None:
    """The view of other readings in the same cell; None where the model cannot be built for them."""
    try:
        model = build(view.cell, poses).model
    except CalibError:
        return None
    values = soft(model, poses)
    for effect, part in zip(model.effects, model.slices, strict=True):
        if isinstance(effect, Base) and effect.station:
            values[part] = _ASIDE
    return linearised(view.cell, model, replace(view.data, poses=poses), values)


def _worst_times(view: View, keys: list[str]) -> float:
    """Multiple of its smallest size from which on the worst of a group is told from the others."""
    by_key = {candidate.key: i for i, candidate in enumerate(view.suspects)}
    positions = [by_key[key] for key in keys if key in by_key]
    sights = [sight_of(view, i) for i in positions]
    if len(sights) < len(keys) or not all(sight.directions for sight in sights):
        return np.inf
    alike = likeness(view.field, [view.columns[i] for i in positions], [s.sizes for s in sights])
    ratio: Array = alike.needed() / np.array([s.needed for s in sights])[:, None]
    np.fill_diagonal(ratio, 0.0)
    return float(np.sqrt(ratio.max()))
