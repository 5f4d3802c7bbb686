"""Frames of recordings: those of one body at one pose as their mean."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from calib.arm.se3 import inverse, nearest_rotation, so3_log
from calib.arrays import Array
from calib.files.exports.bodies import pose_of_texts, pose_texts
from calib.files.exports.matching import NamedPoint


def averaged(points: Sequence[NamedPoint]) -> tuple[list[NamedPoint], list[str]]:
    """The mean of the frames of every body at every pose, and what is said of their scatter."""
    groups: dict[tuple[str, str], list[NamedPoint]] = {}
    for own in points:
        groups.setdefault((own.pose, own.marker), []).append(own)
    counts = [len(group) for group in groups.values()]
    if max(counts) == 1:
        return list(points), []
    found, apart = [], []
    for group in groups.values():
        mean, *scatter = _mean(np.array([pose_of_texts(own.point.values) for own in group]))
        point = replace(group[0].point, values=pose_texts(mean))
        found.append(replace(group[0], point=point))
        apart.append(scatter)
    mm, mrad = 1e3 * np.array(apart).T
    worst = found[
        int(np.argmax(mm / mm.max() + mrad / mrad.max() if mm.max() * mrad.max() else mm))
    ]
    most = f"{mm.max():.2g} mm, {mrad.max():.2g} mrad at most, as at pose {worst.pose[:40]}"
    few = f"{min(counts)} to {max(counts)}" if min(counts) < max(counts) else f"{max(counts)}"
    typical = f"{np.median(mm):.2g} mm and {np.median(mrad):.2g} mrad (RMS, median of the poses)"
    return found, [f"{few} frames of a pose are averaged; they scatter by {typical}; {most}"]


def _mean(frames: Array) -> tuple[Array, float, float]:
    """The mean of frames (n, 4, 4), and their RMS distance from it, m and rad."""
    mean = np.eye(4)
    mean[:3, :3] = nearest_rotation(frames[:, :3, :3].mean(axis=0))
    mean[:3, 3] = frames[:, :3, 3].mean(axis=0)
    off = inverse(mean) @ frames
    return mean, _rms(off[:, :3, 3]), _rms(so3_log(off[:, :3, :3]))


def _rms(vectors: Array) -> float:
    return float(np.sqrt((vectors**2).sum(axis=1).mean()))
