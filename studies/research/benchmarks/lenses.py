"""Is it the camera, the board or the arm: what the diagnosis says of days whose error is known.

    python -m studies.research.benchmarks.lenses [--days 20] [--case A ..] [--on tip] [--workers 2]

A Panda with a camera on its hand looks at a chessboard of 8 x 11 corners, 45 poses a day; or with the
board on its hand is looked at (``--on world``). The arm is read from its URDF and bent by payload and
compliance in this file, pixels are OpenCV's ``projectPoints``: nothing of it is shared with posecal.
The cell believes in the nominal lens and board, and identifies base, tool and geometry.

A: the lens is wrong in all its parts. B: two joints have offsets, one is elastic. C: both. D: the board
is 0.2 % too large. E, F, G: focal length, principal point, k1 alone. H: the camera slips at half-day.
I: the board is bowed by 1 mm. J: the arm is filmed as it moves, images 30 ms after the joints. L: as A,
and the focal length grows with the heat of the day by 0.15 %. N: nothing.

Right is a day whose causes lie on the side that errs, and on no other. ``aside`` counts causes above a
probability of 0.2 that no name on the right side may stand for; ``lens`` the shares of its values
within two standard deviations. ``lens refused`` are days of which ``identify`` says that the readings
do not fit this lens.
"""

from __future__ import annotations

import tempfile
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from defusedxml import ElementTree
from scipy.spatial.transform import Rotation

import calib
from calib.arrays import Array
from calib.identification.lenses import unfit_lenses
from studies.research.bench import Output, Row, bench, data_folder, each, several, table
from studies.research.cameras import corners, frame, poses_that_show, standing
from studies.research.cameras import pixels as pixels_of

_FOCAL, _CENTER, _NOISE = 900.0, (640.0, 480.0), 0.1  # px
_POSES, _DRAWN, _FOR_EACH = 45, 4000, 8  # poses, and candidates: at least so many for each
_PAYLOAD, _GRAVITY = 3.0, 9.81  # kg at the tip, m/s^2
_COMPLIANCE = 8e-5  # rad/(N m) of the fourth joint
_INTERVAL = 120.0  # s, from one pose to the next
_FILM, _FRAME = 90, 0.5  # images, s between them
_STOPS, _APART = 9, 0.7  # poses that the film passes, rad between two of them
_MARGIN = 12.0  # px, of the image that a film does not use
_CELL = """schema = 1
name = "panda with a camera"
[robot]
urdf = "{urdf}"
base = "base_link"
tip = "tool0"
[payload]
mass_kg = {mass}
com_mm = [0, 0, 0]
[boards.board]
on = "{board}"
squares = [12, 9]
pitch_mm = 20
{board_at}
[instruments.camera]
kind = "camera"
on = "{camera}"
focal_px = {focal}
center_px = {center}
image_px = [1280, 960]
sigma_px = {noise}
{camera_at}
[model]
effects = ["base", "tool", "geometry"]
"""
# Where the camera and the board stand or ride, by where the camera is: m, rad about fixed x, y, z.
_PLACES = {
    "tip": (((0.05, 0.0, 0.05), (0.0, 0.0, 90.0)), ((0.5, -0.11, 0.0), (180.0, 0.0, 0.0))),
    "world": (((1.25, 0.0, 0.5), (-90.0, 0.0, 90.0)), ((-0.12, 0.09, 0.05), (180.0, 0.0, 0.0))),
}


@dataclass(frozen=True)
class Truth:
    """What errs on a day.

    focal : shares of fx and fy; centre : px; k1, k2; warming : growth of the focal length by the last
        pose; arm : zero for a perfect one; size : of the board; bow : m; slip : of the camera at
        half-day, m and rad; delay : s; sides : which err
    """

    sides: frozenset[str] = frozenset()
    focal: tuple[float, float] = (0.0, 0.0)
    centre: tuple[float, float] = (0.0, 0.0)
    k1: float = 0.0
    k2: float = 0.0
    warming: float = 0.0
    arm: float = 0.0
    size: float = 1.0
    bow: float = 0.0
    slip: tuple[float, ...] = (0.0,) * 6
    delay: float = 0.0


_ARM, _CAMERA, _BOARD = frozenset({"arm"}), frozenset({"camera"}), frozenset({"board"})
_WRONG = Truth(_CAMERA, (0.006, 0.004), (3.5, -3.0), -0.03, 0.01)
_CASES = {
    "A": _WRONG,
    "B": Truth(_ARM, arm=1.0),
    "C": replace(_WRONG, sides=_CAMERA | _ARM, arm=1.0),
    "D": Truth(_BOARD, size=1.002),
    "E": Truth(_CAMERA, focal=(0.005, 0.005)),
    "F": Truth(_CAMERA, centre=(2.0, 0.0)),
    "G": Truth(_CAMERA, k1=-0.02),
    "H": Truth(_CAMERA, slip=(5e-4, -3e-4, 2e-4, 1e-3, -8e-4, 5e-4)),
    "I": Truth(_BOARD, bow=1e-3),
    "J": Truth(_CAMERA, delay=0.03),
    "L": replace(_WRONG, warming=1.5e-3),
    "N": Truth(),
}
_UNLIKELY = 0.2


