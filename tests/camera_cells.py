"""Cells with cameras and boards, as text and as files of a KR 270."""

from __future__ import annotations

import json
import tomllib
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from calib.arrays import Array
from studies.demo.embedded import embedded_text

LENS = np.array([1400.0, 1380.0, 960.0, 540.0, -0.12, 0.05, 8e-4, -5e-4, -0.01])
PINHOLE = "focal_px = 1000\ncenter_px = [479.5, 359.5]\nsigma_px = 0.1"
"""The camera of :mod:`tests.photographs`."""


def camera_cell(board: str, camera: str, urdf: str, base: str, tip: str) -> str:
    """The text of a cell; board, camera : keys of ``[boards.b]`` and ``[instruments.cam]``."""
    return (
        f'schema = 1\n[robot]\nurdf = "{urdf}"\nbase = "{base}"\ntip = "{tip}"\n'
        f'[boards.b]\non = "tip"\n{board}\n[instruments.cam]\nkind = "camera"\n{camera}\n'
        '[model]\neffects = ["base", "tool"]\n'
    )


def board_text(name: str, on: str, points: Array) -> str:
    """A board of points (n, 3), m, which are named p0, p1 and so on."""
    listed = ", ".join(
        f"p{i} = [{', '.join(f'{1e3 * c:.9f}' for c in point)}]" for i, point in enumerate(points)
    )
    return f'[boards.{name}]\non = "{on}"\npoints_mm = {{ {listed} }}\n'


def camera_text(name: str, on: str, more: str = "", lens: Array = LENS) -> str:
    """A camera of 1920 x 1080 pixels and noise of a fifth of one."""
    return (
        f'[instruments.{name}]\nkind = "camera"\non = "{on}"\n'
        f"focal_px = [{lens[0]}, {lens[1]}]\ncenter_px = [{lens[2]}, {lens[3]}]\n"
        f"distortion = {lens[4:].tolist()}\nimage_px = [1920, 1080]\nsigma_px = 0.2\n{more}\n"
    )


def kr270_cell(folder: Path, *tables: str, effects: Sequence[str]) -> Path:
    """The file of a cell of the KR 270 with these tables."""
    (folder / "kr270.urdf").write_text(embedded_text("kr270.urdf"))
    robot = tomllib.loads(embedded_text("cell.toml"))["robot"]
    (folder / "cell.toml").write_text(
        f'schema = 1\n[robot]\nurdf = "kr270.urdf"\nbase = "{robot["base"]}"\n'
        f'tip = "{robot["tip"]}"\n{"".join(tables)}\n[model]\neffects = {json.dumps([*effects])}\n'
    )
    return folder / "cell.toml"
