"""What cameras saw of boards, from the tables of a result: for the picture of where that was."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from calib import Cell
from calib.arrays import Array, Mask
from calib.instruments import Camera
from calib.instruments.detection import Board
from calib.instruments.posit import LEAST, posed
from calib.poses import Measurements
from studies.document import Figure, Section
from studies.identify.record import IdentifyRecord
from studies.plots.coverage import BoardViews, seen_where
from studies.report.evidence import ReportedResult, ReportEvidence


def coverage(evidence: ReportEvidence, result: ReportedResult) -> Section | None:
    """Which parts of the images were used; None where no camera saw a board, or the tables are gone."""
    cell, tables = evidence.cell, evidence.data.get(result.path)
    if cell is None or tables is None or not isinstance(result.record, IdentifyRecord):
        return None
    views = list(board_views(cell, tables.data))
    if not views:
        return None
    figure = Figure(lambda: seen_where(views), highlight=False)
    return Section("coverage", "Where the boards were seen", (figure,))


def board_views(cell: Cell, data: Measurements) -> Iterator[BoardViews]:
    """Every board as every camera saw it."""
    for camera, part in cell.channels.blocks:
        for board in camera.boards if isinstance(camera, Camera) else ():
            own = slice(part.start + board.channels.start, part.start + board.channels.stop)
            uv, seen = data.readings[:, own, :2], data.seen[:, own]
            if isinstance(camera, Camera) and seen.any():
                size = uv[seen].max(axis=0) if camera.image is None else camera.image
                distance, tilt = _places(camera, board, uv, seen)
                yield BoardViews(camera.name, board.name, size, uv[seen], distance, tilt)


def _places(camera: Camera, board: Board, uv: Array, seen: Mask) -> tuple[Array, Array]:
    """Distance, m, and tilt, rad, of the board in each image that shows enough of it, (k,)."""
    ideal = camera.lens.ideal(uv)
    found = []
    for rays, here in zip(ideal, seen, strict=True):
        if here.sum() < LEAST:
            continue
        points = board.points[here]
        R, t, sound = posed(rays[here], points)
        if not sound:
            continue
        viewed = np.einsum("kij,nj->kni", R, points) + t[:, None]
        off = viewed[..., :2] / viewed[..., 2:] - rays[here]
        best = int((off**2).sum(axis=(1, 2)).argmin())
        middle = R[best] @ board.points.mean(axis=0) + t[best]
        away = float(np.linalg.norm(middle))
        found.append((away, float(np.arccos(min(1.0, abs(R[best][:, 2] @ middle) / away)))))
    distance, tilt = np.array(found).reshape(-1, 2).T
    return distance, tilt
