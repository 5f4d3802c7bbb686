"""Planned motions against motions drawn by chance: determinant, certificate, refitted deviations.

    python -m studies.research.motion_designs [--days 20] [--motions 5] [--json FILE]

On the UR10e, with the usual terms of every joint and its inertials. Of each choice so many days are
drawn, with friction and armature that its drives plausibly have and with errors that remember
themselves as the design takes for granted. Terms of joints are fitted anew on each; their deviations
over the days stand beside those that were predicted.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

import calib
from calib.arrays import Array
from calib.motion.diagnose import products_of
from calib.motion.fit import MotionModel, fit
from calib.motion.gram import FILE, LOSSES
from calib.motion.motions import Motions
from doe import design_motions
from doe.motions.draw import Motion, drawn
from doe.motions.information import MEMORY, RESIDUAL, USUAL, information
from studies.research.bench import Output, Row, bench, count, rms, table
from studies.research.motions import read

_TERMS = ("torque_offset", "coulomb_friction", "viscous_friction", "armature")


def refitted(
    cell: calib.Cell, motions: Sequence[Motion], torque: Array, days: int, rng: np.random.Generator
) -> Array:
    """Deviations over the days of all terms, joint by joint, shape (4 n,); torque : RMS (n,)."""
    found, n = [], cell.robot.dof
    for _ in range(days):
        runs = []
        for k, own in enumerate(motions):
            run = own.run(cell)
            noise = _coloured(rng, len(run), n, run.step)
            runs.append(replace(run, name=f"r{k}", effort=run.effort + RESIDUAL * torque * noise))
        day = products_of(cell, Motions(tuple(runs)), whole=True)
        each = [(k, FILE) if k in LOSSES else day.columns.variants(0, k)[0] for k in _TERMS]
        model = MotionModel((tuple(each),) * n, (False,) * n, inertials="inertials", ridge=1e-3)
        found.append(np.concatenate(fit(day, model, 1.0 / torque**2).b))
    return np.asarray(np.std(found, axis=0, ddof=1))


def _coloured(rng: np.random.Generator, rows: int, n: int, step: float) -> Array:
    """Noise of unit variance (rows, n) of which so much time is worth one sample."""
    keep = np.exp(-2.0 * step / MEMORY)
    x = rng.normal(scale=np.sqrt(1.0 - keep**2), size=(rows, n))
    x[0] /= np.sqrt(1.0 - keep**2)
    for i in range(1, rows):
        x[i] += keep * x[i - 1]
    return np.asarray(x)


@bench(
    count("--motions", 5),
    days=20,
)
def main(days: int, motions: int, seed: int) -> Output:
    """Planned motions against motions drawn by chance."""
    cell, _ = read("UR10e")
    terms = (*_TERMS, USUAL[-1])
    cell = replace(cell, motion=replace(cell.motion, effects=terms))
    planned = design_motions(cell, motions, seed=seed)
    rng = np.random.default_rng(seed + 1)
    pool, _, _ = drawn(cell, 20 + motions, planned.motions[0].lasts, rng)
    every = [*planned.motions, *pool]
    told = information(cell, every, terms, ())
    torque = np.sqrt(np.mean([(own.run(cell).effort ** 2).mean(axis=0) for own in every], axis=0))
    torque = np.maximum(torque, 1e-3 * float(torque.max()))  # as the design has it
    rows: list[Row] = []
    drawn_ones = np.arange(motions, len(every))
    choices = {"planned": np.arange(motions)}
    for k in range(3):
        choices[f"chance {k + 1}"] = rng.choice(drawn_ones, motions, replace=False)
    for name, index in choices.items():
        M = told.M[index].sum(axis=0)
        sizes = np.array([p.size for p in told.parameters])
        std = np.sqrt(np.diag(np.linalg.inv(M))) * sizes
        order = [[(p.effect, p.where) for p in told.parameters].index((kind, joint))
                 for joint in cell.robot.joints for kind in _TERMS]  # fmt: skip
        again = refitted(cell, [every[i] for i in index.tolist()], torque, days, rng)
        relative = again / sizes[order]
        rows.append({
            "motions": name,
            "det^(1/p)": float(np.exp(np.linalg.slogdet(M)[1] / len(M))),
            "condition": float(np.sqrt(np.linalg.cond(M))),
            "predicted deviations, RMS of sizes": rms(std[order] / sizes[order]),
            "refitted": rms(relative),
            "refitted / predicted": float(np.exp(np.mean(np.log(again / std[order])))),
        })  # fmt: skip
    proof = {"efficiency": planned.efficiency, "random": planned.random, "seconds": planned.seconds}
    return [table(rows), table([proof])], {"choices": rows, "proof": proof}


if __name__ == "__main__":
    main()
