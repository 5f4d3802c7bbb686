"""Choose the motions to log, and prove how good the choice is."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from calib.arrays import Array
from calib.cell import Cell
from calib.errors import CalibError, InputError
from calib.threads import one_blas_thread
from doe.criteria import UNASKED
from doe.criteria.determinant import Determinant
from doe.criteria.protocol import Criterion
from doe.criteria.smallest import Rivals, SmallestEigenvalue
from doe.criteria.trace import Average, Combination
from doe.motions.draw import Motion, drawn
from doe.motions.information import USUAL, Information, TorqueParameter, information
from doe.optimal.allowed import Allowed
from doe.optimal.blocks import Blocks, pack
from doe.optimal.function import Selection
from doe.optimal.relax import relax
from doe.optimal.search import best_plan
from doe.problem import RIDGE

CANDIDATES, LASTS = 200, 20.0  # motions; s, of one
CRITERIA = ("D", "A", "E", "c")
_RANDOM = 100  # choices by chance, beside which the best one stands


@dataclass(frozen=True, eq=False)
class MotionDesign:
    """Result of :func:`design_motions`.

    value, bound : criterion as shown, of the chosen motions, and that no choice of the candidates beats
    efficiency : proved: at least this share of the best choice, by the information function
    random : share of the bound that motions drawn by chance reach, median
    std : ndarray, shape (p,), predicted deviations of the parameters, SI
    open : inertials that others stand for in every motion
    removed : what removed drawn motions; granted : what was taken for granted
    """

    cell: Cell
    criterion: Criterion
    motions: tuple[Motion, ...]
    value: float
    bound: float
    efficiency: float
    random: float
    parameters: tuple[TorqueParameter, ...]
    std: Array
    open: tuple[str, ...]
    candidates: int
    removed: dict[str, int]
    granted: tuple[str, ...]
    seconds: float


@one_blas_thread
def design_motions(
    cell: Cell,
    motions: int = 5,
    *,
    criterion: str = "D",
    of: Sequence[str] = (),
    discriminate: tuple[str, str] | None = None,
    candidates: int = CANDIDATES,
    seconds: float = LASTS,
    seed: int = 0,
) -> MotionDesign:
    """Choose so many motions from drawn Fourier series within the limits of the robot.

    The model is the cell's terms of the torque, or the usual ones. A ``[load]`` of the cell may be
    carried in a motion.

    discriminate : two terms to tell apart, in place of a criterion, as ``("spring:j2", "inertials")``
    of : terms that matter, ``kind`` or ``kind:where``, for A and E; for c one parameter,
        ``kind:where:name``
    seconds : of each motion

    Raises CalibError, InputError, UnknownEffect.
    """
    begun = time.perf_counter()
    if not 1 <= motions < candidates:
        raise CalibError(
            f"{motions} motions of {candidates} candidates; ask for 1 or more, and fewer"
        )
    rng = np.random.default_rng(seed)
    pool, removed, granted = drawn(cell, candidates, seconds, rng)
    if len(pool) <= motions:
        raise CalibError(f"{len(pool)} of {candidates} drawn motions keep the limits; draw more")
    found = information(cell, pool, cell.motion.effects or USUAL, discriminate or ())
    asked = _criterion(criterion if discriminate is None else UNASKED, found, of)
    posed = Selection(asked, *_in_coordinates(found.M, motions))
    best = best_plan(posed, relax(posed), seed=seed)
    plan, bound = best.plan, max(best.relaxed.bound, best.value)
    chance = [rng.choice(len(pool), motions, replace=False) for _ in range(_RANDOM)]
    sizes = np.array([own.size for own in found.parameters])
    M = found.M[plan].sum(axis=0)
    std = np.sqrt(np.diag(np.linalg.inv(M))) * sizes
    return MotionDesign(
        cell, asked, tuple(pool[i] for i in plan), asked.shown(best.value), asked.shown(bound),
        best.value / bound, float(np.median([posed.value(own) for own in chance])) / bound,
        found.parameters, std, found.open, len(pool), removed, tuple(granted),
        time.perf_counter() - begun,
    )  # fmt: skip


def _in_coordinates(M: Array, count: int) -> tuple[Blocks, Allowed]:
    """The candidates of matrices (r, p, p), and that any so many of them make a plan."""
    p = M.shape[1]
    fixed = RIDGE * float(np.trace(M.mean(axis=0))) / p * np.eye(p)
    return Blocks(pack(M), fixed, p), Allowed.any_of(len(M), count)


def _criterion(name: str, found: Information, of: Sequence[str]) -> Criterion:
    """The criterion in plausible sizes. Raises InputError."""
    every = np.eye(len(found.parameters))
    if found.rivals is not None:
        first, second = (every[own] for own in found.rivals)
        return Rivals((first, second))
    if name not in CRITERIA:
        known = ", ".join(CRITERIA)
        raise InputError("criterion", "", f"{name!r} is none of motions", f"known are {known}")
    rows = every
    if of:
        rows = every[[i for i, own in enumerate(found.parameters) if _matters(own, of)]]
    if (name == "c" and len(rows) != 1) or not len(rows):
        what = f"{', '.join(of) or 'nothing'} names {len(rows)} parameters"
        raise InputError("of", "", what, "name some of the model's; c takes one, kind:where:name")
    if name == "D":
        return Determinant(rows)
    if name == "E":
        return SmallestEigenvalue(rows)
    return (Average if name == "A" else Combination)(rows.T)


def _matters(own: TorqueParameter, of: Sequence[str]) -> bool:
    names = (own.effect, f"{own.effect}:{own.where}", f"{own.effect}:{own.where}:{own.name}")
    return any(name in of for name in names)
