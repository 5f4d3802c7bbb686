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
from calib.files.shapes import SHAPES, Span, shapes_of, spanned

_SHOWN = 12  # names that a message lists
_MOST = 10_000  # copies of a body: a robot has none, and a slip of the keys would fill the memory
_HINGE, _SLIDE = 3, 2  # mjtJoint; the module is imported where it is needed
_JOINT_OF_TENDON, _SITE = 1, 6  # mjtWrap, mjtObj
_GEOMS = ("plane", "hfield", "sphere", "capsule", "ellipsoid", "cylinder", "box", "mesh", "sdf")
_CONSTRAINTS = ("connect", "weld", "joint", "tendon", *["constraint"] * 8)


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
    first, chain = _chain(path, model, base, (tip, *others))
    joints = [int(j) for b in chain for j in np.flatnonzero(model.jnt_bodyid == b)]
    if not joints:
        raise InputError(path, "", "the chain has no moving joint", "check [robot] base and tip")
    names, limits, efforts = zip(*(_joint(path, model, j) for j in joints), strict=True)
    carrier = _carriers(model, first, chain, joints)
    _refuse_coupled(path, model, chain, set(carrier) - {first})
    unread: list[str] = []
    with np.errstate(over="ignore", invalid="ignore"):  # what is not finite is refused below
        data, back, placed = _placed(model, first, joints, carrier, (*others, tip))
        origins = np.array([back[k] @ T for k, T in placed])
        weights = (((k, back[k]), model.body_mass[b], data.xipos[b]) for b, k in carrier.items())
        masses, coms = weights_of(len(joints), weights)
    if not all(np.isfinite(a).all() for a in (origins, masses, coms)):
        raise InputError(path, "", "holds numbers that are not finite", "check what leads to a tip")
    turned = zip(back[1:], data.xaxis[joints], strict=True)
    return Robot(
        name=name,
        base=base,
        tip=tip,
        joints=names,
        prismatic=model.jnt_type[joints] == _SLIDE,
        origins=origins,
        axes=np.array([T[:3, :3] @ axis for T, axis in turned]),
        limits=np.array(limits),
        efforts=np.array(efforts),
        masses=masses,
        coms=coms,
        shapes=shapes_of(names, _spans(model, data, carrier, back, unread), unread),
        source=Source("mjcf", files),
        others=tuple(others),
        parents=tuple(k for k, _ in placed),
    )


def compiled(path: Path) -> tuple[str, tuple[Path, ...], Any]:
    """Name, all files, and the ``mujoco.MjModel`` of a whole file, its bodies kept apart.

    Raises InputError for what is no safe, well-formed MJCF: includes may not leave its folder.
    """
    root = read_xml(path, "MJCF")
    if root.tag != "mujoco":
        raise InputError(path, f"<{root.tag}>", "is not an MJCF", "name a file that holds <mujoco>")
    pending = [(path, root)]
    for here, element in pending:  # grows as files are met
        for rule in element.iter("replicate"):
            count = rule.get("count", "no number of")
            if not count.strip().isdigit() or int(count) > _MOST:
                what = f"makes {count} copies"
                raise InputError(here, "<replicate>", what, f"give a count of at most {_MOST}")
        for include in element.iter("include"):
            file = _included([own for own, _ in pending], here, include.get("file", ""))
            pending.append((file, read_xml(file, "MJCF")))
    return root.get("model", path.stem), tuple(own for own, _ in pending), _model(path)


def _model(path: Path) -> Any:
    try:
        import mujoco
    except ImportError:
        what = "needs MuJoCo, which is not installed"
        raise InputError(path, "", what, "pip install 'posecal[sim]'") from None
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
        whole, present = file.resolve(), file.is_file()
    except (OSError, ValueError) as error:
        raise InputError(here, where, f"cannot be read ({error})") from None
    if not whole.is_relative_to(folder.resolve()):
        remedy = "copy the file into that folder"
        raise InputError(here, where, "leaves the folder of the model", remedy)
    if not present:
        raise InputError(here, where, "names no file", "check its path")
    if any(whole == other.resolve() for other in files):
        raise InputError(here, where, "is included already", "include each file once")
    return file


def _names(model: Any, kind: str) -> list[str]:
    return [getattr(model, kind)(i).name for i in range(getattr(model, f"n{kind}"))]


