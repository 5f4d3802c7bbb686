"""What reads the arm: cells and rows of every instrument, by plain numpy."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from studies.research.withheld.robots import Array

Row = tuple[int, dict[str, str]]
"""A pose's number, and what stands in the columns of its own."""

_MM, _FOCAL, _CENTER = 1e3, 1400.0, 800.0


class Scene(NamedTuple):
    """The tip at m poses, what sits on it, and what is known of that.

    R, p : ndarray, shapes (m, 3, 3) and (m, 3), m, base axes; station : ndarray of int, shape (m,)
    on_tip, guess : ndarray, shape (M, 3), m, markers in the tip frame, and their first guesses
    sigma : m, of a coordinate as the cell says it; loud : by how much the noise is larger than that
    """

    R: Array
    p: Array
    station: NDArray[np.int_]
    on_tip: Array
    guess: Array
    sigma: float
    loud: float

    @property
    def points(self) -> Array:
        """Markers in base axes, shape (m, M, 3), m."""
        return np.asarray(np.einsum("mij,kj->mki", self.R, self.on_tip) + self.p[:, None])

    @property
    def noise(self) -> float:
        """Of a coordinate as it is, m."""
        return self.sigma * self.loud


Read = Callable[[np.random.Generator, Scene], tuple[str, list[Row]]]


def _markers(scene: Scene) -> str:
    lines = [f"m{k + 1} = {_listed(_MM * g)}" for k, g in enumerate(scene.guess)]
    return "\n".join(["[markers_mm]", *lines, ""])


def _listed(numbers: Array) -> str:
    return str([round(float(x), 6) for x in numbers])


def _told(numbers: Array, *names: str) -> dict[str, str]:
    return {name: f"{x:.9g}" for name, x in zip(names, numbers, strict=True)}


def _each(values: Array) -> Iterator[tuple[int, int, Array]]:
    """Pose, marker and numbers of every reading (m, M, r)."""
    for i, j in np.ndindex(*values.shape[:2]):
        yield i, j, values[i, j]


def _stood(rng: np.random.Generator, scene: Scene) -> tuple[Array, Array]:
    """Where the instrument stands at every pose: frames of its stations, (m, 3, 3) and (m, 3)."""
    R = Rotation.random(8, rng=rng).as_matrix()
    return R[scene.station], rng.normal(scale=1.5, size=(8, 3))[scene.station]


def points(rng: np.random.Generator, scene: Scene) -> tuple[str, list[Row]]:
    """A tracker."""
    R, t = _stood(rng, scene)
    read = np.einsum("mij,mkj->mki", R, scene.points) + t[:, None]
    read = read + rng.normal(scale=scene.noise, size=read.shape)
    rows = [
        (i, {"marker": f"m{j + 1}"} | _told(_MM * y, "x_mm", "y_mm", "z_mm"))
        for i, j, y in _each(read)
    ]
    return f"{_markers(scene)}[instrument]\nsigma_mm = {_MM * scene.sigma:.9g}\n", rows


def pose(rng: np.random.Generator, scene: Scene) -> tuple[str, list[Row]]:
    """Motion capture of one or two bodies; with several stations each may see its own."""
    R, t = _stood(rng, scene)
    count = 1 + int(rng.random() < 0.4)
    own = Rotation.random(count, rng=rng).as_matrix()
    apart = rng.random() < 0.5
    turn = max(scene.noise * 2.0, 1e-9)
    rows: list[Row] = []
    for i, k in np.ndindex(len(R), count):
        if apart and k != scene.station[i] % count:
            continue
        at = R[i] @ scene.points[i, k % len(scene.on_tip)] + t[i]
        at = at + rng.normal(scale=scene.noise, size=3)
        frame = (
            R[i]
            @ scene.R[i]
            @ own[k]
            @ Rotation.from_rotvec(rng.normal(scale=turn, size=3)).as_matrix()
        )
        quat = np.roll(Rotation.from_matrix(frame).as_quat(), 1)
        names = ("x_mm", "y_mm", "z_mm", "qw", "qx", "qy", "qz")
        rows.append((i, {"marker": f"b{k + 1}"} | _told(np.r_[_MM * at, quat], *names)))
    there = dict.fromkeys(row["marker"] for _, row in rows)
    bodies = "".join(f"[bodies.{body}]\n" for body in there)
    sizes = f"sigma_mm = {_MM * scene.sigma:.9g}\nsigma_urad = {2e6 * scene.sigma:.9g}\n"
    return f'{bodies}[instruments.mocap]\nkind = "pose"\n{sizes}', rows


