"""What a type knows, read from the file that ``[model.prior]`` of a cell names."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

from calib.cell import Cell
from calib.errors import InputError
from calib.files.read import read_text, sha256
from calib.population.prior import Prior

_LARGEST_FILE = 200_000_000  # bytes
_LARGEST = 1e12  # SI
_LEARN = "learn one with posecal fleet --prior"


def load_prior(path: Path, cell: Cell) -> Prior:
    """Read what robots of the cell's nominal model have in common.

    Raises InputError: no such file, nothing of this nominal model in it, figures that are damaged.
    """
    entries = _types(path)
    own = [sha256(file) for file in cell.robot_files]
    for k, entry in enumerate(entries):
        if entry.get("nominal_sha256") == own:
            try:
                return _prior(entry)
            except (KeyError, TypeError, ValueError, OverflowError, np.linalg.LinAlgError):
                raise InputError(path, f"types[{k}]", "is damaged", _LEARN) from None
    names = ", ".join(dict.fromkeys(str(entry.get("type"))[:40] for entry in entries))
    raise InputError(
        path,
        "types",
        f"holds {names or 'none'}, and none with the {cell.robot.source} {cell.robot_files[0]} as it "
        "stands",
        f"values count from one nominal model; {_LEARN} from robots of this one, or take "
        "[model.prior] out",
    )


def _types(path: Path) -> list[dict[str, Any]]:
    try:
        found = json.loads(read_text(path, _LARGEST_FILE))
    except (ValueError, RecursionError):
        found = None
    entries = found.get("types") if isinstance(found, dict) else None
    if not isinstance(entries, list) or found.get("command") != "prior":
        raise InputError(path, "", "is nothing that a type knows", _LEARN)
    if found.get("schema") != 1:
        raise InputError(path, "schema", "is not 1", _LEARN)
    return [entry for entry in entries if isinstance(entry, dict)]


def _prior(entry: dict[str, Any]) -> Prior:
    """Raises KeyError, TypeError, ValueError, LinAlgError."""
    rows = entry["parameters"]
    keys = tuple((str(p["effect"]), str(p["where"]), str(p["name"])) for p in rows)
    mean = np.array([p["mean_SI"] for p in rows], dtype=float)
    cov = np.array(entry["covariance_SI"], dtype=float)
    robots = entry["robots"]
    right = cov.shape == 2 * mean.shape and len(set(keys)) == len(keys) > 0
    small = (np.abs(mean) <= _LARGEST).all() and (np.abs(cov) <= _LARGEST**2).all()
    if not (right and small and isinstance(robots, int) and robots >= 1):
        raise ValueError
    if not np.allclose(cov, cov.T, rtol=1e-6, atol=0.0) or not (np.diag(cov) > 0.0).all():
        raise ValueError
    prior = Prior(str(entry["type"]), keys, mean, cov, robots)
    if not np.isfinite(prior.whitening).all():
        raise ValueError
    return prior
