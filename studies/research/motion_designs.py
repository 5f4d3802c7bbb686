"""Planned motions against motions drawn by chance: determinant, certificate, refitted deviations.

    python -m studies.research.motion_designs [--days 20] [--motions 5] [--figaroh FOLDER] [--json FILE]

On the UR10e, with the usual terms of every joint and its inertials. Of each choice so many days are
drawn, with friction and armature that its drives plausibly have and with errors that remember
themselves as the design takes for granted. Terms of joints are fitted anew on each; their deviations
over the days stand beside those that were predicted. ``--figaroh`` also asks FIGAROH, in an
environment of its own, for as many exciting trajectories as long; those know no limit of acceleration.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import click
import numpy as np
from scipy.interpolate import CubicSpline

import calib
from calib.arrays import Array
from calib.motion.diagnose import products_of
from calib.motion.fit import MotionModel, fit
from calib.motion.gram import FILE, LOSSES
from calib.motion.motions import Motions
from doe import design_motions
from doe.motions.draw import Motion, drawn
from doe.motions.information import MEMORY, RESIDUAL, USUAL, information
from studies.research.bench import Output, Row, bench, count, data_folder, rms, table
from studies.research.motions import read
from studies.research.peers.__main__ import environment, said_by

_TERMS = ("torque_offset", "coulomb_friction", "viscous_friction", "armature")


_LIMIT = 3600.0  # s, of FIGAROH


@dataclass(frozen=True, eq=False)
class Splined(Motion):
    """A motion by its path; what makes a Fourier series is empty."""

    path: CubicSpline

    def at(self, time: Array) -> tuple[Array, Array, Array]:
        q, v, a = (self.path(time, order) for order in range(3))
        return q, v, a


def exciting(cell: calib.Cell, folder: Path, count: int, like: Motion) -> list[Motion]:
    """FIGAROH's trajectories, as long as another motion."""
    folder.mkdir(parents=True, exist_ok=True)
    python = environment((folder / "figaroh").resolve(), "figaroh==1.0.2 cyipopt")
    driver = Path(__file__).parent / "peers" / "drive_figaroh_excitation.py"
    urdf, answer = data_folder("ur10e_motion") / "robot.urdf", folder / "excitation.npz"
    joints = ",".join(cell.robot.joints)
    run = [str(python), str(driver), str(urdf), joints, str(count), str(like.lasts)]
    said_by([*run, str(answer)], _LIMIT)
    none, found = np.zeros((0, cell.robot.dof)), list[Motion]()
    for q in np.load(answer)["q"]:
        path = CubicSpline(np.linspace(0.0, like.lasts, len(q)), q, bc_type="clamped")
        found.append(Splined(q[0], none, none, 0.0, like.lasts, like.payload, path))
    return found


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
    click.option("--figaroh", type=click.Path(path_type=Path, file_okay=False)),
    days=20,
)
def main(days: int, motions: int, figaroh: Path | None, seed: int) -> Output:
    """Planned motions against motions drawn by chance."""
    cell, _ = read("UR10e")
    terms = (*_TERMS, USUAL[-1])
    cell = replace(cell, motion=replace(cell.motion, effects=terms))
    planned = design_motions(cell, motions, seed=seed)
    rng = np.random.default_rng(seed + 1)
    pool, _, _ = drawn(cell, 20 + motions, planned.motions[0].lasts, rng)
    theirs = [] if figaroh is None else exciting(cell, figaroh, motions, planned.motions[0])
    every = [*planned.motions, *theirs, *pool]
    told = information(cell, every, terms, ())
    torque = np.sqrt(np.mean([(own.run(cell).effort ** 2).mean(axis=0) for own in every], axis=0))
    torque = np.maximum(torque, 1e-3 * float(torque.max()))  # as the design has it
    rows: list[Row] = []
    drawn_ones = np.arange(motions + len(theirs), len(every))
    choices = {"planned": np.arange(motions)}
    if theirs:
        choices["FIGAROH"] = np.arange(motions, motions + len(theirs))
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
