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
from calib.identification.estimators import choose_directions
from calib.identification.identify import check_counts
from calib.model import Model
from calib.model.build import build
from calib.model.covariance import Unidentifiable
from calib.observations import Points
from calib.poses import Measurements, Poses
from calib.poses.moves import before_the_first_move, with_moves
from calib.scatter import Variances, scatter_of
from doe.constraints import scene_of, visible
from doe.problem.nominal import soft


@dataclass(frozen=True, eq=False)
class View:
    """The causes of the catalogue that a model lacks, as a plan shows them.

    cell : Cell
    model : Model; values : ndarray, shape (p,), SI, where it is linearised
    data : Measurements, the readings to come: which markers are seen; its points are predictions
    waiting : ndarray of bool, shape (m,), readings before the first move, which the diagnosis drops
    suspects : tuple of Candidate, by name; missing : tuple of NotAsked
    asked : int, all that the diagnosis will ask, curves included
    N : ndarray, shape (rows, k), derivatives of what is modelled, in independent rows of unit variance;
        kinds : tuple of str, the kind of effect of each column; lost : what the plan leaves open
    X : ndarray, shape (rows, K), the same of the suspects
    field : Field, of the suspects; columns : tuple of ndarray of int, of each suspect in it
    moved : ndarray, shape (columns,), m per SI unit, RMS displacement of the markers
    assumed : bool, whether compliances are taken as usual, for nobody gave them
    """

    cell: Cell
    model: Model
    values: Array
    data: Measurements
    waiting: Mask
    suspects: tuple[Candidate, ...]
    missing: tuple[NotAsked, ...]
    asked: int
    N: Array
    kinds: tuple[str, ...]
    lost: tuple[Unidentifiable, ...]
    X: Array
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
    if values is None:
        return linearised(cell, model, data, soft(model, data.poses), assumed=True)
    return linearised(cell, model, data, values)


def linearised(
    cell: Cell, model: Model, data: Measurements, values: Array, *, assumed: bool = False
) -> View:
    """The view of given readings, their points ignored.

    values : ndarray, shape (p,), SI, known or, as told by ``assumed``, taken for lack of better
    """
    points = model.predict(values, data.poses)
    data = replace(data, readings=points)
    waiting = before_the_first_move(data.poses)
    counted = data.seen & ~waiting[:, None]
    weights = model.readout.whitening(values, data.poses, points, data.sigma)
    weights = weights * counted[..., None, None]
    everything, missing = candidates(cell, model, data)
    everything = [replace(c, tried=_tunings(c.effect, data.poses)) for c in everything]
    everything = [c for c in everything if c.tried]
    suspects = tuple(c for c in everything if c.named)
    whole, start = model.extended(values, [c.effect for c in suspects])
    _, J = whole.jacobian(start, data.poses)
    arm = Variances.of_arm(model.robot.dof, cell.repeatability)
    known = scatter_of(model, values, data.poses, arm)
    observation = Points(whole, data, weights, known=known)
    rows = observation.rows(J)
    if observation.weighing is not None:
        rows = observation.weighing(rows)
    rows = rows.reshape(-1, J.shape[-1])
    added = np.setdiff1d(np.arange(len(values), J.shape[-1]), whole.tunings)
    choice = choose_directions(Points(model, data, weights, known=known), values)
    N, X = rows[:, choice.kept], rows[:, added]
    ends = np.cumsum([0, *(len(c.amounts) for c in suspects)])
    return View(
        cell,
        model,
        values,
        data,
        waiting,
        suspects,
        tuple(missing),
        len(everything),
        N,
        tuple(model.parameters[i].effect for i in choice.kept),
        choice.unidentifiable,
        X,
        field(N, X, np.zeros(len(X))),
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
