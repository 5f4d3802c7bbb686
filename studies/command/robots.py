"""The robot that ``identify`` writes: its URDF, and the offsets of its joints."""

from __future__ import annotations

from pathlib import Path

from calib import Cell, Identification
from calib.effects.tool_base import Tool
from calib.files.robot_out import corrected_robot, not_rigid, zero_offsets, zero_offsets_csv
from studies.render import listed


def robot_files(
    cell: Cell,
    result: Identification,
    urdf: Path | None,
    zeros: Path | None,
) -> tuple[dict[Path, str | bytes], list[str]]:
    """Texts of the files that are asked for, and lines on what they do not hold. Raises InputError."""
    texts, lines = _urdf_file(cell, result, urdf)
    if zeros is not None:
        texts[zeros], lost = _offsets_file(cell, result, zeros)
        lines += lost
    return texts, lines


def _urdf_file(
    cell: Cell, result: Identification, path: Path | None
) -> tuple[dict[Path, str | bytes], list[str]]:
    """The URDF of the corrected robot, and lines on what it does not hold. Raises InputError."""
    if path is None:
        return {}, []
    corrections = result.model.constant_displacements(result.values)
    every = dict(zip(result.model.marker_names, result.marker_positions, strict=True))
    markers = {name: point for name, point in every.items() if name in cell.named_markers}
    flange = flange_unknown(cell, result)
    made = corrected_robot(cell, corrections, markers, path)
    lines = [f"{path}: {flange}"] if flange else []
    lines += [f"{path} {lack}" for lack in made.lacks]
    if names := not_rigid(result.model):
        lines.append(f"the robot written is rigid, without {', '.join(names)}")
    return {path: _headed(made.text, flange)}, lines


def flange_unknown(cell: Cell, result: Identification) -> str:
    """What a written robot knows of its flange where only markers were measured; "" with known markers.

    Where the markers sit on the flange is found together with the arm, so that a flange that is moved
    and markers that are moved back read alike.
    """
    if not result.model.where(Tool).size:
        return ""
    robot, markers = result.model.robot, cell.named_markers
    tips = listed(robot.tips)
    where = (
        f"{tips} sit on the last links: they stay"
        if robot.branched
        else f"{tips} sits on the last link: it stays"
    )
    return (
        f"only the markers ({listed(markers)}) are calibrated. The readings do not show where "
        f"{where} nominal. Program to the markers, or measure markers whose places on {tips} are known"
    )


def _headed(text: str, comment: str) -> str:
    """An XML text with a comment below its declaration."""
    first, rest = text.split("\n", 1)
    safe = comment.replace("--", "__")
    return f"{first}\n<!-- {safe} -->\n{rest}" if comment else text


def _offsets_file(cell: Cell, result: Identification, path: Path) -> tuple[str, list[str]]:
    """The table of zero offsets, and how much of the identified geometry it is. Raises InputError."""
    corrections = result.model.constant_displacements(result.values)
    frames = result.model.marker_frames
    offsets = zero_offsets(cell.robot, corrections, result.marker_positions, frames)
    lost = (
        f"{path} holds zero offsets alone: of the geometry found, {offsets.before * 1e3:.3g} mm at the "
        f"markers, {offsets.after * 1e3:.3g} mm stay (RMS, base fitted)"
    )
    first, last = cell.robot.joints[0], cell.robot.joints[-1]
    ends = f"where base and tool are in the model, offsets of {first} and {last} are part of them"
    return zero_offsets_csv(cell.robot, offsets), [lost, ends]
