"""The verbs of Python: what they are given is checked here, and each fault names its argument."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias, overload

import numpy as np

from calib.arrays import Array, IntArray, Mask
from calib.cell import Cell
from calib.cell.contacts import with_sites
from calib.errors import CalibError, NoEquilibrium
from calib.model import Model
from calib.model.build import build
from calib.motion.motions import Motions
from calib.observations import Approach, orientable, pose_from_points
from calib.poses import Measurements, Poses, hung, poses_at
from calib.poses.moves import with_moves
from calib.simulation import drawn_readings, photographed

if TYPE_CHECKING:
    from calib.diagnosis import Diagnosis
    from calib.identification import Identification
    from calib.motion.diagnose import MotionDiagnosis

Plan: TypeAlias = Poses | Measurements | str | Path | Array
"""Poses, measurements, a plan's file, or joint values (m, n) in rad and m."""
Data: TypeAlias = Measurements | str | Path
"""Measurements, or their file; from a file of motions the result is that of motions."""
Kept: TypeAlias = Data | float | None
Runs: TypeAlias = Motions | str | Path | float | None
"""What is held out: of measurements and of motions; their file, or a share."""
Seed: TypeAlias = np.random.Generator | int
Values: TypeAlias = Sequence[float] | Mapping[str, float]
"""All of a model, SI, or some by their names."""


@overload
def identify(
    cell: Cell, data: Motions, *, heldout: Runs = None, rng: Seed = 0
) -> MotionDiagnosis: ...
@overload
def identify(
    cell: Cell, data: Data, *, heldout: Kept = None, rng: Seed = 0, **options: Any
) -> Identification: ...
def identify(
    cell: Cell, data: Any, *, heldout: Any = None, rng: Seed = 0, **options: Any
) -> Identification | MotionDiagnosis:
    """Estimate the effects that the cell's model contains.

    data : measurements of poses, or motions; or their file
    heldout : what takes no part in the estimate and is predicted with it; or the share of the
        configurations, or of the runs, that is set aside, drawn by ``rng``
    options : approach, method, weighting, length, of :func:`calib.identification.identify.identify`

    Raises CalibError, naming the argument, for what is no measurement of this cell; and what that does.
    """
    if _of_motions(data):
        from calib.motion.diagnose import identify_motions

        runs, apart = _runs(cell, data, heldout, rng)
        return identify_motions(cell, runs, heldout=apart)
    from calib.identification.identify import identify as estimate

    kept, held = _parts(cell, data, heldout, rng)
    return estimate(cell, kept, heldout=held, **options)


@overload
def diagnose(
    cell: Cell, data: Motions, *, heldout: Runs = None, rng: Seed = 0
) -> MotionDiagnosis: ...
@overload
def diagnose(cell: Cell, data: Data, *, heldout: Kept = None, rng: Seed = 0) -> Diagnosis: ...
def diagnose(
    cell: Cell, data: Any, *, heldout: Any = None, rng: Seed = 0
) -> Diagnosis | MotionDiagnosis:
    """Where the gap lies, which effects cause it, and how far it shrinks.

    data, heldout, rng : as for :func:`identify`

    Raises CalibError as :func:`identify` does.
    """
    if _of_motions(data):
        from calib.motion.diagnose import diagnose_motions

        runs, apart = _runs(cell, data, heldout, rng)
        return diagnose_motions(cell, runs, heldout=apart)
    from calib.diagnosis.diagnose import diagnose as explain

    kept, held = _parts(cell, data, heldout, rng)
    return explain(cell, kept, heldout=held)


def _of_motions(data: object) -> bool:
    """Whether data, or their file, are motions."""
    from calib.files.motions import holds_motions

    return isinstance(data, Motions) or (isinstance(data, str | Path) and holds_motions(Path(data)))


def _runs(cell: Cell, data: Any, heldout: Any, rng: Seed) -> tuple[Motions, Motions | None]:
    """Runs to fit and to hold out. Raises CalibError."""
    from calib.files.motions import load_motions

    kept, held = (
        load_motions(cell, own) if isinstance(own, str | Path) else own for own in (data, heldout)
    )
    if isinstance(held, int | float):
        return kept.split(held, rng)
    if held is not None and not isinstance(held, Motions):
        raise CalibError(f"heldout: {held!r:.60} is no Motions; name a file or a share")
    return kept, held


