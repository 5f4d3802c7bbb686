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
    share, path = share_or_file(holdout)
    if share is not None:
        return Session(data, *data.split(share, seed), [], data.warnings)
    if path is None:
        return Session(data, data, None, [], data.warnings)
    if path.resolve() == data_path.resolve():
        raise InputError(path, "", "holds the data themselves", "name other poses")
    held = calib.load_measurements(cell, path, every_marker=False)
    warnings = (*data.warnings, *held.warnings, *_shared_points(data, held))
    return Session(data, *calib.in_one_session(data, held), [path], warnings)


def share_or_file(holdout: str | Path | None) -> tuple[float | None, Path | None]:
    """What is held out: a share between 0 and 1, or a file. Raises InputError."""
    from calib.errors import InputError

    if holdout is None or isinstance(holdout, Path):
        return None, holdout
    try:
        share = float(holdout)
    except ValueError:
        return None, Path(holdout)
    if not 0.0 < share < 1.0:
        raise InputError("--holdout", "", f"{holdout} is not between 0 and 1", "use 0.3, or a file")
    return share, None


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
