"""The XML of an MJCF: its includes, the chain of bodies, and what of it is given to MuJoCo."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from xml.etree.ElementTree import Element, SubElement

from calib.errors import InputError
from calib.files.read import read_xml

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


_SECTIONS = ("compiler", "default", "asset", "worldbody")
_DEFAULTS = ("default", "joint", "geom", "site", "mesh")
_CONTENT = (*JOINTS, "inertial", "geom", "site")
# These make bodies that the file does not list.
_BY_RULE = ("attach", "replicate", "composite", "flexcomp")
_ENDS = {f"{tag}{n}": tag for tag in ("joint", "body", "site") for n in (1, 2)}
_NOT_USED = ("settotalmass", "discardvisual", "strippath", "meshdir", "texturedir", "assetdir")


def strip(path: Path, chain: Chain) -> dict[Element, str]:
    """Take everything else out, in place, and name what has to be found again.

    What hangs on the chain by joints of its own loses them: it is carried as it is drawn.

    The chain's bodies get a name where they have none, and every frame of the chain a site in its
    origin: (frame -> name of that site) is returned.

    Raises InputError for what makes no serial chain of independent joints.
    """
    carried, branches = _attached(path, chain)
    _refuse_coupled(path, chain.root, [*chain.bodies, *carried], branches)
    links = [*chain.bodies, *carried, *branches]
    for body in branches:
        _drop(body, JOINTS)
    settings = compiler_settings(chain.root)
    if not settings.get("settotalmass", "-1").strip().startswith("-"):
        raise InputError(
            path,
            "compiler settotalmass",
            "scales the masses of everything in the file",
            "give each body its own mass and remove it",
        )
    for section in list(chain.root):
        if section.tag not in _SECTIONS or section.tag == "compiler":
            chain.root.remove(section)
        elif section.tag == "default":
            _keep(section, _DEFAULTS)
    for world in chain.root.findall("worldbody"):
        _prune(world, chain.path | set(links), chain, moves=False)
    from_geoms = settings.get("inertiafromgeom", "auto")
    for body in links:
        weighed = body.find("inertial") is not None
        if from_geoms == "false" or (weighed and from_geoms == "auto"):
            _drop(body, ("geom",))
    for element in chain.root.iter():
        element.attrib.pop("material", None)
    used = {key: value for key, value in settings.items() if key not in _NOT_USED}
    chain.root.insert(0, Element("compiler", used | {"fusestatic": "false"}))
    for number, body in enumerate(chain.bodies, 1):
        body.set("name", body.get("name") or f"body {number} of the chain")
    found = [f for world in chain.root.findall("worldbody") for f in world.iter("frame")]
    frames = {frame: f"frame {number} of the chain" for number, frame in enumerate(found, 1)}
    for frame, name in frames.items():
        SubElement(frame, "site", name=name)
    return frames


def _attached(path: Path, chain: Chain) -> tuple[list[Element], list[Element]]:
    """Bodies that hang on the chain without joints, and those that hang on joints of their own."""
    carried: list[Element] = []
    branches: list[Element] = []
    pending = list(chain.bodies)
    while pending:
        body = pending.pop()
        for child in inside(body):
            if child.tag in _BY_RULE:
                raise InputError(
                    path,
                    label(body),
                    f"holds <{child.tag}>, which is not supported",
                    "write its bodies down, as MuJoCo does when it saves the model",
                )
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
            raise InputError(
                path,
                f"equality <{equality.tag}>",
                f"constrains {names}",
                'closed loops and coupled joints are not supported; remove it or set active="false"',
            )


def _keep(element: Element, tags: tuple[str, ...]) -> None:
    for child in list(element):
        if child.tag in tags:
            _keep(child, tags)
        else:
            element.remove(child)


def _prune(element: Element, kept: set[Element], chain: Chain, moves: bool) -> None:
    """Take out bodies that are not kept, and what stands in the base and before it."""
    for child in list(element):
        if child.tag == "body" and child in kept:
            _prune(child, kept, chain, moves or child in chain.bodies)
        elif child.tag == "frame" and (moves or child in kept):
            _prune(child, kept, chain, moves)
        elif child.tag not in _CONTENT or not moves:
            element.remove(child)
        else:
            _keep(child, ())


def _drop(element: Element, tags: tuple[str, ...]) -> None:
    """Take out of a body, frames opened, what has one of these tags."""
    for child in list(element):
        if child.tag in tags:
            element.remove(child)
        elif child.tag == "frame":
            _drop(child, tags)


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
