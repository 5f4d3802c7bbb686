"""The verb of a day that plans itself: what to measure next, and when to stop."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, TypeAlias

import numpy as np

from calib.cell import Cell
from calib.diagnosis.diagnose import Diagnosis, diagnose
from calib.errors import CalibError
from calib.poses import Measurements, Poses
from calib.result import Result
from calib.threads import one_blas_thread
from doe.ahead.accuracy import ForecastStep
from doe.ahead.enough import Enough, enough
from doe.ahead.next_poses import NextPoses, next_poses
from doe.plan import named

Aim: TypeAlias = Literal["task", "causes", "both"]
Stop: TypeAlias = Literal[
    "goal", "beyond_reach", "averages", "settled", "nothing_found", "no_pose_helps"
]
COUNT = 3
"""Poses that are chosen unless the user says otherwise."""
# Of the work, squared error times readings: less is what readings do by their number.
_AVERAGES = 0.05


@dataclass(frozen=True, eq=False, repr=False)
class Onward(Result):
    """Result of :func:`onward`.

    poses : Poses, to be read next, in this order; none where it is time to stop
    serves : what they are for
    stops : tuple of Stop, why each aim asks for no more, the aims that do left out
    enough : Enough, without the poses to come; None where only causes are asked for
    diagnosis : Diagnosis or None; doubts : NextPoses or None, where causes are asked for
    """

    poses: Poses
    serves: Aim
    stops: tuple[Stop, ...]
    enough: Enough | None
    diagnosis: Diagnosis | None
    doubts: NextPoses | None

    def sentences(self) -> list[str]:
        if self.done:
            return [f"Onward: stop ({', '.join(self.stops)})"]
        return [f"Onward: {len(self.poses)} poses next, for {self.serves}"]

    def rows(self) -> list[dict[str, object]]:
        return [
            {"pose": name, **{f"q{k + 1}_rad_or_m": v for k, v in enumerate(q)}}
            for name, q in zip(self.poses.names, self.poses.q.tolist(), strict=True)
        ]

    @property
    def done(self) -> bool:
        """Whether to stop."""
        return not len(self.poses)


@one_blas_thread
def onward(
    cell: Cell,
    data: Measurements,
    *,
    aim: Aim = "task",
    count: int = COUNT,
    goal: float | None = None,
    ahead: int = 0,
    missed: Poses | None = None,
    seed: int = 0,
) -> Onward:
    """Choose the next poses after what was measured, or say that it is time to stop.

    aim : "task", the expected error at the targets; "causes", the rivals that a diagnosis cannot tell
        apart, and the forms of those that stand alone; "both", poses that serve both while both are
        open (:mod:`doe.ahead.search`)
    goal : expected RMS error at the targets that is wanted, m; without one, the task is done when more
        poses only average noise
    ahead : poses that the day still has room for: those for the task are chosen as the best of so many
    missed : poses that could not be read: what is nearer to them than to any that was is left out

    Raises CalibError where count is not positive, or poses to come depend on more than joints.
    """
    if count < 1:
        raise CalibError(f"{count} next poses are too few; ask for at least one")
    answer = diagnosis = doubts = task = causes = None
    if aim != "causes":
        answer = enough(cell, data, goal=goal, fresh=count, ahead=ahead, missed=missed, seed=seed)
        task = _task_done(answer)
    if aim != "task":
        diagnosis = diagnose(cell, data)
        together = answer is not None and task is None
        doubts = next_poses(
            cell, diagnosis, count=count, seed=seed, forms=True, accuracy=together, missed=missed
        )
        causes = _causes_done(diagnosis, doubts)
    stops = tuple(stop for stop in (task, causes) if stop is not None)
    q = np.zeros((0, cell.robot.dof))
    serves: Aim = "task"
    if doubts is not None and len(doubts.poses):
        q, serves = doubts.poses.q, "causes" if doubts.shares is None else "both"
    elif answer is not None and task is None:
        q = answer.fresh_q
    return Onward(named(q, "n"), serves, stops, answer, diagnosis, doubts)


def _task_done(answer: Enough) -> Stop | None:
    """Why the task asks for no more poses, None where it does."""
    now = answer.steps[0]
    if answer.beyond_reach:
        return "beyond_reach"
    if answer.reaches(now):
        return "goal"
    if not answer.fresh:
        kinds = ", ".join(f"{e.kind}:{e.where}" for e in answer.model.effects if e.uses)
        raise CalibError(
            f"poses to come depend on more than joints ({kinds}); design a plan and ask posecal enough "
            "--plan for its order"
            if kinds
            else "no configuration satisfies the cell's constraints; relax [design]"
        )
    if answer.goal is not None or set(now.open) - set(answer.fresh[-1].open):
        return None
    works = _work(now), _work(answer.fresh[-1])
    return "averages" if works[0] <= (1.0 + _AVERAGES) * works[1] else None


def _work(step: ForecastStep) -> float:
    """Squared error by the parameters times readings: constant where readings only average noise."""
    return float(step.readings * step.from_parameters**2)


def _causes_done(diagnosis: Diagnosis, doubts: NextPoses) -> Stop | None:
    """Why the causes ask for no more poses, None where they do."""
    if len(doubts.poses):
        return None
    if doubts.predictions or any(not form.told for form in doubts.forms):
        return "no_pose_helps"
    return "nothing_found" if diagnosis.verdict == "unknown" else "settled"
