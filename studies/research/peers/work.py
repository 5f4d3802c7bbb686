"""The work that every program gets: a real arm's readings, the held-out ones kept back.

The arm is ``irb120_faro`` of POSECAL_DATA. Its links' masses are not known; where a compliance is asked
for, both programs that have one get the same assumed ones, since gravity's torque needs some.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from calib.arrays import Array
from calib.files.write import json_text, write_files
from calib.files.write_tables import measurements_csv
from studies.research.bench import data_folder, real_data

NAME, FIT = "irb120_faro", 100
MASSES = (3.1, 3.9, 2.9, 1.3, 0.5, 0.1)  # kg, assumed, of the links that the joints move
COMPLIANT = ("joint_2", "joint_3", "joint_5")  # those that gravity loads


@dataclass(frozen=True, eq=False)
class Work:
    """fit, heldout : points, shape (n, markers, 3), m; the latter are written nowhere."""

    folder: Path
    fit: Array
    heldout: Array

    def errors_mm(self, predicted: dict[str, Any], table: str) -> Array:
        """Length of each error, shape (n, markers); of the first markers if fewer are predicted."""
        own = np.asarray(predicted[table])
        return np.asarray(
            1e3 * np.linalg.norm(own - getattr(self, table)[:, : own.shape[1]], axis=-1)
        )


def write_work(folder: Path, fit: int = FIT, enough_s: float = 20.0) -> Work:
    """Write the files of the work; ``fit`` poses in order of a draw, the others are held out.

    enough_s : s after which a run is not repeated
    """
    source, (cell, data) = data_folder(NAME), real_data(NAME)
    order = np.random.default_rng(0).permutation(len(data))
    given, kept = data.take(np.sort(order[:fit])), data.take(np.sort(order[fit:]))
    joints = list(cell.robot.joints)
    markers = dict(zip(cell.marker_names, cell.markers, strict=True))
    effects = ['"base"', '"tool"', '"geometry"']
    ways = {
        "full geometry": ("geometry.toml", effects),
        "full geometry, compliance": (
            "compliance.toml", [*effects, f'"joint_compliance:{",".join(COMPLIANT)}"']
        ),
    }  # fmt: skip
    work = {
        "name": NAME, "tip": cell.robot.tip, "base": cell.robot.base, "joints": joints,
        "markers": markers, "compliant": COMPLIANT, "enough_s": enough_s,
        "cells": [{"cell": name, "way": way} for way, (name, _) in ways.items()],
    }  # fmt: skip
    text = (source / "cell.toml").read_text().split("[model]")[0]
    text = text.replace("irb120.urdf", "robot.urdf")
    wide = np.column_stack([given.poses.q, given.points.reshape(fit, -1)])
    coordinates = (f"{axis}{k + 1}" for k in range(len(markers)) for axis in "xyz")
    files: dict[Path, str | bytes] = {
        folder / "work.json": json_text(work),
        folder / "robot.urdf": _with_masses(source / "irb120.urdf"),
        folder / "fit.csv": _table([*joints, *coordinates], wide),
        folder / "heldout.csv": _table(joints, kept.poses.q),
        folder / "targets.csv": _table([f"{name}_rad" for name in joints], kept.poses.q),
        folder / "measurements.csv": measurements_csv(cell, given),
        **{
            folder / name: f"{text}[model]\neffects = [{', '.join(e)}]\n"
            for name, e in ways.values()
        },
    }
    folder.mkdir(parents=True, exist_ok=True)
    write_files(files)
    return Work(folder, given.points, kept.points)


def _table(head: list[str], rows: Array) -> str:
    return "\n".join([",".join(head), *(",".join(map(repr, row)) for row in rows.tolist()), ""])


def _with_masses(urdf: Path) -> str:
    """The arm with the assumed masses halfway to each link's next joint."""
    robot = ET.parse(urdf).getroot()  # noqa: S314
    joints = {j.find("parent").get("link"): j for j in robot.iter("joint")}  # type: ignore[union-attr]
    for k, mass in enumerate(MASSES, 1):
        link = robot.find(f"link[@name='link_joint_{k}']")
        assert link is not None  # noqa: S101
        ahead = joints[link.get("name")].find("origin")
        assert ahead is not None  # noqa: S101
        half = " ".join(str(float(x) / 2) for x in (ahead.get("xyz") or "0 0 0").split())
        own = ET.SubElement(link, "inertial")
        ET.SubElement(own, "origin", xyz=half, rpy="0 0 0")
        ET.SubElement(own, "mass", value=str(mass))
        ET.SubElement(own, "inertia", ixx="0.01", iyy="0.01", izz="0.01", ixy="0", ixz="0", iyz="0")
    return ET.tostring(robot, encoding="unicode")
