"""Read an MJCF: MuJoCo compiles the whole file; its tree is walked from the base to the tips."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from calib.arm.robot import Robot, Source, weights_of
from calib.arm.se3 import inverse, transform, transformed
from calib.arrays import Array
from calib.errors import InputError
from calib.files.read import read_xml
from calib.files.shapes import SHAPES, shapes_of, spanned

_SHOWN = 12  # names that a message lists
_MOST = 10_000  # copies of a body: a robot has none, and a slip of the keys would fill the memory
_HINGE, _SLIDE = 3, 2  # mjtJoint; the module is imported where it is needed
_JOINT_OF_TENDON, _SITE = 1, 6  # mjtWrap, mjtObj
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
    names, limits, efforts = zip(*(_joint(path, model, j) for j in joints), strict=True)
    carrier = _carriers(model, first, chain, joints)
    _refuse_coupled(path, model, chain, set(carrier) - {first})
    unread: list[str] = []
    with np.errstate(over="ignore", invalid="ignore"):  # what is not finite is refused below
        data = _at_zero(model, joints)
        frames = _frames(model, data, first, joints)
        back = [inverse(T) for T in frames]
        tips = [_tip(model, data, end) for end in (*others, tip)]
        parents = [*_parents(model, carrier, joints), *(carrier[body] for body, _ in tips)]
        hung = zip(parents, [*frames[1:], *(T for _, T in tips)], strict=True)
        origins = np.array([back[k] @ T for k, T in hung])
        weights = (((k, back[k]), model.body_mass[b], data.xipos[b]) for b, k in carrier.items())
        masses, coms = weights_of(len(joints), weights)
    if not all(np.isfinite(a).all() for a in (origins, masses, coms)):
        raise InputError(path, "", "holds numbers that are not finite", "check what leads to a tip")
    spans = (((k, back[k]), own, wide) for k, own, wide in _spans(model, data, carrier, unread))
    return Robot(
        name=name,
        base=base,
        tip=tip,
        joints=names,
        prismatic=model.jnt_type[joints] == _SLIDE,
        origins=origins,
        axes=np.array(
            [own[:3, :3] @ data.xaxis[j] for own, j in zip(back[1:], joints, strict=True)]
        ),
        limits=np.array(limits),
        efforts=np.array(efforts),
        masses=masses,
        coms=coms,
        shapes=shapes_of(names, spans, unread),
        source=Source("mjcf", files),
        others=tuple(others),
        parents=tuple(parents),
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


def _carriers(
    model: Any, first: int, chain: Sequence[int], joints: Sequence[int]
) -> dict[int, int]:
    """Number of the joint of the chain that carries each body of the arm, 0 before the first one.

    Of the world itself nothing belongs to the arm, and what stands there neither: the floor, tables.
    """
    found, last = {first: 0}, {int(model.jnt_bodyid[j]): n for n, j in enumerate(joints, 1)}
    for body in range(1, model.nbody):  # parents come first
        parent = int(model.body_parentid[body])
        if body != first and parent in found and (body in chain or parent != 0):
            found[body] = last.get(body, found[parent])
    return found


def _at_zero(model: Any, joints: Sequence[int]) -> Any:
    """Where MuJoCo has everything when the chain's joints read zero, all others as they are drawn."""
    import mujoco

    data = mujoco.MjData(model)
    data.qpos[model.jnt_qposadr[joints]] = 0.0
    mujoco.mj_kinematics(model, data)
    return data


def _frames(model: Any, data: Any, first: int, joints: Sequence[int]) -> list[Array]:
    """Those of the base and of each joint: the axes of its body, at its anchor; in the world."""
    found = [_frame(data.xmat[first], data.xpos[first])]
    return found + [_frame(data.xmat[model.jnt_bodyid[j]], data.xanchor[j]) for j in joints]


def _parents(model: Any, carrier: dict[int, int], joints: Sequence[int]) -> list[int]:
    """Number of the joint that carries each joint: the one before it on its body, or its parent's."""
    bodies = [int(model.jnt_bodyid[j]) for j in joints]
    return [
        n if n and bodies[n - 1] == body else carrier[int(model.body_parentid[body])]
        for n, body in enumerate(bodies)
    ]


def _frame(matrix: Array, position: Array) -> Array:
    """The frame (4, 4) at a position (3,), m, of a matrix (9,)."""
    return transform(matrix.reshape(3, 3), position)


def _tip(model: Any, data: Any, name: str) -> tuple[int, Array]:
    """The body that is a tip, or else has a site of that name, and its frame in the world."""
    if name in _names(model, "body"):
        body = int(model.body(name).id)
        return body, _frame(data.xmat[body], data.xpos[body])
    site = int(model.site(name).id)
    return int(model.site_bodyid[site]), _frame(data.site_xmat[site], data.site_xpos[site])


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
        if kind == "tendon":
            ends = [j for tendon in ends for j in _pulled(model, tendon)]
        of, body_of = "body", np.arange(model.nbody)
        if kind in ("joint", "tendon"):
            of, body_of = "joint", model.jnt_bodyid
        elif model.eq_objtype[i] == _SITE:
            of, body_of = "site", model.site_bodyid
        held = {f"{of} {getattr(model, of)(e).name!r}": int(body_of[e]) for e in ends if e >= 0}
        hit = [what for what, body in held.items() if body in (chain if of == "joint" else links)]
        if hit and (of == "joint" or not branches & set(held.values())):
            remedy = "closed loops and coupled joints are not supported"
            remedy += '; remove it or set active="false"'
            what = f"constrains {' and '.join(sorted(hit))}"
            raise InputError(path, f"equality <{kind}>", what, remedy)


def _pulled(model: Any, tendon: int) -> list[int]:
    """Joints that a fixed tendon couples; none of tendon -1."""
    begin, count = int(model.tendon_adr[tendon]), int(model.tendon_num[tendon])
    own = slice(begin, begin + count if tendon >= 0 else begin)
    return [int(j) for j in model.wrap_objid[own][model.wrap_type[own] == _JOINT_OF_TENDON]]


def _spans(
    model: Any, data: Any, carrier: dict[int, int], unread: list[str]
) -> Iterator[tuple[int, Array, float]]:
    """Geoms of the arm: their joint, points in the world and a radius about these.

    One that touches nothing is a picture, one without an end is named.
    """
    for g in np.flatnonzero((model.geom_contype | model.geom_conaffinity) != 0).tolist():
        body, kind = int(model.geom_bodyid[g]), _GEOMS[model.geom_type[g]]
        if body == 0 or body not in carrier:  # what the world holds is none of the arm's
            continue
        if kind not in SHAPES:
            unread.append(f"{model.body(body).name} ({kind} has no end)")
            continue
        size = np.array(model.geom_size[g])
        if kind == "mesh":
            mesh = model.mesh(int(model.geom_dataid[g]))
            begin, count = int(mesh.vertadr[0]), int(mesh.vertnum[0])
            size = np.array(model.mesh_vert[begin : begin + count], dtype=float)
        points, radius = spanned(kind, size)
        yield (
            carrier[body],
            transformed(_frame(data.geom_xmat[g], data.geom_xpos[g]), points),
            radius,
        )