@bench(
    several("--case", sorted(_CASES)),
    several("--on", sorted(_PLACES), ["tip"], help="Where the camera is."),
    days=20,
    days_help="Days of each case.",
    workers=True,
)
def main(case: Sequence[str], on: Sequence[str], days: int, seed: int, workers: int) -> Output:
    """Camera, board or arm: how often the diagnosis is right."""
    tasks = [(name, seed + day, place) for place in on for name in case for day in range(days)]
    rows = each(a_day, tasks, workers)
    return [_table([row for row in rows if row["on"] == place], case) for place in on], rows


def _table(rows: Sequence[Row], case: Sequence[str]) -> Any:
    shown = []
    for name in case:
        own = [row for row in rows if row["case"] == name]
        lens = [inside for row in own for inside in row["lens"]]
        shown.append(
            {
                "case": name,
                "camera on": own[0]["on"],
                "what errs": ", ".join(sorted(_CASES[name].sides)) or "nothing",
                "right": f"{sum(row['right'] for row in own)} of {len(own)}",
                "aside": sum(row["aside"] for row in own),
                "lens within 2 std": f"{np.mean(lens):.2f} of {len(lens)}" if lens else "",
                "lens refused": f"{sum(row['said'] for row in own)} of {len(own)}",
                "left [px]": f"{np.median([row['after_px'] for row in own]):.3f}",
            }
        )
    return table(shown)


def a_day(name: str, seed: int, on: str = "tip") -> Row:
    """One day, measured and diagnosed."""
    truth = _CASES[name].sides
    with tempfile.TemporaryDirectory() as folder:
        path, table_path = written(Path(folder), name, seed, on)
        cell = calib.load_cell(path)
        data = calib.load_measurements(cell, table_path)
        found = calib.diagnose(cell, data)
        said = any(unfit_lenses(calib.identify(cell, data)))
    named: list[Any] = [*found.causes, *found.imitated]
    sides = {_side(cause.where) for cause in named}
    likely = [cause for cause in named if cause.members[0][1] > _UNLIKELY]
    return {
        "case": name,
        "on": on,
        "seed": seed,
        "causes": [cause.members[0][0].key for cause in named],
        "sides": {own.side: own.share for own in found.sides},
        "right": sides == truth,
        "aside": sum(not _may_be(cause, truth) for cause in likely),
        "verdict": found.verdict,
        "lens": _inside(found, _CASES[name]),
        "said": said,
        "after_px": float(found.gap.fit_after),
    }


def written(
    folder: Path, name: str, seed: int, on: str = "tip", poses: int = _POSES
) -> tuple[Path, Path]:
    """Cell and table of a day of so many poses in a folder."""
    truth = _CASES[name]
    rng = np.random.default_rng([seed, ord(name), len(on)])
    chain = Chain(data_folder("panda_sockets_2") / "robot.urdf")
    path, table_path = folder / "cell.toml", folder / "measurements.csv"
    known = {"mass": _PAYLOAD, "focal": _FOCAL, "center": list(_CENTER), "noise": _NOISE}
    camera_at, board_at = map(_stated, _PLACES[on])
    other = {"tip": "world", "world": "tip"}[on]
    known |= {"camera": on, "board": other, "camera_at": camera_at, "board_at": board_at}
    path.write_text(_CELL.format(urdf=chain.path, **known))
    cell = calib.load_cell(path)
    drawn = max(_DRAWN, _FOR_EACH * poses)
    shown = poses_that_show(cell, rng, drawn, None if truth.delay else poses)
    q = true = shown[:poses]
    time: Array = _INTERVAL * np.arange(float(len(q)))
    if truth.delay:
        q, true, time = _film(chain, shown, truth, on)
    uv = pixels(chain, true, truth, on)
    uv += rng.normal(0.0, _NOISE, uv.shape)
    table_path.write_text(_columns(cell.robot.joints, q, time, uv))
    return path, table_path


def _stated(place: tuple[tuple[float, ...], tuple[float, ...]]) -> str:
    position, rpy = place
    return f"position_mm = {[1e3 * x for x in position]}\nrpy_deg = {list(rpy)}"


def _film(chain: Chain, shown: Array, truth: Truth, on: str) -> tuple[Array, Array, Array]:
    """Joints as they were read and as they were, and times, of images on a way past some poses."""
    from scipy.interpolate import CubicSpline

    stops = [shown[0]]
    while len(stops) < _STOPS:
        away = np.min([np.linalg.norm(shown - stop, axis=1) for stop in stops], axis=0)
        from_last = np.linalg.norm(shown - stops[-1], axis=1)
        stops.append(shown[np.argmin(np.where(away < _APART, np.inf, from_last))])
    way = CubicSpline(np.linspace(0.0, _FILM * _FRAME, len(stops)), stops)
    time = np.linspace(0.0, _FILM * _FRAME, _FILM)
    true = way(time + truth.delay)
    size = 2.0 * np.array(_CENTER)
    uv = pixels(chain, true, truth, on)
    seen = ((uv > _MARGIN) & (uv < size - _MARGIN)).all(axis=(1, 2))
    return way(time)[seen], true[seen], time[seen]


