"""Write a cell with more effects, or terms of motions, in its model: all else as it stands."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from calib.arm.robot import FORMS
from calib.cell import Cell
from calib.effects import Effect
from calib.effects.elastic import StiffnessVsAngle
from calib.errors import CalibError
from calib.files.read import read_text
from calib.model.build import build, parse_effect
from calib.poses import Poses

if TYPE_CHECKING:
    from tomlkit import TOMLDocument

    from calib.motion.diagnose import MotionDiagnosis

_LARGEST_FILE = 2_000_000  # bytes


@dataclass(frozen=True)
class Extended:
    """A cell file with effects added.

    text : str, TOML
    added : tuple of str, ``name:where``
    replaced : tuple of str, ``effect:where`` of what gave way to an effect that contains it
    refused : tuple of (str, str), an effect that the model cannot hold, and why
    """

    text: str
    added: tuple[str, ...]
    replaced: tuple[str, ...]
    refused: tuple[tuple[str, str], ...]


def document_of(cell: Cell) -> TOMLDocument:
    """The user's own file, with its comments. Raises InputError where it cannot be read any more."""
    import tomlkit

    return tomlkit.parse(read_text(cell.path, _LARGEST_FILE))


def extended_cell(cell: Cell, effects: Sequence[Effect], poses: Poses, target: Path) -> Extended:
    """The text of a cell file whose model has these effects too.

    Comments, order and layout stay. Files that the cell names are named as seen from the target. The
    knots of ``stiffness_vs_angle`` are written down: another table would put them elsewhere.

    effects : as found, the most important first; one that is part of another is left out
    poses : Poses, at which the effects were found; every addition is tried out on them
    target : Path, where the text is to be written

    Raises InputError where the cell file cannot be read any more.
    """
    document = document_of(cell)
    entries = [*cell.effects]
    added: list[Effect] = []
    parts, refused = list[str](), list[tuple[str, str]]()
    for effect in effects:
        if any(other.contains(effect.kind, effect.where) for other in effects):
            continue
        left = [_without(entry, effect, cell) if entry else ("", ()) for entry in entries]
        extended = [*(text for text, _ in left), _name(effect)]
        knots = _knots(cell, [*added, effect])
        try:
            build(replace(cell, effects=tuple(filter(None, extended)), knots=knots), poses)
        except CalibError as error:
            refused.append((_name(effect), str(error)))
            continue
        entries = extended
        added.append(effect)
        parts += [part for _, gone in left for part in gone]
    _write_effects(document, entries)
    _write_knots(document, cell, added)
    write_paths(document, cell.path.parent, target.parent)
    names = tuple(map(_name, added))
    return Extended(document.as_string(), names, tuple(parts), tuple(refused))


def _name(effect: Effect) -> str:
    return f"{effect.kind}:{effect.where}"


def _without(entry: str, effect: Effect, cell: Cell) -> tuple[str, tuple[str, ...]]:
    """An entry of the model without what is part of the effect, which may leave nothing; and that."""
    name, given = parse_effect(entry)
    places = cell.robot.joints if given is None else given
    gone = tuple(place for place in places if effect.contains(name, place))
    left = [place for place in places if place not in gone]
    text = entry if not gone else f"{name}:{','.join(left)}" if left else ""
    return text, tuple(f"{name}:{place}" for place in gone)


def _knots(cell: Cell, added: Sequence[Effect]) -> dict[str, Any]:
    found = {e.where: e.knots for e in added if isinstance(e, StiffnessVsAngle)}
    return found | dict(cell.knots)


def _write_effects(document: TOMLDocument, entries: list[str]) -> None:
    """Change what differs and append what is new: comments between the entries stay."""
    array: Any = document["model"]["effects"]
    count = len(array)
    for place in reversed(range(count)):
        if not entries[place]:
            del array[place]
        elif entries[place] != array[place]:
            array[place] = entries[place]
    for entry in entries[count:]:
        array.append(entry)


def _write_knots(document: TOMLDocument, cell: Cell, added: Sequence[Effect]) -> None:
    import tomlkit
    from tomlkit.items import InlineTable

    model: Any = document["model"]
    for joint, knots in _knots(cell, added).items():
        if joint in cell.knots:
            continue
        if "knots_deg" not in model:
            inline = isinstance(model, InlineTable)
            model["knots_deg"] = tomlkit.inline_table() if inline else tomlkit.table()
        model["knots_deg"][joint] = np.round(np.degrees(knots), 6).tolist()


def write_paths(document: TOMLDocument, source: Path, target: Path) -> None:
    """Name files relative to the new folder; absolute names hold anywhere."""
    for name, key in (*(("robot", form) for form in FORMS), ("design", "targets")):
        table: Any = document.get(name, {})
        given = table.get(key)
        if given is None or Path(given).is_absolute() or source.resolve() == target.resolve():
            continue
        file = source / given
        seen = os.path.relpath(file.parent.resolve() / file.name, target.resolve())
        table[key] = Path(seen).as_posix()


def cell_with_terms(found: MotionDiagnosis, target: Path) -> tuple[str, list[str]]:
    """The text of a cell file whose model has what was found too, and the entries that are new.

    target : where it is to be written; files are named as seen from there

    Raises InputError where the cell file cannot be read any more.
    """
    import tomlkit

    from calib.motion.effects import INERTIALS, PAYLOAD

    places = dict[str, list[str]]()
    for cause in found.fitted_causes:
        places.setdefault(cause.effect, []).append(cause.where)
    added = [
        kind
        if kind in (PAYLOAD, INERTIALS) or len(joints) == found.cell.robot.dof
        else f"{kind}:{','.join(joints)}"
        for kind, joints in places.items()
    ]
    document = document_of(found.cell)
    model: Any = document.setdefault("model", tomlkit.table())
    for entry in added:
        model.setdefault("effects", tomlkit.array()).append(entry)
    write_paths(document, found.cell.path.parent, target.parent)
    return document.as_string(), added
