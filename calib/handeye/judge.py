"""The verb: where the camera sits, beside what others make of the same samples, and what limits it."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from calib.arrays import Array, IntArray
from calib.cell import Cell
from calib.effects import ENDS, catalogue
from calib.effects.readings import PartEffect, ReadingEffect
from calib.errors import EffectCannotAct, TooFewPoses
from calib.handeye.errors import (
    UNITS,
    Missed,
    alone,
    folds,
    lower,
    missed_by,
    missed_by_model,
    target_of,
)
from calib.handeye.opencv import METHODS, Method, hand_eye_by, missing
from calib.handeye.samples import Eye, Pair, pairs_of
from calib.identification import Identification
from calib.identification.identify import identify
from calib.identification.lenses import UnfitLens, lenses_before_arm
from calib.poses import Measurements
from calib.result import Result
from calib.threads import one_blas_thread
from calib.uncertainty.expanded import coverage_factor

ARM_AS_IT_IS: Final = "arm as it is"
ARM_TOO: Final = "arm calibrated"
_FOLDS = 5
_LEAST = 3  # images that OpenCV's methods ask for
_CHANCE = 0.05


@dataclass(frozen=True, eq=False)
class Standing:
    """Where a camera sits on its carrier.

    T : ndarray, shape (4, 4), m; carrier : "tip" or "base"
    std : ndarray, shape (6,), x, y, z along the axes of the carrier, m, and the turn about those of the
        camera, rad; NaN where nothing tells
    half : ndarray, shape (6,), half of the 95 % interval
    """

    camera: str
    carrier: str
    T: Array
    std: Array
    half: Array


@dataclass(frozen=True, eq=False)
class Judged:
    """What a method misses, of one camera and target; nothing where it found no result.

    better : probability by chance that it misses as much less than the result in use; None for that
        itself, or of too few poses
    """

    pair: Pair
    method: Method
    missed: Missed
    better: float | None


@dataclass(frozen=True, eq=False, repr=False)
class HandEye(Result):
    """Result of :func:`hand_eye`.

    judged : tuple of Judged, every method at the same held-out images
    poses : how many were fitted
    crossed : whether every pose was held out in turn
    cell : Cell with the model in use; found : its Identification of all poses that may be fitted
    calibrated : whether that has the arm calibrated
    p : probability by chance that the arm's calibration lowers what is missed by as much, None where it
        cannot be told; why : then why
    standing : tuple of Standing, of every camera
    alone : dict, camera -> px RMS of a point that images by themselves leave
    left_out : why methods of OpenCV are missing, empty where none is
    lenses : tuple of UnfitLens, to be freed first: what limits the hand-eye is not known before
    """

    judged: tuple[Judged, ...]
    crossed: bool
    poses: int
    cell: Cell
    found: Identification
    calibrated: bool
    p: float | None
    why: str
    standing: tuple[Standing, ...]
    alone: dict[str, float]
    left_out: str
    lenses: tuple[UnfitLens, ...] = ()

    @property
    def used(self) -> Method:
        """The method whose result is to be used."""
        return ARM_TOO if self.calibrated else ARM_AS_IT_IS

    def sentences(self) -> list[str]:
        said = []
        for own in self.judged:
            if own.method == self.used:
                errors = ((unit, own.missed.rms(unit)) for unit in UNITS)
                shown = ", ".join(f"{rms.value:.3g} {unit}" for unit, rms in errors if rms)
                said.append(
                    f"Hand-eye of {own.pair.camera}, {self.used}: {shown} at held-out poses"
                )
        return [
            *said,
            *(f"the lens of {own.camera} does not fit: free it first" for own in self.lenses),
            *([self.why] if self.why else []),
            *([self.left_out] if self.left_out else []),
        ]

    def rows(self) -> list[dict[str, object]]:
        found: list[dict[str, object]] = []
        for own in self.judged:
            row: dict[str, object] = {"camera": own.pair.camera, "target": own.pair.target}
            row["method"] = own.method
            for unit in UNITS:
                rms = own.missed.rms(unit)
                row[unit] = float("nan") if rms is None else rms.value
            found.append(row)
        return found


@one_blas_thread
def hand_eye(
    cell: Cell,
    data: Measurements,
    *,
    heldout: Measurements | None = None,
    eye: Eye | None = None,
    seed: int = 0,
) -> HandEye:
    """Calibrate hand and eye, and say how good that is at poses that took no part.

    The camera is found with the arm as its file has it, and with the arm calibrated as the cell's model
    says, or its geometry. OpenCV's five methods get the same samples, of cameras the pose that each
    image shows by itself. A target that they leave open is fitted beside them.

    heldout : poses that take no part; without them each fifth of the poses is predicted by the others
    eye : where the camera is, of instruments that read whole poses: "in-hand" (the default: the body is
        the camera) or "on-base" (the instrument is)
    seed : of the fifths

    Raises CalibError where nothing is a hand-eye calibration, or the poses do not suffice.
    """
    pairs = pairs_of(cell, data, eye)
    plain = replace(cell, effects=_beside_arm(cell))
    whole = replace(cell, effects=_with_arm(cell))
    rigid = identify(plain, data, heldout=heldout)
    full, why = _calibrated(whole, data)
    every = data if heldout is None else heldout
    group = every.poses.configuration
    shown = {own: _shown(own, rigid, every) for own in pairs}
    left_out = missing()
    parts: dict[tuple[Pair, Method], list[Missed]] = {}
    for train, test, index in _splits(data, heldout, seed):
        fits: dict[Method, Identification | None]
        if heldout is None:
            fits = {ARM_AS_IT_IS: identify(plain, train)}
            fits[ARM_TOO] = None if full is None else _calibrated(whole, train)[0]
        else:
            fits = {ARM_AS_IT_IS: rigid, ARM_TOO: full}
        for pair in pairs:
            C, own = shown[pair][index], group[index]
            for method, fit in fits.items():
                if fit is not None:
                    missed = missed_by_model(pair, fit.model, fit.values, test, own, C)
                    parts.setdefault((pair, method), []).append(missed)
            if not left_out:
                for method, missed in _by_opencv(pair, rigid, train, test, own, C):
                    parts.setdefault((pair, method), []).append(missed)
    count = {pair: len(parts[pair, ARM_AS_IT_IS]) for pair in pairs}
    none = parts[pairs[0], ARM_AS_IT_IS][0].none
    found = {
        key: Missed.together(own if len(own) == count[key[0]] else [none])
        for key, own in parts.items()
    }
    p = None
    if all((pair, ARM_TOO) in found for pair in pairs):
        first, second = (
            Missed.together([found[pair, method] for pair in pairs])
            for method in (ARM_TOO, ARM_AS_IT_IS)
        )
        p = lower(first, second)
        fell = first.loss.sum() < second.loss.sum()
        p = p if p is None or fell else max(p, 0.5)
        why = why or ("" if p is not None else "too few poses to tell whether the arm limits it")
    elif not why:
        why = "four fifths of the poses are too few to calibrate the arm"
    lenses = lenses_before_arm(rigid, full)
    use = p is not None and p < _CHANCE and not lenses
    used = full if use and full is not None else rigid
    judged = tuple(
        Judged(pair, method, missed, _better(found, pair, method, ARM_TOO if use else ARM_AS_IT_IS))
        for (pair, method), missed in found.items()
    )
    images = {pair: alone(pair, every, shown[pair]) for pair in pairs}
    return HandEye(
        judged,
        heldout is None,
        len(data),
        whole if use else plain,
        used,
        use,
        p,
        why,
        tuple(_standing(pair, used) for pair in {own.camera: own for own in pairs}.values()),
        {pair.camera: px for pair, px in images.items() if px is not None},
        left_out,
        lenses,
    )


def _better(
    found: dict[tuple[Pair, Method], Missed], pair: Pair, method: Method, used: Method
) -> float | None:
    """Whether a method misses less than the result in use, by chance."""
    if method == used:
        return None
    return lower(found[pair, method], found[pair, used])


def _beside_arm(cell: Cell) -> tuple[str, ...]:
    """Places, and what of the cell's model concerns the readings alone."""
    kinds = catalogue()
    own = [(name, name.partition(":")[0]) for name in cell.effects]
    aside = (
        name
        for name, kind in own
        if kind in kinds and issubclass(kinds[kind], ReadingEffect | PartEffect)
    )
    return (*ENDS, *aside)


