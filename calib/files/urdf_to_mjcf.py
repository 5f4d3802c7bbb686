"""A URDF as an MJCF, through MuJoCo: bodies, joints and inertias, no shapes."""

from __future__ import annotations

from pathlib import Path
from xml.etree import ElementTree
from xml.etree.ElementTree import Element, SubElement

from calib.files.in_mujoco import mujoco_for
from calib.files.urdf_out import MARKER

_KEPT = ("link", "joint")
_SHAPES = ("visual", "collision")
# Links without inertia, and inertias that no body can have, must not keep MuJoCo from reading it.
_LENIENT = {"boundmass": "1e-9", "boundinertia": "1e-9", "balanceinertia": "true"}


def mjcf_of_urdf(source: Path, text: str, tip: str) -> str:
    """The text of an MJCF with the chain, the branches and the inertias of a URDF.

    Marker links become sites of the tip. MuJoCo writes six digits: places, axes and ranges, which
    the calibration is about, are written anew from the compiled model.

    source : path that messages name
    text : the URDF
    tip : the link that carries the marker links

    Raises InputError where MuJoCo is not installed or refuses it.
    """
    root = ElementTree.fromstring(text)  # noqa: S314 - made by corrected_urdf
    for element in list(root):
        if element.tag not in _KEPT:
            root.remove(element)
        for shape in [child for child in element if child.tag in _SHAPES]:
            element.remove(shape)
    extension = SubElement(root, "mujoco")
    SubElement(extension, "compiler", _LENIENT | {"fusestatic": "false", "discardvisual": "false"})
    with mujoco_for(source) as mujoco:
        spec = mujoco.MjSpec.from_string(ElementTree.tostring(root, encoding="unicode"))
        model = spec.compile()
        written = ElementTree.fromstring(spec.to_xml())  # noqa: S314 - made by MuJoCo
    for body in written.iter("body"):
        compiled = model.body(body.get("name"))
        _exact(body, pos=compiled.pos, quat=compiled.quat)
        for element in body.findall("joint"):
            joint = model.joint(element.get("name"))
            _exact(element, axis=joint.axis)
            if joint.limited[0]:
                _exact(element, range=joint.range)
    for body in written.iter("body"):
        if body.get("name") == tip:
            for marker in body.findall("body"):
                _as_site(marker)
    ElementTree.indent(written)
    return ElementTree.tostring(written, encoding="unicode") + "\n"


def _exact(element: Element, **values: object) -> None:
    for key, numbers in values.items():
        element.set(key, " ".join(repr(float(x)) for x in numbers))  # type: ignore[attr-defined]


def _as_site(body: Element) -> None:
    if body.get("name", "").startswith(MARKER):
        body[:] = []
        body.tag = "site"
