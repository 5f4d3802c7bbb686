"""The XML of an MJCF: its includes, the bodies on the ways to tips, and what of it MuJoCo is given."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from xml.etree.ElementTree import Element, SubElement

from calib.errors import InputError
from calib.files.read import read_xml

WORLD = "world"
JOINTS = ("joint", "freejoint")
_DEEPEST = 200  # elements inside one another
_WRITE_DOWN = "write its bodies down, as MuJoCo does when it saves the model"


@dataclass(frozen=True, eq=False)
class Chain:
    """The bodies below the base up to the tips, as they stand in the file.

    root : Element, the file with its includes in place
    bodies : list of Element, none of them the base: those on the way to the tip, then to the others
    tips : dict, name -> Tip, the tip first
    path : set of Element, everything that tips stand in, and themselves
    """

    root: Element
    bodies: list[Element]
    tips: dict[str, Tip]
    path: set[Element]


@dataclass(frozen=True, eq=False)
class Tip:
    """The body, None for the base, that is a tip or holds it; and the site, where it is one."""

    body: Element | None
    site: Element | None


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
        remedy = "copy the file into that folder"
        raise InputError(here, where, "leaves the folder of the model", remedy)
    if not found:
        raise InputError(here, where, "names no file", "check its path")
    if any(whole == other.resolve() for other in files):
        raise InputError(here, where, "is included already", "include each file once")
    return file


def chain_of(path: Path, root: Element, base: str, tip: str, others: Sequence[str] = ()) -> Chain:
    """The bodies from body ``base``, or the world, to body or site ``tip``, and to other tips.

    Raises InputError.
    """
    keys = {tip: "[robot] tip"} | dict.fromkeys(others, "'on' of what it carries")
    bodies: dict[Element, None] = {}
    tips: dict[str, Tip] = {}
    on_path: set[Element] = set()
    for name, key in keys.items():
        way, site, own = _way(path, root, base, name, key)
        bodies |= dict.fromkeys(way)
        tips[name] = Tip(way[-1] if way else None, site)
        on_path |= own
    return Chain(root, [*bodies], tips, on_path)


def _way(
    path: Path, root: Element, base: str, tip: str, key: str
) -> tuple[list[Element], Element | None, set[Element]]:
    """Bodies on the way to one tip, the site that it is, and all that it stands in.

    key : of the cell, by which it is named
    """
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
        known = ", ".join(named[:12]) or "none"
        remedy = f"set {key} to a site, or to one of: {known}"
        raise InputError(path, "", f"has no body or site {tip!r}", remedy)
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
        what = f"no chain of bodies leads from {base!r} to it"
        raise InputError(path, f"tip {tip!r}", what, "check [robot] base and tip")
    for element in on_path - {root, site, *worlds}:
        if element.tag not in ("frame", "body"):
            what = f"stands in <{element.tag}>, which is not supported"
            raise InputError(path, f"tip {tip!r}", what, _WRITE_DOWN)
    return chain[::-1], site, on_path


_DEFAULTS = ("default", "joint", "geom", "site", "mesh")
_CONTENT = ("inertial", "site")
# These make bodies that the file does not list.
_BY_RULE = ("attach", "replicate", "composite", "flexcomp")
_ENDS = {f"{tag}{n}": tag for tag in ("joint", "body", "site") for n in (1, 2)}
_NOT_USED = ("settotalmass", "discardvisual", "strippath", "meshdir", "texturedir", "assetdir")


@dataclass(frozen=True, eq=False)
class Part:
    """What of a file MuJoCo is given: the chain and what gives it mass.

    root : Element, a file of its own; meshes : dict, contents of the files that it names
    names : dict, body of the chain -> its name there
    """

    root: Element
    meshes: dict[str, bytes]
    names: dict[Element, str]


def part_of(path: Path, chain: Chain) -> Part:
    """A copy of the chain and of what hangs on it.

    What hangs on the chain by joints of its own loses them: it is carried as it is drawn.

    Raises InputError for what makes no serial chain of independent joints, and where a mesh is missing
    that gives a body its mass.
    """
    carried, branches = _attached(path, chain)
    _refuse_coupled(path, chain.root, [*chain.bodies, *carried], branches)
    settings = compiler_settings(chain.root)
    if not settings.get("settotalmass", "-1").strip().startswith("-"):
        what = "scales the masses of everything in the file"
        remedy = "give each body its own mass and remove it"
        raise InputError(path, "compiler settotalmass", what, remedy)
    kept = chain.path | {*carried, *branches}
    from_geoms = settings.get("inertiafromgeom", "auto")
    names: dict[Element, str] = {}

    def copied(element: Element, content: tuple[str, ...]) -> Element:
        """A body, frame or world with those of its elements that count; none before the chain."""
        copy = _bare(element)
        for child in element:
            if child.tag == "body" and child in kept:
                own: tuple[str, ...] = ()
                if content or child in chain.bodies:
                    weighed = child.find("inertial") is not None
                    massive = from_geoms != "false" and not (weighed and from_geoms == "auto")
                    own = _CONTENT + (() if child in branches else JOINTS)
                    own += ("geom",) if massive else ()
                copy.append(copied(child, own))
            elif child.tag == "frame" and (content or child in kept):
                copy.append(copied(child, content))
            elif child.tag in content:
                copy.append(_bare(child))
        if element in chain.bodies:
            names[element] = element.get("name") or f"body {len(names)} of the chain"
            copy.set("name", names[element])
        return copy

    root = _bare(chain.root)
    used = {key: value for key, value in settings.items() if key not in _NOT_USED}
    SubElement(root, "compiler", used | {"fusestatic": "false"})
    root.extend(_defaults(own) for own in chain.root.findall("default"))
    root.extend(copied(world, ()) for world in chain.root.findall("worldbody"))
    return Part(root, _meshes(path, settings, chain.root, root), names)


def _bare(element: Element) -> Element:
    """The element alone; materials give no mass."""
    return Element(element.tag, {k: v for k, v in element.items() if k != "material"})


def _defaults(element: Element) -> Element:
    copy = _bare(element)
    copy.extend(_defaults(child) for child in element if child.tag in _DEFAULTS)
    return copy


def _attached(path: Path, chain: Chain) -> tuple[list[Element], list[Element]]:
    """Bodies that hang on the chain without joints, and those that hang on joints of their own."""
    carried: list[Element] = []
    branches: list[Element] = []
    pending = list(chain.bodies)
    while pending:
        body = pending.pop()
        for child in inside(body):
            if child.tag in _BY_RULE:
                what = f"holds <{child.tag}>, which is not supported"
                raise InputError(path, label(body), what, _WRITE_DOWN)
            if child.tag == "body" and child not in chain.path:
                beside = bool(joints_of(child)) or body in branches
                (branches if beside else carried).append(child)
                pending.append(child)
    return carried, branches


def _refuse_coupled(
    path: Path, root: Element, links: list[Element], branches: list[Element]
) -> None:
    """Refuse constraints on the chain's joints and links, but for those with a branch."""
    ours = {(e.tag, e.get("name")) for body in links for e in [body, *inside(body)]}
    theirs = {(e.tag, e.get("name")) for branch in branches for e in branch.iter()}
    tendons = {
        tendon.get("name"): {("joint", joint.get("joint")) for joint in tendon.iter("joint")}
        for tendon in root.findall("tendon/fixed")
    }
    for equality in root.findall("equality/*"):
        if equality.get("active") == "false":
            continue
        ends = {(tag, equality.get(key)) for key, tag in _ENDS.items() if equality.get(key)}
        for key in ("tendon1", "tendon2"):
            ends |= tendons.get(equality.get(key), set()) if equality.get(key) else set()
        on_joints = any(tag == "joint" for tag, _ in ends)
        if ends & ours and (on_joints or not ends & theirs):
            names = " and ".join(sorted(f"{tag} {name!r}" for tag, name in ends & ours))
            remedy = "closed loops and coupled joints are not supported"
            remedy += '; remove it or set active="false"'
            where = f"equality <{equality.tag}>"
            raise InputError(path, where, f"constrains {names}", remedy)