def _with_arm(cell: Cell) -> tuple[str, ...]:
    """What the cell's model has, its geometry where it has nothing of the arm."""
    aside = _beside_arm(cell)
    more = [name for name in cell.effects if name not in aside]
    return (*aside, *(more or ["geometry"]))


def _calibrated(cell: Cell, data: Measurements) -> tuple[Identification | None, str]:
    """The arm as well, or why not."""
    try:
        return identify(cell, data), ""
    except (TooFewPoses, EffectCannotAct) as error:
        return None, str(error)


def _splits(
    data: Measurements, heldout: Measurements | None, seed: int
) -> Iterator[tuple[Measurements, Measurements, IntArray]]:
    """What is fitted, what is predicted, and which of all that is predicted that is."""
    if heldout is not None:
        yield data, heldout, np.arange(len(heldout))
        return
    for out in folds(data.poses.configuration, _FOLDS, np.random.default_rng(seed)):
        yield data.take(~out), data.take(out), np.flatnonzero(out)


def _shown(pair: Pair, fit: Identification, data: Measurements) -> Array:
    """C of every image (m, 4, 4), NaN where it shows none."""
    first = pair.predicted(fit.model, fit.values, data.poses)
    C, there = pair.measured(data, first)
    C[~there] = np.nan
    return C


def _by_opencv(
    pair: Pair,
    rigid: Identification,
    train: Measurements,
    test: Measurements,
    group: IntArray,
    C: Array,
) -> Iterator[tuple[Method, Missed]]:
    """What each of OpenCV's methods misses."""
    seen = _shown(pair, rigid, train)
    there = np.asarray(np.isfinite(seen).all(axis=(1, 2)))
    F, F_test = (pair.carried(rigid.model, own.poses) for own in (train, test))
    for method in METHODS:
        E = hand_eye_by(method, F[there], seen[there]) if there.sum() >= _LEAST else None
        if E is None:
            yield method, missed_by(pair, F_test, np.eye(4), np.eye(4), test, group, C).none
            continue
        W = target_of(pair, F, E, train, seen, there)
        yield method, missed_by(pair, F_test, E, W, test, group, C)


def _standing(pair: Pair, found: Identification) -> Standing:
    T, by = pair.standing(found.model, found.values)
    covariance = found.covariance + found.systematic
    std = np.sqrt(np.einsum("ap,pq,aq->a", by, covariance, by))
    told = by.any(axis=0)
    freedom = float(np.min(found.freedoms[told]))
    std = np.where(std > 0.0, std, np.nan)
    return Standing(pair.camera, pair.carrier, T, std, coverage_factor(freedom) * std)
