"""Recordings of ROS (bag, db3, mcap): images of cameras and the joint states that belong to them.

A pose is a stop: where the joints stand still the image nearest to its middle is taken, with the mean
of the joint states. Of a moving arm images are taken every few degrees, with joint states interpolated
to the image's stamp.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from calib.arm.robot import Robot
from calib.arrays import Array, Mask
from calib.errors import InputError
from calib.files.exports.images import opencv
from calib.files.exports.joints import JointRow, JointTable
from calib.files.exports.sightings import Shot

SUFFIXES = (".bag", ".db3", ".mcap")
_IMAGES = ("sensor_msgs/msg/Image", "sensor_msgs/msg/CompressedImage")
_JOINTS, _INFO = "sensor_msgs/msg/JointState", "sensor_msgs/msg/CameraInfo"
_ASIDE = 0.25  # s before and after, for which joints that stand still have stood
_LOST = 0.5  # s without joint states: nobody knows where the arm was
_STILL = np.array([1e-3, 2e-4])  # rad, m
_APART = np.array([0.035, 0.02])  # rad, m, between two images of a moving arm
_NS = 1e-9  # s
_COLOURS = {"rgb8": "RGB", "bgr8": "BGR", "rgba8": "RGBA", "bgra8": "BGRA"}
_BAYER = {"bayer_rggb8": "BG", "bayer_bggr8": "RG", "bayer_gbrg8": "GR", "bayer_grbg8": "GB"}


@dataclass(frozen=True, eq=False)
class Recording:
    """What one camera recorded.

    topic : of its images; shots : those that are taken, of the poses of ``joints``
    images : how many there are; stops : of the arm, 0 where it moves
    lens : fx, fy, cx, cy and the distortion, px, as ``camera_info`` has them, or None
    """

    topic: str
    shots: list[Shot]
    joints: JointTable
    images: int
    stops: int
    lens: Array | None


def is_bag(path: Path) -> bool:
    """Whether a file is a recording, or a folder one of ROS 2."""
    return path.suffix.lower() in SUFFIXES or (path / "metadata.yaml").is_file()


@contextmanager
def recordings(
    path: Path, robot: Robot, topics: Sequence[str] = (), moving: bool = False
) -> Iterator[list[Recording]]:
    """What each camera recorded, in the order of ``topics``; all with images where none is named.

    Images are loaded while the context lasts. Raises InputError.
    """
    try:
        from rosbags.highlevel import AnyReader
        from rosbags.typesys import Stores, get_typestore
    except ImportError:
        remedy = "pip install 'posecal[rosbag]'"
        raise InputError(path, "", "needs rosbags, which is not installed", remedy) from None
    try:
        reader = AnyReader([path], default_typestore=get_typestore(Stores.ROS2_HUMBLE))
        reader.open()
    except Exception as error:  # whatever the readers of four kinds of files say
        said = str(error).partition("\n")[0][:120]
        raise InputError(path, "", f"is no recording that rosbags reads ({said})") from None
    try:
        own = _Bag(path, reader, robot)
        yield [own.recording(topic, moving) for topic in own.topics(topics)]
    finally:
        reader.close()


class _Bag:
    """An open recording and the joint states in it, in seconds since the first."""

    def __init__(self, path: Path, reader: Any, robot: Robot) -> None:
        self.path, self.reader, self.cv2 = path, reader, opencv(str(path))
        self.names = list(robot.told)
        slides = {own.master: own.slides for sources in robot.sources for own in sources}
        self.kinds = np.array([int(slides[name]) for name in self.names])
        self.start, self.time, self.q = self._joint_states()

    def topics(self, wanted: Sequence[str]) -> list[str]:
        """Those of the images that are wanted. Raises InputError for one that is none."""
        known = [own.topic for own in self.reader.connections if own.msgtype in _IMAGES]
        for topic in wanted:
            if topic not in known:
                remedy = f"images are in {', '.join(known)}" if known else "it has no images"
                raise InputError("--topic", "", f"{topic!r} is not in {self.path}", remedy)
        if not known:
            raise InputError(self.path, "", "holds no images", f"record {' or '.join(_IMAGES)}")
        return list(wanted or dict.fromkeys(known))

    def recording(self, topic: str, moving: bool) -> Recording:
        """The images of a topic that are taken, with their joints. Raises InputError without any."""
        logged, stamps = self._stamps(topic)
        place = self._moving(stamps) if moving else self._stops(stamps)
        if not place:
            what = f"shows no image of {topic} at which the joints stand still for {2 * _ASIDE} s"
            remedy = "give --moving if the arm was filmed as it moved; are the stamps of one clock?"
            raise InputError(self.path, "", what, remedy)
        shots, rows = [], []
        letter = "image" if moving else "stop"
        for k, (image, q, time) in place.items():
            pose = f"{letter}{k + 1:03d}"
            name = f"{topic} at {stamps[image]:.2f} s"
            shots.append(Shot(pose, name, partial(self._image, topic, logged[image])))
            values = tuple(f"{value:.9g}" for value in (*q, time))
            rows.append(JointRow(k + 1, pose, values))
        joints = tuple(
            f"{name}_{'m' if slides else 'rad'}"
            for name, slides in zip(self.names, self.kinds, strict=True)
        )
        table = JointTable(self.path, joints, ("time_s",), rows, ())
        return Recording(
            topic, shots, table, len(stamps), 0 if moving else len(rows), self._lens(topic)
        )

    def _messages(self, kinds: Sequence[str], topic: str = "", **span: int) -> Iterator[Any]:
        """Topic, time of record [ns] and message."""
        own = [c for c in self.reader.connections if c.msgtype in kinds and topic in ("", c.topic)]
        if own:
            for connection, logged, raw in self.reader.messages(own, **span):
                yield connection, logged, self.reader.deserialize(raw, connection.msgtype)

    def _joint_states(self) -> tuple[float, Array, Array]:
        """Time of the first one, s, and times (n,) and joints (n, dof) of all of the robot's."""
        names = self.names
        rows = [
            (
                _stamp(message, logged),
                [message.position[list(message.name).index(n)] for n in names],
            )
            for _, logged, message in self._messages([_JOINTS])
            if set(names) <= set(message.name) and len(message.position) == len(message.name)
        ]
        if len(rows) < 2:
            what = f"holds no joint states of {', '.join(names)}"
            raise InputError(self.path, "", what, f"record {_JOINTS} of this arm")
        rows.sort(key=lambda row: row[0])
        time = np.array([row[0] for row in rows])
        return float(time[0]), time - time[0], np.array([row[1] for row in rows], dtype=float)

    def _stamps(self, topic: str) -> tuple[list[int], Array]:
        """Times of record [ns] of the images, and their stamps (n,), s."""
        found = [
            (logged, _stamp(message, logged) - self.start)
            for _, logged, message in self._messages(_IMAGES, topic)
        ]
        return [logged for logged, _ in found], np.array([stamp for _, stamp in found])

    def _at(self, time: Array) -> Array:
        return np.stack([np.interp(time, self.time, own) for own in self.q.T], axis=1)

    def _near(self, a: Array, b: Array, tolerance: Array) -> Mask:
        return np.asarray((np.abs(a - b) <= tolerance[self.kinds]).all(axis=-1))

    def _stops(self, stamps: Array) -> dict[int, tuple[int, Array, float]]:
        """Stop -> the image nearest to its middle, the mean joints and the middle, s."""
        before, after = self._at(self.time - _ASIDE), self._at(self.time + _ASIDE)
        still = self._near(before, self.q, _STILL) & self._near(after, self.q, _STILL)
        begins = np.diff(still, prepend=False) & still
        begins |= still & (np.diff(self.time, prepend=0.0) > _LOST)
        number = np.where(still, np.cumsum(begins) - 1, -1)
        found = {}
        for k in range(number.max(initial=-1) + 1):
            time = self.time[number == k]
            middle = float(time[[0, -1]].mean())
            inside = np.flatnonzero((stamps >= time[0]) & (stamps <= time[-1]))
            if len(inside):
                nearest = int(inside[np.abs(stamps[inside] - middle).argmin()])
                found[k] = nearest, self.q[number == k].mean(axis=0), middle
        return found

    def _moving(self, stamps: Array) -> dict[int, tuple[int, Array, float]]:
        """Image -> itself, the joints at its stamp and the stamp, s; wherever the arm went further."""
        later = np.searchsorted(self.time, stamps).clip(1, len(self.time) - 1)
        known = self.time[later] - self.time[later - 1] <= _LOST
        known &= (stamps >= self.time[0]) & (stamps <= self.time[-1])
        q, found, last = self._at(stamps), {}, None
        for i in np.flatnonzero(known).tolist():
            if last is None or not self._near(q[i], q[last], _APART):
                found[i], last = (i, q[i], float(stamps[i])), i
        return found

    def _image(self, topic: str, logged: int) -> Any:
        """The pixels, grey."""
        span = {"start": logged, "stop": logged + 1}
        connection, _, message = next(self._messages(_IMAGES, topic, **span))
        if connection.msgtype == _IMAGES[1]:
            image = self.cv2.imdecode(np.asarray(message.data), self.cv2.IMREAD_GRAYSCALE)
        else:
            image = grey(self.cv2, message)
        if image is None:
            raise InputError(self.path, topic, "holds an image that OpenCV cannot read")
        return image

    def _lens(self, topic: str) -> Array | None:
        """Of the ``camera_info`` beside the images."""
        beside = f"{topic.removesuffix('/compressed').rpartition('/')[0]}/camera_info"
        for _, _, message in self._messages([_INFO], beside):
            K, D = (np.asarray(getattr(message, n, getattr(message, n.lower(), ()))) for n in "KD")
            return np.r_[K[[0, 4, 2, 5]], D] if len(K) == 9 and K[0] > 0.0 else None
        return None


