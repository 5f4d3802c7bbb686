"""What earlier results say: identified values, and a whole model."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any, TypeAlias, get_args

import numpy as np

from calib.arrays import Array
from calib.cell import Cell
from calib.effects import catalogue
from calib.effects.protocol import Effect
from calib.effects.tuned import Tuned, amounts_of
from calib.errors import CalibError, InputError
from calib.files.read import read_text, sha256
from calib.model import Model
from calib.model.build import context_of, model_of, place_effect
from calib.observations.scatter import Owner, Variances
from calib.prediction.discrepancy import ModelDiscrepancy
from calib.prediction.estimate import Estimate
from calib.prediction.unmeasured import Unmeasured, unmeasured_context

_LARGEST_FILE = 200_000_000  # bytes; residuals of every point stand in it
_LARGEST_VALUE = 1e12  # SI, as in tables: times may count from 1970
_LARGEST_SQUARE = _LARGEST_VALUE**2  # a spring that nothing showed has a variance of 1e10

Key: TypeAlias = tuple[str, ...]
"""Effect, where and name of a parameter."""


def load_estimate(cell: Cell, path: str | Path) -> Estimate:
    """Read what ``identify --json`` or ``diagnose --json`` found.

    Effects stand in the model as the result has them, whatever the cell's [model] says now; a cell or
    robot file that changed since is a note.

    Raises InputError: no such result, or parameters that this cell's robot has not.
    """
    path = Path(path)
    result = _json_object(path)
    if result.get("command") not in ("identify", "diagnose"):
        what = "is not a result of posecal identify or diagnose"
        raise InputError(path, "", what, "write one with --json")
    entry = result.get("estimate")
    if not isinstance(entry, dict):
        remedy = "write it with identify --json or diagnose --json"
        raise InputError(path, "", "holds no estimate", remedy)
    try:
        keys = [
            tuple(str(p[key]) for key in ("effect", "where", "name")) for p in entry["parameters"]
        ]
        values = _numbers([p["value_SI"] for p in entry["parameters"]])
        model = _model(cell, keys, values, str(entry["session_clock"]))
        estimate = _estimate(cell, model, values, entry)
    except CalibError as error:
        what = f"is not of this cell: {error}"
        raise InputError(path, "estimate", what, "give the cell that it was made with") from None
    except (KeyError, TypeError, ValueError, OverflowError):
        raise InputError(path, "estimate", "is damaged", "write the result again") from None
    return replace(estimate, notes=(*estimate.notes, *_changed(cell, path, result)))


def _json_object(path: Path) -> dict[str, Any]:
    """What a file holds; nothing where it is no object of JSON. Raises InputError."""
    try:
        found = json.loads(read_text(path, _LARGEST_FILE))
    except (ValueError, RecursionError):
        found = None
    return found if isinstance(found, dict) else {}


def _numbers(entries: Any, largest: float = _LARGEST_VALUE) -> Array:
    values = np.array(entries, dtype=float)
    if not (np.abs(values) <= largest).all():
        raise ValueError
    return values


def _estimate(cell: Cell, model: Model, values: Array, entry: dict[str, Any]) -> Estimate:
    """The estimate of an entry. Raises KeyError, TypeError, ValueError, OverflowError."""
    square = (len(values), len(values))
    cov = _numbers(entry["covariance_SI"], _LARGEST_SQUARE).reshape(square)
    start, unexplained = _numbers([entry["session_start_s"], entry["unexplained"]["rms_mm"]])
    if (np.diag(cov) < 0.0).any() or unexplained < 0.0:
        raise ValueError
    variances, owner = _variances(cell, entry["scatter_SI"])
    undetermined, notes = (tuple(map(str, entry[key])) for key in ("undetermined", "notes"))
    discrepancy = ModelDiscrepancy(float(unexplained) * 1e-3, str(entry["unexplained"]["source"]))
    trend = entry.get("trend_SI")
    if trend is not None:
        trend = _numbers(trend, _LARGEST_SQUARE).reshape(square)
    return Estimate(
        model, values, cov, float(start), discrepancy, undetermined, notes,
        entry["converged"] is True, variances, str(entry["session_clock"]), owner, trend,
        tuple(_unmeasured(cell, len(values), one) for one in entry.get("unmeasured", ())),
    )  # fmt: skip


def _unmeasured(cell: Cell, count: int, entry: Any) -> Unmeasured:
    """Effects that no reading could show. Raises CalibError, KeyError, TypeError, ValueError."""
    names = [str(name).partition(":") for name in entry["effects"]]
    effects = tuple(place_effect(k, w, unmeasured_context(cell)) for k, _, w in names)
    own = sum(len(amounts_of(effect)) for effect in effects)
    square = _numbers(entry["square_SI"], _LARGEST_SQUARE).reshape(own, own)
    absorbed = _numbers(entry["absorbed_SI"], _LARGEST_SQUARE).reshape(count, own)
    time = None if entry["time_s"] is None else float(entry["time_s"])
    low, high = _numbers(entry["within"]).tolist()
    largest = float(entry["largest_mm"]) * 1e-3
    return Unmeasured(effects, square, absorbed, largest, (low, high), time)


def _variances(cell: Cell, entry: Any) -> tuple[Variances | None, Owner]:
    """What errs as a whole, and whose it is. Raises KeyError, ValueError."""
    if entry is None:
        return None, "undecided"
    found = [_numbers(entry[key], _LARGEST_SQUARE) for key in ("approach", "configuration")]
    of: Owner = entry["configuration_of"]
    wrong = any(v.shape != (cell.robot.dof + 2,) or (v < 0.0).any() for v in found)
    if wrong or of not in get_args(Owner):
        raise ValueError
    return Variances(1.0, *found), of


def _model(cell: Cell, keys: list[Key], values: Array, clock: str) -> Model:
    """The model whose parameters these are, in their order. Raises CalibError."""
    still = {instrument.name for instrument in cell.instruments if not instrument.has_stations}
    placed = (where for kind, where, _ in keys if kind == "base" and where not in still)
    stations = tuple(dict.fromkeys(placed)) or ("base",)
    context = replace(context_of(cell, None), stations=stations, clock_unit=clock)
    effects: list[Effect] = []
    for kind, where in dict.fromkeys((kind, where) for kind, where, _ in keys):
        if kind not in catalogue():
            raise CalibError(f"effect {kind!r} is not known here")
        names = [name for k, w, name in keys if (k, w) == (kind, where)]
        effect = place_effect(kind, where, context, names)
        first = next(i for i, (k, w, _) in enumerate(keys) if (k, w) == (kind, where))
        effects.append(effect.tuned(values[first]) if isinstance(effect, Tuned) else effect)
    model = model_of(cell, effects)
    if list(model.keys) != keys:
        raise CalibError("its parameters are not those of the effects here")
    return model


def _changed(cell: Cell, path: Path, result: dict[str, Any]) -> list[str]:
    """Notes on files of the cell that are not those that the result was made from."""
    inputs = result.get("inputs")
    named = inputs if isinstance(inputs, list) else []
    known = [i.get("sha256") for i in named if isinstance(i, dict)]
    return [
        f"{file} changed since {path} was written: its values hold for the cell as it was"
        for file in (cell.path, *cell.robot_files)
        if file.is_file() and sha256(file) not in known
    ]
