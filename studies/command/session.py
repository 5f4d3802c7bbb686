"""Which poses of a table are fitted, and which take no part."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:
    from calib import Cell, Measurements


class HeldOut(NamedTuple):
    """What is fitted, what is not, from which further files, and what to say of it."""

    data: Measurements
    heldout: Measurements | None
    files: list[Path]
    warnings: tuple[str, ...]


def held_out(
    cell: Cell, data: Measurements, holdout: str | None, seed: int, data_path: Path
) -> HeldOut:
    """Split the data, or read the poses held out. Raises InputError.

    holdout : a file, a share of the configurations between 0 and 1, or None
    """
    import numpy as np

    import calib
    from calib.errors import InputError

    if holdout is None:
        return HeldOut(data, None, [], data.warnings)
    path = Path(holdout)
    try:
        fraction = float(holdout)
    except ValueError:
        if path.resolve() == data_path.resolve():
            raise InputError(path, "", "holds the data themselves", "name other poses") from None
        held = calib.load_measurements(cell, path, every_marker=False)
        warnings = (*data.warnings, *held.warnings, *_shared_points(data, held))
        return HeldOut(*calib.in_one_session(data, held), [path], warnings)
    if not 0.0 < fraction < 1.0:
        raise InputError("--holdout", "", f"{holdout} is not between 0 and 1", "use 0.3, or a file")
    return HeldOut(*data.split(fraction, np.random.default_rng(seed)), [], data.warnings)


def _shared_points(data: Measurements, held: Measurements) -> tuple[str, ...]:
    """A warning for held-out poses that are among the fitted ones: noise never repeats to the digit."""
    fitted = {point.tobytes() for point in data.points[data.seen]}
    names = [
        name
        for name, points, seen in zip(held.poses.names, held.points, held.seen, strict=True)
        if seen.any() and all(point.tobytes() in fitted for point in points[seen])
    ]
    if not names:
        return ()
    return (f"{len(names)} of the held-out poses are in the data too ({names[0]} ..): no proof",)