def _stamp(message: Any, logged: int) -> float:
    """When it was measured, s; when it was recorded, where it says none."""
    stamp = message.header.stamp
    return (stamp.sec + stamp.nanosec * _NS) or logged * _NS


def grey(cv2: Any, message: Any) -> Any:
    """An image of ROS, grey. Raises InputError for an encoding that is not read."""
    encoding = message.encoding.lower()
    wide = encoding in ("mono16", "16uc1")
    rows = np.asarray(message.data).reshape(message.height, message.step)
    if wide:
        pixels = rows.view(">u2" if message.is_bigendian else "<u2")[:, : message.width]
        return (pixels / (int(pixels.max()) / 255.0 or 1.0)).astype(np.uint8)
    if encoding in ("mono8", "8uc1"):
        return np.ascontiguousarray(rows[:, : message.width])
    if encoding in _BAYER:
        code = getattr(cv2, f"COLOR_Bayer{_BAYER[encoding]}2GRAY")
        return cv2.cvtColor(np.ascontiguousarray(rows[:, : message.width]), code)
    if encoding not in _COLOURS:
        remedy = "record it as mono8, rgb8 or bgr8"
        raise InputError("--topic", "", f"images are encoded as {encoding[:20]!r}", remedy)
    order = _COLOURS[encoding]
    pixels = rows[:, : message.width * len(order)].reshape(message.height, message.width, -1)
    return cv2.cvtColor(np.ascontiguousarray(pixels), getattr(cv2, f"COLOR_{order}2GRAY"))
