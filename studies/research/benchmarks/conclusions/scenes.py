"""Scene of a day: an arm that is rigid, its errors of geometry, an hour or two of readings."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from studies.research.benchmarks.placement import placement
from studies.research.withheld.actions import State
from studies.research.withheld.noise import Noise
from studies.research.withheld.robots import Arm, Array
from studies.research.withheld.scatter import Scatter, scatter_of
from studies.research.withheld.scene import Scene
from studies.research.withheld.session import Session, approaches

ALL_COLUMNS = frozenset({"time", "temperature", "approach"})
_GEOMETRY = np.repeat([3e-4, 4e-4], 3)  # m and rad, standard deviations of the errors of a frame
_GUESS = 1e-3  # m, by which a coordinate of a marker is guessed wrongly
_PACE = (80.0, 140.0)  # s from reading to reading


def random_poses(rng: np.random.Generator, arm: Arm, count: int, share: float = 1.0) -> Array:
    """Joints anywhere in a share of their ranges, shape (count, n), rad or m."""
    low, high = arm.limits.T
    start = low + rng.random(arm.dof) * (1.0 - share) * (high - low)
    return as_shown(arm, start + rng.random((count, arm.dof)) * share * (high - low))


def as_shown(arm: Arm, q: Array) -> Array:
    """Rounded as the files show them, 1e-6 deg or mm."""
    unit = np.where(arm.slides, 1e-3, np.pi / 180.0)
    return np.asarray(np.round(q / unit, 6) * unit)


def reflectors(rng: np.random.Generator, arm: Arm, count: int = 3) -> Array:
    """About the tool at uneven heights, m, as the cell shows them, shape (count, 3)."""
    turn = rng.uniform(0, 2 * np.pi) + np.arange(count) * 2 * np.pi / count
    across = np.stack([np.cos(turn), np.sin(turn)], axis=1) * rng.uniform(0.4, 0.7)
    along = rng.uniform(0.5, 1.1, (count, 1))
    return np.asarray(np.round(np.hstack([across, along]) * arm.tool, 4))


def scene_of(
    rng: np.random.Generator,
    arm: Arm,
    q: Array,
    guesses: Array,
    *,
    sigma: float,
    columns: frozenset[str] = ALL_COLUMNS,
    geometry: Array | None = None,
    weighs: bool = True,
) -> Scene:
    """The arm on its day; base, markers and, where it is not given, geometry are drawn."""
    R, p = placement(rng)
    if geometry is None:
        geometry = rng.normal(size=(arm.dof + 2, 6)) * _GEOMETRY
        geometry[0] = 0.0
    turning = [joint.name for joint in arm.joints if not joint.slides]
    return Scene(
        arm=arm,
        session=_session(rng, q),
        geometry=geometry,
        markers=guesses + rng.normal(size=guesses.shape) * _GUESS,
        guesses=guesses,
        compliance=np.zeros(arm.dof),
        modelled=(),
        known_geometry=False,
        weighs=weighs,
        payload=0.0,
        com=np.zeros(3),
        columns=columns,
        knots={},
        noise=Noise.uniform(sigma),
        believed=Noise.uniform(sigma),
        R=R,
        p=p,
        wrench=np.zeros((len(q), 6)),
        ratios={name: int(rng.integers(50, 161)) for name in turning},
    )


def scattering(
    rng: np.random.Generator, scene: Scene, still: State, size: float, in_joints: bool
) -> Scene:
    """The same with an arm that scatters at each approach; size : m, of one coordinate of its tip."""
    if size == 0.0:
        return scene
    shape = scatter_of(rng, scene.arm, still, in_joints)
    factor = size / shape.repeatability(scene.arm, still)[0]
    return with_scatter(scene, shape.times(factor))


def with_scatter(scene: Scene, scatter: Scatter) -> Scene:
    """The same with a scatter that is given."""
    return replace(scene, scatter=scatter)


def _session(rng: np.random.Generator, q: Array) -> Session:
    N = len(q)
    time = np.cumsum(rng.uniform(*_PACE, N)).round(1)
    approach, motion = approaches(rng, q, known_start=True)
    nothing_held: NDArray[np.bool_] = np.zeros(N, dtype=bool)
    return Session(
        names=tuple(f"p{i:03d}" for i in range(N)),
        q=q,
        held=nothing_held,
        force=np.zeros((N, 3)),
        hang=np.zeros(3),
        time=time,
        temperature=_temperature(rng, time),
        approach=approach,
        motion=motion,
    )


def _temperature(rng: np.random.Generator, time: Array) -> Array:
    """A hall in the course of a morning: a swing of some hours beside a rise."""
    hours = (time - time[0]) / 3600.0
    turn = 2.0 * np.pi * (hours / rng.uniform(2.0, 4.0) + rng.random())
    swing, rise = rng.uniform(2.0, 4.0), rng.uniform(-1.0, 1.0)
    return np.asarray(np.round(rng.uniform(19.0, 23.0) + swing * np.sin(turn) + rise * hours, 3))
