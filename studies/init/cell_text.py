"""The text of a first cell: what the robot's file tells filled in, what it cannot tell marked EDIT."""

from __future__ import annotations

import json
import re

import numpy as np

from calib.arm.repeatability import usual_repeatability
from calib.arm.robot import Robot
from calib.files.csv_table import csv_text
from calib.files.proposal import Proposal
from calib.files.write_tables import measurement_columns
from calib.instruments import Tracker

_MARKERS = ((1.0, 0.0, 0.5), (-0.5, 0.87, 0.5), (-0.5, -0.87, 0.5))  # of the circle they stand on


def cell_text(found: Proposal, robot_file: str, name: str) -> str:
    """TOML with comments, which loads as it is.

    robot_file : the robot's file as seen from the cell
    """
    robot = found.robot
    said = robot.source.convention
    convention = f'dh_convention = "{said}"\n' if said else ""
    return f"""\
# A measurement cell, proposed by `posecal init`. Edit the lines marked EDIT.
schema = 1
name = {_text(name)}

[robot]
{found.form} = {_text(robot_file)}
{convention}\
base = {_text(robot.base):<23} # frame of gravity, obstacles and the instrument's position
tip = {_text(robot.tip):<24} # frame of markers, payload and load
{_repeatability(robot)}
{_limits(robot)}
[markers_mm]                   # EDIT: rough positions of the reflectors, in the tip frame. Use three or
                               # more, far apart, not in a line. The data give their exact positions.
{_markers(robot)}
[instrument]
sigma_mm = 0.010               # EDIT: one standard deviation of one coordinate; or by range:
# sigma_mm = {{ range_mm = 0.003, transverse_mm = 0.004, transverse_mm_per_m = 0.0015 }}
# sigma_mm = {{ mpe_mm = 0.015, mpe_mm_per_m = 0.006, divisor = 2 }}   # std = MPE / divisor
# position_mm = [4000, 0, 1500]  # rough position, base frame: for line of sight and range

# [gravity]                    # base frame; EDIT if the base is not upright
# m_s2 = [0, 0, -9.80665]

# [payload]                    # carried at every pose
# mass_kg = 2.5
# com_mm = [0, 0, 60]          # tip frame

# [load]                       # test load for a second reading of every pose: shows compliances
# mass_kg = 10.0
# com_mm = [100, 0, 100]

[design]                       # what `posecal design` chooses
poses = 30                     # EDIT: as many as you can measure in a day
# targets = "targets.csv"      # target poses: joint columns, optional weight
# targets_after_h = 1.0        # hours from the last reading to the work at the targets
# floor_mm = 0.0               # the arm stays above it (posecal explain constraints)
# [[design.obstacle]]          # needs the arm's shape: that of a URDF, or [robot.capsules_mm]
# type = "halfspace"           # its normal points to the forbidden side
# point_mm = [0, 900, 0]
# normal = [0, 1, 0]

[model]                        # what is to be identified
effects = ["base", "tool", "geometry"]
# add "joint_compliance" where {
        "the arm bends under its own weight, payload or load"
        if robot.masses.any()
        else "a load, payload or wrench bends the arm"
    }
"""


def table_header(robot: Robot) -> str:
    """An empty ``measurements.csv`` with the columns that every table has."""
    return csv_text(measurement_columns(robot, (Tracker(),)), [])


def _text(text: str) -> str:
    """A TOML string: its escapes are those of JSON."""
    return json.dumps(text)


def _key(name: str) -> str:
    return name if re.fullmatch(r"[A-Za-z0-9_-]+", name) else _text(name)


def _repeatability(robot: Robot) -> str:
    """What arms of this size have by data sheets, marked as assumed."""
    usual = usual_repeatability(robot.reach)
    low, middle, high = (_rough(1e3 * std) for std in (usual.best, usual.middle, usual.worst))
    turn = _rough(1e6 * usual.middle / (0.5 * robot.reach))  # of joints, at half the arm's length
    return f"""\
# EDIT: the arm's repeatability, ASSUMED: data sheets of arms of this reach give {low} to {high} mm.
# Write RP / 3.6, with RP from its data sheet. Left out, `posecal design` plans repeat visits of some
# poses, which measure it.
{f"repeatability_mm = {middle}":<30} # assumed: one standard deviation of one coordinate of the tip
{f"repeatability_urad = {turn}":<30} # assumed: of one component of its rotation"""


def _rough(x: float) -> str:
    """One digit."""
    return f"{float(f'{x:.1g}'):g}"


def _limits(robot: Robot) -> str:
    """Tables of limits to be filled in, for joints that have none; an example for those that do."""
    lines = []
    missing = [not np.isfinite(own).all() for own in robot.limits]
    for slides, table, width in ((False, "limits_deg", 180), (True, "limits_mm", 1000)):
        joints = [
            joint
            for joint, own, lacks in zip(robot.joints, robot.prismatic, missing, strict=True)
            if bool(own) is slides and lacks
        ]
        if joints:
            lines += ["", f"# [robot.{table}]           # EDIT: none given; plans use these"]
            lines += [f"# {_key(joint)} = [-{width}, {width}]" for joint in joints]
    if not lines:
        table, width = ("limits_mm", 500) if robot.prismatic[0] else ("limits_deg", 90)
        lines = [
            "",
            f"# [robot.{table}]           # narrower than the robot's own, where the cell is",
            f"# {_key(robot.joints[0])} = [-{width}, {width}]",
        ]
    return "\n".join([*lines, ""])


def _markers(robot: Robot) -> str:
    size = float(np.clip(round(robot.reach * 1e3 / 20, -1), 20, 150))  # mm
    places = [f"[{', '.join(f'{size * x:g}' for x in place)}]" for place in _MARKERS]
    rows = [f"m{j} = {place}" for j, place in enumerate(places, 1)]
    rows += [
        f"{_key(f'{link}_{j}')} = {{ position = {place}, on = {_text(link)} }}"
        for link in robot.others
        for j, place in enumerate(places, 1)
    ]
    return "\n".join([*rows, ""])