def _parts(
    cell: Cell, data: Data, heldout: Kept, rng: Seed
) -> tuple[Measurements, Measurements | None]:
    """Measurements to fit and to hold out. Raises CalibError."""
    kept = measured(cell, data)
    if isinstance(heldout, int | float):
        return kept.split(heldout, rng)
    return kept, None if heldout is None else measured(cell, heldout, "heldout")


def measured(cell: Cell, data: Data, name: str = "data") -> Measurements:
    """Measurements of a cell, read where they are a file. Raises CalibError that names the argument."""
    if not isinstance(cell, Cell):
        raise CalibError(f"cell: {cell!r:.60} is none; read one by load_cell, or make a Cell")
    if isinstance(data, str | Path):
        from calib.files.tables import load_measurements

        return load_measurements(cell, data, every_marker=name == "data")
    if not isinstance(data, Measurements):
        remedy = "name a file, or make them of arrays by Measurements.of"
        raise CalibError(f"{name}: {data!r:.60} is no Measurements; {remedy}")
    _check_joints(cell, data.poses, name)
    if data.seen.shape[1] != len(cell.channels):
        channels = f"{data.seen.shape[1]} channels, and the cell {len(cell.channels)}"
        raise CalibError(f"{name}: has {channels}; give a reading of each of its markers")
    data.check_numbers(f"{name}: q", f"{name}: readings")
    return data


def _check_joints(cell: Cell, poses: Poses, name: str) -> None:
    if poses.q.shape[1] != cell.robot.dof:
        wrong = f"joint values have shape {poses.q.shape}"
        raise CalibError(f"{name}: {wrong}, expected ({len(poses)}, {cell.robot.dof})")


def parameters(cell: Cell, plan: Plan | None = None) -> list[str]:
    """Names of the p parameters of the cell's model, in the order of columns and values.

    plan : needed only where ``stiffness_vs_angle`` takes its angles, or ``payload`` its wrench, from
        the poses
    Raises UnknownEffect, EffectCannotAct.
    """
    poses = None if plan is None else poses_of(cell, plan)
    return [p.id for p in build(cell, poses).model.parameters]


