"""A random arm that every kind of instrument reads; what a camera sees lies ahead of it."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from calib import Cell, instruments
from calib.arm.se3 import inverse, so3_exp, so3_log, transform
from calib.arrays import Array
from calib.effects import Context
from calib.effects.protocol import Effect
from calib.instruments.board import Board
from calib.instruments.lens import Lens
from calib.instruments.riding import corners_of
from calib.model import Model
from calib.noise import Noise
from calib.poses import Poses
from tests.helpers import GRAVITY, cell_of, model_of, random_poses, random_robot
from tests.plain_arm import tips

LENS = Lens(np.array([1400.0, 1380.0, 960.0, 540.0, -0.12, 0.05, 8e-4, -5e-4, -0.01]))
SITES = ("nest", "cup", "cone")
_SPREAD = 0.25  # rad, of the poses: what is ahead of a camera stays there
_AHEAD = 1.5  # m


@dataclass(frozen=True, eq=False)
class Scene:
    """The arm with all that reads it, poses, and the places (u,) at which the instruments stand."""

    context: Context
    poses: Poses
    places: dict[str, Array]

    def model(self, *effects: Effect, of: str = "") -> Model:
        """The instruments, or those of one kind, at unknown places, with these effects."""
        stands = model_of(replace(self.context, instruments=self.read(of)), ["base"])
        return stands.with_effects((*stands.effects, *effects))

    def read(self, kind: str) -> tuple[instruments.Instrument, ...]:
        return tuple(i for i in self.context.instruments if kind in ("", i.kind))

    def cell(self, kind: str, *effects: str) -> Cell:
        """With the instruments of one kind."""
        context = self.context
        return replace(
            cell_of(context.robot, context.markers, effects),
            marker_names=context.marker_names,
            bodies=context.bodies,
            instruments=self.read(kind),
        )

    def at(self, model: Model) -> Array:
        """Values of a model with its instruments where they stand."""
        values = model.initial
        for effect, part in model.parts:
            if effect.kind == "base":
                place = self.places[effect.where]
                values[part.start : part.start + len(place)] = place
        return values


def scene(seed: int, count: int, free: bool = False) -> Scene:
    """Two markers, a body, a camera and a board on the tip; two boards and three sockets beside it.

    free : whether no lens is known
    """
    rng = np.random.default_rng(seed)
    robot = random_robot(rng, 5)
    poses = random_poses(rng, robot, count)
    middle = rng.uniform(-2.0, 2.0, robot.dof)
    q = middle + rng.uniform(-_SPREAD, _SPREAD, poses.q.shape)
    site = np.array(SITES)[np.arange(count) % len(SITES)]
    time = 1e3 * np.arange(count)
    poses = replace(poses, q=q, site=site, time=time)
    tip = tips(robot, middle[None])[0]
    plate, tiles, solid = (rng.uniform(-0.1, 0.1, (n, 3)) for n in (7, 5, 6))
    plate[:, 2] = tiles[:, 2] = 0.0
    camera = framed(rng)
    markers = [
        rng.uniform(-0.2, 0.2, (2, 3)),
        corners(framed(rng)),
        corners(camera),
        plate @ so3_exp(rng.normal(size=3)).T + rng.uniform(-0.2, 0.2, 3),
    ]
    names = ["m1", "m2"] + [f"{b}{e}" for b in ("flange", "eye") for e in ("", ":x", ":y")]
    names += [f"plate:{i}" for i in range(len(plate))]
    bodies = {"flange": slice(2, 5), "eye": slice(5, 8), "plate": slice(8, 15)}
    square = np.repeat([4e-8, 1e-7], 3)  # of deviations, m2 and rad2
    given = {"lens": LENS, "sigma": 0.2, "free": np.arange(9 if free else 0)}
    on_tip = (Board("plate", slice(2, 9), plate),)
    boards = (Board("tiles", slice(0, 5), tiles), Board("solid", slice(5, 11), solid))
    read: tuple[instruments.Instrument, ...] = (
        instruments.Tracker(name="laser", markers=(0, 1), noise=Noise.isotropic(2e-5)),
        instruments.Pose(name="mocap", markers=(2, 3, 4), covariance=np.diag(square)),
        instruments.FixedCamera(name="wall", markers=(0, 1, *range(8, 15)), boards=on_tip, **given),
        instruments.ArmCamera(name="eye", markers=(5, 6, 7) * 11, boards=boards, **given),
        instruments.Distance(name="bar", markers=(0, 1), sigma=2e-5, offset=True),
        instruments.Plane(name="table", markers=(0, 1), sigma=2e-5),
        instruments.Socket(name=SITES[0], markers=(0, 1), sigma=2e-5, sites=SITES),
    )
    context = Context(
        robot=robot,
        markers=np.concatenate(markers),
        marker_names=tuple(names),
        gravity=GRAVITY,
        measured_load=True,
        instruments=read,
        bodies=bodies,
    )
    R = so3_exp(rng.normal(size=3))  # of the camera on the wall, whose axis points at the plate
    wall = inverse(tip @ transform(R, markers[3].mean(axis=0) - R[:, 2] * _AHEAD))
    ahead = np.concatenate([place_of(tip @ camera @ before(rng)) for _ in boards])
    places = {
        "base": rng.normal(size=6),
        "mocap:base": rng.normal(size=6),
        "wall": place_of(wall),
        "eye": ahead,
        "bar": np.array([*(tip[:3, 3] + [1.0, -0.6, 0.3]), 0.1]),
        "table": np.array([0.3, -0.2, 0.4]),
    }
    places |= {name: tip[:3, 3] + rng.uniform(-0.2, 0.2, 3) for name in SITES}
    return Scene(context, poses, places)


def framed(rng: np.random.Generator) -> Array:
    return transform(so3_exp(rng.normal(size=3)), rng.uniform(-0.2, 0.2, 3))


def before(rng: np.random.Generator) -> Array:
    """A board's frame in that of a camera which looks at it."""
    return transform(so3_exp(0.4 * rng.normal(size=3)), np.array([0.0, 0.1, _AHEAD]))


def corners(T: Array) -> Array:
    return corners_of(T[:3, :3], T[:3, 3])


def place_of(T: Array) -> Array:
    return np.concatenate([T[:3, 3], so3_log(T[:3, :3])])
