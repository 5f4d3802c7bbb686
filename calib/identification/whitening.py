"""How much each reading weighs."""

from __future__ import annotations

from calib.arrays import Array
from calib.cell import Cell
from calib.errors import CalibError
from calib.model import Model
from calib.poses import Measurements


def whitening(cell: Cell, model: Model, values: Array, data: Measurements) -> Array:
    """Weights of the readings, shape (m, C, r, r); zero for hidden markers.

    A tracker's range is from where the cell says it stands, else from the origin of its readings.
    Raises CalibError where it stands at one place and the data have several stations.
    """
    if len(data.poses.stations) > 1 and any(i.fixed for i in cell.instruments):
        raise CalibError(
            "[instrument] position_mm holds for one station and the data have "
            f"{len(data.poses.stations)}; take it out, and ranges count from each station's origin"
        )
    W = model.readout.whitening(values, data.poses, data.readings, data.sigma)
    return W * data.seen[..., None, None]
