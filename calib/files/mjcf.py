"""Read an MJCF: MuJoCo compiles the whole file, and the bodies that it makes are walked."""

from __future__ import annotations

import re
import warnings
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from calib.arm.robot import Robot, Source
from calib.arm.se3 import inverse, transform, transformed
from calib.arrays import Array
from calib.errors import InputError
from calib.files.read import read_xml
from calib.files.shapes import SHAPES, spanned
from calib.files.tree import Joint, Shape, Tree, Weight

_LARGEST = 1e9  # in SI units
_KINDS = ("free", "ball", "prismatic", "revolute")  # mjtJoint; the module is imported where needed
_SITE = 6  # mjtObj
_GEOMS = ("plane", "hfield", "sphere", "capsule", "ellipsoid", "cylinder", "box", "mesh", "sdf")
_CONSTRAINTS = ("connect", "weld", "joint", "tendon", *["constraint"] * 8)


def load_mjcf(path: str | Path, base: str, tip: str, others: Sequence[str] = ()) -> Robot:
    """The arm from body ``base``, or ``world``, to body or site ``tip``, and to other tips.

    Joint readings are MuJoCo's ``qpos``. Joint frames have the axes of their body.

    Raises InputError for what is not well-formed, no way of hinge and slide joints, or refused by
    MuJoCo (a mesh that is missing too), and where MuJoCo is not installed.
    """
    path = Path(path)
    tree, model = mjcf_tree(path)
    robot = tree.robot(base, tip, others)
    links = _links(model)
    arm = [links.index(j.child) for j in tree.chain(base, tip, others) if j.child in links]
    _refuse_coupled(path, model, links.index(base), arm)
    return robot


def mjcf_tree(path: Path) -> tuple[Tree, Any]:
    """What an MJCF holds, and its ``mujoco.MjModel``. Raises InputError."""
    title, files, model = _compiled(path)
    data, read = _at_zero(model)
    if not all((np.abs(numbers) < _LARGEST).all() for numbers in read):  # NaN is not below
        what = "holds numbers that are not finite, or of no plausible size"
        raise InputError(path, "", what, "check what leads to a tip")
    links = _links(model)
    joints, frames = _walked(model, data, links)
    sites = [(name, s) for s in range(model.nsite) if (name := model.site(s).name) not in links]
    for site, s in sites:
        body = int(model.site_bodyid[s])
        T = inverse(frames[body]) @ _frame(data.site_xmat[s], data.site_xpos[s])
        joints.append(Joint("", "fixed", links[body], site or f"\0site {s}", T))
    weights = []
    for b in range(1, model.nbody):  # by principal moments in a frame of its own
        T = inverse(frames[b]) @ _frame(data.ximat[b], data.xipos[b])
        inertia = T[:3, :3] @ np.diag(model.body_inertia[b]) @ T[:3, :3].T
        weights.append(Weight(links[b], float(model.body_mass[b]), T[:3, 3], inertia))
    return Tree(
        Source("mjcf", files),
        title,
        (*links, *(joint.child for joint in joints[len(joints) - len(sites) :])),
        tuple(joints),
        tuple(weights),
        lambda link: _shapes(model, data, links.index(link), frames) if link in links else iter(()),
        ground=links[0],
        called="body or site",
    ), model


def _at_zero(model: Any) -> tuple[Any, tuple[Array, ...]]:
    """MuJoCo's data where joints read zero, those that are no hinge or slide as drawn; and numbers."""
    import mujoco

    data = mujoco.MjData(model)
    data.qpos[model.jnt_qposadr[model.jnt_type >= _KINDS.index("prismatic")]] = 0.0
    mujoco.mj_kinematics(model, data)
    placed = data.xpos, data.xmat, data.xipos, data.xanchor, data.site_xpos, data.geom_xpos
    return data, (*placed, model.body_mass)


def _links(model: Any) -> list[str]:
    """A key of every body: its name, if it has one."""
    return [model.body(b).name or f"\0{b}" for b in range(model.nbody)]


def _walked(model: Any, data: Any, links: list[str]) -> tuple[list[Joint], list[Array]]:
    """Joints, parents first, and the frame of each body (4, 4), m, in the world."""
    joints, frames = list[Joint](), [np.eye(4)]
    for b in range(1, model.nbody):
        above = int(model.body_parentid[b])
        parent, T = links[above], frames[above]
        for n, j in enumerate(np.flatnonzero(model.jnt_bodyid == b).tolist(), 1):
            kind, child = _KINDS[model.jnt_type[j]], f"\0{n} of {links[b]}"
            frame = _frame(data.xmat[b], data.xanchor[j] if kind in _KINDS[2:] else data.xpos[b])
            ends, axis = (parent, child), frame[:3, :3].T @ data.xaxis[j]
            moved = Joint(
                model.joint(j).name,
                kind,
                *ends,
                inverse(T) @ frame,
                axis,
                *_limits(model, j),
                losses=_losses(model, j),
            )
            joints.append(moved)
            parent, T = child, frame
        frames.append(_frame(data.xmat[b], data.xpos[b]))
        joints.append(Joint("", "fixed", parent, links[b], inverse(T) @ frames[b]))
    return joints, frames


def _losses(model: Any, j: int) -> tuple[float, float, float]:
    """Damping, friction and armature of a joint."""
    at = int(model.jnt_dofadr[j])
    each = model.dof_damping, model.dof_frictionloss, model.dof_armature
    damping, friction, armature = (float(own[at]) for own in each)
    return damping, friction, armature


