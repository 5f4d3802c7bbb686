"""Read XML that may come from anywhere: no entities, no external files, a bound on the size."""

from __future__ import annotations

from pathlib import Path
from xml.etree import ElementTree

from calib.errors import InputError

_LARGEST_FILE = 20_000_000  # bytes; a robot's file holds text, meshes lie elsewhere


def read_xml(path: Path, kind: str) -> ElementTree.Element:
    """The root element, its comments kept; ``kind`` names the format, URDF or MJCF.

    Raises InputError for what is not readable, not well-formed, too large or not safe.
    """
    from defusedxml import ElementTree as Safe
    from defusedxml.common import DefusedXmlException

    try:
        if not path.is_file() and path.exists():
            raise InputError(path, "", "is no file", f"check [robot] {kind.lower()}")
        size = path.stat().st_size
    except OSError as error:
        raise InputError(
            path, "", f"cannot be read ({error.strerror})", f"check [robot] {kind.lower()}"
        ) from None
    if size > _LARGEST_FILE:
        raise InputError(path, "", f"is {size / 1e6:.0f} MB, too large for a {kind}")
    keeps_comments = ElementTree.TreeBuilder(insert_comments=True)
    try:
        root: ElementTree.Element = Safe.parse(
            path, Safe.XMLParser(target=keeps_comments)
        ).getroot()
    except ElementTree.ParseError as error:
        line = error.position[0]
        raise InputError(
            path, f"line {line}", f"is not well-formed XML ({error})", f"export the {kind} again"
        ) from None
    except (DefusedXmlException, ValueError) as error:
        raise InputError(
            path,
            "",
            f"uses XML that is refused for safety ({type(error).__name__})",
            "remove the DOCTYPE and its entities",
        ) from None
    except OSError as error:
        raise InputError(path, "", f"cannot be read ({error.strerror})") from None
    return root
