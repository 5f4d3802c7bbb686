"""Stepwise selection of effects by an information criterion.

The cell's model is identified, all effects of the catalogue that it lacks are linearised there, and one
after the other enters or leaves as long as ``n log(RSS / n) + price * parameters`` falls: price 2 is
Akaike's criterion (1974), log n Schwarz's (1978). What is selected is then identified with the model.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any

import numpy as np

import calib
from calib import Cell, Identification, Measurements
from calib.arrays import Array, IntArray
from calib.effects import EFFECTS, GROUPS, Effect
from calib.errors import CalibError, EffectCannotAct
from calib.identification.start import whitening
from calib.model.build import context_of, place_effect
from calib.observations import Points
from studies.research.rivals.answer import answer

_VISIBLE = 1e-6  # squared share of a unit column that must be left beside the others to count
_DEPENDENT = 1e-8
_IN_GEOMETRY = ("joint_offset", "link_geometry")


def stepwise(
    cell: Cell, data: Measurements, heldout: Measurements, *, schwarz: bool = False
) -> dict[str, Any]:
    """Answer in the form of ``diagnose --json``: no gap, or explained by what was selected.

    schwarz : Schwarz's criterion instead of Akaike's
    Raises CalibError where the model cannot be identified.
    """
    before = calib.identify(cell, data, heldout=heldout)
    suspects = absent(cell, before, data)
    screen = linearised(cell, before, data, suspects)
    price = float(np.log(screen.n)) if schwarz else 2.0
    selected = select(screen, price)
    chosen = [suspects[i] for i in selected]
    after = before
    while chosen:
        names = [f"{effect.kind}:{effect.where}" for effect in chosen]
        try:
            after = calib.identify(
                replace(cell, effects=(*cell.effects, *names)), data, heldout=heldout
            )
            break
        except CalibError:
            chosen.pop()  # together they are not one model: the last to enter goes
    weights = screen.weights(selected[: len(chosen)], price)
    effects = [_named(effect, w, after) for effect, w in zip(chosen, weights, strict=True)]
    return answer("explained" if effects else "no_gap", before, after.rms("heldout"), effects)


def absent(cell: Cell, fit: Identification, data: Measurements) -> list[Effect]:
    """Every effect that the model lacks, wherever it can act."""
    context = context_of(cell, data.poses)
    present = {(e.kind, e.where) for e in fit.model.effects}
    present |= {("joint_compliance", where) for k, where in present if k == "stiffness_vs_angle"}
    kinds = [k for k in EFFECTS if k not in GROUPS]
    if "geometry" in cell.effects:
        kinds = [k for k in kinds if k not in _IN_GEOMETRY]
    found = []
    for kind in kinds:
        for where in EFFECTS[kind].places(context):
            if (kind, where) in present:
                continue
            try:
                found.append(place_effect(kind, where, context))
            except EffectCannotAct:
                continue  # the data lack what it depends on
    return found


@dataclass(frozen=True, eq=False)
class Screen:
    """Linear least squares with the model's own parameters projected out.

    G : ndarray, shape (K, K), products of the suspects' columns, of unit length before the projection
    g : ndarray, shape (K,), their products with the residual; cost : sum of its squares
    n : int, number of coordinates; columns : of each suspect
    """

    G: Array
    g: Array
    cost: float
    n: int
    columns: tuple[IntArray, ...]

    def criterion(self, members: Sequence[int], price: float) -> float:
        """Of the model with these suspects added."""
        if not members:
            return self.n * float(np.log(self.cost / self.n))
        own = np.concatenate([self.columns[i] for i in members])
        values, vectors = np.linalg.eigh(self.G[np.ix_(own, own)])
        seen = values > _VISIBLE
        fall = float((((vectors.T @ self.g[own]) ** 2)[seen] / values[seen]).sum())
        rest = max(self.cost - fall, 1e-300)
        return self.n * float(np.log(rest / self.n)) + price * int(seen.sum())

    def weights(self, members: Sequence[int], price: float) -> list[float]:
        """Akaike weight of each member against nothing and every other suspect in its place."""
        found = []
        for member in members:
            rest = [i for i in members if i != member]
            others = [i for i in range(len(self.columns)) if i not in members]
            rivals = [self.criterion([*rest, i], price) for i in others]
            lead = np.array([*rivals, self.criterion(rest, price)])
            lead -= self.criterion(members, price)
            found.append(float(1.0 / (1.0 + np.exp(np.minimum(-0.5 * lead, 700.0)).sum())))
        return found


def linearised(
    cell: Cell, fit: Identification, data: Measurements, suspects: Sequence[Effect]
) -> Screen:
    """All suspects at the identified values, over the poses that the fit kept."""
    from scipy.linalg import qr

    whole, values = fit.model.extended(fit.values, suspects)
    p = len(fit.values)
    weights = whitening(cell, fit.model, fit.values, data)
    weights = weights * ~fit.fit.outlier[:, None, None, None]
    r, J = Points(whole, data, weights).flat(values)
    lengths = np.linalg.norm(J, axis=0)
    J = J / np.where(lengths > 0.0, lengths, 1.0)
    Q, R, _ = qr(J[:, :p], mode="economic", pivoting=True)
    pivots = np.abs(np.diag(R))
    Q = Q[:, pivots > _DEPENDENT * pivots[0]]
    X = J[:, p:] - Q @ (Q.T @ J[:, p:])
    r = r - Q @ (Q.T @ r)
    ends = np.cumsum([0, *(len(e.parameters) for e in suspects)])
    columns = tuple(np.arange(a, b) for a, b in pairwise(ends))
    n = int(np.count_nonzero(np.abs(J).sum(axis=1)))
    return Screen(X.T @ X, X.T @ r, float(r @ r), n, columns)


def select(screen: Screen, price: float) -> list[int]:
    """Suspects in the order in which they entered, one step in or out at a time."""
    members: list[int] = []
    best = screen.criterion(members, price)
    while True:
        steps = [[i for i in members if i != out] for out in members]
        steps += [[*members, i] for i in range(len(screen.columns)) if i not in members]
        values = [screen.criterion(step, price) for step in steps]
        lowest = int(np.argmin(values))
        if values[lowest] >= best - 1e-9:
            return members
        members, best = steps[lowest], values[lowest]


def _named(effect: Effect, weight: float, fit: Identification) -> dict[str, Any]:
    own = [
        (p, value, std)
        for p, value, std in zip(fit.model.parameters, fit.values, fit.std, strict=True)
        if (p.effect, p.where) == (effect.kind, effect.where)
    ]
    return {
        "effect": effect.kind,
        "where": effect.where,
        "probability": weight,
        "class": [{"effect": effect.kind, "where": effect.where}],
        "parameters": [
            {"name": p.name, "value": value / p.scale, "std": std / p.scale, "unit": p.unit}
            for p, value, std in own
        ],
    }
