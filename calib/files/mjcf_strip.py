"""Leave of an MJCF what places and loads the chain: no joint beside it, no shape without need."""

from __future__ import annotations

from pathlib import Path
from xml.etree.ElementTree import Element, SubElement

from calib.errors import InputError
from calib.files.mjcf_tree import JOINTS, Chain, compiler_settings, inside, joints_of, label

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