def observation(
    cell: Cell, plan: Plan, approach: Approach = "points", *, values: Values | None = None
) -> Array:
    """Observation matrix B_i of every pose (paper, equations 19 and 20), base and tool included.

    approach : "points": the rows that are read, of a tracker x, y, z of marker 1, of marker 2 ..;
        "pose": rows x, y, z of the tip frame's origin and its rotation vector, as computed from the
        markers by least squares
    values : where to linearise, SI; the nominal model by default
    Returns ndarray, shape (poses, rows, p), SI: m and rad per SI unit of each parameter, unweighted,
    in the instrument's frame. Rows of hidden markers are zero. With a [load] in the cell a plan has
    two readings a pose, and the rows of the free one come before those of the loaded one.

    Raises CalibError where approach pose has no three markers out of line.
    """
    poses = poses_of(cell, plan)
    m = len(poses)
    if not m:
        raise CalibError("the plan has no poses")
    seen = np.ones((m, len(cell.channels)), dtype=bool)
    if isinstance(plan, Measurements):
        seen = plan.seen
    else:
        poses = readings(cell, poses)
        seen = np.tile(seen, (len(poses) // m, 1))
    model = build(cell, poses).model
    vector = as_vector(model, values)
    points, J = model.jacobian(vector, poses)
    J = J * seen[..., None, None]
    rows = J.reshape(len(poses), -1, J.shape[-1])
    if approach == "pose":
        rows = _tip_origin_map(model, vector, poses, points, seen) @ rows
    stacked = rows.reshape(len(poses) // m, m, *rows.shape[1:])
    return np.concatenate(list(stacked), axis=1)


def predict(cell: Cell, measurements: Plan, values: Values) -> Array:
    """Predicted readings, shape (poses, markers, 3), m, in the frame of each pose's station.

    values : ndarray, shape (p,), SI, in the order of ``parameters(cell)``, or a mapping from names to
        values, the others nominal

    Raises CalibError where an elastic arm finds no equilibrium.
    """
    poses = poses_of(cell, measurements)
    model = build(cell, poses).model
    points = model.predict(as_vector(model, values), poses)
    if not np.isfinite(points).all():
        raise NoEquilibrium
    return points


def simulate(
    cell: Cell, plan: Plan, values: Values | None = None, *, rng: Seed = 0
) -> Measurements:
    """Measurements of a robot that is known, with the noise of the cell's instruments and arm.

    plan : read in its order, of a cell with a [load] every pose free and loaded, without what a camera
        has not in its image; measurements, as they were read
    values : the truth, as for :func:`predict`; the nominal robot by default
    rng : a generator, or the seed of one

    Raises CalibError where an elastic arm finds no equilibrium.
    """
    if isinstance(plan, Measurements):
        poses = plan.poses
    else:
        poses = with_moves(in_turn(cell, poses_of(cell, plan)))
    model = build(cell, poses).model
    generator = np.random.default_rng(rng)
    truth = as_vector(model, values)
    data = drawn_readings(model, truth, poses, None, generator, arm=cell.repeatability)
    if not np.isfinite(data.points).all():
        raise NoEquilibrium
    seen = plan.seen if isinstance(plan, Measurements) else photographed(model, truth, poses)
    return replace(data, readings=data.readings * seen[..., None], seen=seen)


def readings(cell: Cell, plan: Poses) -> Poses:
    """The readings of a plan: each pose free, then each pose with the cell's [load] hung on it.

    Of several sockets each pose is in the one that it touches.
    """
    plan = with_sites(cell, plan)
    if cell.load is None:
        return plan
    both = hung(plan.take(np.tile(np.arange(len(plan)), 2)), 1.0, cell.load.com)
    names = [f"{n}_free" for n in plan.names] + [f"{n}_loaded" for n in plan.names]
    loaded = np.repeat([0.0, 1.0], len(plan))
    change = cell.pace.reading + cell.pace.load
    return replace(
        both,
        names=tuple(names),
        load_mass=loaded * cell.load.mass,
        time=None if both.time is None else both.time + loaded * change,
        order=None if both.order is None else 2.0 * both.order + loaded,
    )


def in_turn(cell: Cell, plan: Poses) -> Poses:
    """The readings of a plan in the order of measuring."""
    return readings(cell, plan).take(turn_of(cell, plan))


def turn_of(cell: Cell, plan: Poses) -> IntArray:
    """Readings as :func:`readings` has them in the order of measuring, shape (k,).

    All free and then all loaded; but where the arm's repeatability is known, each pose is read under
    both in one stay, as then they share what its approach was off by.
    """
    if cell.load is None:
        return np.arange(len(plan))
    both = np.arange(2 * len(plan)).reshape(2, -1)
    return (both.T if cell.scatters else both).ravel()


def as_vector(model: Model, values: Values | None) -> Array:
    """Values of all parameters, shape (p,), SI. Raises CalibError for a wrong name or number."""
    ids = [p.id for p in model.parameters]
    if values is None:
        return model.initial
    if isinstance(values, Mapping):
        unknown = [name for name in values if name not in ids]
        if unknown:
            raise CalibError(f"no parameter {unknown[0]!r}; there are {', '.join(ids)}")
        given = zip(ids, model.initial, strict=True)
        return np.array([values.get(name, nominal) for name, nominal in given])
    vector = np.asarray(values, dtype=float)
    if vector.shape != (len(ids),):
        raise CalibError(f"values have shape {vector.shape}, expected ({len(ids)},)")
    return vector


def poses_of(cell: Cell, plan: Plan) -> Poses:
    """The poses of whatever says which they are. Raises InputError, CalibError."""
    if isinstance(plan, Measurements):
        return measured(cell, plan, "plan").poses
    if isinstance(plan, Poses):
        _check_joints(cell, plan, "plan")
        return plan
    if isinstance(plan, str | Path):
        from calib.files.tables import load_plan

        return load_plan(cell, plan)
    try:
        q = np.atleast_2d(np.asarray(plan, dtype=float))
    except (TypeError, ValueError):
        remedy = "give poses, measurements, a file, or joint values"
        raise CalibError(f"plan: {plan!r:.60} is none; {remedy}") from None
    poses = poses_at(q)
    _check_joints(cell, poses, "plan")
    return poses


def _tip_origin_map(model: Model, values: Array, poses: Poses, points: Array, seen: Mask) -> Array:
    usable = orientable(model.marker_positions(values), seen)
    if model.scattered or not usable.any():
        raise CalibError(
            "approach pose needs three visible markers on one link that are not in line; "
            "add markers, or use approach points"
        )
    frames = model.state(values, poses).frames
    origin = model.readings(values, poses, frames.o[:, -1:])[:, 0]
    return pose_from_points(points, origin, seen & usable[:, None])
