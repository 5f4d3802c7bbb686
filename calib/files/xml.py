"""Read XML that may come from anywhere: no entities, no external files, bounds on size and depth."""

from __future__ import annotations

from pathlib import Path
from xml.etree import ElementTree

from calib.errors import InputError
from calib.files.read import read_bytes

_LARGEST_FILE = 20_000_000  # bytes; a robot's file holds text, meshes lie elsewhere
_DEEPEST = 200  # levels of elements


def read_xml(path: Path, kind: str) -> ElementTree.Element:
    """The root element, its comments kept; ``kind`` names the format, URDF or MJCF.

    Raises InputError for what is not readable, not well-formed, too large or not safe.
    """
    from defusedxml import ElementTree as Safe
    from defusedxml.common import DefusedXmlException

    content = read_bytes(path, _LARGEST_FILE, f"check [robot] {kind.lower()}")
    keeps_comments = ElementTree.TreeBuilder(insert_comments=True)
    try:
        parser = Safe.XMLParser(target=keeps_comments)
        parser.feed(content)
        root: ElementTree.Element = parser.close()
    except ElementTree.ParseError as error:
        line = error.position[0]
        raise InputError(
            path, f"line {line}", f"is not well-formed XML ({error})", f"export the {kind} again"
        ) from None
    except DefusedXmlException as error:
        raise InputError(
            path,
            "",
            f"uses XML that is refused for safety ({type(error).__name__})",
            "remove the DOCTYPE and its entities",
        ) from None
    except (LookupError, ValueError):
        what = "names an encoding that cannot be read"
        raise InputError(path, "line 1", what, "save it as UTF-8") from None
    if _depth(root) > _DEEPEST:
        raise InputError(path, "", "is nested too deeply", f"export the {kind} again")
    return root


def _depth(root: ElementTree.Element) -> int:
    """Levels of elements, up to one more than any robot needs."""
    level, depth = [root], 0
    while level and depth <= _DEEPEST:
        level, depth = [child for element in level for child in element], depth + 1
    return depth
