"""Recordings of ROS 2 as rosbags' own writer writes them: joint states, images and a lens."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from calib.arrays import Array

pytest.importorskip("rosbags")

from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

STORE = get_typestore(Stores.ROS2_HUMBLE)
T = STORE.types
START = 1_700_000_000  # s


def header(time: float) -> Any:
    whole = int(np.floor(time))
    stamp = T["builtin_interfaces/msg/Time"](START + whole, int((time - whole) * 1e9))
    return T["std_msgs/msg/Header"](stamp, "base")


def joint_state(names: Sequence[str], q: Array, time: float) -> Any:
    """Beside the joints there is a finger, as on grippers, and the order is another."""
    none = np.zeros(0)
    every = [*reversed(names), "finger"]
    position = np.array([*reversed(q), 0.02])
    return T["sensor_msgs/msg/JointState"](header(time), every, position, none, none)


def image(pixels: Any, time: float, encoding: str = "mono8", wide: int = 0) -> Any:
    """wide : bytes by which a row is longer than its pixels"""
    rows = pixels.reshape(len(pixels), -1)
    data = np.pad(rows, ((0, 0), (0, wide)))
    height, width = pixels.shape[:2]
    own = T["sensor_msgs/msg/Image"]
    return own(header(time), height, width, encoding, 0, data.shape[1], data.ravel())


def compressed(data: Any, time: float) -> Any:
    return T["sensor_msgs/msg/CompressedImage"](header(time), "png", np.asarray(data).ravel())


def camera_info(K: Array, size: tuple[int, int], time: float) -> Any:
    roi = T["sensor_msgs/msg/RegionOfInterest"](0, 0, 0, 0, False)
    P = np.c_[K, np.zeros(3)].ravel()
    own = T["sensor_msgs/msg/CameraInfo"]
    D = np.zeros(5)
    return own(header(time), size[1], size[0], "plumb_bob", D, K.ravel(), np.eye(3).ravel(), P, 0, 0,
               roi)  # fmt: skip


def written(path: Path, topics: dict[str, list[tuple[float, Any]]], mcap: bool = False) -> Path:
    """A recording of topics, each with times, s, and messages."""
    kind = StoragePlugin.MCAP if mcap else StoragePlugin.SQLITE3
    with Writer(path, version=9, storage_plugin=kind) as writer:
        for topic, messages in topics.items():
            name = messages[0][1].__msgtype__
            connection = writer.add_connection(topic, name, typestore=STORE)
            for time, message in messages:
                raw = STORE.serialize_cdr(message, name)
                writer.write(connection, int((START + time) * 1e9), raw)
    return path
