"""Meshes of an MJCF that give a body its mass; no other shape is read."""

from __future__ import annotations

from pathlib import Path
from xml.etree.ElementTree import Element

from calib.errors import InputError
from calib.files.mjcf_tree import Chain, compiler_settings, inside, label

_LARGEST_FILE = 200_000_000  # bytes


def mesh_files(path: Path, root: Element, stripped: Chain) -> dict[str, bytes]:
    """Contents by the names that the stripped file then has for them; other assets are taken out.

    Raises InputError where a mesh is missing that gives a body its mass.
    """
    settings = compiler_settings(root)
    folder = path.parent / settings.get("meshdir", settings.get("assetdir", ""))
    used = {geom.get("mesh") for geom in stripped.root.iter("geom")}
    contents: dict[str, bytes] = {}
    for section in stripped.root.findall("asset"):
        for asset in list(section):
            given = asset.get("file", "")
            name = asset.get("name", Path(given.replace("\\", "/")).stem)
            if asset.tag != "mesh" or name not in used:
                section.remove(asset)
            elif given:
                stands = Path(given).name if settings.get("strippath") == "true" else given
                key = f"{len(contents)}{Path(given).suffix}"
                contents[key] = _content(path, folder / stands, name, stripped)
                asset.set("name", name)
                asset.set("file", key)
    return contents


def _content(path: Path, file: Path, name: str, stripped: Chain) -> bytes:
    try:
        if not file.is_file() or file.stat().st_size > _LARGEST_FILE:
            raise OSError
        return file.read_bytes()
    except (OSError, ValueError):
        bodies = (
            body for world in stripped.root.findall("worldbody") for body in world.iter("body")
        )
        user = next(b for b in bodies if any(e.get("mesh") == name for e in inside(b)))
        raise InputError(
            path,
            label(user),
            f"takes its mass from mesh {name!r}, and {file} cannot be read",
            "bring the file, or give the body an <inertial>",
        ) from None
