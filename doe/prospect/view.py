"""A plan as the diagnosis will see it: every cause beside everything modelled, and no residual yet."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from calib.api import Plan, in_turn, poses_of
from calib.arrays import Array, IntArray, Mask
from calib.cell import Cell
from calib.diagnosis.candidates import Candidate, NotAsked, candidates
from calib.diagnosis.screen import Field, field
from calib.effects.protocol import Effect
from calib.effects.tuned import Tuned
from calib.identification.checks import check_counts
from calib.identification.estimators import choose_directions
from calib.model import Model
from calib.model.build import build
from calib.model.covariance import Unidentifiable
from calib.observations import Points
from calib.poses import Measurements, Poses
from calib.poses.moves import before_the_first_move, with_moves
from calib.scatter import Variances
from doe.constraints import scene_of, visible
from doe.problem.linearisation import Linearisation
from doe.problem.nominal import soft


@dataclass(frozen=True, eq=False)
class View:
    """The causes of the catalogue that a model lacks, as a plan shows them.

    model : Model; values : ndarray, shape (p,), SI, where it is linearised
    whole : Linearisation, of the model and all suspects
    data : Measurements, the readings to come: which markers are seen; its points are predictions
    waiting : ndarray of bool, shape (m,), readings before the first move, which the diagnosis drops
    suspects : tuple of Candidate, by name; missing : tuple of NotAsked
    asked : int, all that the diagnosis will ask, curves included
    rows : ndarray, shape (N, K), derivatives by all parameters, in independent rows of unit variance
    kept : ndarray of int, columns of what is modelled; lost : what the plan leaves open
    field : Field, of the suspects; columns : tuple of ndarray of int, of each suspect in it
    moved : ndarray, shape (columns,), m per SI unit, RMS displacement of the markers
    assumed : bool, whether compliances are taken as usual, for nobody gave them
    """

    model: Model
    values: Array
    whole: Linearisation
    data: Measurements
    waiting: Mask
    suspects: tuple[Candidate, ...]
    missing: tuple[NotAsked, ...]
    asked: int
    rows: Array
    kept: IntArray
    lost: tuple[Unidentifiable, ...]
    field: Field
    columns: tuple[IntArray, ...]
    moved: Array
    assumed: bool


def view_of(cell: Cell, plan: Plan, values: Array | None = None) -> View:
    """Linearise the model and every cause that it lacks at the readings of a plan.

    plan : a plan, whose poses are read free and loaded where the cell has a [load], with the markers
        that are in sight; or measurements, which are taken as they are but for their points
    values : ndarray, shape (p,), SI. Without them all is nominal, but what is elastic is as soft as
        usual: weights and springs show through compliances only

    Raises UnknownEffect, EffectCannotAct, TooFewPoses, CalibError.
    """
    data = readings_of(cell, plan)
    model = build(cell, data.poses).model
    check_counts(model, data)
    assumed = values is None
    values = soft(model, data.poses) if values is None else values
    data = replace(data, readings=model.predict(values, data.poses))
    everything, missing = candidates(cell, model, data)
    everything = [replace(c, tried=_tunings(c.effect, data.poses)) for c in everything]
    everything = [c for c in everything if c.tried]
    suspects = tuple(c for c in everything if c.named)
    full, start = model.extended(values, [c.effect for c in suspects])
    arm = Variances.of_arm(model.robot.dof, cell.repeatability)
    whole = Linearisation(cell, full, start, arm)
    waiting = before_the_first_move(data.poses)
    rows = np.concatenate([whole.of(data, ~waiting).flat, full.beside(start)[1]])
    own = Points(model, data, whole.weights(data, ~waiting), known=whole.scatter(data.poses))
    choice = choose_directions(own, values)
    _, J = full.jacobian(start, data.poses)
    added = np.setdiff1d(np.arange(len(values), len(start)), full.tunings)
    ends = np.cumsum([0, *(len(c.amounts) for c in suspects)])
    return View(
        model,
        values,
        whole,
        data,
        waiting,
        suspects,
        tuple(missing),
        len(everything),
        rows,
        choice.kept,
        choice.unidentifiable,
        field(rows[:, choice.kept], rows[:, added], np.zeros(len(rows))),
        tuple(np.arange(a, b) for a, b in pairwise(ends)),
        np.sqrt((J[data.seen][..., added] ** 2).sum(axis=1).mean(axis=0)),
        assumed,
    )


def _tunings(effect: Effect, poses: Poses) -> int:
    """How many will be tried of an effect at these poses, none where they tell nothing of it."""
    return len(effect.grid(poses)) if isinstance(effect, Tuned) else 1


def readings_of(cell: Cell, plan: Plan) -> Measurements:
    """The readings that a plan brings, their points still unknown."""
    if isinstance(plan, Measurements):
        return plan
    poses = poses_of(cell, plan)
    if poses.approach is None:
        poses = replace(with_moves(poses), order=None)  # a plan says nothing of when it is measured
    poses = in_turn(cell, poses)
    seen = visible(scene_of(cell, poses.q))
    blank = np.zeros((*seen.shape, cell.channels.width))
    return Measurements(poses, blank, seen, np.full(seen.shape, np.nan))