_LARGEST_FILE = 200_000_000  # bytes


def _meshes(path: Path, settings: dict[str, str], root: Element, part: Element) -> dict[str, bytes]:
    """Contents of the meshes that a part of a file uses, by the names that it then has for them."""
    folder = path.parent / settings.get("meshdir", settings.get("assetdir", ""))
    users = {e.get("mesh"): body for body in part.iter("body") for e in inside(body)}
    contents: dict[str, bytes] = {}
    assets = SubElement(part, "asset")
    for asset in root.findall("asset/mesh"):
        given = asset.get("file", "")
        name = asset.get("name", Path(given.replace("\\", "/")).stem)
        if name not in users:
            continue
        copy = _bare(asset)
        copy.extend(asset)
        assets.append(copy)
        if given:
            file = folder / (Path(given).name if settings.get("strippath") == "true" else given)
            key = f"{len(contents)}{Path(given).suffix}"
            copy.attrib |= {"name": name, "file": key}
            try:
                if not file.is_file() or file.stat().st_size > _LARGEST_FILE:
                    raise OSError
                contents[key] = file.read_bytes()
            except (OSError, ValueError):
                what = f"takes its mass from mesh {name!r}, and {file} cannot be read"
                remedy = "bring the file, or give the body an <inertial>"
                raise InputError(path, label(users[name]), what, remedy) from None
    return contents
