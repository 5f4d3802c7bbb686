"""Where the fit of cameras ends, from cells as people write them: in the right valley, or with a word.

    python -m studies.research.benchmarks.camera_starts [--days 500] [--only hand] [--workers 2]

A set-up is drawn: an arm (Panda, UR5e, MA1400 on a turntable, SO-101), cameras (one fixed, two fixed,
one on the hand), a target (chessboard, AprilTag, twenty points in space, single points), few poses or
many, an arm that is right or wrong by degrees, extrinsics that are absent, guessed (20 cm, 30 deg off)
or right, and a focal length that is right, or 20 % off, free or not. The arm is NumPy's,
pixels are OpenCV's ``projectPoints``: nothing of it is shared with posecal.

``right`` ends at the noise, or where the same fit from the truth ends; ``said`` ends elsewhere
with a refusal or a warning of the camera; ``wrong`` is given as good. ``silent`` are right fits that
leave more than ten times the noise and do not say so.
"""

from __future__ import annotations

import tempfile
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from time import perf_counter
from typing import Any, cast

import click
import numpy as np
from scipy.spatial.transform import Rotation

import calib
from calib.arm.se3 import inverse
from calib.arrays import Array, Mask
from calib.effects.base import Base
from calib.effects.tool import Tool
from calib.errors import CalibError
from calib.identification.lenses import unfit_lenses
from calib.identification.start import whitening
from calib.instruments import Camera
from calib.observations import Points
from calib.solver import levenberg_marquardt
from studies.identify.parameters import UnfitLensEntry
from studies.research.bench import Output, Row, bench, each, table
from studies.research.cameras import corners, frame, pixels
from studies.research.withheld.robots import LIGHT, Arm, Joint, Triple
from studies.research.withheld.truth import tip_in_numpy, urdf

_IMAGE, _NOISE = np.array([1280.0, 960.0]), 0.2  # px
_DRAWN = 4000
_RIGHT, _LOUD = 1.15, 10.0  # of what the fit from the truth leaves, and of the noise
_GUESS_M, _GUESS_DEG = 0.2, 30.0
_H = np.pi / 2.0


@dataclass(frozen=True, eq=False)
class Placed:
    """An arm whose joints turn about z, and the angles, deg, about which it is measured."""

    arm: Arm
    home_deg: tuple[float, ...]

    def tips(self, q: Array) -> Array:
        """Tip frames (m, 4, 4) at joint angles (m, dof), rad."""
        T = np.tile(np.eye(4), (len(q), 1, 1))
        T[:, :3, :3], T[:, :3, 3] = tip_in_numpy(self.arm, q, np.zeros((self.arm.dof + 2, 6)))
        return T


def _arm(home_deg: tuple[float, ...], *links: tuple[Triple, Triple]) -> Placed:
    """An arm by the origins (xyz, rpy) of its joints, the tip's last."""
    *joints, (tip_xyz, tip_rpy) = links
    turning = tuple(
        Joint(f"j{k + 1}", xyz, (0, 0, 1), -6.3, 6.3, 0.0, (0, 0, 0), rpy=rpy)
        for k, (xyz, rpy) in enumerate(joints)
    )
    arm = replace(
        LIGHT, name="arm", base="base", tip="tip", joints=turning, tip_xyz=tip_xyz, tip_rpy=tip_rpy
    )
    return Placed(arm, home_deg)


