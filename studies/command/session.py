"""Which poses of a table are fitted, and which take no part."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:
    from calib import Cell, Measurements


class Session(NamedTuple):
    """All readings of a table, what is fitted, what is not, further files, and what to say of it."""

    whole: Measurements
    data: Measurements
    heldout: Measurements | None
    files: list[Path]
    warnings: tuple[str, ...]


def read_session(cell: Cell, data_path: Path, holdout: str | Path | None, seed: int) -> Session:
    """Read a table, and split it, or read the poses held out. Raises InputError.

    holdout : a share of the configurations, between 0 and 1, as text; else a file
    """
    import calib
    from calib.errors import InputError

    data = calib.load_measurements(cell, data_path)
    share = _share(holdout)
    if share is not None and not 0.0 < share < 1.0:
        what = f"{holdout} is not between 0 and 1"
        raise InputError("--holdout", "", what, "use 0.3, or a file")
    if share is not None:
        return Session(data, *data.split(share, seed), [], data.warnings)
    if holdout is None:
        return Session(data, data, None, [], data.warnings)
    path = Path(holdout)
    if path.resolve() == data_path.resolve():
        raise InputError(path, "", "holds the data themselves", "name other poses")
    held = calib.load_measurements(cell, path, every_marker=False)
    warnings = (*data.warnings, *held.warnings, *_shared_points(data, held))
    return Session(data, *calib.in_one_session(data, held), [path], warnings)


def _share(holdout: str | Path | None) -> float | None:
    try:
        return float(holdout) if isinstance(holdout, str) else None
    except ValueError:
        return None


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
