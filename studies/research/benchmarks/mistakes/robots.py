"""Small robots with the shapes that public ones have: a gripper, a finger, a linkage, absent meshes."""

from __future__ import annotations

_AXES = ("0 0 1", "0 1 0", "0 1 0", "1 0 0", "0 1 0", "1 0 0", "0 0 1")


def urdf(joints: str, more: str = "", limits: tuple[str, str] = ("-2", "2")) -> str:
    """Joints as ``parent>child:name:type``; more : elements of the robot."""
    parts = [part.replace(">", ":").split(":") for part in joints.split()]
    links = dict.fromkeys(name for parent, child, *_ in parts for name in (parent, child))
    texts = [f'<link name="{name}"/>' for name in links]
    for k, (parent, child, name, kind) in enumerate(parts):
        texts.append(
            f'<joint name="{name}" type="{kind}"><origin xyz="0.05 0 0.2"/><parent link="{parent}"/>'
            f'<child link="{child}"/><axis xyz="{_AXES[k % len(_AXES)]}"/>'
            f'<limit lower="{limits[0]}" upper="{limits[1]}" effort="0" velocity="0"/></joint>'
        )
    return f'<robot name="arm">{"".join(texts)}{more}</robot>'


_LINKS = "base>l1:pan:revolute l1>l2:lift:revolute l2>l3:elbow:revolute l3>l4:wrist:revolute "
JAW = urdf(
    _LINKS + "l4>hand:wrist_roll:revolute hand>frame:f:fixed hand>moving_jaw:gripper:revolute"
)
MOVER = urdf(_LINKS + "l4>stator:s:fixed stator>mover:jointGripper:revolute")
LEFT = urdf(
    _LINKS + "l4>ft:ft:fixed ft>palm:p:fixed palm>drive:gripper_left_joint:revolute "
    "drive>inner:inner_double_joint:fixed"
)
FINGER = urdf(_LINKS + "l4>tool0:t:fixed l4>slider:j7:prismatic")
TURNING = urdf(_LINKS + "l4>hand:HandYaw:revolute hand>tool0:t:fixed")
BARE = urdf(_LINKS + "l4>l5:roll:revolute l5>tool0:t:fixed")
MESHES = BARE.replace(
    '<link name="l2"/>',
    '<link name="l2"><collision><geometry><mesh filename="package://arm/l2.stl"/></geometry>'
    "</collision></link>",
)
LINKAGE = BARE.replace(
    '<axis xyz="0 1 0"/><limit lower="-2" upper="2" effort="0" velocity="0"/></joint>'
    '<joint name="wrist"',
    '<axis xyz="0 1 0"/><limit lower="-2" upper="2" effort="0" velocity="0"/>'
    '<mimic joint="lift" multiplier="-1"/></joint><joint name="wrist"',
)
DEGREES = urdf(_LINKS + "l4>l5:roll:revolute l5>tool0:t:fixed", limits=("-170", "170"))
FAR_SLIDE = urdf(
    "base>l0:rail:prismatic l0>l1:pan:revolute l1>l2:lift:revolute l2>tool0:t:fixed",
    limits=("-180", "180"),
)
