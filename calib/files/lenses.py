"""Lenses of cameras: calibrations as OpenCV and ROS (``camera_info``) write them, in and out.

Both hold the pinhole of OpenCV, or its fisheye. Of the pinhole's models of distortion those are read
that are k1, k2, p1, p2, k3: what is bent otherwise would be taken for the arm's. Standard deviations,
and a covariance, stand beside them as ``calibrateCameraExtended`` has them: fx, fy, cx, cy, the others.
"""

from __future__ import annotations

import re
import tomllib
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, TypeAlias

import numpy as np

from calib.arrays import Array
from calib.cell import Cell
from calib.effects.lens import LENS_EFFECTS
from calib.errors import InputError
from calib.files.read import read_text
from calib.files.schema import CellFile
from calib.files.yaml_text import Node, Scalar, leaves, number_at, read_yaml
from calib.instruments import Camera
from calib.instruments.camera_table import CameraTable, is_covariance

LensForm: TypeAlias = Literal["opencv", "ros"]
_MATRIX = ("camera_matrix", "intrinsic_matrix", "K", "mtx")
_DISTORTION = ("distortion_coefficients", "dist_coeffs", "D", "dist")
_PLAIN = ("plumb_bob", "radtan", "brown", "none", "")
_FISHEYE = ("fisheye", "equidistant", "kannala_brandt", "kannala_brandt4")
_OF_FISHEYE = 8  # values
_DEVIATIONS = (
    "std_dev_intrinsics",
    "standard_deviation_intrinsics",
    "standard_deviations_intrinsics",
    "std_deviations_intrinsics",
    "intrinsics_std",
)
_COVARIANCE = ("covariance_intrinsics", "intrinsics_covariance")
_MORE = {8: "rational", 12: "thin prism", 14: "tilted"}  # coefficients, OpenCV's models
_LARGEST = 1e6  # px, or of a coefficient
_IMPLAUSIBLE = "is no number of plausible size"
_REMEDY = "calibrate with the five coefficients k1, k2, p1, p2, k3, or undistort the images first"


@dataclass(frozen=True, eq=False)
class LensFile:
    """What a calibration says.

    values : ndarray, shape (9,), fx, fy, cx, cy [px], k1, k2, p1, p2, k3; of a fisheye (8,), k1 to k4
    image : ndarray, shape (2,), px, its size, or None
    covariance : ndarray, shape (n, n), of the values, zero for what is known; or None
    """

    form: LensForm
    values: Array
    image: Array | None
    covariance: Array | None = None


def read_lens(path: Path) -> LensFile:
    """The calibration in a YAML file. Raises InputError, naming a model of distortion not read here."""
    root = {_plain(key): node for key, node in read_yaml(path).root.items()}
    K = _numbers(path, "camera matrix", _of(root, _MATRIX))
    if K is None:
        what = "holds no camera matrix (camera_matrix, cameraMatrix or K)"
        raise InputError(path, "", what, "is it the calibration of one camera?")
    if len(K) != 9 or not (K[[0, 4]] > 0.0).all() or K[[3, 6, 7]].any() or K[8] != 1.0:
        what = "is not [fx, 0, cx, 0, fy, cy, 0, 0, 1]"
        raise InputError(path, "camera matrix", what, "is the camera calibrated?")
    if K[1]:
        raise InputError(path, "camera matrix", f"has a skew of {K[1]:g}", "calibrate without one")
    _refuse_parts(path, root)
    model = _word(root.get("distortionmodel"))
    bending = "fisheye" if _word(root.get("fisheyemodel")) in ("1", "true") else model
    if bending not in _FISHEYE and bending not in (*_PLAIN, "rational_polynomial"):
        what = f"has the distortion model {bending[:40]!r}, where plumb_bob is read"
        raise InputError(path, "distortion_model", what, _REMEDY)
    D = _numbers(path, "distortion", _of(root, _DISTORTION))
    if D is None:
        what = "names no distortion (distortion_coefficients, distCoeffs or D)"
        raise InputError(path, "", what, "write zeros for a lens without")
    bent = _four(path, D) if bending in _FISHEYE else _five(path, D, model)
    form: LensForm = "ros" if "distortionmodel" in root else "opencv"
    values = np.array([K[0], K[4], K[2], K[5], *bent])
    return LensFile(form, values, _image(path, root), _covariance(path, root, len(values)))


