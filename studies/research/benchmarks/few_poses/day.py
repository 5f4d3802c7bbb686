"""A day's arm and readings in plain NumPy, the user's files, and estimators beside posecal's."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

import calib
from calib.arrays import Array, IntArray
from calib.effects.base import Base
from calib.effects.tool import Tool
from calib.identification.start import initial_values
from calib.model import Model
from calib.poses import Measurements, poses_at
from studies.research.bench import cell_from, rms_3d
from studies.research.benchmarks.day import cell_text, placement, reflectors
from studies.research.withheld.robots import Arm
from studies.research.withheld.truth import tip_in_numpy, urdf

SIGMA = 15e-6  # m, of one coordinate of the instrument
READ, HELD = 40, 200  # poses
SCATTER = (20e-6, 20e-6)  # m and rad, of one coordinate of an ordinary arm's tip
_LENGTHS, _ANGLES = (0.3e-3, 1e-3), (0.2e-3, 1e-3)  # m, rad: deviations of one arm's usual errors
_GUESS = 2e-3  # m, by which a coordinate of a marker is guessed wrongly


@dataclass(frozen=True)
class Setting:
    """times : size of the errors, 1 usual; markers : how many; scatters : whether the arm does."""

    times: float
    markers: int
    scatters: bool


@dataclass(frozen=True, eq=False)
class Day:
    """One arm and what was read of it.

    constants : ndarray, shape (n + 2, 6), m and rad, errors of base, of segments up to joints, of tip
    markers, guesses : ndarray, shape (M, 3), m, true and as the cell has them
    R, p : placement of the base in the instrument's frame
    q, held : ndarray, shape (40, n) and (200, n), rad or m; read : ndarray, shape (40, M, 3), m
    """

    arm: Arm
    constants: Array
    markers: Array
    guesses: Array
    R: Array
    p: Array
    q: Array
    held: Array
    read: Array

    def points(self, q: Array) -> Array:
        """Where the markers stand at joints (N, n), shape (N, M, 3), m, in the instrument's frame."""
        return _placed(*tip_in_numpy(self.arm, q, self.constants), self.markers, self.R, self.p)


def draw_day(arm: Arm, setting: Setting, index: int, seed: int) -> Day:
    """One day; of one index the errors of all sizes are the same but for their size."""
    rng = np.random.default_rng([seed, index, arm.dof])
    sizes = [np.exp(rng.uniform(*np.log(ends))) for ends in (_LENGTHS, _ANGLES)]
    constants = setting.times * rng.normal(size=(arm.dof + 1, 6)) * np.repeat(sizes, 3)
    constants = np.vstack([np.zeros(6), constants])
    guesses = reflectors(rng, arm, setting.markers)
    markers = guesses + rng.normal(size=guesses.shape) * _GUESS
    placed = placement(rng)
    low, high = arm.limits.T
    q, held = (low + rng.random((count, arm.dof)) * (high - low) for count in (READ, HELD))
    R, p = tip_in_numpy(arm, q, constants)
    if setting.scatters:
        shift, turn = (rng.normal(size=(READ, 3)) * size for size in SCATTER)
        p = p + (R @ shift[..., None])[..., 0]
        R = R @ Rotation.from_rotvec(turn).as_matrix()
    stood = _placed(R, p, markers, *placed)
    read = stood + rng.normal(size=stood.shape) * SIGMA
    return Day(arm, constants, markers, guesses, *placed, q, held, read)


def _placed(R: Array, p: Array, markers: Array, R_in: Array, p_in: Array) -> Array:
    points = np.einsum("nij,mj->nmi", R, markers) + p[:, None]
    return np.asarray(points @ R_in.T + p_in)


DEFAULT, OFF = "posecal", "posecal, off"


def cells_of(day: Day) -> dict[str, calib.Cell]:
    """Ways of posecal: by default, and without the usual sizes of errors."""
    return {DEFAULT: read_cell(day), OFF: read_cell(day, 'size_prior = "off"')}


