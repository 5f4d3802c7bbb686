"""The XML of an MJCF: what it includes, and the bodies between base and tip."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from xml.etree.ElementTree import Element

from calib.errors import InputError
from calib.files.xml import read_xml

WORLD = "world"
JOINTS = ("joint", "freejoint")
_DEEPEST = 200  # elements inside one another


@dataclass(frozen=True, eq=False)
class Chain:
    """The bodies below the base up to the tip, as they stand in the file.

    root : Element, the file with its includes in place
    bodies : list of Element, none of them the base
    site : Element, the tip where it is no body
    path : set of Element, everything that the tip stands in, and itself
    """

    root: Element
    bodies: list[Element]
    site: Element | None
    path: set[Element]


def inside(element: Element) -> Iterator[Element]:
    """What stands in a body, frames opened, other bodies closed."""
    for child in element:
        yield child
        if child.tag == "frame":
            yield from inside(child)


def joints_of(body: Element) -> list[Element]:
    """The joints that move a body, in their order."""
    return [e for e in inside(body) if e.tag in JOINTS]


def compiler_settings(root: Element) -> dict[str, str]:
    """Attributes of all <compiler> elements; the last one counts."""
    return {key: value for element in root.findall("compiler") for key, value in element.items()}


def label(element: Element) -> str:
    """An element as messages name it."""
    return f"{element.tag} {element.get('name', '')!r}"


def read_mjcf(path: Path) -> tuple[Element, tuple[Path, ...]]:
    """The <mujoco> element with every <include> replaced by what it names, and the files read.

    Raises InputError for what is no safe, well-formed MJCF: includes may not leave its folder.
    """
    root = read_xml(path, "MJCF")
    if root.tag != "mujoco":
        raise InputError(path, f"<{root.tag}>", "is not an MJCF", "name a file that holds <mujoco>")
    files = [path]
    _include(files, path, root, 0)
    return root, tuple(files)


def _include(files: list[Path], here: Path, element: Element, depth: int) -> None:
    if depth > _DEEPEST:
        raise InputError(here, "", f"is nested more than {_DEEPEST} deep")
    for child in list(element):
        if child.tag != "include":
            _include(files, here, child, depth + 1)
            continue
        file = _included(files, here, child.get("file", ""))
        other = read_xml(file, "MJCF")
        files.append(file)
        _include(files, file, other, depth + 1)
        at = list(element).index(child)
        element[at : at + 1] = list(other)


def _included(files: list[Path], here: Path, name: str) -> Path:
    """The file that an <include> names, seen from the main file or else from the including one."""
    where, folder = f"include {name!r}", files[0].parent.resolve()
    try:
        file = files[0].parent / name
        if not file.is_file():
            file = here.parent / name
        whole, found = file.resolve(), file.is_file()
    except (OSError, ValueError) as error:
        raise InputError(here, where, f"cannot be read ({error})") from None
    if not whole.is_relative_to(folder):
        raise InputError(
            here, where, "leaves the folder of the model", "copy the file into that folder"
        )
    if not found:
        raise InputError(here, where, "names no file", "check its path")
    if any(whole == other.resolve() for other in files):
        raise InputError(here, where, "is included already", "include each file once")
    return file


def chain_of(path: Path, root: Element, base: str, tip: str) -> Chain:
    """The bodies from body ``base``, or the world, to body or site ``tip``. Raises InputError."""
    parents = {child: parent for parent in root.iter() for child in parent}
    worlds = root.findall("worldbody")
    bodies = [body for world in worlds for body in world.iter("body")]
    sites = [site for world in worlds for site in world.iter("site")]
    named = [name for body in bodies if (name := body.get("name"))]
    known = ", ".join([WORLD, *named[:12]])
    if base != WORLD and base not in named:
        raise InputError(path, "", f"has no body {base!r}", f"set [robot] base to one of: {known}")
    here = next((e for e in [*bodies, *sites] if e.get("name") == tip), None)
    if here is None:
        raise InputError(
            path,
            "",
            f"has no body or site {tip!r}",
            f"set [robot] tip to a site, or to one of: {', '.join(named[:12]) or 'none'}",
        )
    site = here if here.tag == "site" else None
    chain: list[Element] = []
    on_path = {here}
    found = False
    while here in parents:
        found = found or (here.tag == "body" and here.get("name") == base)
        if here.tag == "body" and not found:
            chain.append(here)
        here = parents[here]
        on_path.add(here)
    if not found and base != WORLD:
        raise InputError(
            path,
            f"tip {tip!r}",
            f"no chain of bodies leads from {base!r} to it",
            "check [robot] base and tip",
        )
    for element in on_path - {root, site, *worlds}:
        if element.tag not in ("frame", "body"):
            raise InputError(
                path,
                f"tip {tip!r}",
                f"stands in <{element.tag}>, which is not supported",
                "write its bodies down, as MuJoCo does when it saves the model",
            )
    return Chain(root, chain[::-1], site, on_path)