def lens_yaml(
    name: str,
    form: LensForm,
    values: Array,
    image: Array | None,
    covariance: Array | None = None,
) -> str:
    """The text of a calibration, values and covariance as in :class:`LensFile`."""
    fx, fy, cx, cy, *bent = (float(v) for v in values)
    fisheye, n = len(values) == _OF_FISHEYE, len(values)
    spread = (
        []
        if covariance is None
        else [
            ("standard_deviation_intrinsics", n, 1, np.sqrt(np.diag(covariance)).tolist()),
            ("covariance_intrinsics", n, n, covariance.ravel().tolist()),
        ]
    )
    K = [fx, 0.0, cx, 0.0, fy, cy, 0.0, 0.0, 1.0]
    size = (
        [] if image is None else [f"image_{k}: {v:.0f}" for k, v in zip(_SIZE, image, strict=True)]
    )
    if form == "opencv":
        matrices = [("camera_matrix", 3, 3, K), ("distortion_coefficients", len(bent), 1, bent)]
        lines = [
            line
            for own in (*matrices, *spread)
            for line in _matrix(*own, " !!opencv-matrix", ["   dt: d"])
        ]
        kind = ["fisheye_model: 1"] if fisheye else []
        return "\n".join(["%YAML:1.0", "---", *size, *kind, *lines, ""])
    P = [fx, 0.0, cx, 0.0, 0.0, fy, cy, 0.0, 0.0, 0.0, 1.0, 0.0]
    lines = [*size, f"camera_name: {re.sub(r'[^A-Za-z0-9_]', '_', name)}"]
    bending = "equidistant" if fisheye else "plumb_bob"
    lines += [*_matrix("camera_matrix", 3, 3, K), f"distortion_model: {bending}"]
    lines += _matrix("distortion_coefficients", 1, len(bent), bent)
    lines += [line for own in spread for line in _matrix(*own)]
    lines += _matrix("rectification_matrix", 3, 3, [float(v) for v in np.eye(3).flat])
    return "\n".join([*lines, *_matrix("projection_matrix", 3, 4, P), ""])


_SIZE = ("width", "height")


def _matrix(
    name: str, rows: int, cols: int, data: list[float], tag: str = "", more: list[str] | None = None
) -> list[str]:
    numbers = ", ".join(repr(value) for value in data)
    size = [f"   rows: {rows}", f"   cols: {cols}"]
    return [f"{name}:{tag}", *size, *(more or []), f"   data: [{numbers}]"]


def _plain(key: str) -> str:
    """``cameraMatrix`` and ``Camera_Matrix`` are ``camera_matrix``."""
    return key.lower().replace("_", "")


def _of(root: dict[str, Node], names: tuple[str, ...]) -> Node | None:
    return next((root[_plain(name)] for name in names if _plain(name) in root), None)


def _word(node: Node | None) -> str:
    return node.word.strip().lower() if isinstance(node, Scalar) else ""


def _numbers(path: Path, what: str, node: Node | None) -> Array | None:
    """The numbers of a list, of lists in a list, or of the ``data`` of a matrix."""
    if node is None:
        return None
    if isinstance(node, dict):
        node = node.get("data", [])
    own = [leaf for leaf in leaves(node) if isinstance(leaf, Scalar)]
    found = np.array([number_at(path, leaf, _LARGEST, _IMPLAUSIBLE) for leaf in own])
    if not len(found) and not isinstance(node, list):
        raise InputError(path, what, "is no list of numbers", "write them as data: [..]")
    return found


def _five(path: Path, D: Array, model: str) -> Array:
    """k1, k2, p1, p2, k3: coefficients beyond these must be zero."""
    name = _MORE.get(len(D), "")
    if len(D) not in (0, 1, 4, 5, *_MORE):
        raise InputError(path, "distortion", f"has {len(D)} coefficients", _REMEDY)
    if D[5:].any():
        own = f" ({model})" if model else ""
        raise InputError(
            path, "distortion", f"has {len(D)} coefficients, of the {name} model{own}", _REMEDY
        )
    return np.pad(D[:5], (0, 5 - len(D[:5])))


def _four(path: Path, D: Array) -> Array:
    """k1, k2, k3, k4 of a fisheye; ROS may write none for zeros."""
    if len(D) not in (0, 4):
        what = f"has {len(D)} coefficients, where a fisheye has four"
        raise InputError(path, "distortion", what, "calibrate with cv2.fisheye: k1, k2, k3, k4")
    return np.pad(D, (0, 4 - len(D)))


