"""Recordings of ROS 2 with ``sensor_msgs/JointState``: runs of joint angles and efforts."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from calib.errors import InputError

_JOINTS = "sensor_msgs/msg/JointState"


@dataclass(frozen=True)
class Recording:
    """The rows of a bag: time since its first stamp, positions and efforts, as text."""

    path: Path
    joints: tuple[str, ...]
    lines: list[list[str]]
    warnings: tuple[str, ...]

    @property
    def name(self) -> str:
        """Of the run."""
        return self.path.resolve().stem


def files_of(path: Path) -> list[Path]:
    """The files of a bag, which is one or a folder."""
    return sorted(own for own in path.iterdir() if own.is_file()) if path.is_dir() else [path]


def motion_columns(joints: Sequence[str], slides: Sequence[str], effort: str) -> list[str]:
    """The header of a table of runs; effort : Nm or A. Raises InputError for an unknown slide."""
    if unknown := [name for name in slides if name not in joints]:
        raise InputError("--slides", "", f"no joint {unknown[0]!r}", f"use {', '.join(joints)}")
    read = [f"{name}_{'m' if name in slides else 'rad'}" for name in joints]
    force = [f"{j}_{'N' if j in slides and effort == 'Nm' else effort}" for j in joints]
    return ["session", "time_s", *read, *force]


def read_bag(path: Path, topic: str | None = None) -> Recording:
    """The joint states of a bag, timed by the stamps of their headers.

    Raises InputError where the library is missing, for what is no bag, for several topics without a
    choice, and for messages without stamps or efforts.
    """
    try:
        from rosbags.highlevel import AnyReader
        from rosbags.typesys import Stores, get_typestore
    except ImportError:
        what = "needs rosbags, which is not installed"
        raise InputError(path, "", what, "pip install '.[rosbag]'") from None
    try:
        with AnyReader([path], default_typestore=get_typestore(Stores.ROS2_HUMBLE)) as reader:
            messages = list(_messages(path, reader, topic))
    except InputError:
        raise
    except Exception as error:  # the library's many kinds, and those of what it reads by
        what = f"cannot be read as a bag ({error})"
        raise InputError(path, "", what, "check the file, and metadata.yaml beside it") from None
    return _recording(path, messages)


def _messages(path: Path, reader: Any, topic: str | None) -> Iterator[Any]:
    """The messages of the topic that is asked for, or of the only one."""
    found = [own for own in reader.connections if own.msgtype == _JOINTS and own.msgcount]
    topics = sorted({own.topic for own in found})
    if topic not in (topics if len(topics) != 1 else [None, *topics]):
        what = f"has joints under {', '.join(topics)}" if topics else f"has no {_JOINTS}"
        raise InputError(
            path, "", what, "name one by --topic" if topics else "record /joint_states"
        )
    for connection, _, raw in reader.messages([o for o in found if topic in (None, o.topic)]):
        yield reader.deserialize(raw, connection.msgtype)


def _recording(path: Path, messages: Sequence[Any]) -> Recording:
    """The rows of the joints that most messages are about."""
    (joints, count), *_ = Counter(tuple(own.name) for own in messages).most_common()
    kept = [own for own in messages if tuple(own.name) == joints]
    stamps = [own.header.stamp.sec * 10**9 + own.header.stamp.nanosec for own in kept]
    if not any(stamps):
        raise InputError(path, "", "its headers have no stamps", "let the driver stamp them")
    if any(not len(joints) == len(own.position) == len(own.effort) for own in kept):
        what = "has messages without a position and an effort of every joint"
        raise InputError(path, "", what, "let the driver publish efforts")
    lines = [
        [f"{(stamp - stamps[0]) * 1e-9:.9f}", *(f"{x:.12g}" for x in (*own.position, *own.effort))]
        for stamp, own in zip(stamps, kept, strict=True)
    ]
    others = len(messages) - count
    said = f"{path}: {others} messages about other joints than {', '.join(joints)} left out"
    return Recording(path, joints, lines, (said,) if others else ())
