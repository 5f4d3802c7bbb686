"""Every key of the cell: its form from the schema, its meaning told here."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from typing import Any

MEANINGS = {
    "schema": "version of this format",
    "name": "of the cell, before every result",
    "robot.urdf": "the robot's file, beside the cell; one of urdf, mjcf, dh, kinematics",
    "robot.mjcf": "a MuJoCo model (posecal explain robots)",
    "robot.dh": "a Denavit-Hartenberg table (posecal explain robots)",
    "robot.dh_convention": "which product its rows mean",
    "robot.kinematics": "a maker's YAML (posecal explain robots)",
    "robot.base": "first link: frame of gravity, obstacles and the instrument's position",
    "robot.tip": "last link: frame of markers, payload and load",
    "robot.repeatability_mm": "of the arm from approach to approach: one standard deviation of one coordinate of the tip",
    "robot.repeatability_urad": "the same of one component of its rotation",
    "robot.limits_deg": "narrower limits of joints that turn",
    "robot.limits_mm": "narrower limits of joints that slide",
    "robot.capsules_mm": "shapes of joints, base and tool (posecal explain constraints)",
    "robot.capsules_mm.NAME[].from": "one end of the axis, in the frame that turns with the joint; of base in the base's, of tool in the tip's",
    "robot.capsules_mm.NAME[].to": "the other end",
    "robot.capsules_mm.NAME[].radius": "of the capsule",
    "robot.compensators_mm": "springs of gravity_compensator, by joint",
    "robot.compensators_mm.NAME.before": "anchor on the link before the joint, from the joint's origin",
    "robot.compensators_mm.NAME.after": "anchor on the link after it",
    "robot.gear_ratio": "turns of the motor, or of the wave generator, a turn of the joint: gear_ripple is searched there alone",
    "markers_mm": "reference points in the tip frame, first guesses: position alone, or a table",
    "markers_mm.NAME.position": "of the marker",
    "markers_mm.NAME.normal": "in which it looks, for line of sight",
    "markers_mm.NAME.acceptance_deg": "how far the instrument may stand beside the normal",
    "bodies": "frames on the tip that an instrument of kind pose reads",
    "bodies.NAME.position_mm": "first guess in the tip frame",
    "bodies.NAME.rpy_deg": "first guess of its turn: roll, pitch, yaw",
    "boards": "known shapes that cameras see",
    "boards.NAME.position_mm": "first guess, in the tip frame or the world",
    "boards.NAME.rpy_deg": "first guess of its turn: roll, pitch, yaw",
    "boards.NAME.on": "where it is fixed",
    "boards.NAME.points_mm": "points by name, in the board's frame",
    "boards.NAME.squares": "squares of a chequered board, across and down: points are its inner corners, row by row",
    "boards.NAME.pitch_mm": "edge of a square",
    "instrument.sigma_mm": "one standard deviation of one coordinate; or by range; or from a maximum permissible error",
    "instrument.sigma_mm.range_mm": "standard deviation along the beam",
    "instrument.sigma_mm.transverse_mm": "across it",
    "instrument.sigma_mm.range_mm_per_m": "its growth along the beam a metre of range",
    "instrument.sigma_mm.transverse_mm_per_m": "its growth across",
    "instrument.sigma_mm.mpe_mm": "maximum permissible error",
    "instrument.sigma_mm.mpe_mm_per_m": "its growth a metre of range",
    "instrument.sigma_mm.divisor": "standard deviation = maximum permissible error / divisor",
    "instrument.position_mm": "where it stands, in the base's frame, for range and line of sight; else ranges count from the readings' origin",
    "instruments": "several, or other kinds; rows of the table name theirs",
    "instruments.NAME.kind": "what it reads (posecal explain instruments)",
    "instruments.NAME.sigma_mm": "one standard deviation of a length; of kind points as under [instrument]",
    "instruments.NAME.position_mm": "where it stands, in the base's frame",
    "instruments.NAME.sigma_urad": "of a pose: one standard deviation of a component of its rotation",
    "instruments.NAME.covariance": "of a pose, in place of both: 6 x 6, mm and urad, body axes",
    "instruments.NAME.rpy_deg": "of a camera: its turn, z ahead and x to the right of the image",
    "instruments.NAME.on": "of a camera: where it is fixed",
    "instruments.NAME.focal_px": "of a camera: focal length, one or two",
    "instruments.NAME.center_px": "of a camera: principal point",
    "instruments.NAME.distortion": "of a camera: k1 k2 p1 p2 k3, as OpenCV",
    "instruments.NAME.image_px": "of a camera: size of its image",
    "instruments.NAME.sigma_px": "of a camera: one standard deviation of a coordinate",
    "instruments.NAME.free": "of a camera: what of the lens is identified",
    "instruments.NAME.intrinsics_std": "of a camera: how well its lens is known; a list is fx fy cx cy k1 k2 p1 p2 k3",
    "instruments.NAME.intrinsics_std.focal_px": "standard deviation of the focal length",
    "instruments.NAME.intrinsics_std.center_px": "standard deviation of the principal point",
    "instruments.NAME.intrinsics_std.distortion": "standard deviation of the coefficients",
    "instruments.NAME.anchor_mm": "of a distance: where it is measured from; found if absent",
    "instruments.NAME.offset": "of a distance: whether a constant is added to it",
    "instruments.NAME.radius_mm": "of a sphere; found if absent",
    "known_distances": "lengths that hold two sockets or two markers apart",
    "known_distances[].between": "their names",
    "known_distances[].mm": "the length",
    "known_distances[].sigma_mm": "its standard deviation",
    "gravity.m_s2": "in the base's frame",
    "payload.mass_kg": "carried at every pose",
    "payload.com_mm": "its centre of mass, tip frame",
    "load.mass_kg": "hung on for a plan's second reading of each pose; measured data bring theirs as wrench",
    "load.com_mm": "where it hangs, tip frame",
    "load.max_tilt_deg": "how far the tip's x axis may leave the horizontal",
    "design.poses": "how many",
    "design.levels": "angles of one joint that a plan shares among poses",
    "design.levels.NAME.poses_per_level": "poses at each",
    "design.levels.NAME.count": "how many levels, to be chosen",
    "design.levels.NAME.min_separation_deg": "between levels that are chosen",
    "design.levels.NAME.values_deg": "levels that are given",
    "design.targets": "table of target poses (posecal explain targets)",
    "design.repeats": "whether a pose may be chosen twice",
    "design.reference_every": "one pose is read again after so many",
    "design.reapproaches": "so many poses are visited again after the others",
    "design.obstacle": "bodies that the arm must not touch (posecal explain constraints)",
    "design.obstacle[].type": "its form",
    "design.obstacle[].center_mm": "of a box or a sphere, base frame",
    "design.obstacle[].size_mm": "of a box: its edges",
    "design.obstacle[].rpy_deg": "of a box: its turn",
    "design.obstacle[].radius_mm": "of a sphere",
    "design.obstacle[].point_mm": "of a halfspace: a point of its plane",
    "design.obstacle[].normal": "of a halfspace: towards the forbidden side",
    "diagnosis.exclude": "causes that this robot cannot have: name or name:where",
    "model.effects": "what is identified (posecal explain effects)",
    "model.knots_deg": "angles at which stiffness_vs_angle has a coefficient, by joint; else the plan's levels, or those of the data",
}  # fmt: skip
"""What each key means. ``NAME`` is the user's; ``[]`` an entry of a list of tables."""

