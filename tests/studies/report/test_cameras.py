"""Where boards were seen: distances and tilts as they were, and how much of the image was used."""

from __future__ import annotations

from pathlib import Path

import numpy as np

import calib
from studies.plots.coverage import seen_where
from studies.report.cameras import board_views
from tests.calib.files.test_images import SQUARES
from tests.camera_cells import PINHOLE, kr270_cell
from tests.photographs import SIZE, facing, pixels

BOARD = f'[boards.b]\non = "tip"\n{SQUARES}\n'
CAMERA = f'[instruments.cam]\nkind = "camera"\non = "world"\n{PINHOLE}\nimage_px = {list(SIZE)}\n'
TILTS, AWAY = (0.2, 0.5, 0.8), (0.4, 0.6, 0.9)


def test_a_board_is_where_it_was(tmp_path: Path) -> None:
    path = kr270_cell(tmp_path, BOARD, CAMERA, effects=("base", "tool"))
    points = np.array([[x, y, 0.0] for y in range(1, 6) for x in range(1, 9)]) * 0.03
    lines = ["pose,marker," + ",".join(f"A{k}_deg" for k in range(1, 7)) + ",u_px,v_px"]
    for k, (tilt, away) in enumerate(zip(TILTS, AWAY, strict=True)):
        uv = pixels(points, facing(0.3 * k, (tilt, 0.0), (0.27, 0.18), away))
        lines += [f"p{k},b:{i},{k},-90,90,0,0,0,{u:.5f},{v:.5f}" for i, (u, v) in enumerate(uv)]
    (tmp_path / "m.csv").write_text("\n".join([*lines, ""]))
    cell = calib.load_cell(path)
    data = calib.load_measurements(cell, tmp_path / "m.csv")
    (view,) = board_views(cell, data)
    np.testing.assert_allclose(view.distance, AWAY, rtol=1e-4)
    np.testing.assert_allclose(view.tilt, TILTS, atol=1e-3)
    assert view.fields.sum() == len(TILTS) * len(points)
    picture = seen_where([view])
    assert picture.rows[0][:3] == ("cam", "b", 3)
    np.testing.assert_allclose(picture.rows[0][3], 100.0 * (view.fields > 0).mean())