ARMS = {
    "panda": _arm(
        (0, 0, 0, -110, 0, 110, 45),
        ((0, 0, 0.333), (0, 0, 0)), ((0, 0, 0), (-_H, 0, 0)), ((0, -0.316, 0), (_H, 0, 0)),
         ((0.0825, 0, 0), (_H, 0, 0)), ((-0.0825, 0.384, 0), (-_H, 0, 0)), ((0, 0, 0), (_H, 0, 0)),
         ((0.088, 0, 0), (_H, 0, 0)), ((0, 0, 0.107), (0, 0, 0)),
    ),
    "ur5e": _arm(
        (10, -80, 100, -110, -90, 20),
        ((0, 0, 0.1625), (0, 0, 0)), ((0, 0, 0), (_H, 0, 0)), ((-0.425, 0, 0), (0, 0, 0)),
         ((-0.3922, 0, 0.1333), (0, 0, 0)), ((0, -0.0997, 0), (_H, 0, 0)),
         ((0, 0.0996, 0), (_H, np.pi, np.pi)), ((0, 0, 0.05), (0, 0, 0)),
    ),
    "ma1400": _arm(
        (0, -20, 30, -30, -60, 15, -70),
        ((0, 0, 0), (0, 0, -_H)), ((0, 0, -0.263), (0.2618, 0, 0)),
         ((0.15, 0, 1.4159), (-_H, -_H, 0)), ((0.614, 0, 0), (np.pi, 0, 0)),
         ((0.2, 0, 0), (-_H, 0, 0)), ((0, 0, -0.64), (_H, _H, 0)), ((0.03, 0, 0), (_H, 0, 0)),
         ((0, 0, 0.2), (0, 0, 0)),
    ),
    "so101": _arm(
        (0, -20, 20, 40, 10),
        ((0.0388, 0, 0.0624), (np.pi, 0, -np.pi)), ((-0.0304, -0.0183, -0.0542), (-_H, -_H, 0)),
         ((-0.1126, -0.028, 0), (0, 0, _H)), ((-0.1349, 0.0052, 0), (0, 0, -_H)),
         ((0, -0.0611, 0.0181), (_H, 0.0487, np.pi)), ((-0.0079, -0.0002, -0.0981), (0, np.pi, 0)),
    ),
}  # fmt: skip
_FIRST_FIXED = {"ma1400"}  # a turntable that stands


def _about_z(angle: float) -> Array:
    return np.asarray(Rotation.from_rotvec([0.0, 0.0, angle]).as_matrix())


def _turn(rng: np.random.Generator, degrees: float) -> Array:
    """A turn by so much about an axis drawn at random."""
    axis = rng.normal(size=3)
    turn = Rotation.from_rotvec(axis / np.linalg.norm(axis) * np.radians(degrees))
    return np.asarray(turn.as_matrix())


# -- targets -------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Target:
    """Points (n, 3), m, in a frame whose z goes into the paper; normals (n, 3) against the view.

    whole : whether it is found as a whole or not at all; keys : of its table, None for single markers
    """

    names: tuple[str, ...]
    points: Array
    normals: Array
    whole: bool
    keys: str | None