def read_cell(day: Day, more: str = "") -> calib.Cell:
    """The cell of a day; more : a line of its [model]."""
    text = cell_text("few poses", day.arm, day.guesses, SIGMA, model=[more])
    return cell_from(text, urdf(day.arm, masses=False))


def table_of(q: Array, points: Array) -> Measurements:
    """Points (m, M, 3), m, read at joints (m, n), as a table holds them."""
    shape = points.shape[:-1]
    return Measurements(poses_at(q), points, np.ones(shape, dtype=bool), np.full(shape, np.nan))


FOLDS = 10
_UNIT = 1e-3  # m and rad
_PENALTIES = 1.0 / np.logspace(-2.5, 3.0, 45) ** 2  # of squared units, in squared units of the rows
_ROUNDS, _CHOICES = 20, 4  # linearisations, and those at which the penalty is chosen anew
_SETTLED = 1e-12  # m and rad


def ridge(model: Model, data: Measurements, sigma: float, rng: np.random.Generator) -> Array:
    """Values of the parameters, shape (p,), SI; sigma : m, by which rows are divided."""
    folds = np.array_split(rng.permutation(len(data)), min(FOLDS, len(data)))
    return _solved(model, data, sigma, folds)


def exact_values(model: Model, data: Measurements) -> tuple[Array, float]:
    """Values without any penalty, and the RMS of what they leave, m."""
    values = _solved(model, data, 1.0, None)
    return values, rms_3d(model.off(values, data))


def _solved(model: Model, data: Measurements, sigma: float, folds: list[IntArray] | None) -> Array:
    """From the readings' own first values on, until a step moves nothing."""
    values = initial_values(model, data)
    placed = np.zeros(len(values), dtype=bool)
    placed[model.where(Base, Tool)] = True
    penalties = np.zeros(1)
    for count in range(_ROUNDS):
        predicted, J = model.jacobian(values, data.poses)
        own = np.where(placed, 0.0, values)
        y = (data.readings - predicted + J @ own) / sigma
        # Poses first, so that a fold takes its rows with it.
        A, B = J[..., placed] / sigma, J[..., ~placed] * (_UNIT / sigma)
        if folds is not None and count < _CHOICES:
            penalties = _PENALTIES[[int(np.argmin(_unseen(A, B, y, folds)))]]
        step, sizes = (found[0] for found in _fits(A, B, y, penalties))
        new = values.copy()
        new[placed] += step
        new[~placed] = _UNIT * sizes
        moved, values = np.abs(new - values).max(), new
        if moved < _SETTLED and count >= _CHOICES:
            break
    return values


def _unseen(A: Array, B: Array, y: Array, folds: list[IntArray]) -> Array:
    """Squares that folds which took no part leave under each penalty, shape (k,)."""
    total = np.zeros(len(_PENALTIES))
    for fold in folds:
        kept = np.setdiff1d(np.arange(len(y)), fold)
        step, sizes = _fits(A[kept], B[kept], y[kept], _PENALTIES)
        off = y[fold] - np.moveaxis(A[fold] @ step.T + B[fold] @ sizes.T, -1, 0)
        total += (off**2).sum(axis=(1, 2, 3))
    return total


def _fits(A: Array, B: Array, y: Array, penalties: Array) -> tuple[Array, Array]:
    """Free values (k, a) and penalised ones (k, b) that fit y, one row a penalty."""
    A, B, y = A.reshape(-1, A.shape[-1]), B.reshape(-1, B.shape[-1]), y.ravel()
    free = np.linalg.qr(A)[0]
    U, s, Vt = np.linalg.svd(B - free @ (free.T @ B), full_matrices=False)
    gain = s / (s**2 + np.where(s > 0.0, penalties[:, None], 1.0))
    sizes = (gain * (U.T @ (y - free @ (free.T @ y)))) @ Vt
    rest = y[:, None] - B @ sizes.T
    return np.linalg.lstsq(A, rest, rcond=None)[0].T, sizes
