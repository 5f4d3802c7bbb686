"""Images of boards: what each shows, and which do not count, with the reason."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from calib.arrays import Array, IntArray
from calib.errors import InputError
from calib.files.exports.images import FEWEST, Detector, Pattern, opencv
from calib.files.exports.points import MeasuredPoint, PointList
from calib.files.read import read_bytes

IMAGES = (".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff", ".pgm", ".ppm", ".webp")
_LARGEST_FILE = 200_000_000  # bytes
_NEAR, _WAYS = 6, 8  # px around a point in which edges are looked at, in so many directions
_SMEARED, _SOFT = 2.5, 2.0  # times the usual blur, and px: edges that are smeared more are blurred
_RARE, _DULL = 1e-3, 60.0  # of the pixels; grey values between the darkest and the lightest


@dataclass(frozen=True, eq=False)
class Shot:
    """An image before it is looked at.

    pose : of the arm; name : of the file, or of the image in a recording
    load : the image, ndarray, shape (height, width), grey
    """

    pose: str
    name: str
    load: Callable[[], Any]


@dataclass(frozen=True, eq=False)
class Sighting:
    """What an image shows.

    size : ndarray, shape (2,), px, width and height
    boards : name -> numbers (n,) of its points and where they are, (n, 2), px
    few : most points of a board that was not seen well enough
    edge : px, standard deviation of the blur at the points; without any, where the image is steepest,
        NaN where it is dull
    reason : why the image does not count, empty where it does
    """

    shot: Shot
    size: Array
    boards: Mapping[str, tuple[IntArray, Array]]
    few: int
    edge: float
    reason: str = ""

    @property
    def count(self) -> int:
        return sum(len(ids) for ids, _ in self.boards.values())


def file_shots(paths: Sequence[Path], poses: Collection[str] = ()) -> list[Shot]:
    """Images of files, named as their poses: with the suffix where one of ``poses`` is, else without.

    Raises InputError where OpenCV is not installed; loading, where a file is no image.
    """
    cv2 = opencv("--board")
    return [
        Shot(p.name if p.name in poses else p.stem, p.name, partial(_image, cv2, p)) for p in paths
    ]


def look(
    shots: Sequence[Shot],
    patterns: Sequence[Pattern],
    size: Array | None = None,
    seen: Callable[[Sighting, Any], None] = lambda *_: None,
) -> list[Sighting]:
    """Look for the boards in every image, and name those that do not count with their reason.

    size : ndarray, shape (2,), px, that images have; None: the one that most of them have
    seen : told of each image, with its pixels

    Raises InputError where OpenCV is not installed.
    """
    cv2 = opencv("--board")
    searches = [Detector(cv2, pattern) for pattern in patterns]
    found = []
    for shot in shots:
        image = shot.load()
        found.append(_sighting(cv2, shot, image, searches))
        seen(found[-1], image)
    return _judged(found, size)


def _sighting(cv2: Any, shot: Shot, image: Any, searches: Sequence[Detector]) -> Sighting:
    own = {search.pattern.name: search.found(image) for search in searches}
    boards = {name: (ids, at) for name, (ids, at) in own.items() if len(ids) >= FEWEST}
    few = max((len(ids) for ids, _ in own.values() if len(ids) < FEWEST), default=0)
    corners = np.concatenate([np.zeros((0, 2)), *(at for _, at in boards.values())])
    size = np.array(image.shape[::-1], dtype=float)
    return Sighting(shot, size, boards, few, blur(cv2, image, corners))


def blur(cv2: Any, image: Any, corners: Array) -> float:
    """Standard deviation [px] by which edges at corners (n, 2) are smeared in the worst direction.

    Without corners that of the steepest edges, NaN where there is little to see. An edge that a
    Gaussian smears has the slope ``step / (sqrt(2 pi) sigma)``.
    """
    slopes = np.stack([cv2.Sobel(image, cv2.CV_64F, *way, scale=0.125) for way in ((1, 0), (0, 1))])
    ways = np.stack([f(np.arange(_WAYS) * np.pi / _WAYS) for f in (np.cos, np.sin)], axis=1)
    low, high = np.quantile(image, [_RARE, 1.0 - _RARE])
    if not len(corners):
        steep = float(np.quantile(np.hypot(*slopes), 1.0 - _RARE))
        return (high - low) / steep / np.sqrt(2.0 * np.pi) if high - low > _DULL else float("nan")
    widths = []
    for u, v in np.rint(corners).astype(int).tolist():
        part = slice(max(v - _NEAR, 0), v + _NEAR + 1), slice(max(u - _NEAR, 0), u + _NEAR + 1)
        steepest = np.abs(np.tensordot(ways, slopes[:, *part], 1)).max(axis=(1, 2)).min()
        widths.append(float(np.ptp(image[part])) / max(float(steepest), 1e-9))
    return float(np.median(widths) / np.sqrt(2.0 * np.pi))


def _judged(found: Sequence[Sighting], size: Array | None) -> list[Sighting]:
    """The same, with the reasons of those that do not count."""
    shown = [own.size for own in found if own.boards] or [own.size for own in found]
    sizes, counts = np.unique(shown, axis=0, return_counts=True)
    wanted = sizes[counts.argmax()] if size is None else size
    edges = [own.edge for own in found if own.boards]
    edge = max(_SMEARED * float(np.median(edges)), _SOFT) if edges else np.inf
    return [replace(own, reason=_reason(own, wanted, edge)) for own in found]


def _reason(own: Sighting, size: Array, edge: float) -> str:
    if (own.size != size).any():
        return f"other size: {own.size[0]:g} x {own.size[1]:g} px, not {size[0]:g} x {size[1]:g}"
    if not own.boards:
        said = f"too few points ({own.few})" if own.few else "no board"
        return f"{said}, blurred" if own.edge > edge else said
    return f"blurred: edges are smeared by {own.edge:.1f} px" if own.edge > edge else ""


def point_list(path: Path, sightings: Sequence[Sighting], patterns: Sequence[Pattern]) -> PointList:
    """The points of all images that count. path : what they are of. Raises InputError without any."""
    names = {pattern.name: pattern.names for pattern in patterns}
    points = [
        MeasuredPoint(
            path, k, "", own.shot.pose, f"{board}:{names[board][i]}", (f"{u:.4f}", f"{v:.4f}")
        )
        for k, own in enumerate(sightings, 1)
        if not own.reason
        for board, (ids, at) in own.boards.items()
        for i, (u, v) in zip(ids.tolist(), at.tolist(), strict=True)
    ]
    columns = ("image", "board", "point", "u", "v")
    if not points:
        raise _nothing(path, sightings, list(names))
    written, pattern = ("u_px", "v_px"), "{pose}::{marker}"
    return PointList(path, points, columns, "px", "of images", (), written, pattern)


def _nothing(path: Path, sightings: Sequence[Sighting], boards: Sequence[str]) -> InputError:
    """Why no image counts."""
    reasons = Counter(own.reason for own in sightings)
    reason, _ = reasons.most_common(1)[0]
    if reason == "no board":
        more = f"and {len(sightings) - 1} more show" if sightings[1:] else "shows"
        what = f"{more} no board {', '.join(boards)}"
        remedy = "compare squares, tags and dictionary of the cell with what is printed"
        return InputError(path / sightings[0].shot.name, "", what, remedy)
    remedy = "compare image_px of the cell with the images"
    if "size" not in reason:
        remedy = "show more of the board, hold still, focus"
    return InputError(path, "", f"none of {len(sightings)} images counts ({reason})", remedy)


def _image(cv2: Any, path: Path) -> Any:
    data = np.frombuffer(read_bytes(path, _LARGEST_FILE), dtype=np.uint8)
    image = cv2.imdecode(data, cv2.IMREAD_GRAYSCALE) if len(data) else None
    if image is None:
        raise InputError(path, "", "is no image that OpenCV reads", f"give {', '.join(IMAGES)}")
    return image
