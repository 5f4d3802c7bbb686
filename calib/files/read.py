"""Open what a user names: a regular file of bearable size, read whole; XML without entities."""

from __future__ import annotations

import math
import stat
from pathlib import Path
from xml.etree import ElementTree

from calib.errors import InputError

ORDER = "give the files in the order that --help shows"
"""What to do with a file that is of another kind than its place in the call."""


def check_file(path: Path, largest: float = math.inf, remedy: str = "check the path") -> None:
    """Refuse what is no regular file, or larger than so many bytes.

    A pipe or a device may never end, and its content could not be hashed for the result.

    Raises InputError.
    """
    try:
        found = path.stat()
    except OSError as error:
        raise InputError(path, "", f"cannot be read ({error.strerror})", remedy) from None
    except ValueError:  # a NUL, or half a character
        raise InputError(path, "", "is no name of a file", remedy) from None
    if stat.S_ISDIR(found.st_mode):
        raise InputError(path, "", "cannot be read (is a folder)", remedy)
    if not stat.S_ISREG(found.st_mode):
        raise InputError(path, "", "is a pipe or a device", "write its content to a file first")
    if found.st_size > largest:
        size, most = (f"{count / 1e6:.0f} MB" for count in (found.st_size, largest))
        what = f"is {size}, too large (at most {most})"
        raise InputError(path, "", what, "is it the right file?")


def read_bytes(path: Path, largest: int, remedy: str = "check the path") -> bytes:
    """The content of a file. Raises InputError."""
    check_file(path, largest, remedy)
    try:
        return path.read_bytes()
    except OSError as error:
        raise InputError(path, "", f"cannot be read ({error.strerror})", remedy) from None


def read_text(path: Path, largest: int, remedy: str = "check the path") -> str:
    """The content of a file in UTF-8, without a mark of byte order. Raises InputError."""
    try:
        return read_bytes(path, largest, remedy).decode("utf-8-sig")
    except UnicodeDecodeError:
        raise InputError(path, "", "is not text in UTF-8", "save it as UTF-8") from None


def sha256(path: Path) -> str:
    """Hash of a file's content, as hexadecimal digits."""
    import hashlib

    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


_LARGEST_FILE = 20_000_000  # bytes; a robot's file holds text, meshes lie elsewhere


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
        what = f"is not well-formed XML ({error})"
        raise InputError(path, f"line {line}", what, f"export the {kind} again") from None
    except DefusedXmlException as error:
        what = f"uses XML that is refused for safety ({type(error).__name__})"
        raise InputError(path, "", what, "remove the DOCTYPE and its entities") from None
    except (LookupError, ValueError):
        what = "names an encoding that cannot be read"
        raise InputError(path, "line 1", what, "save it as UTF-8") from None
    return root
