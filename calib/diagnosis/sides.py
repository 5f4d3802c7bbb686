"""Camera, board or arm: how much of the unmodelled error each side has.

Shares of causes taken out one by one do not add up where causes do alike. The error that was there is
``r0 = r + sum of x``, x what each cause does beside the user's model and r what is left, which lies
across all of them. So ``|r0|^2 = |r|^2 + sum of x . r0``, and these products add up.
"""

from __future__ import annotations

from typing import Literal, NamedTuple

import numpy as np

from calib.diagnosis.finding import Finding
from calib.instruments import Camera

Side = Literal["camera", "board", "arm"]


class SideShare(NamedTuple):
    """A side, and its share of the unmodelled error."""

    side: Side
    share: float


def side_of(where: str) -> Side:
    """Whose error a cause at a place is."""
    first = where.partition(":")[0]
    return "camera" if first == "camera" else "board" if first == "board" else "arm"


def sides_of(finding: Finding) -> tuple[SideShare, ...]:
    """The share of each side, where a camera reads and something was found."""
    model, active = finding.after.model, finding.outcome.active
    if not active or not any(isinstance(i, Camera) for i in model.instruments):
        return ()
    view = finding.outcome.view
    fit = view.fit
    r, J = (rows[: fit.r.size] for rows in fit.linear.independent)
    own = {c.key: fit.positions(c.effect) for c in active}
    every = np.concatenate(list(own.values()))
    Q = fit.without([c.effect for c in active]).linear.basis[: fit.r.size]
    moved = {key: J[:, at] @ fit.moving[at] for key, at in own.items()}
    moved = {key: x - Q @ (Q.T @ x) for key, x in moved.items()}
    r = r - Q @ (Q.T @ r)
    before = r + np.sum(list(moved.values()), axis=0)
    noise = min(float(r @ r), fit.dof * finding.scale**2)
    excess = float(before @ before) - noise
    if excess <= 0.0 or not len(every):
        return ()
    found = dict.fromkeys(("camera", "board", "arm"), 0.0)
    for c in active:
        found[side_of(c.where)] += float(moved[c.key] @ before) / excess
    return tuple(SideShare(side, share) for side, share in found.items())  # type: ignore[arg-type]