def camera(rng: np.random.Generator, scene: Scene) -> tuple[str, list[Row]]:
    """A camera before the arm, or on it, of a board of five points."""
    rides = rng.random() < 0.5
    shape = np.c_[rng.uniform(-0.1, 0.1, (5, 2)), np.zeros(5)]
    middle = scene.p.mean(axis=0)
    away = rng.normal(size=3)
    other = middle + 2.0 * away / np.linalg.norm(away)  # where the far one of the two stands
    near = scene.R @ scene.on_tip[0] + scene.p
    frame = scene.R @ Rotation.random(rng=rng).as_matrix()
    if (
        rides
    ):  # it looks at the board from each pose, as well as that goes: turned to it from the first
        first = scene.R[0].T @ _towards(other - near[0])
        look, eye, seen = scene.R @ first, near, np.broadcast_to(shape + other, (len(near), 5, 3))
    else:
        look = np.broadcast_to(_towards(middle - other), (len(near), 3, 3))
        eye = np.broadcast_to(other, near.shape)
        seen = near[:, None] + np.einsum("mij,kj->mki", frame, shape)
    own = np.einsum("mji,mkj->mki", look, seen - eye[:, None])
    rows: list[Row] = []
    for i, j, x in _each(own):
        if x[2] < 0.1 or np.hypot(x[0], x[1]) > 0.6 * x[2]:
            continue
        pixels = _FOCAL * x[:2] / x[2] + _CENTER + rng.normal(scale=0.2 * scene.loud, size=2)
        rows.append((i, {"marker": f"plate:p{j + 1}"} | _told(pixels, "u_px", "v_px")))
    named = ", ".join(f"p{k + 1} = {_listed(_MM * s)}" for k, s in enumerate(shape))
    on = ("tip", "world") if rides else ("world", "tip")
    text = (
        f'[boards.plate]\non = "{on[1]}"\npoints_mm = {{ {named} }}\n[instruments.eye]\n'
        f'kind = "camera"\non = "{on[0]}"\nfocal_px = {_FOCAL}\ncenter_px = [{_CENTER}, {_CENTER}]\n'
        "sigma_px = 0.2\n"
    )
    return text, rows


def _towards(ahead: Array) -> Array:
    """A frame whose z axis has this direction."""
    z = ahead / np.linalg.norm(ahead)
    x = np.cross(np.eye(3)[int(np.abs(z).argmin())], z)
    x = x / np.linalg.norm(x)
    return np.stack([x, np.cross(z, x), z], axis=1)


def distance(rng: np.random.Generator, scene: Scene) -> tuple[str, list[Row]]:
    """One or more draw-wires from anchors, some with an offset."""
    cell, rows = _markers(scene), []
    for k in range(int(rng.integers(1, 4))):
        anchor, offset = rng.normal(scale=1.5, size=3), rng.random() < 0.5
        d = np.linalg.norm(scene.points - anchor, axis=-1) + 0.2 * offset
        d = d + rng.normal(scale=scene.noise, size=d.shape)
        given = f"anchor_mm = {_listed(_MM * anchor + 20.0)}\n" if rng.random() < 0.3 else ""
        cell += (
            f'[instruments.w{k}]\nkind = "distance"\nsigma_mm = {_MM * scene.sigma:.9g}\n{given}'
            f"offset = {str(offset).lower()}\n"
        )
        rows += [
            (i, {"instrument": f"w{k}", "marker": f"m{j + 1}", "d_mm": f"{_MM * d[i, j]:.9g}"})
            for i, j in np.ndindex(*d.shape)
        ]
    return cell, rows


def plane(rng: np.random.Generator, scene: Scene) -> tuple[str, list[Row]]:
    """Gauges above planes."""
    return _gauged(rng, scene, "plane", lambda x, c, n: (x - c) @ n)


def _gauged(
    rng: np.random.Generator,
    scene: Scene,
    kind: str,
    height: Callable[[Array, Array, Array], Array],
) -> tuple[str, list[Row]]:
    cell, rows = _markers(scene), []
    for k in range(int(rng.integers(1, 4))):
        n = rng.normal(size=3)
        d = height(scene.points, rng.normal(size=3), n / np.linalg.norm(n))
        d = d + rng.normal(scale=scene.noise, size=d.shape)
        cell += f'[instruments.s{k}]\nkind = "{kind}"\nsigma_mm = {_MM * scene.sigma:.9g}\n'
        rows += [
            (i, {"instrument": f"s{k}", "marker": f"m{j + 1}", "d_mm": f"{_MM * d[i, j]:.9g}"})
            for i, j in np.ndindex(*d.shape)
        ]
    return cell, rows


def socket(rng: np.random.Generator, scene: Scene) -> tuple[str, list[Row]]:
    """The marker is said to sit in sockets; whether these poses could, nobody asked."""
    count = int(rng.integers(1, 5))
    cell = _markers(scene) + "".join(
        f'[instruments.n{k}]\nkind = "socket"\nsigma_mm = {_MM * scene.sigma:.9g}\n'
        for k in range(count)
    )
    rows = [
        (i, {"instrument": f"n{rng.integers(count)}", "marker": "m1"}) for i in range(len(scene.p))
    ]
    return cell, rows


READERS: dict[str, Read] = {
    "points": points, "pose": pose, "camera": camera, "distance": distance, "plane": plane,
    "socket": socket,
}  # fmt: skip