def _chain(path: Path, model: Any, base: str, tips: Sequence[str]) -> tuple[int, list[int]]:
    """The base, and the bodies below it on the way to the first tip, then to the others.

    Raises InputError.
    """
    bodies, sites = _names(model, "body"), _names(model, "site")
    known = [own for own in bodies if own]
    if base not in bodies:
        remedy = f"set [robot] base to one of: {', '.join(known[: _SHOWN + 1])}"
        raise InputError(path, "", f"has no body {base!r}", remedy)
    first, chain = bodies.index(base), dict[int, None]()
    for name in tips:
        if name not in (*bodies, *sites):
            key = "[robot] tip" if name == tips[0] else "'on' of what it carries"
            shown = ", ".join(known[1 : _SHOWN + 1]) or "none"
            remedy = f"set {key} to a site, or to one of: {shown}"
            raise InputError(path, "", f"has no body or site {name!r}", remedy)
        at = bodies.index(name) if name in bodies else int(model.site_bodyid[sites.index(name)])
        way: list[int] = []
        while at != first:
            if at == 0:
                what = f"no chain of bodies leads from {base!r} to it"
                raise InputError(path, f"tip {name!r}", what, "check [robot] base and tip")
            way.insert(0, at)
            at = int(model.body_parentid[at])
        chain |= dict.fromkeys(way)
    return first, [*chain]


def _carriers(
    model: Any, first: int, chain: Sequence[int], joints: Sequence[int]
) -> dict[int, int]:
    """Number of the joint of the chain that carries each body of the arm, 0 before the first one.

    Of the world itself nothing belongs to the arm, and what stands there neither: the floor, tables.
    """
    carrier, last = {first: 0}, {int(model.jnt_bodyid[j]): n for n, j in enumerate(joints, 1)}
    for body in range(1, model.nbody):  # parents come first
        parent = int(model.body_parentid[body])
        if body != first and parent in carrier and (body in chain or parent != 0):
            carrier[body] = last.get(body, carrier[parent])
    return carrier


def _placed(
    model: Any, first: int, joints: Sequence[int], carrier: dict[int, int], tips: Sequence[str]
) -> tuple[Any, list[Array], list[tuple[int, Array]]]:
    """Where MuJoCo has everything when the chain's joints read zero, all others as they are drawn.

    Returns its data; transforms (4, 4) from the world to the base and to each joint's frame, which has
    the axes of its body; and the number of the joint that carries each joint and tip, 0 for the base,
    with its frame in the world.
    """
    import mujoco

    data = mujoco.MjData(model)
    data.qpos[model.jnt_qposadr[joints]] = 0.0
    mujoco.mj_kinematics(model, data)
    bodies, placed = [int(model.jnt_bodyid[j]) for j in joints], list[tuple[int, Array]]()
    for n, (j, body) in enumerate(zip(joints, bodies, strict=True)):
        same = n > 0 and bodies[n - 1] == body  # several joints of one body
        parent = n if same else carrier[int(model.body_parentid[body])]
        placed.append((parent, _frame(data.xmat[body], data.xanchor[j])))
    back = [inverse(_frame(data.xmat[first], data.xpos[first])), *(inverse(T) for _, T in placed)]
    named = _names(model, "body")
    for name in tips:
        if name in named:
            body = named.index(name)
            placed.append((carrier[body], _frame(data.xmat[body], data.xpos[body])))
        else:
            site = int(model.site(name).id)
            T = _frame(data.site_xmat[site], data.site_xpos[site])
            placed.append((carrier[int(model.site_bodyid[site])], T))
    return data, back, placed


def _frame(matrix: Array, position: Array) -> Array:
    """The frame (4, 4) at a position (3,), m, of a matrix (9,)."""
    return transform(matrix.reshape(3, 3), position)


def _joint(path: Path, model: Any, j: int) -> tuple[str, tuple[float, float], float]:
    """Name, limits [rad or m] and effort [N m or N] of a joint. Raises InputError."""
    name, where = model.joint(j).name, f"body {model.body(int(model.jnt_bodyid[j])).name!r}"
    if model.jnt_type[j] not in (_HINGE, _SLIDE):
        kind = ("free", "ball")[int(model.jnt_type[j])]
        raise InputError(path, where, f"has a {kind} joint", "use hinge and slide joints")
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
        kind = _CONSTRAINTS[int(model.eq_type[i])]
        ends = [int(model.eq_obj1id[i]), int(model.eq_obj2id[i])]
        of, body_of = "body", np.arange(model.nbody)
        if kind in ("joint", "tendon"):
            of, body_of = "joint", model.jnt_bodyid
            ends = [j for end in ends for j in _pulled(model, end)] if kind == "tendon" else ends
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
    model: Any, data: Any, carrier: dict[int, int], back: list[Array], unread: list[str]
) -> Iterator[Span]:
    """Geoms of the arm. One that touches nothing is a picture, one without an end is named."""
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
        T = _frame(data.geom_xmat[g], data.geom_xpos[g])
        yield (carrier[body], back[carrier[body]]), transformed(T, points), radius