def _solid(radius: float) -> Array:
    """The corners of a dodecahedron: twenty centres of an icosahedron's faces."""
    g = (1.0 + np.sqrt(5.0)) / 2.0
    cube = [(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]
    rest = [np.roll((0.0, a / g, b * g), k) for k in range(3) for a in (-1, 1) for b in (-1, 1)]
    return np.asarray(np.array([*cube, *rest]) * (radius / np.sqrt(3.0)))


def target(kind: str, size: float, rng: np.random.Generator) -> Target:
    """A target for an arm of this size, m."""
    into = np.array([0.0, 0.0, 1.0])
    if kind == "chessboard":
        pitch = round(0.02 * size, 4)
        names = tuple(map(str, range(35)))
        keys = f"squares = [8, 6]\npitch_mm = {1e3 * pitch}"
        return Target(names, corners(7, 5, pitch), np.tile(into, (35, 1)), True, keys)
    if kind == "tag":
        side = round(0.06 * size, 4)
        around = np.array([(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)]) * side
        keys = f"tags = [1, 1]\ntag_mm = {1e3 * side}\ngap_mm = 10"
        return Target(tuple(f"0_{k}" for k in range(4)), around, np.tile(into, (4, 1)), True, keys)
    if kind == "solid":
        points = _solid(0.055 * size)
        names = tuple(f"f{k + 1}" for k in range(20))
        listed = ", ".join(
            f"{n} = [{', '.join(f'{1e3 * c:.6f}' for c in p)}]"
            for n, p in zip(names, points, strict=True)
        )
        return Target(names, points, -points / np.linalg.norm(points, axis=1)[:, None], False,
                      f"points_mm = {{ {listed} }}")  # fmt: skip
    count = int(rng.integers(1, 4))
    points = rng.uniform(-0.06, 0.06, (count, 3)) * size
    return Target(
        tuple(f"m{k + 1}" for k in range(count)), points, np.zeros((count, 3)), False, None
    )


# -- a set-up ------------------------------------------------------------------------------------


@dataclass(frozen=True)
class SetUp:
    """What was drawn: words by which set-ups are counted, files, and the truth.

    cameras : frames on the tip, or in the base; target : the target's frame on the other side
    focal : px, the true one; offsets : rad, of the joints
    """

    kind: dict[str, str]
    cell: str
    urdf: str
    rows: tuple[str, ...]
    target: Target
    cameras: dict[str, Array]
    at: Array
    focal: float
    offsets: Array


def drawn(index: int, seed: int, only: Sequence[str] = ()) -> SetUp:
    """The set-up of an index; only : words that must stand in its kind."""
    for attempt in range(1000):
        found = _drawn(np.random.default_rng([seed, index, attempt]), only)
        if found is not None:
            return found
    raise click.UsageError(f"no set-up is of the kinds {', '.join(only)}")


def _drawn(rng: np.random.Generator, only: Sequence[str]) -> SetUp | None:
    arm_name = str(rng.choice([*ARMS]))
    where = str(rng.choice(["one fixed", "two fixed", "hand"]))
    shape = str(rng.choice(["chessboard", "tag", "solid", "singles"]))
    if where == "hand" and shape == "singles":
        shape = "chessboard"
    few = bool(rng.random() < 0.5)
    kind = {
        "arm": arm_name,
        "cameras": where,
        "target": shape,
        "poses": "few" if few else "many",
        "joints": str(rng.choice(["true arm", "wrong arm"])),
        "extrinsics": str(rng.choice(["absent", "guessed", "given"])),
        "focal": str(rng.choice(["f right", "f off, fixed", "f off, free"], p=[0.5, 0.2, 0.3])),
    }
    if any(word not in kind.values() for word in only):
        return None
    arm = ARMS[arm_name]
    home, dof = np.radians(arm.home_deg), len(arm.home_deg)
    tip = arm.tips(home[None])[0]
    size = {"so101": 0.5, "ma1400": 1.6}.get(arm_name, 1.0)
    own = target(shape, size, rng)
    focal = float(rng.uniform(900.0, 1500.0))
    middle = own.points.mean(axis=0)
    cameras: dict[str, Array] = {}
    if where == "hand":
        away = float(rng.uniform(0.25, 0.6)) * size
        there = rng.uniform(-0.08, 0.08, 3) * size
        turned = _turn(rng, rng.uniform(0.0, 30.0)) @ _about_z(rng.uniform(-3, 3))
        cameras["eye"] = frame(there, turned)
        C = tip @ cameras["eye"]
        facing = C[:3, :3] @ _turn(rng, rng.uniform(0.0, 35.0)) @ _about_z(rng.uniform(-3, 3))
        at = frame(C[:3, 3] + away * C[:3, 2] - facing @ middle, facing)
    else:
        at = frame(rng.uniform(-0.1, 0.1, 3) * size, _turn(rng, rng.uniform(0.0, 180.0)))
        X = tip @ at
        centre = X[:3, :3] @ middle + X[:3, 3]
        for k in range(2 if where == "two fixed" else 1):
            away = float(rng.uniform(0.9, 1.6)) * size
            to = X[:3, :3] @ _turn(rng, rng.uniform(5.0, 35.0)) @ _about_z(rng.uniform(-3, 3))
            cameras[f"cam{k + 1}"] = frame(centre - away * to[:, 2], to)
    wanted = int(rng.integers(4, 11) if few else rng.integers(20, 41))
    if shape == "singles":  # four images of one point tell nothing
        wanted = max(wanted, 8) if few else wanted
    wrong = kind["joints"] == "wrong arm"
    offsets = np.radians(rng.normal(scale=1.5, size=dof)) * wrong
    held = np.arange(dof) < (1 if arm_name in _FIRST_FIXED else 0)
    spread = float(rng.uniform(15.0, 35.0))
    while True:
        q = home + np.radians(spread) * rng.uniform(-1, 1, (_DRAWN, dof)) * ~held
        uv, seen = _views(arm.tips(q + offsets), cameras, at, own, focal, where == "hand")
        good = np.flatnonzero(np.all([s.sum(axis=1) >= 1 for s in seen.values()], axis=0))
        if where == "two fixed":
            good = np.flatnonzero(np.any([s.sum(axis=1) >= 1 for s in seen.values()], axis=0))
        if len(good) >= wanted:
            break
        spread *= 0.75
        if spread < 5.0:
            return None
    good = good[:wanted]
    rows = []
    for camera, own_uv in uv.items():
        for i, k in enumerate(good.tolist()):
            shared = ",".join(f"{np.degrees(v):.6f}" for v in q[k])
            for j in np.flatnonzero(seen[camera][k]).tolist():
                u, v = own_uv[k, j] + rng.normal(scale=_NOISE, size=2)
                name = own.names[j] if own.keys is None else f"b:{own.names[j]}"
                rows.append(f"p{i:03d},{camera},{name},{shared},{u:.4f},{v:.4f}")
    off = 1.0 if kind["focal"] == "f right" else float(rng.choice([0.8, 1.25]))
    cell = _cell(kind, own, cameras, at, focal * off, rng)
    return SetUp(
        kind, cell, urdf(arm.arm, masses=False), tuple(rows), own, cameras, at, focal, offsets
    )


def _views(
    tips: Array, cameras: dict[str, Array], at: Array, own: Target, focal: float, hand: bool
) -> tuple[dict[str, Array], dict[str, Mask]]:
    """Pixels (m, n, 2) of every camera, and which of them are seen."""
    uv, seen = {}, {}
    for name, camera in cameras.items():
        T = np.linalg.inv(tips @ camera) @ at if hand else np.linalg.inv(camera) @ tips @ at
        viewed = own.points @ np.swapaxes(T[:, :3, :3], -1, -2) + T[:, None, :3, 3]
        normals = own.normals @ np.swapaxes(T[:, :3, :3], -1, -2)
        ahead = viewed[..., 2] > 0.05
        flat = np.where(ahead[..., None], viewed, [0.0, 0.0, 1.0]).reshape(-1, 3)
        uv[name] = pixels(flat, np.eye(4), focal, _IMAGE / 2).reshape((*viewed.shape[:-1], 2))
        cosine = (viewed * normals).sum(axis=-1) / np.linalg.norm(viewed, axis=-1)
        faces = (cosine > np.cos(np.radians(65.0))) | (np.abs(own.normals).sum(axis=-1) == 0.0)
        inside = ((uv[name] > 5.0) & (uv[name] < _IMAGE - 5.0)).all(axis=-1)
        seen[name] = ahead & faces & inside
        if own.whole:
            seen[name] &= seen[name].all(axis=1, keepdims=True)
    return uv, seen


def _cell(
    kind: dict[str, str],
    own: Target,
    cameras: dict[str, Array],
    at: Array,
    focal: float,
    rng: np.random.Generator,
) -> str:
    hand = kind["cameras"] == "hand"

    def place(T: Array) -> str:
        if kind["extrinsics"] == "absent":
            return ""
        if kind["extrinsics"] == "guessed":
            shift = rng.normal(size=3)
            shift *= _GUESS_M / np.linalg.norm(shift)
            T = frame(T[:3, 3] + shift, T[:3, :3] @ _turn(rng, _GUESS_DEG))
        listed = [
            ", ".join(f"{v:.6f}" for v in own)
            for own in (
                1e3 * T[:3, 3],
                Rotation.from_matrix(T[:3, :3]).as_euler("xyz", degrees=True),
            )
        ]
        return f"position_mm = [{listed[0]}]\nrpy_deg = [{listed[1]}]\n"

    parts = ['schema = 1\n[robot]\nurdf = "arm.urdf"\nbase = "base"\ntip = "tip"\n']
    if own.keys is None:
        parts.append("[markers_mm]\n")
        for name, p in zip(own.names, own.points, strict=True):
            there = at[:3, :3] @ p + at[:3, 3] if kind["extrinsics"] == "given" else np.zeros(3)
            parts.append(f"{name} = [{', '.join(f'{1e3 * v:.4f}' for v in there)}]\n")
    else:
        parts.append(f'[boards.b]\non = "{"world" if hand else "tip"}"\n{own.keys}\n{place(at)}')
    for name, T in cameras.items():
        free = '\nfree = ["focal"]' if kind["focal"] == "f off, free" else ""
        parts.append(
            f'[instruments.{name}]\nkind = "camera"\non = "{"tip" if hand else "world"}"\n'
            f"focal_px = {focal:.4f}\ncenter_px = [640, 480]\nimage_px = [1280, 960]\n"
            f"sigma_px = {_NOISE}{free}\n{place(T)}"
        )
    effects = ["base", "tool"] + ["joint_offset"] * (kind["joints"] == "wrong arm")
    parts.append(f"[model]\neffects = {effects}\n".replace("'", '"'))
    return "".join(parts)


def written(folder: Path, setup: SetUp) -> tuple[calib.Cell, calib.Measurements]:
    """The set-up's files in a folder, read again."""
    (folder / "arm.urdf").write_text(setup.urdf)
    (folder / "cell.toml").write_text(setup.cell)
    joints = ",".join(f"j{k + 1}_deg" for k in range(len(setup.offsets)))
    head = f"pose,instrument,marker,{joints},u_px,v_px"
    (folder / "m.csv").write_text("\n".join([head, *setup.rows, ""]))
    cell = calib.load_cell(folder / "cell.toml")
    return cell, calib.load_measurements(cell, folder / "m.csv")


def truth_values(setup: SetUp, model: Any) -> Array:
    """The values (p,) of the truth, as far as the model has them."""

    def vector(T: Array) -> Array:
        return np.concatenate([T[:3, 3], Rotation.from_matrix(T[:3, :3]).as_rotvec()])

    values, hand = model.initial.copy(), setup.kind["cameras"] == "hand"
    for effect, part in model.parts:
        if isinstance(effect, Base):
            place = setup.at if hand else inverse(setup.cameras[effect.of.name])
            lens = [setup.focal - f for f in cast("Camera", effect.of).lens.values[:2]]
            values[part] = [*vector(place), *lens][: part.stop - part.start]
        elif isinstance(effect, Tool):
            if hand:
                C = setup.cameras["eye"]
                there = C[:3, 3] + np.array([np.zeros(3), C[:3, 0], C[:3, 1]])
            else:
                there = setup.target.points @ setup.at[:3, :3].T + setup.at[:3, 3]
                if setup.target.keys is None:
                    there = there[effect.marker : effect.marker + 1]
            values[part] = effect.values_at(there - model.markers[effect.markers])
        elif effect.kind == "joint_offset":
            values[part] = setup.offsets[int(effect.where[1:]) - 1]
    return np.asarray(values)


def a_set_up(index: int, seed: int, only: Sequence[str] = ()) -> Row:
    """One set-up, identified from its files."""
    setup = drawn(index, seed, only)
    row: Row = {"index": index, **setup.kind}
    with tempfile.TemporaryDirectory() as folder:
        cell, data = written(Path(folder), setup)
        begun = perf_counter()
        try:
            found = calib.identify(cell, data)
        except CalibError as error:
            return {**row, "end": "said", "said": str(error), "seconds": perf_counter() - begun}
        row["seconds"] = perf_counter() - begun
        model = found.model
        points = Points(model, data, whitening(cell, model, found.values, data))
        best = levenberg_marquardt(points.flat, truth_values(setup, model), found.span, 200)
        numbers = 2 * int(data.seen.sum())
        row["left"] = float(np.sqrt((points.flat(found.values)[0] ** 2).sum() / numbers)) * _NOISE
        row["from truth"] = float(np.sqrt(best.cost / numbers)) * _NOISE
    said = [w for w in found.warnings if "camera" in w or "cam" in w or "eye" in w]
    refused = [UnfitLensEntry.from_result(own).said for own in unfit_lenses(found)]
    row["said"] = "; ".join([*said, *refused])
    right = bool(row["left"] <= max(_RIGHT * row["from truth"], 1.5 * _NOISE))
    row["end"] = "right" if right else "said" if row["said"] else "wrong"
    row["silent"] = right and row["left"] > _LOUD * _NOISE and not row["said"]
    return row


@bench(
    click.option("--only", multiple=True, help="Words of a kind, as printed; all must hold."),
    days=500,
    days_help="Set-ups.",
    workers=True,
)
def main(only: Sequence[str], days: int, seed: int, workers: int) -> Output:
    """In which valley the fit of cameras ends."""
    rows = each(a_set_up, [(k, seed, only) for k in range(days)], workers)
    shown = [{"kind": "all", **_counts(rows)}]
    for key in ("cameras", "target", "poses", "joints", "extrinsics", "focal", "arm"):
        for value in dict.fromkeys(row[key] for row in rows):
            shown.append({"kind": value, **_counts([row for row in rows if row[key] == value])})
    return [table(shown)], rows


def _counts(rows: Sequence[Row]) -> Row:
    ends = [row["end"] for row in rows]
    return {
        "set-ups": len(rows),
        "right": ends.count("right"),
        "said": ends.count("said"),
        "wrong": ends.count("wrong"),
        "right or said": f"{1.0 - ends.count('wrong') / max(len(rows), 1):.1%}",
        "silent": sum(row.get("silent", False) for row in rows),
        "median s": f"{np.median([row['seconds'] for row in rows]):.2f}",
    }


if __name__ == "__main__":
    main()
