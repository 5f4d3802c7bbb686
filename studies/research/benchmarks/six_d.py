"""Approach #1 where it is real: a 6-D probe's poses, with what is stated of them, against its points.

    python -m studies.research.benchmarks.six_d [--poses 30] [--refits 60]

A probe of four points on the KR 270 of the demo, read by a tracker. Approach #2 takes the points as
they are read. Approach #1 takes what the probe gives out: the pose that fits its known shape best,
with one covariance for all poses, as a data sheet states it (one figure for position, one for
rotation), or the mean of the true ones. Last, what would be foreseen if each pose came with the
covariance that it has: a cell cannot say that. Claimed is what an identification says by the
covariance stated, foreseen what follows to first order from how the points err, simulated how
identifications scatter: standard deviations of the arm's parameters over those foreseen of #2, in the
geometric mean.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

import calib
import doe
from calib.arrays import Array
from calib.instruments import Pose
from calib.model import Model
from calib.poses import Measurements, Poses
from studies.compare.experiment import POINTS, experiment_of
from studies.compare.prediction import predict
from studies.demo.embedded import embedded_text
from studies.research.bench import Output, bench, cell_from, count, table
from studies.research.benchmarks.planned_days import HEAD, LIMITS, Arm

PROBE = (
    np.array([[60.0, 0.0, 0.0], [-40.0, 55.0, 0.0], [-40.0, -55.0, 0.0], [0.0, 0.0, 45.0]]) * 1e-3
)
_ALONG, _ACROSS, _PER_METRE = 10e-6, 15e-6, 6e-6  # m, of a point: an absolute tracker's typical
_AT = np.array([0.2792, -0.0164, -0.0919])  # of the probe on the tip, m
_STANDS = np.array([4.0, -1.0, 1.2])  # the tracker, base axes, m
_POLAR = "{ range_mm = 0.010, transverse_mm = 0.015, transverse_mm_per_m = 0.006 }"


@dataclass(frozen=True, eq=False)
class Read:
    """Days of one plan: points (days, m, 4, 3), m, and how those of a day err, (m, 12, 12), m^2."""

    points: Array
    covariance: Array

    def poses(self) -> tuple[Array, Array]:
        """What the probe gives out: R (days, m, 3, 3) and p (days, m, 3)."""
        return posed(self.points)


def posed(points: Array) -> tuple[Array, Array]:
    """The pose at which the probe's shape fits points (..., 4, 3) best (Kabsch, 1976)."""
    middle, own = points.mean(axis=-2), PROBE - PROBE.mean(axis=0)
    U, _, Vt = np.linalg.svd(np.swapaxes(points - middle[..., None, :], -1, -2) @ own)
    R = U @ (np.array([1.0, 1.0, 0.0])[:, None] * Vt)
    R = R + (np.linalg.det(U @ Vt)[..., None] * U[..., 2])[..., None] * Vt[..., 2:, :]
    return R, middle - R @ PROBE.mean(axis=0)


def errors_of(points: Array, covariance: Array) -> Array:
    """Covariance (m, 6, 6) of such poses in the probe's axes, by differences.

    points : ndarray, shape (m, 4, 3), m; covariance : ndarray, shape (m, 12, 12), m^2
    """
    R, p = posed(points)
    columns = []
    for moved in 1e-6 * np.eye(12).reshape(12, 4, 3):
        R_there, p_there = posed(points + moved)
        turn = np.swapaxes(R, -1, -2) @ R_there
        spin = 0.5 * np.stack(
            [
                turn[:, 2, 1] - turn[:, 1, 2],
                turn[:, 0, 2] - turn[:, 2, 0],
                turn[:, 1, 0] - turn[:, 0, 1],
            ],
            axis=-1,
        )
        shift = np.einsum("mji,mj->mi", R, p_there - p)
        columns.append(np.concatenate([shift, spin], axis=-1) / 1e-6)
    L = np.stack(columns, axis=-1)
    return np.asarray(L @ covariance @ np.swapaxes(L, -1, -2))


def read(arm: Arm, q: Array, days: int, rng: np.random.Generator) -> Read:
    """Points of the probe in base axes, with noise along and across the beams."""
    exact = arm.points(q, _AT + PROBE)
    beams = exact - _STANDS
    away = np.sqrt((beams**2).sum(axis=-1))
    along = beams / away[..., None]
    across = _ACROSS + _PER_METRE * away
    half = across[..., None, None] * np.eye(3)
    half = half + (_ALONG - across)[..., None, None] * along[..., :, None] * along[..., None, :]
    noise = np.einsum("mjab,dmjb->dmja", half, rng.normal(size=(days, *exact.shape)))
    covariance = np.zeros((len(q), 12, 12))
    for j in range(len(PROBE)):
        own = slice(3 * j, 3 * j + 3)
        covariance[:, own, own] = half[:, j] @ half[:, j]
    return Read(exact + noise, covariance)


def cell_of(text: str) -> calib.Cell:
    """The arm with an instrument."""
    return cell_from(HEAD.format(LIMITS) + text, embedded_text("kr270.urdf"))


def point_cell() -> calib.Cell:
    """Approach #2."""
    listed = "\n".join(f"m{k} = {(1e3 * (_AT + p)).tolist()}" for k, p in enumerate(PROBE))
    stands = f"position_mm = {(1e3 * _STANDS).tolist()}\n"
    tracker = f'[instruments.tracker]\nkind = "points"\nsigma_mm = {_POLAR}\n{stands}'
    return cell_of(f"[markers_mm]\n{listed}\n{tracker}")


