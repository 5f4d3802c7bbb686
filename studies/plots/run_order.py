"""A day in its order: when each pose is read, how warm it is then, and from which side joints come."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from calib.arrays import Array
from studies.plots import style


@style.styled
def over_the_day(
    pose_names: Sequence[str], minutes: Array, degrees: Array, moves: Mapping[str, Array]
) -> style.Picture:
    """The readings over the time, and the last move of each joint to them.

    minutes, degrees : ndarray, shape (m,), min since the first reading and degC; NaN where unknown
    moves : joint -> ndarray, shape (m,), with its sign; joints of which it counts
    """
    timed, m = bool(np.isfinite(minutes).all()), len(pose_names)
    heated = timed and bool(np.isfinite(degrees).all())
    at = minutes if timed else np.arange(1.0, m + 1.0)
    rows = [2.0] * heated + [0.32 * len(moves) + 0.4] * bool(moves)
    figure = style.sheet(max(style.PANEL, 7.0), 1.4 + sum(rows))
    panels = np.atleast_1d(figure.subplots(len(rows), 1, sharex=True, height_ratios=rows))
    looks = style.looks(["from below", "from above"])
    if heated:
        style.tidy(panels[0], "y")
        panels[0].plot(at, degrees, color=style.VERMILLION, marker="o", markersize=3.5)
        panels[0].set(ylabel="temperature\n[degC]")
    if moves:
        last = panels[-1]
        style.tidy(last, "x")
        for row, move in enumerate(moves.values()):
            for sign, look in zip((1.0, -1.0), looks.values(), strict=True):
                there = np.sign(move) == sign
                last.plot(at[there], np.full(int(there.sum()), row), linestyle="", **look.mark)
        last.set(ylim=(len(moves) - 0.5, -0.5), yticks=range(len(moves)), yticklabels=list(moves))
        handles = [
            last.plot([], [], linestyle="", label=own, **looks[own].mark)[0] for own in looks
        ]
        style.legend_below(figure, handles)
    panels[-1].set(xlabel="time since the first reading [min]" if timed else "place in the order")
    balance = ", ".join(
        f"{joint} {(own > 0).sum()}:{(own < 0).sum()}" for joint, own in moves.items()
    )
    caption = "Each mark is the reading of a pose."
    if moves:
        caption += (
            " Lost motion of a joint shows where it comes from both sides. Poses reached from below "
            f"and from above: {balance}."
        )
    header = ("pose", "time [min]", "temperature [degC]", *(f"last move of {own}" for own in moves))
    table = zip(
        pose_names, minutes.tolist(), degrees.tolist(), *(own.tolist() for own in moves.values()),
        strict=True,
    )  # fmt: skip
    cells = tuple(tuple(None if value != value else value for value in row) for row in table)
    return style.Picture("run_order", "The day in its order", caption, figure, header, cells)
