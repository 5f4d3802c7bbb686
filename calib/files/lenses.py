"""Lenses of a cell's cameras from their calibration files, and such files of lenses that were found."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from calib.cell import Cell
from calib.effects.base import Base
from calib.errors import InputError
from calib.files.lens_yaml import LensForm, lens_yaml, read_lens
from calib.files.read import read_text
from calib.files.schema import CameraTable, CellFile
from calib.instruments import Camera

if TYPE_CHECKING:
    from calib.identification.identification import Identification

_LARGEST_FILE = 2_000_000  # bytes


def with_lenses(path: Path, table: CellFile) -> tuple[CellFile, tuple[Path, ...]]:
    """The cell's table with the numbers of the files that its cameras name, and these files.

    Raises InputError where a file cannot be used, or is of images of another size.
    """
    filled, files = {}, []
    for name, own in table.instruments.items():
        if isinstance(own, CameraTable) and own.calibration is not None:
            files.append(path.parent / own.calibration)
            filled[name] = _filled(own, f"{path}: instruments.{name}", files[-1])
    return table.model_copy(update={"instruments": {**table.instruments, **filled}}), tuple(files)


def _filled(table: CameraTable, where: str, file: Path) -> CameraTable:
    found = read_lens(file)
    fx, fy, cx, cy, *bent = found.values.tolist()
    update = {"focal_px": (fx, fy), "center_px": (cx, cy), "distortion": tuple(bent)}
    if found.image is not None:
        own = tuple(found.image.tolist())
        if table.image_px not in (None, own):
            what = f"is of images of {own[0]:g} x {own[1]:g}, image_px of {where} is another"
            raise InputError(file, "", what, "calibrate at the size that is read")
        update["image_px"] = own
    return table.model_copy(update=update)


def camera_named(cell: Cell, name: str) -> Camera:
    """The camera of a name, which may be empty where there is one, whose lens is not all known.

    Raises InputError.
    """
    cameras = {i.name: i for i in cell.instruments if isinstance(i, Camera)}
    if name not in cameras and (name or len(cameras) != 1):
        what = f"{name!r} is no camera of the cell" if name else "the cell has not one camera"
        remedy = f"write NAME=FILE, of {', '.join(cameras)}" if cameras else "leave it out"
        raise InputError("--calibration", "", what, remedy)
    camera = cameras[name or next(iter(cameras))]
    if not len(camera.free):
        what = f"the lens of {camera.name!r} is given as known: nothing of it is found"
        raise InputError("--calibration", "", what, 'set free = ["focal", "center"] in the cell')
    return camera


def lens_found(cell: Cell, result: Identification, camera: Camera) -> str:
    """The text of a camera's calibration with what was free of its lens as found.

    In the form of the camera's own file, else in OpenCV's. Raises InputError for a model without base.
    """
    effects = zip(result.model.effects, result.model.slices, strict=True)
    own = [p for e, p in effects if isinstance(e, Base) and e.of.name == camera.name]
    if not own:
        what = "has no base: lenses are taken as known"
        raise InputError(cell.path, "model.effects", what, 'add "base"')
    by = np.zeros(9)
    by[camera.free] = result.values[own[0]][-len(camera.free) :]
    values = camera.lens.moved(by).values
    return lens_yaml(camera.name, _form(cell, camera.name), values, camera.image)


def _form(cell: Cell, name: str) -> LensForm:
    """That of the file that the cell names for the camera."""
    tables = tomllib.loads(read_text(cell.path, _LARGEST_FILE))["instruments"]
    named = tables[name].get("calibration")
    return "opencv" if named is None else read_lens(cell.path.parent / named).form
