"""Read an MJCF through MuJoCo itself: the joints from a body to bodies or sites, a chain or a tree."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

import numpy as np

from calib.arm.robot import Place, Robot, weights_of
from calib.arm.se3 import so3_about, transform
from calib.arrays import Array
from calib.errors import InputError
from calib.files.mjcf_tree import WORLD, chain_of, joints_of, label, part_of, read_mjcf


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
        raise InputError(path, "", f"is refused by MuJoCo: {said}") from None
    finally:
        mujoco.set_mju_user_warning(None)


@dataclass(frozen=True, eq=False)
class MjcfJoint:
    """A joint as compiled: ``T = .. E(q - ref) ..``, E about or along the axis through the anchor.

    anchor, axis : ndarray, shape (3,), m and unit vector, in the frame of the body
    ref : float, rad or m, the reading at which the body stands as the file says
    limits, effort : as in :class:`~calib.arm.robot.Robot`
    """

    name: str
    slides: bool
    anchor: Array
    axis: Array
    ref: float
    limits: tuple[float, float]
    effort: float

    @property
    def origin(self) -> Array:
        """T_body_joint, the joint frame at zero reading, shape (4, 4)."""
        if self.slides:
            return shifted(self.anchor - self.ref * self.axis)
        return transform(so3_about(self.axis, np.array(-self.ref)), self.anchor)


@dataclass(frozen=True, eq=False)
class MjcfBody:
    """A body on the way to a tip as compiled.

    parent : int, position among these of the one that carries it, -1 for the base
    T : ndarray, shape (4, 4), T_parent_body
    joints : list of MjcfJoint, the first one moves the others
    """

    parent: int
    T: Array
    joints: list[MjcfJoint]


@dataclass(frozen=True, eq=False)
class MjcfChain:
    """What lies between base and tips, as compiled.

    tips : dict, name -> position of the body that is or holds the tip, -1 for the base, and its frame
        (4, 4) there; the tip first
    weights : list of place, mass [kg] and centre of mass (3,), m, of every body that the chain moves
    """

    bodies: list[MjcfBody]
    tips: dict[str, tuple[int, Array]]
    weights: list[tuple[Place, float, Array]]


def load_mjcf(path: str | Path, base: str, tip: str, others: Sequence[str] = ()) -> Robot:
    """Read the joints from body ``base``, or ``world``, to body or site ``tip``, and to other tips.

    Joint readings are MuJoCo's ``qpos``. Joint frames have the axes of their body. Bodies that hang on
    a moving one give it their masses, as they are drawn where joints beside the chain move them.

    Raises InputError for what is not well-formed, no way of hinge and slide joints, or refused by
    MuJoCo, and where MuJoCo is not installed.
    """
    path = Path(path)
    root, _ = read_mjcf(path)
    chain = compiled(path, root, base, tip, others)
    joints = [joint for body in chain.bodies for joint in body.joints]
    with np.errstate(over="ignore", invalid="ignore"):  # what is not finite is refused below
        hung = _hung(chain, (*others, tip))
        origins = [T for _, T in hung]
        masses, coms = weights_of(len(joints), chain.weights)
    if not all(np.isfinite(a).all() for a in (origins, masses, coms)):
        raise InputError(path, "", "holds numbers that are not finite", "check what leads to a tip")
    return Robot(
        name=root.get("model", path.stem),
        base=base,
        tip=tip,
        joints=tuple(joint.name for joint in joints),
        prismatic=np.array([joint.slides for joint in joints]),
        origins=np.array(origins),
        axes=np.array([joint.axis for joint in joints]),
        limits=np.array([joint.limits for joint in joints]),
        efforts=np.array([joint.effort for joint in joints]),
        masses=masses,
        coms=coms,
        others=tuple(others),
        parents=tuple(k for k, _ in hung),
    )


def _hung(chain: MjcfChain, tips: Sequence[str]) -> list[Place]:
    """Where each joint's frame, and then each tip's, hangs on the joint before it."""
    found: list[Place] = []
    carried: list[Place] = [(0, np.eye(4))]  # of the base, then of the bodies
    for body in chain.bodies:
        k, T = carried[body.parent + 1]
        T = T @ body.T
        for joint in body.joints:
            found.append((k, T @ joint.origin))
            k, T = len(found), shifted(-joint.anchor)
        carried.append((k, T))
    for body_of_tip, T_tip in (chain.tips[tip] for tip in tips):
        k, T = carried[body_of_tip + 1]
        found.append((k, T @ T_tip))
    return found


def mjcf_files(path: Path) -> tuple[Path, ...]:
    """The file and all that it includes. Raises InputError."""
    return read_mjcf(path)[1]


@np.errstate(over="ignore", invalid="ignore")  # load_mjcf refuses what is not finite
def compiled(
    path: Path, root: Element, base: str, tip: str, others: Sequence[str] = ()
) -> MjcfChain:
    """The chain, or tree, of a file, which stays as it is. Raises InputError."""
    tree = chain_of(path, root, base, tip, others)
    part = part_of(path, tree)
    with mujoco_for(path) as mujoco:
        text = ElementTree.tostring(part.root, encoding="unicode")
        model = mujoco.MjModel.from_xml_string(text, part.meshes)
    if not any(joints_of(body) for body in tree.bodies):
        raise InputError(path, "", "the chain has no moving joint", "check [robot] base and tip")
    own = [int(model.body(part.names[body]).id) for body in tree.bodies]
    at = {b: i for i, b in enumerate(own)}
    bodies = [
        MjcfBody(
            at.get(int(model.body_parentid[b]), -1),
            placed(model.body_pos[b], model.body_quat[b]),
            [_joint(path, element, model, int(j)) for j in np.flatnonzero(model.jnt_bodyid == b)],
        )
        for element, b in zip(tree.bodies, own, strict=True)
    ]
    tips: dict[str, tuple[int, Array]] = {}
    for name, end in tree.tips.items():
        body = -1 if end.body is None else tree.bodies.index(end.body)
        site = None if end.site is None else model.site(name)
        tips[name] = body, np.eye(4) if site is None else placed(site.pos, site.quat)
    places = places_of(model, 0 if base == WORLD else int(model.body(base).id), own)
    return MjcfChain(
        bodies,
        tips,
        [(place, float(model.body_mass[i]), model.body_ipos[i]) for i, place in places.items()],
    )


def places_of(model: Any, first: int, chain: list[int]) -> dict[int, Place]:
    """Where every body of the arm is, of a compiled model whose ways to tips have these bodies.

    Of the world itself nothing belongs to the arm, and what stands there neither: the floor, tables.

    first : the base, 0 for the world
    """
    found: dict[int, Place] = {first: (0, np.eye(4))}
    last = dict(zip(chain, np.cumsum(model.body_jntnum[chain]).tolist(), strict=True))
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
    return {body: place for body, place in found.items() if body}


def _joint(path: Path, body: Element, model: Any, j: int) -> MjcfJoint:
    from mujoco import mjtJoint

    kind, name = mjtJoint(int(model.jnt_type[j])), model.joint(j).name
    if kind not in (mjtJoint.mjJNT_HINGE, mjtJoint.mjJNT_SLIDE):
        said = kind.name.removeprefix("mjJNT_").lower()
        raise InputError(path, label(body), f"has a {said} joint", "use hinge and slide joints")
    if not name:
        raise InputError(
            path, label(body), "has a joint without a name", "name it as the columns of the data do"
        )
    low, high = map(float, model.jnt_range[j])
    if low > high:  # MuJoCo takes it as no limit
        raise InputError(path, f"joint {name!r}", f"range {low:g} .. {high:g} is reversed")
    # The weaker direction counts where both differ; 0 says nothing, as in a URDF.
    effort = float(np.abs(model.jnt_actfrcrange[j]).min()) if model.jnt_actfrclimited[j] else 0.0
    return MjcfJoint(
        name,
        slides=kind == mjtJoint.mjJNT_SLIDE,
        anchor=model.jnt_pos[j].copy(),
        axis=model.jnt_axis[j].copy(),
        ref=float(model.qpos0[model.jnt_qposadr[j]]),
        limits=(low, high) if model.jnt_limited[j] else (-np.inf, np.inf),
        effort=effort or np.nan,
    )


def placed(position: Array, quaternion: Array) -> Array:
    """The frame (4, 4) at a position (3,), m, turned by a quaternion (w, x, y, z)."""
    import mujoco

    R = np.empty(9)
    mujoco.mju_quat2Mat(R, quaternion)
    return transform(R.reshape(3, 3), position)


def shifted(translation: Array) -> Array:
    """The frame (4, 4) at a translation (3,), m, not turned."""
    return transform(np.eye(3), translation)
