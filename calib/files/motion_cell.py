"""Write a cell with the terms of motions in its model: the user's own file, all else as it stands."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from calib.files.cell_out import document_of, write_paths
from calib.motion.diagnose import MotionDiagnosis
from calib.motion.effects import INERTIALS, PAYLOAD


def cell_with_terms(found: MotionDiagnosis, target: Path) -> tuple[str, list[str]]:
    """The text of a cell file whose model has what was found too, and the entries that are new.

    target : where it is to be written; files are named as seen from there

    Raises InputError where the cell file cannot be read any more.
    """
    import tomlkit

    places = dict[str, list[str]]()
    for cause in found.causes:
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