def _covariance(path: Path, root: dict[str, Node], count: int) -> Array | None:
    """Covariance (count, count) of the values; values beyond these must be known."""
    std = _numbers(path, "standard deviations", _of(root, _DEVIATIONS))
    cov = _numbers(path, "covariance", _of(root, _COVARIANCE))
    if cov is not None:
        side = round(float(np.sqrt(len(cov))))
        cov = cov.reshape(side, side) if side * side == len(cov) else np.zeros((0, 0))
        what, remedy = "is no covariance of fx, fy, cx, cy and the distortion", "leave it out"
        if len(cov) < _OF_FISHEYE // 2 or not is_covariance(cov):
            raise InputError(path, "covariance", what, remedy)
    elif std is not None:
        if len(std) < _OF_FISHEYE // 2 or (std < 0.0).any():
            what = "are no standard deviations of fx, fy, cx, cy and the distortion"
            raise InputError(path, "standard deviations", what, "leave them out")
        cov = np.diag(std**2)
    if cov is None or not cov[:count, :count].any():
        return None
    missing = max(0, count - len(cov))
    return np.pad(cov[:count, :count], (0, missing))


def _refuse_parts(path: Path, root: dict[str, Node]) -> None:
    """A message of ROS may say that its images are a part of those for which the matrix holds."""
    roi = root.get("roi")
    offsets = [roi.get(k) for k in ("x_offset", "y_offset")] if isinstance(roi, dict) else []
    cut = any(_word(own) not in ("", "0") for own in offsets)
    if cut or any(_word(root.get(k)) not in ("", "0", "1") for k in ("binningx", "binningy")):
        what = "is of images that are binned or cut (binning, roi)"
        raise InputError(path, "", what, "give the camera matrix of the images as they are read")


def _image(path: Path, root: dict[str, Node]) -> Array | None:
    found = [_of(root, (f"image_{key}", key)) for key in _SIZE]
    if not all(isinstance(own, Scalar) for own in found):
        return None
    size = np.array(
        [number_at(path, own, _LARGEST, _IMPLAUSIBLE) for own in found if isinstance(own, Scalar)]
    )
    return size if (size >= 1.0).all() else None


_LARGEST_FILE = 2_000_000  # bytes


def with_lenses(path: Path, table: CellFile) -> tuple[CellFile, tuple[Path, ...]]:
    """The cell's table with the numbers of the files that its cameras name, and these files.

    Raises InputError where a file cannot be used, or is of images of another size.
    """
    filled, files = {}, []
    for name, own in table.cameras.items():
        if own.calibration is not None:
            files.append(path.parent / own.calibration)
            filled[name] = _filled(own, f"{path}: instruments.{name}", files[-1])
    return table.model_copy(update={"instruments": {**table.instruments, **filled}}), tuple(files)


def _filled(table: CameraTable, where: str, file: Path) -> CameraTable:
    found = read_lens(file)
    fx, fy, cx, cy, *bent = found.values.tolist()
    update: dict[str, object] = {"focal_px": (fx, fy), "center_px": (cx, cy)}
    update["distortion"] = tuple(bent)
    update["model"] = "fisheye" if len(found.values) == _OF_FISHEYE else "pinhole"
    if found.covariance is not None and table.intrinsics_std is None:
        update["intrinsics_covariance"] = found.covariance.tolist()
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
    named = {effect.partition(":")[0] for effect in cell.effects}
    if not len(camera.free) and not named & LENS_EFFECTS:
        what = f"the lens of {camera.name!r} is given as known: nothing of it is found"
        raise InputError("--calibration", "", what, 'set free = ["focal", "center"] in the cell')
    return camera


def lens_text(
    cell: Cell, values: Array, covariance: Array, camera: Camera, form: LensForm | None = None
) -> str:
    """The text of a camera's calibration: in the form given, of the camera's own file, else OpenCV's.

    values : ndarray, shape (n,), as found; covariance : ndarray, shape (n, n), zero for what was known
    """
    tables = tomllib.loads(read_text(cell.path, _LARGEST_FILE))["instruments"]
    named = tables[camera.name].get("calibration")
    if form is None:
        form = "opencv" if named is None else read_lens(cell.path.parent / named).form
    return lens_yaml(camera.name, form, values, camera.image, covariance)