def _side(where: str) -> str:
    return where.partition(":")[0] if where.startswith(("camera:", "board:")) else "arm"


def _may_be(cause: Any, truth: frozenset[str]) -> bool:
    """Whether the cause, or what the readings do not tell from it, is on a side that errs."""
    return any(_side(c.where) in truth for c, p in cause.members if p > _UNLIKELY)


def _inside(found: Any, truth: Truth) -> list[bool]:
    """Of every value of the lens that was named: within two standard deviations of the truth."""
    fx, fy = (_FOCAL * share for share in truth.focal)
    hours = _INTERVAL * (_POSES - 1) / 3600.0
    true = {"fx": fx, "fy": fy, "cx": truth.centre[0], "cy": truth.centre[1]}
    true |= {"k1": truth.k1, "k2": truth.k2, "p1": 0.0, "p2": 0.0, "k3": 0.0}
    true |= {"scale": truth.focal[0], "rate": truth.warming / hours / 3600.0}
    own = [c for c in found.causes if c.name in _OF_LENS]
    return [
        bool(abs(value - true[parameter.name]) <= 2.0 * std)
        for cause in own
        for parameter, value, std in zip(
            cause.named.candidate.effect.parameters, cause.values, cause.std, strict=True
        )
    ]


_OF_LENS = ("focal", "principal_point", "distortion")


class Chain:
    """A URDF's joints in a row."""

    def __init__(self, path: Path) -> None:
        self.path = path.resolve()
        self.links: list[tuple[Array, bool]] = []
        for joint in ElementTree.parse(path).iter("joint"):
            origin = joint.find("origin").attrib
            xyz, rpy = (
                np.array(origin.get(key, "0 0 0").split(), dtype=float) for key in ("xyz", "rpy")
            )
            turns = joint.get("type") == "revolute"
            self.links.append((frame(xyz, Rotation.from_euler("xyz", rpy).as_matrix()), turns))

    def frames(self, q: Array) -> list[Array]:
        """Frames of the joints, which turn about z, and of the tip last, for one pose (dof,)."""
        T, found, angles = np.eye(4), [], iter(q)
        for link, turns in self.links:
            T = T @ link
            if turns:
                found.append(T)
                about_z = Rotation.from_rotvec([0.0, 0.0, next(angles)])
                T = T @ frame(np.zeros(3), about_z.as_matrix())
        return [*found, T]


def pixels(chain: Chain, q: Array, truth: Truth, on: str = "tip") -> Array:
    """What a true camera sees, (m, 88, 2)."""
    bent = truth.k1, truth.k2, 0.0, 0.0, 0.0
    grid = corners(11, 8, 0.02) * truth.size
    across = (grid[:, 0] - grid[:, 0].mean()) / np.ptp(grid[:, 0]) * 2.0
    grid[:, 2] = truth.bow * (1.0 - across**2)
    camera, board = (standing(*own) for own in _PLACES[on])
    slipped = frame(truth.slip[:3], Rotation.from_rotvec(truth.slip[3:]).as_matrix())
    found = []
    for k, own in enumerate(q):
        tip = bent_tip(chain, own, truth.arm)
        eye = camera @ slipped if 2 * k >= len(q) else camera
        seen = np.linalg.inv(tip @ eye) @ board if on == "tip" else np.linalg.inv(eye) @ tip @ board
        warm = 1.0 + truth.warming * k / max(len(q) - 1, 1)
        f = [_FOCAL * warm * (1.0 + share) for share in truth.focal]
        c = np.add(_CENTER, truth.centre)
        found.append(pixels_of(grid, seen, f, c, bent))
    return np.array(found)


def bent_tip(chain: Chain, q: Array, arm: float) -> Array:
    """Frame of the tip of an arm that errs so much, zero for a perfect one."""
    true = q + arm * np.array([0.0, 8e-4, 0.0, -6e-4, 0.0, 0.0, 0.0])
    *joints, tip = chain.frames(true)
    lever = np.cross(tip[:3, 3] - joints[3][:3, 3], [0.0, 0.0, -_PAYLOAD * _GRAVITY])
    true[3] += arm * _COMPLIANCE * float(joints[3][:3, 2] @ lever)
    return chain.frames(true)[-1]


def _columns(joints: Sequence[str], q: Array, time: Array, uv: Array) -> str:
    head = ["pose", "instrument", "marker", "time_s", *(f"{j}_rad" for j in joints), "u_px", "v_px"]
    lines = [",".join(head)]
    for k, (own, at, points) in enumerate(zip(q, time, uv, strict=True)):
        shared = ",".join([f"{at:.3f}", *(f"{value:.9f}" for value in own)])
        lines += [
            f"p{k + 1:02d},camera,board:{i},{shared},{u:.5f},{v:.5f}"
            for i, (u, v) in enumerate(points)
        ]
    return "\n".join(lines) + "\n"


if __name__ == "__main__":
    main()
