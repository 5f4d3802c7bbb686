"""Read an MJCF: MuJoCo compiles the whole file; its tree is walked from the base to the tips."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from calib.arm.robot import Place, Robot, Source, weights_of
from calib.arm.se3 import so3_about, transform, transformed
from calib.arrays import Array
from calib.errors import InputError
from calib.files.read import read_xml
from calib.files.shapes import SHAPES, Span, shapes_of, spanned

_SHOWN = 12  # names that a message lists
_MOST = 10_000  # copies of a body: a robot has none, and a slip of the keys would fill the memory
_HINGE, _SLIDE = 3, 2  # mjtJoint; the module is imported where it is needed
_JOINT_OF_TENDON, _SITE, _MESH = 1, 6, 7  # mjtWrap, mjtObj, mjtGeom
_GEOMS = ("plane", "hfield", "sphere", "capsule", "ellipsoid", "cylinder", "box", "mesh", "sdf")
_CONSTRAINTS = ("connect", "weld", "joint", "tendon")


def load_mjcf(path: str | Path, base: str, tip: str, others: Sequence[str] = ()) -> Robot:
    """Read the joints from body ``base``, or ``world``, to body or site ``tip``, and to other tips.

    Joint readings are MuJoCo's ``qpos``. Joint frames have the axes of their body. Bodies that hang on
    a moving one give it their masses and shapes, as they are drawn where joints beside the chain move
    them.

    Raises InputError for what is not well-formed, no way of hinge and slide joints, or refused by
    MuJoCo (a mesh that is missing too), and where MuJoCo is not installed.
    """
    path = Path(path)
    name, files, model = compiled(path)
    first = _body(path, model, base)
    chain = _chain(path, model, first, (tip, *others))
    joints = [int(j) for b in chain for j in np.flatnonzero(model.jnt_bodyid == b)]
    if not joints:
        raise InputError(path, "", "the chain has no moving joint", "check [robot] base and tip")
    read = [_joint(path, model, j) for j in joints]
    with np.errstate(over="ignore", invalid="ignore"):  # what is not finite is refused below
        arm = _walked(model, first, chain, joints)
        _refuse_coupled(path, model, chain, set(arm.bodies) - {first})
        hung = [*arm.joints, *(_tip(model, arm, end) for end in (*others, tip))]
        weights = [
            (arm.bodies[b], float(model.body_mass[b]), model.body_ipos[b])
            for b in arm.bodies
            if b != first
        ]
        masses, coms = weights_of(len(joints), weights)
    origins = np.array([T for _, T in hung])
    if not all(np.isfinite(a).all() for a in (origins, masses, coms)):
        raise InputError(path, "", "holds numbers that are not finite", "check what leads to a tip")
    names, limits, efforts = zip(*read, strict=True)
    unread: list[str] = []
    return Robot(
        name=name,
        base=base,
        tip=tip,
        joints=names,
        prismatic=model.jnt_type[joints] == _SLIDE,
        origins=origins,
        axes=model.jnt_axis[joints],
        limits=np.array(limits),
        efforts=np.array(efforts),
        masses=masses,
        coms=coms,
        shapes=shapes_of(names, _spans(model, arm, unread), unread),
        source=Source("mjcf", files),
        others=tuple(others),
        parents=tuple(k for k, _ in hung),
    )


def compiled(path: Path) -> tuple[str, tuple[Path, ...], Any]:
    """Name, all files, and the ``mujoco.MjModel`` of a whole file, its bodies kept apart.

    Raises InputError for what is no safe, well-formed MJCF: includes may not leave its folder.
    """
    root = read_xml(path, "MJCF")
    if root.tag != "mujoco":
        raise InputError(path, f"<{root.tag}>", "is not an MJCF", "name a file that holds <mujoco>")
    pending = [(path, root)]
    for here, element in pending:  # grows as files are found
        for rule in element.iter("replicate"):
            if not rule.get("count", "").strip().isdigit() or int(rule.get("count", "0")) > _MOST:
                what = f"makes {rule.get('count', 'no number of')} copies"
                raise InputError(here, "<replicate>", what, f"give a count of at most {_MOST}")
        for include in element.iter("include"):
            file = _included([own for own, _ in pending], here, include.get("file", ""))
            pending.append((file, read_xml(file, "MJCF")))
    return root.get("model", path.stem), tuple(own for own, _ in pending), _model(path)


def _model(path: Path) -> Any:
    try:
        import mujoco
    except ImportError:
        raise InputError(
            path, "", "needs MuJoCo, which is not installed", "pip install 'posecal[sim]'"
        ) from None
    mujoco.set_mju_user_warning(lambda _: None)  # its own handler writes MUJOCO_LOG.TXT
    try:
        spec = mujoco.MjSpec.from_file(str(path))
        spec.compiler.fusestatic = False  # else a base without joints loses its name
        return spec.compile()
    except (ValueError, mujoco.FatalError) as error:
        said = re.sub(r"(, id \d+)?, line \d+", "", str(error))
        said = "; ".join(line.strip() for line in said.splitlines() if line.strip())
        missing = "opening file" in said
        remedy = "a file is read whole: bring what it names, or remove it" if missing else ""
        raise InputError(path, "", f"is refused by MuJoCo: {said}", remedy) from None
    finally:
        mujoco.set_mju_user_warning(None)


def _included(files: list[Path], here: Path, name: str) -> Path:
    """The file that an <include> names, seen from the main file or else from the including one."""
    where, folder = f"include {name!r}", files[0].parent
    try:
        file = next((f for f in (folder / name, here.parent / name) if f.is_file()), folder / name)
        whole, found = file.resolve(), file.is_file()
    except (OSError, ValueError) as error:
        raise InputError(here, where, f"cannot be read ({error})") from None
    if not whole.is_relative_to(folder.resolve()):
        remedy = "copy the file into that folder"
        raise InputError(here, where, "leaves the folder of the model", remedy)
    if not found:
        raise InputError(here, where, "names no file", "check its path")
    if any(whole == other.resolve() for other in files):
        raise InputError(here, where, "is included already", "include each file once")
    return file


def _names(model: Any, kind: str) -> list[str]:
    return [getattr(model, kind)(i).name for i in range(getattr(model, f"n{kind}"))]


def _body(path: Path, model: Any, name: str) -> int:
    """The base of a cell. Raises InputError."""
    names = _names(model, "body")
    if name not in names:
        known = ", ".join([own for own in names if own][: _SHOWN + 1])
        raise InputError(path, "", f"has no body {name!r}", f"set [robot] base to one of: {known}")
    return names.index(name)


def _chain(path: Path, model: Any, first: int, tips: Sequence[str]) -> list[int]:
    """Bodies below the first one on the way to the tip, then to the others. Raises InputError."""
    chain: dict[int, None] = {}
    bodies, sites = _names(model, "body"), _names(model, "site")
    for name in tips:
        if name not in (*bodies, *sites):
            key = "[robot] tip" if name == tips[0] else "'on' of what it carries"
            known = ", ".join([own for own in bodies[1:] if own][:_SHOWN]) or "none"
            remedy = f"set {key} to a site, or to one of: {known}"
            raise InputError(path, "", f"has no body or site {name!r}", remedy)
        at = bodies.index(name) if name in bodies else int(model.site_bodyid[sites.index(name)])
        way: list[int] = []
        while at != first:
            if at == 0:
                what = f"no chain of bodies leads from {model.body(first).name!r} to it"
                raise InputError(path, f"tip {name!r}", what, "check [robot] base and tip")
            way.insert(0, at)
            at = int(model.body_parentid[at])
        chain |= dict.fromkeys(way)
    return [*chain]


@dataclass(frozen=True, eq=False)
class _Arm:
    """Where every body of the arm is, and each joint of the chain at zero reading."""

    bodies: dict[int, Place]
    joints: list[Place]


def _walked(model: Any, first: int, chain: Sequence[int], joints: Sequence[int]) -> _Arm:
    """A joint moves by ``E(q - ref)`` about or along its axis through its anchor, in its body's frame.

    Of the world itself nothing belongs to the arm, and what stands there neither: the floor, tables.

    first : the base, 0 for the world; joints : those of the chain's bodies
    """
    bodies: dict[int, Place] = {first: (0, np.eye(4))}
    frames: dict[int, Place] = {}
    for i in range(1, model.nbody):  # parents come first
        parent = int(model.body_parentid[i])
        if i == first or parent not in bodies or (i not in chain and parent == 0):
            continue
        k, T = bodies[parent]
        T = T @ _placed(model.body_pos[i], model.body_quat[i])
        for j in np.flatnonzero(model.jnt_bodyid == i).tolist() if i in chain else ():
            anchor, axis = model.jnt_pos[j], model.jnt_axis[j]
            ref = float(model.qpos0[model.jnt_qposadr[j]])
            if model.jnt_type[j] == _SLIDE:
                frames[j] = k, T @ _shifted(anchor - ref * axis)
            else:
                frames[j] = k, T @ transform(so3_about(axis, np.array(-ref)), anchor)
            k, T = joints.index(j) + 1, _shifted(-anchor)
        bodies[i] = k, T
    return _Arm(bodies, [frames[j] for j in joints])


def _tip(model: Any, arm: _Arm, name: str) -> Place:
    """Where a body, or else a site, hangs on the joint before it."""
    if name in _names(model, "body"):
        return arm.bodies[int(model.body(name).id)]
    site = model.site(name)
    k, T = arm.bodies[int(model.site_bodyid[site.id])]
    return k, T @ _placed(site.pos, site.quat)


def _joint(path: Path, model: Any, j: int) -> tuple[str, tuple[float, float], float]:
    """Name, limits [rad or m] and effort [N m or N] of a joint. Raises InputError."""
    name, where = model.joint(j).name, f"body {model.body(int(model.jnt_bodyid[j])).name!r}"
    if model.jnt_type[j] not in (_HINGE, _SLIDE):
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


def _refuse_coupled(path: Path, model: Any, chain: list[int], links: set[int]) -> None:
    """Refuse constraints on the chain's joints, and on its links but for those with a branch.

    links : the bodies of the arm: the chain, what is fixed to it, and branches with joints of their own
    """
    branches: set[int] = set()
    for body in sorted(links - set(chain)):
        if model.body_jntnum[body] or int(model.body_parentid[body]) in branches:
            branches.add(body)
    for i in np.flatnonzero(model.eq_active0):
        kind = dict(enumerate(_CONSTRAINTS)).get(int(model.eq_type[i]), "constraint")
        ends = [int(model.eq_obj1id[i]), int(model.eq_obj2id[i])]
        if kind in ("joint", "tendon"):
            ends = [j for t in ends for j in _pulled(model, t)] if kind == "tendon" else ends
            held = {
                f"joint {model.joint(j).name!r}": int(model.jnt_bodyid[j]) for j in ends if j >= 0
            }
            hit = [what for what, body in held.items() if body in chain]
        else:
            of = "site" if model.eq_objtype[i] == _SITE else "body"
            held = {
                f"{of} {getattr(model, of)(e).name!r}": int(model.site_bodyid[e])
                if of == "site"
                else e
                for e in ends
            }
            free = branches & set(held.values())
            hit = [] if free else [what for what, body in held.items() if body in links]
        if hit:
            remedy = "closed loops and coupled joints are not supported"
            remedy += '; remove it or set active="false"'
            what = f"constrains {' and '.join(sorted(hit))}"
            raise InputError(path, f"equality <{kind}>", what, remedy)


def _pulled(model: Any, tendon: int) -> list[int]:
    """Joints that a fixed tendon couples; none of tendon -1."""
    begin, count = int(model.tendon_adr[tendon]), int(model.tendon_num[tendon])
    own = slice(begin, begin + count if tendon >= 0 else begin)
    return [int(j) for j in model.wrap_objid[own][model.wrap_type[own] == _JOINT_OF_TENDON]]


def _spans(model: Any, arm: _Arm, unread: list[str]) -> Iterator[Span]:
    """Geoms of the arm; one that touches nothing is a picture, one without an end is named."""
    for g in np.flatnonzero((model.geom_contype | model.geom_conaffinity) != 0).tolist():
        body, kind = int(model.geom_bodyid[g]), _GEOMS[model.geom_type[g]]
        if body == 0 or body not in arm.bodies:  # what the world holds is none of the arm's
            continue
        size = np.array(model.geom_size[g])
        if model.geom_type[g] == _MESH:
            mesh = model.mesh(int(model.geom_dataid[g]))
            begin, count = int(mesh.vertadr[0]), int(mesh.vertnum[0])
            size = np.array(model.mesh_vert[begin : begin + count], dtype=float)
        if kind not in SHAPES:
            unread.append(f"{model.body(body).name} ({kind} has no end)")
            continue
        points, radius = spanned(kind, size)
        T = _placed(model.geom_pos[g], model.geom_quat[g])
        yield arm.bodies[body], transformed(T, points), radius


def _placed(position: Array, quaternion: Array) -> Array:
    """The frame (4, 4) at a position (3,), m, turned by a quaternion (w, x, y, z)."""
    import mujoco

    R = np.empty(9)
    mujoco.mju_quat2Mat(R, quaternion)
    return transform(R.reshape(3, 3), position)


def _shifted(translation: Array) -> Array:
    """The frame (4, 4) at a translation (3,), m, not turned."""
    return transform(np.eye(3), translation)