def _limits(model: Any, j: int) -> tuple[tuple[float, float], float]:
    """Limits of a joint, reversed ones too, which MuJoCo takes as none, and its effort."""
    low, high = map(float, model.jnt_range[j])
    # The weaker direction counts where both differ; 0 says nothing, as in a URDF.
    effort = float(np.abs(model.jnt_actfrcrange[j]).min()) if model.jnt_actfrclimited[j] else 0.0
    limited = model.jnt_limited[j] or low > high
    return (low, high) if limited else (-np.inf, np.inf), effort or np.nan


def _frame(matrix: Array, position: Array) -> Array:
    """The frame (4, 4) at a position (3,), m, of a matrix (9,)."""
    return transform(matrix.reshape(3, 3), position)


def _shapes(model: Any, data: Any, body: int, frames: list[Array]) -> Iterator[Shape | str]:
    """Geoms of a body that can touch; what the world holds is none of the arm's."""
    touches = (model.geom_contype | model.geom_conaffinity) != 0
    for g in np.flatnonzero(touches & (model.geom_bodyid == body) & (body > 0)).tolist():
        kind, size = _GEOMS[model.geom_type[g]], np.array(model.geom_size[g])
        if kind not in SHAPES:
            yield f"{model.body(body).name} ({kind} has no end)"
            continue
        if kind == "mesh":
            mesh = model.mesh(int(model.geom_dataid[g]))
            begin, count = int(mesh.vertadr[0]), int(mesh.vertnum[0])
            size = np.array(model.mesh_vert[begin : begin + count], dtype=float)
        points, radius = spanned(kind, size)
        T = inverse(frames[body]) @ _frame(data.geom_xmat[g], data.geom_xpos[g])
        yield transformed(T, points), radius


# -- the file and what it includes -----------------------------------------------------------------


def _compiled(path: Path) -> tuple[str, tuple[Path, ...], Any]:
    """Name, all files, and the ``mujoco.MjModel`` of a whole file, its bodies kept apart.

    Raises InputError for what is no safe, well-formed MJCF.
    """
    files, title = [path], ""
    for here in files:  # grows as includes are met; what is not there MuJoCo names
        root = read_xml(here, "MJCF")
        if here == path and root.tag != "mujoco":
            remedy = "name a file that holds <mujoco>"
            raise InputError(path, f"<{root.tag}>", "is not an MJCF", remedy)
        title = title or root.get("model", path.stem)
        for include in root.iter("include"):
            tried = [place / include.get("file", "") for place in (path.parent, here.parent)]
            files += [file for file in tried if file.is_file() and file not in files][:1]
    return title, tuple(files), _model(path)


def _model(path: Path) -> Any:
    try:
        import mujoco
    except ImportError:
        what = "needs MuJoCo, which is not installed"
        raise InputError(path, "", what, "pip install '.[sim]'") from None
    mujoco.set_mju_user_warning(lambda _: None)  # its own handler writes MUJOCO_LOG.TXT
    try:
        with warnings.catch_warnings():  # of masses, which kinematics does not ask
            warnings.simplefilter("ignore")
            spec = mujoco.MjSpec.from_file(str(path))
            spec.compiler.fusestatic = False  # else a base without joints loses its name
            return spec.compile()
    except (ValueError, mujoco.FatalError) as error:
        said = re.sub(r"(, id \d+)?, line \d+", "", str(error))
        said = "; ".join(line.strip() for line in said.splitlines() if line.strip())
        remedy = "bring what it names, or remove it" if "opening file" in said else ""
        raise InputError(path, "", f"is refused by MuJoCo: {said}", remedy) from None
    finally:
        mujoco.set_mju_user_warning(None)


def _refuse_coupled(path: Path, model: Any, base: int, arm: Sequence[int]) -> None:
    """Refuse constraints on the bodies of the arm, but for those that hold a branch of it."""
    weld, below = model.body_weldid, {base}
    for b in range(base + 1, model.nbody):  # parents come first
        below |= {b} if int(model.body_parentid[b]) in below else set()
    rigid = {int(weld[b]) for b in arm} - {int(weld[base])}
    branches = {b for b in below if int(weld[b]) not in rigid | {int(weld[base])}}
    for i in np.flatnonzero(model.eq_active0).tolist():
        kind, of, body_of = _CONSTRAINTS[model.eq_type[i]], "body", np.arange(model.nbody)
        if kind == "joint":
            of, body_of = "joint", model.jnt_bodyid
        elif model.eq_objtype[i] == _SITE:
            of, body_of = "site", model.site_bodyid
        ends = [int(e) for e in (model.eq_obj1id[i], model.eq_obj2id[i]) if e >= 0]
        if kind == "tendon":
            of, hit, held = "tendon", ends[:1], set[int]()
        else:
            held = {int(body_of[e]) for e in ends}
            hit = [e for e in ends if int(weld[body_of[e]]) in rigid]
        if hit and (kind == "joint" or not branches & held):
            named = sorted(f"{of} {getattr(model, of)(e).name!r}" for e in hit)
            remedy = "closed loops and coupled joints are not supported"
            remedy += '; remove it or set active="false"'
            what = f"constrains {' and '.join(named)}"
            raise InputError(path, f"equality <{kind}>", what, remedy)
