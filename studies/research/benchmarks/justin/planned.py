"""Days planned for Justin: both hands read by one tracker, or watched from a head.

The public files have no shapes, limits and head. Capsules about torso and arms are guessed, and joints
keep to the angles of the public table. A head, with a joint to pan, one to tilt and a camera, is put on
the chest.

A torso that yields carries head and hands alike. The rod keeps the chest level, or gravity would tilt
for the arms, which the head does not see.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from scipy.stats import chi2

import calib
import doe
from calib.arrays import Array
from calib.poses import Measurements, Poses, poses_at
from doe.assess import assess
from doe.constraints import scene_of, visible
from doe.problem import Problem
from doe.problem.pool import drawn, judge
from doe.problem.visits import Visits
from studies.compare.experiment import POINTS, experiment_of
from studies.compare.prediction import predict
from studies.research.bench import Row, cell_from, clocked, data_folder, rms_3d
from studies.research.benchmarks.justin.robot import (
    HEAD,
    SIDES,
    SIGMA_MM,
    TRACKED,
    justin,
    robot_text,
)
from studies.research.benchmarks.justin.truth import CAMERA, CENTRE, FOCAL, Truth
from studies.research.refits import Refits

INSTRUMENTS = ("tracker", "head camera")
POSES, CANDIDATES, RANDOM = 40, 2000, 500
_JUDGED, _MOST_DRAWN = 200, 100_000  # configurations
_GUESSES = 2  # of a number of poses
_SIGMA_PX = 0.2
_SURE = 0.95
_HEAD = """
<joint name="pan" type="revolute"><parent link="l3"/><child link="neck"/><origin xyz="0 -0.4 0"/>
<axis xyz="0 -1 0"/><limit lower="-1.2" upper="1.2" effort="0" velocity="1"/></joint><link name="neck"/>
<joint name="tilt" type="revolute"><parent link="neck"/><child link="head"/><origin xyz="0 -0.1 0"/>
<axis xyz="0 0 1"/><limit lower="-1" upper="1" effort="0" velocity="1"/></joint><link name="head"/>
"""
_CELL = """
[robot.limits_deg]
{limits}
[robot.capsules_mm]
t2 = [{{ from = [0, 0, 0], to = [300, 0, 0], radius = 100 }}]
t3 = [{{ from = [0, 0, 0], to = [300, 0, 0], radius = 100 }}]
t4 = [{{ from = [50, -145, -90], to = [50, -145, 90], radius = 100 }}]
{arms}
{read}
[model]
effects = [{effects}]
"""
_ARM = """
{0}_a2 = [{{ from = [0, {1}50, 0], to = [0, {1}400, 0], radius = 60 }}]
{0}_a4 = [{{ from = [0, 0, 0], to = [0, {1}390, 0], radius = 55 }}]
{0}_a7 = [{{ from = [0, 0, 0], to = [90, 160, 0], radius = 45 }}]
"""
_BOARD = """
[boards.{0}]
on = "{0}_l10"
squares = [6, 5]
pitch_mm = 20
position_mm = [40, 90, -60]
rpy_deg = [0, 0, 0]
"""
_CAMERA = """
[instruments.eye]
kind = "camera"
on = "head"
boards = ["right", "left"]
focal_px = {}
center_px = {}
image_px = [1280, 960]
sigma_px = {}
position_mm = {}
rpy_deg = [0, 90, 0]
"""


def planned_cell(instrument: str, effects: Sequence[str]) -> calib.Cell:
    """Justin for a plan by one of INSTRUMENTS."""
    urdf = robot_text(data_folder("justin"))
    if instrument == INSTRUMENTS[0]:
        read = TRACKED
    else:
        urdf = urdf.replace("</robot>", f"{_HEAD}</robot>")
        read = "".join(_BOARD.format(side) for side in SIDES)
        read += _CAMERA.format(FOCAL, CENTRE.tolist(), _SIGMA_PX, (CAMERA[:3, 3] * 1e3).tolist())
    text = HEAD + _CELL.format(
        limits=_limits(),
        arms="".join(_ARM.format(side, "-" if side == "left" else "") for side in SIDES),
        read=read,
        effects=", ".join(f'"{effect}"' for effect in effects),
    )
    return cell_from(text, urdf)


def _limits() -> str:
    """The angles of the public table, as lines of a cell."""
    cell, data = justin()
    ends = np.degrees([data.poses.q.min(axis=0), data.poses.q.max(axis=0)]).T
    return "\n".join(
        f"{joint} = [{low:.1f}, {high:.1f}]"
        for joint, (low, high) in zip(cell.robot.joints, ends, strict=True)
    )


@dataclass(frozen=True, eq=False)
class Day:
    """A planned day, and what the simulated ones had of it."""

    plan: doe.Design
    truth: Truth
    seconds: float

    @property
    def cell(self) -> calib.Cell:
        """That the plan is of."""
        return self.plan.problem.cell


def day(instrument: str, effects: Sequence[str], poses: int, seed: int) -> Day:
    """A planned day and a true robot for it."""
    cell = planned_cell(instrument, effects)
    design = partial(doe.design, cell, poses=poses, candidates=CANDIDATES)
    plan, seconds = clocked(partial(design, reapproach=0, seed=seed))
    return Day(plan, Truth.drawn(cell, np.random.default_rng(seed)), seconds)


def read(of: Day, poses: Poses, rng: np.random.Generator | None = None) -> Measurements:
    """The readings of the true robot, exact without ``rng``."""
    cell = of.cell
    marker = of.plan.problem.model.readout.channels.marker
    camera = cell.instruments[0].kind == "camera"
    exact = (of.truth.pixels(poses.q) if camera else of.truth.points(poses.q))[:, marker]
    if rng is not None:
        exact = exact + (_SIGMA_PX if camera else SIGMA_MM * 1e-3) * rng.normal(size=exact.shape)
    seen = visible(scene_of(cell, poses.q))
    return Measurements(poses, exact * seen[..., None], seen, np.full(seen.shape, np.nan))


def refits(of: Day, count: int, seed: int) -> Row:
    """Simulated days set beside what the plan promised.

    The covariance is of readings alone, and so are these fits; errors are those of fits as usual.
    """
    experiment = experiment_of(of.cell, of.plan.poses)
    cov, model = predict(experiment, POINTS).covariance, experiment.model
    rng = np.random.default_rng(seed)
    others = read(of, poses_at(_random(of.plan.problem, _JUDGED, seed + 1)))
    alone, missed = [], []
    for _ in range(count):
        data = read(of, experiment.poses, rng)
        alone.append(calib.identify(replace(of.cell, size_prior={}), data))
        usual = calib.identify(of.cell, data)
        off = usual.model.predict(usual.values, others.poses) - others.readings
        missed.append(off[others.seen])
    _, J = model.jacobian(experiment.nominal, others.poses)
    J = J[others.seen]
    foreseen = np.einsum("nip,pq,niq->n", J, cov, J, optimize=True)
    unit = 1.0 if of.cell.instruments[0].kind == "camera" else 1e3
    return _judged(Refits.of(experiment, alone)) | {
        "error": rms_3d(missed) * unit,
        "foreseen": float(np.sqrt(foreseen.mean())) * unit,
    }


def _judged(found: Refits) -> Row:
    """How fits scatter beside what was promised: all parameters, and one by one."""
    freedom, count = len(found.scatter) - 1, len(found.covariance)
    each = (found.scatter**2).sum(axis=0) / np.diag(found.covariance)
    low, high = chi2.ppf([(1.0 - _SURE) / 2.0, (1.0 + _SURE) / 2.0], freedom)
    tails = 2.0 * np.minimum(chi2.cdf(each, freedom), chi2.sf(each, freedom))
    return {
        "parameters": count,
        "scatter_over_foreseen": found.over_foreseen,
        "p": found.p,
        "inside": float(np.mean((each > low) & (each < high))),
        "smallest_p_times_parameters": float(min(1.0, tails.min() * count)),
    }


def _random(problem: Problem, count: int, seed: int) -> Array:
    """Configurations at random that a plan could have, (count, n)."""
    found: list[Array] = []
    for visits in drawn(problem.cell, _MOST_DRAWN, None, seed, problem.choice):
        found.append(judge(problem.regressor, problem.constraints, None, visits).q)
        if sum(map(len, found)) >= count:
            break
    return np.concatenate(found)[:count]


def as_many_at_random(of: Day, seed: int) -> Row:
    """How many poses at random are as good as the plan, and what ``RANDOM`` of them expect."""
    problem, wanted = of.plan.problem, of.plan.assessment.task_rms
    q = _random(problem, RANDOM, seed + 2)
    low, high = len(of.plan.poses), len(q)
    least = assess(problem, Visits(q)).task_rms
    while low < high:
        middle = (low + high) // 2
        if assess(problem, Visits(q[:middle])).task_rms <= wanted:
            high = middle
        else:
            low = middle + 1
    return {"like_plan_at_random": high, "random_mm": least * 1e3}


def like_random(
    of: Day, instrument: str, effects: Sequence[str], random_mm: float, seed: int
) -> Row:
    """How many planned poses, polished, expect no more error than ``RANDOM`` at random.

    The second guess follows the slope of the first: near as few as parameters, a pose counts more.
    """
    first, error = len(of.plan.poses), of.plan.assessment.task_rms * 1e3
    count, slope, told = first, 0.5, {}
    for _ in range(_GUESSES):
        guess = int(np.ceil(count * (error / random_mm) ** (1.0 / slope)))
        found = day(instrument, effects, guess, seed).plan.assessment.task_rms * 1e3
        told[guess] = found
        slope = float(np.log(error / found) / np.log(guess / count))
        count, error = guess, found
    enough = [n for n, mm in told.items() if mm <= random_mm]
    return {"like_random": min(enough, default=0), "tried_mm": str(told)}


def rows(effects: Sequence[str], count: int, seed: int, match: bool) -> list[Row]:
    """A row for each instrument; match : whether plans of hundreds of poses are sought, too."""
    found: list[Row] = []
    for instrument in INSTRUMENTS:
        of = day(instrument, effects, POSES, seed)
        plan, random = of.plan, as_many_at_random(of, seed)
        own = like_random(of, instrument, effects, random["random_mm"], seed) if match else {}
        found.append(
            {
                "instrument": instrument,
                "poses": POSES,
                "feasible": f"{plan.candidates.feasible} of {plan.candidates.drawn}",
                "efficiency": plan.efficiency,
                "expected_mm": plan.assessment.task_rms * 1e3,
                "plan_cpu_s": of.seconds,
                **refits(of, count, seed),
                **random,
                **own,
            }
        )
    return found