def pose_cell(stated: Array) -> calib.Cell:
    """Approach #1, with a covariance (6, 6), m and rad, stated of all poses."""
    units = np.repeat([1e3, 1e6], 3)
    listed = (stated * np.outer(units, units)).tolist()
    body = f"[bodies.probe]\nposition_mm = {(1e3 * _AT).tolist()}\n"
    return cell_of(f'{body}[instruments.probe]\nkind = "pose"\ncovariance = {listed}\n')


def pose_rows(poses: tuple[Array, Array]) -> Array:
    """Rows (..., 1, 9) of readings of kind pose: origin, and the x and y axes."""
    R, p = poses
    return np.concatenate([p, R[..., 0], R[..., 1]], axis=-1)[..., None, :]


@dataclass(frozen=True, eq=False)
class Result:
    """Standard deviations of the arm's parameters, (k,), SI: claimed, foreseen, and of the scatter."""

    ids: tuple[str, ...]
    claimed: Array
    foreseen: Array
    simulated: Array

    def over(self, other: Result) -> tuple[float, float, float]:
        """Each over what is foreseen of another, in the geometric mean of the parameters of both."""
        own = [self.ids.index(name) for name in self.ids if name in other.ids]
        theirs = other.foreseen[[other.ids.index(self.ids[k]) for k in own]]
        rows = (self.claimed[own], self.foreseen[own], self.simulated[own])
        a, b, c = (float(np.exp(np.log(row / theirs).mean())) for row in rows)
        return a, b, c


def weighed_each(cell: calib.Cell, plan: Poses, errors: Array) -> Result:
    """What would be foreseen if every pose came with the covariance (m, 6, 6) that it has."""
    experiment = experiment_of(cell, plan)
    weights = experiment.weights.copy()
    own = np.linalg.inv(np.linalg.cholesky(errors)) @ _stated(cell)
    weights[:, 0, :6] = own @ weights[:, 0, :6]
    std = predict(replace(experiment, weights=weights), POINTS).std
    ids, kept = _of_arm(experiment.model)
    unknown = np.full(len(kept), np.nan)
    return Result(ids, std[kept], std[kept], unknown)


def _stated(cell: calib.Cell) -> Array:
    """Half (6, 6) of the covariance that a cell states of a pose."""
    probe = next(i for i in cell.instruments if isinstance(i, Pose))
    return np.asarray(np.linalg.cholesky(probe.covariance))


def _of_arm(model: Model) -> tuple[tuple[str, ...], list[int]]:
    own = [(p.id, k) for k, p in enumerate(model.parameters) if p.effect not in ("base", "tool")]
    return tuple(name for name, _ in own), [k for _, k in own]


def judged(cell: calib.Cell, plan: Poses, days: Array, errors: Array | None) -> Result:
    """What a cell makes of days of readings (days, m, C, r).

    errors : ndarray, shape (m, 6, 6), m and rad, how its poses truly err; None where noise is as stated
    """
    experiment = experiment_of(cell, plan)
    found = predict(experiment, POINTS)
    cov = found.covariance
    if errors is not None:
        observation, start = experiment.observe(
            POINTS, experiment.model.predict(experiment.truth, experiment.poses)
        )
        gains = observation.gains(start, found.span)[:, :6]
        white = np.linalg.inv(_stated(cell)) @ errors @ np.linalg.inv(_stated(cell)).T
        cov = np.einsum("mrp,mrs,msq->pq", gains, white, gains, optimize=True)
    estimates = []
    for rows in days:
        unstated = np.full(rows.shape[:-1], np.nan)
        data = Measurements(plan, rows, np.ones(rows.shape[:-1], dtype=bool), unstated)
        estimates.append(calib.identify(cell, data).values)
    ids, kept = _of_arm(experiment.model)
    scatter = np.std(estimates, axis=0, ddof=1)
    root = np.sqrt(np.diag(cov))
    return Result(ids, found.std[kept], root[kept], scatter[kept])


@bench(count("--poses", 30, least=15), count("--refits", 60, least=10))
def main(poses: int, refits: int, seed: int) -> Output:
    """Identify the same days from points and from poses."""
    del seed
    cell, rng = point_cell(), np.random.default_rng(0)
    plan = doe.design(cell, poses=poses, criterion="D", candidates=1000, reapproach=0).poses
    off = 2e-4 * rng.normal(size=(6, 6))
    days = read(Arm(cell.robot, off), plan.q, refits, rng)
    errors = errors_of(days.points[0], days.covariance)
    mean = errors.mean(axis=0)
    sheet = np.diag(np.repeat([np.trace(mean[:3, :3]) / 3.0, np.trace(mean[3:, 3:]) / 3.0], 3))
    rows = pose_rows(days.poses())
    points = judged(cell, plan, days.points, None)
    results = {
        "#2: four points": points,
        "#1: poses, covariance of a data sheet": judged(pose_cell(sheet), plan, rows, errors),
        "#1: poses, mean covariance in full": judged(pose_cell(mean), plan, rows, errors),
        "#1: poses, each with its own": weighed_each(pose_cell(mean), plan, errors),
    }
    told = []
    for name, result in results.items():
        shown = (f"{x:.3f}" if np.isfinite(x) else "" for x in result.over(points))
        row = zip(("claimed", "foreseen", "simulated"), shown, strict=True)
        told.append({"what enters": name, **dict(row)})
    position, rotation = np.sqrt(sheet[0, 0]) * 1e3, np.sqrt(sheet[3, 3]) * 1e6
    stated = f"data sheet: {position:.4f} mm and {rotation:.0f} urad, one standard deviation"
    return [table(told), stated], told


if __name__ == "__main__":
    main()