_ABOVE = ("schema", "name")
_TOLD = "instruments.NAME.sigma_mm."  # as under [instrument]
_WORDS = {
    "number": "number",
    "integer": "whole number",
    "string": "text",
    "boolean": "true or false",
}


TABLES = (
    "robot", "markers_mm", "instrument", "instruments", "bodies", "boards", "known_distances", "gravity",
    "payload", "load", "design", "diagnosis", "model",
)  # fmt: skip


def rows(table: str) -> list[tuple[str, str, str]]:
    """Key, form and meaning of every key of a table; of those above all tables for an empty name."""
    return [
        (key.removeprefix(table).lstrip("[].") or table, " or ".join(found), MEANINGS[key])
        for key, found in forms().items()
        if table == ("" if key in _ABOVE else re.split(r"\W", key)[0])
    ]


def forms() -> dict[str, dict[str, None]]:
    """What may stand at every key of the cell, from its schema."""
    from calib.files.schema import CellFile

    schema = CellFile.model_json_schema()
    found: dict[str, dict[str, None]] = {}
    for key, form in _keys(schema, schema["$defs"], ""):
        found.setdefault(key, {})[form] = None
    return {key: own for key, own in found.items() if not key.startswith(_TOLD)}


def keys_of_instrument(kind: str) -> tuple[str, ...]:
    """Keys of ``[instruments.NAME]`` of one kind."""
    from calib.files.schema import CellFile

    schema = CellFile.model_json_schema()
    named = schema["properties"]["instruments"]["additionalProperties"]["discriminator"]
    table = schema["$defs"][named["mapping"][kind].rpartition("/")[2]]
    return tuple(key for key in table["properties"] if key != "kind")


def _keys(schema: Any, known: dict[str, Any], path: str) -> Iterator[tuple[str, str]]:
    """Keys and forms below a path, every choice in turn."""
    if "$ref" in schema:
        schema = known[schema["$ref"].rpartition("/")[2]]
    for choice in schema.get("anyOf", schema.get("oneOf", ())):
        yield from _keys(choice, known, path)
    dot = f"{path}." if path else ""
    if "properties" in schema:
        for key, own in schema["properties"].items():
            yield from _keys(own, known, f"{dot}{key}")
    elif isinstance(own := schema.get("additionalProperties"), dict):
        inner = [*_keys(own, known, f"{dot}NAME")]
        yield path, f"by name: {_either(form for key, form in inner if key == f'{dot}NAME')}"
        yield from (pair for pair in inner if pair[0] != f"{dot}NAME")
    elif schema.get("type") == "array" and "$ref" in str(schema.get("items")):
        yield path, "list of tables"
        yield from _keys(schema["items"], known, f"{path}[]")
    elif form := _form(schema):
        yield path, form


def _either(forms: Iterator[str]) -> str:
    return " or ".join(dict.fromkeys(forms)) or "table"


def _form(schema: Any) -> str:
    """What stands at a key that holds no table; nothing where it may be left out."""
    choices = [schema["const"]] if "const" in schema else schema.get("enum", [])
    if choices:
        return ", ".join(map(json.dumps, choices))
    if schema.get("type") == "array":
        many = len(schema.get("prefixItems", ()))
        return f"list of {many}" if many else "list"
    return _WORDS.get(schema.get("type", ""), "")
