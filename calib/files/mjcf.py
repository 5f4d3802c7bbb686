"""Read an MJCF: MuJoCo compiles the whole file; its tree is walked from the base to the tips."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any
from xml.etree.ElementTree import Element

import numpy as np

from calib.arm.robot import Place, Robot, weights_of
from calib.arm.se3 import so3_about, transform
from calib.arrays import Array
from calib.errors import InputError
from calib.files.read import read_xml

WORLD = "world"
_SHOWN = 12  # names that a message lists
_MOST = 10_000  # copies of a body: a robot has none, and a slip of the keys would fill the memory
HINGE, SLIDE = 3, 2  # mjtJoint; the module is imported where it is needed
_JOINT_OF_TENDON, _SITE = 1, 6  # mjtWrap, mjtObj


def load_mjcf(path: str | Path, base: str, tip: str, others: Sequence[str] = ()) -> Robot:
    """Read the joints from body ``base``, or ``world``, to body or site ``tip``, and to other tips.

    Joint readings are MuJoCo's ``qpos``. Joint frames have the axes of their body. Bodies that hang on
    a moving one give it their masses, as they are drawn where joints beside the chain move them.

    Raises InputError for what is not well-formed, no way of hinge and slide joints, or refused by
    MuJoCo (a mesh that is missing too), and where MuJoCo is not installed.
    """
    path = Path(path)
    root, _ = read_mjcf(path)
    model = compiled(path)
    first = body_of(path, model, base)
    chain = chain_of(path, model, first, (tip, *others))
    joints = [int(j) for b in chain for j in np.flatnonzero(model.jnt_bodyid == b)]
    if not joints:
        raise InputError(path, "", "the chain has no moving joint", "check [robot] base and tip")
    read = [_joint(path, model, j) for j in joints]
    with np.errstate(over="ignore", invalid="ignore"):  # what is not finite is refused below
        hung = places_of(model, first, chain)
        _refuse_coupled(path, model, chain, set(hung) - {first})
        frames = [_frame(model, hung, joints, i) for i in range(len(joints))]
        tips = [_tip(model, hung, name) for name in (*others, tip)]
        weights = [
            (hung[b], float(model.body_mass[b]), model.body_ipos[b]) for b in hung if b != first
        ]
        masses, coms = weights_of(len(joints), weights)
        origins = [T for _, T in [*frames, *tips]]
    if not all(np.isfinite(a).all() for a in (origins, masses, coms)):
        raise InputError(path, "", "holds numbers that are not finite", "check what leads to a tip")
    return Robot(
        name=root.get("model", path.stem),
        base=base,
        tip=tip,
        joints=tuple(name for name, _, _ in read),
        prismatic=model.jnt_type[joints] == SLIDE,
        origins=np.array(origins),
        axes=model.jnt_axis[joints],
        limits=np.array([limits for _, limits, _ in read]),
        efforts=np.array([effort for _, _, effort in read]),
        masses=masses,
        coms=coms,
        others=tuple(others),
        parents=tuple(k for k, _ in [*frames, *tips]),
    )


def mjcf_files(path: Path) -> tuple[Path, ...]:
    """The file and all that it includes. Raises InputError."""
    return read_mjcf(path)[1]


def read_mjcf(path: Path) -> tuple[Element, tuple[Path, ...]]:
    """The <mujoco> element, and the files that it is read from.

    Raises InputError for what is no safe, well-formed MJCF: includes may not leave its folder.
    """
    root = read_xml(path, "MJCF")
    if root.tag != "mujoco":
        raise InputError(path, f"<{root.tag}>", "is not an MJCF", "name a file that holds <mujoco>")
    files, pending = [path], [(path, root)]
    for here, element in pending:  # grows as files are found
        for rule in element.iter("replicate"):
            if not rule.get("count", "").strip().isdigit() or int(rule.get("count", "0")) > _MOST:
                what = f"makes {rule.get('count', 'no number of')} copies"
                raise InputError(here, "<replicate>", what, f"give a count of at most {_MOST}")
        for include in element.iter("include"):
            file = _included(files, here, include.get("file", ""))
            files.append(file)
            pending.append((file, read_xml(file, "MJCF")))
    return root, tuple(files)


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


def compiled(path: Path) -> Any:
    """The ``mujoco.MjModel`` of a whole file, its bodies kept apart. Raises InputError."""
    with mujoco_for(path) as mujoco:
        spec = mujoco.MjSpec.from_file(str(path))
        spec.compiler.fusestatic = False  # else a base without joints loses its name
        return spec.compile()


@contextmanager
def mujoco_for(path: Path) -> Iterator[Any]:
    """The module, to compile what stands in a file.

    Raises InputError where it is not installed, and for what it refuses.
    """
    try:
        import mujoco
    except ImportError:
        raise InputError(
            path, "", "needs MuJoCo, which is not installed", "pip install 'posecal[sim]'"
        ) from None
    mujoco.set_mju_user_warning(lambda _: None)  # its own handler writes MUJOCO_LOG.TXT
    try:
        yield mujoco
    except (ValueError, mujoco.FatalError) as error:
        said = re.sub(r"(, id \d+)?, line \d+", "", str(error))
        said = "; ".join(line.strip() for line in said.splitlines() if line.strip())
        missing = "opening file" in said
        remedy = "a file is read whole: bring what it names, or remove it" if missing else ""
        raise InputError(path, "", f"is refused by MuJoCo: {said}", remedy) from None
    finally:
        mujoco.set_mju_user_warning(None)


def chain_of(path: Path, model: Any, first: int, tips: Sequence[str]) -> list[int]:
    """Bodies below the first one on the way to the tip, then to the others. Raises InputError."""
    chain: dict[int, None] = {}
    for number, name in enumerate(tips):
        body = _end(path, model, name, "'on' of what it carries" if number else "[robot] tip")
        way: list[int] = []
        while body != first:
            if body == 0:
                what = f"no chain of bodies leads from {model.body(first).name!r} to it"
                raise InputError(path, f"tip {name!r}", what, "check [robot] base and tip")
            way.insert(0, body)
            body = int(model.body_parentid[body])
        chain |= dict.fromkeys(way)
    return [*chain]


def places_of(model: Any, first: int, chain: Sequence[int]) -> dict[int, Place]:
    """Where every body of the arm is, of a model whose ways to tips have these bodies.

    Of the world itself nothing belongs to the arm, and what stands there neither: the floor, tables.

    first : the base, 0 for the world
    """
    found: dict[int, Place] = {first: (0, np.eye(4))}
    last = dict(zip(chain, np.cumsum(model.body_jntnum[list(chain)]).tolist(), strict=True))
    for i in range(1, model.nbody):  # parents come first
        parent = int(model.body_parentid[i])
        if i == first or parent not in found or (i not in chain and parent == 0):
            continue
        k, T = found[parent]
        T = T @ placed(model.body_pos[i], model.body_quat[i])
        joints = np.flatnonzero(model.jnt_bodyid == i)
        if len(joints) and i in chain:
            k, T = last[i], shifted(-model.jnt_pos[joints[-1]])
        found[i] = k, T
    return found


def _frame(model: Any, places: dict[int, Place], joints: list[int], i: int) -> Place:
    """Where joint i of the chain hangs on the joint before it, at zero reading.

    It moves by ``E(q - ref)`` about or along its axis through its anchor, in the frame of its body.
    """
    j, body = joints[i], int(model.jnt_bodyid[joints[i]])
    if i and int(model.jnt_bodyid[joints[i - 1]]) == body:
        k, T = i, shifted(-model.jnt_pos[joints[i - 1]])
    else:
        k, T = places[int(model.body_parentid[body])]
        T = T @ placed(model.body_pos[body], model.body_quat[body])
    anchor, axis = model.jnt_pos[j], model.jnt_axis[j]
    ref = float(model.qpos0[model.jnt_qposadr[j]])
    if model.jnt_type[j] == SLIDE:
        return k, T @ shifted(anchor - ref * axis)
    return k, T @ transform(so3_about(axis, np.array(-ref)), anchor)


def _tip(model: Any, places: dict[int, Place], name: str) -> Place:
    """Where a body, or else a site, hangs on the joint before it."""
    if name in _names(model, "body"):
        return places[int(model.body(name).id)]
    site = model.site(name)
    k, T = places[int(model.site_bodyid[site.id])]
    return k, T @ placed(site.pos, site.quat)


def _joint(path: Path, model: Any, j: int) -> tuple[str, tuple[float, float], float]:
    """Name, limits [rad or m] and effort [N m or N] of a joint. Raises InputError."""
    name, where = model.joint(j).name, f"body {model.body(int(model.jnt_bodyid[j])).name!r}"
    if model.jnt_type[j] not in (HINGE, SLIDE):
        said = ("free", "ball")[int(model.jnt_type[j])]
        raise InputError(path, where, f"has a {said} joint", "use hinge and slide joints")
    if not name:
        remedy = "name it as the columns of the data do"
        raise InputError(path, where, "has a joint without a name", remedy)
    low, high = map(float, model.jnt_range[j])
    if low > high:  # MuJoCo takes it as no limit
        raise InputError(path, f"joint {name!r}", f"range {low:g} .. {high:g} is reversed")
    # The weaker direction counts where both differ; 0 says nothing, as in a URDF.
    effort = float(np.abs(model.jnt_actfrcrange[j]).min()) if model.jnt_actfrclimited[j] else 0.0
    return name, (low, high) if model.jnt_limited[j] else (-np.inf, np.inf), effort or np.nan


def _names(model: Any, kind: str) -> list[str]:
    return [getattr(model, kind)(i).name for i in range(getattr(model, f"n{kind}"))]


def body_of(path: Path, model: Any, name: str) -> int:
    """The base of a cell. Raises InputError."""
    names = _names(model, "body")
    if name not in names:
        known = ", ".join([own for own in names if own][: _SHOWN + 1])
        raise InputError(path, "", f"has no body {name!r}", f"set [robot] base to one of: {known}")
    return names.index(name)


def _end(path: Path, model: Any, name: str, key: str) -> int:
    """The body that is a tip, or that holds the site of that name. Raises InputError."""
    bodies, sites = _names(model, "body"), _names(model, "site")
    if name in bodies:
        return bodies.index(name)
    if name in sites:
        return int(model.site_bodyid[sites.index(name)])
    known = ", ".join([own for own in bodies[1:] if own][:_SHOWN]) or "none"
    remedy = f"set {key} to a site, or to one of: {known}"
    raise InputError(path, "", f"has no body or site {name!r}", remedy)


def _refuse_coupled(path: Path, model: Any, chain: list[int], links: set[int]) -> None:
    """Refuse constraints on the chain's joints, and on its links but for those with a branch.

    links : the bodies of the arm: the chain, what is fixed to it, and branches with joints of their own
    """
    branches: set[int] = set()
    for body in sorted(links - set(chain)):
        if model.body_jntnum[body] or int(model.body_parentid[body]) in branches:
            branches.add(body)
    for i in np.flatnonzero(model.eq_active0):
        kind = ("connect", "weld", "joint", "tendon")
        ends = [int(model.eq_obj1id[i]), int(model.eq_obj2id[i])]
        named = kind[model.eq_type[i]] if model.eq_type[i] < len(kind) else "constraint"
        if named in ("joint", "tendon"):
            joints = ends if named == "joint" else [j for t in ends for j in _pulled(model, t)]
            hit = [
                f"joint {model.joint(j).name!r}"
                for j in joints
                if j >= 0 and int(model.jnt_bodyid[j]) in chain
            ]
        elif model.eq_objtype[i] == _SITE:
            bodies = [int(model.site_bodyid[site]) for site in ends]
            hit = [
                f"site {model.site(s).name!r}"
                for s, b in zip(ends, bodies, strict=True)
                if b in links - branches
            ]
            hit = hit if not branches & set(bodies) else []
        else:
            hit = [f"body {model.body(b).name!r}" for b in ends if b in links - branches]
            hit = hit if not branches & set(ends) else []
        if hit:
            remedy = "closed loops and coupled joints are not supported"
            remedy += '; remove it or set active="false"'
            what = f"constrains {' and '.join(sorted(hit))}"
            raise InputError(path, f"equality <{named}>", what, remedy)


def _pulled(model: Any, tendon: int) -> list[int]:
    """Joints that a fixed tendon couples; none of tendon -1."""
    if tendon < 0:
        return []
    own = slice(
        int(model.tendon_adr[tendon]), int(model.tendon_adr[tendon] + model.tendon_num[tendon])
    )
    return [int(j) for j in model.wrap_objid[own][model.wrap_type[own] == _JOINT_OF_TENDON]]


def placed(position: Array, quaternion: Array) -> Array:
    """The frame (4, 4) at a position (3,), m, turned by a quaternion (w, x, y, z)."""
    import mujoco

    R = np.empty(9)
    mujoco.mju_quat2Mat(R, quaternion)
    return transform(R.reshape(3, 3), position)


def shifted(translation: Array) -> Array:
    """The frame (4, 4) at a translation (3,), m, not turned."""
    return transform(np.eye(3), translation)
