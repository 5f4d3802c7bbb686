"""posecal beside other programs at joint torques: the same filtered runs, the same ones held out.

    python -m studies.research.peers.motions FOLDER [--json FILE]

The UR10e's eleven runs, three held out (``N.motions``). Other programs get angles, speeds,
accelerations and efforts through posecal's filter, and the robot's URDF; what they fit is what their
user lists. They know no torque constants: those that the data's source quotes for a UR10 stand in.
Errors are RMS in percent of the effort's RMS, quadratic mean over joints; times are CPU seconds of one
thread.
"""

from __future__ import annotations

from pathlib import Path

import click
import numpy as np

from calib.arrays import Array
from calib.motion.filtering import filtered
from studies.research.bench import Output, Row, bench, data_folder, table
from studies.research.motions import HELD_OUT, one_choice, read
from studies.research.peers.__main__ import LeftOut, environment, solved

CONSTANTS = np.array([14.87, 13.26, 11.13, 10.62, 11.03, 11.47])  # N m of a joint for one ampere
PROGRAMS = {
    "figaroh_motions": "figaroh==1.0.2",
    "mujoco_motions": "mujoco[sysid]==4.0.0",
}


@bench(click.argument("folder", type=click.Path(path_type=Path, file_okay=False)))
def main(folder: Path, seed: int) -> Output:
    """Set posecal and other programs the same runs."""
    del seed
    cell, motions = read("UR10e")
    own = one_choice(cell, motions, HELD_OUT)
    rows: list[Row] = [
        {"program": "posecal", "free": "what stands", "seconds": own["CPU s"],
         "held out [%]": own["after"], "says of causes": own["terms"]}
    ]  # fmt: skip
    work, said = folder / "work", list[str]()
    held = _write(work, cell.motion.cutoff)
    for name, wanted in PROGRAMS.items():
        try:
            answer = solved(environment((folder / name).resolve(), wanted), name, work, 1)
        except LeftOut as why:
            said.append(f"{name}: left out, {why}")
            continue
        for run in answer["runs"]:
            rows.append(
                {"program": f"{name.removesuffix('_motions')} {answer['version']}",
                 "free": run["way"], "seconds": f"{run['seconds']:.1f}",
                 "held out [%]": f"{error(np.array(run['heldout']), held):.2f}",
                 "says of causes": "nothing: values of what was listed"}
            )  # fmt: skip
    return [table(rows), *said], {"runs": rows}


def error(predicted: Array, measured: Array) -> float:
    """Percent of the RMS of each joint's torque, (m, n), quadratic mean over joints."""
    share = ((measured - predicted) ** 2).sum(axis=0) / (measured**2).sum(axis=0)
    return 100.0 * float(np.sqrt(share.mean()))


def _write(folder: Path, cutoff: float) -> Array:
    """Write robot and runs; of those held out the torque (m, n), N m, is written nowhere."""
    cell, motions = read("UR10e")
    folder.mkdir(parents=True, exist_ok=True)
    source = data_folder("ur10e_motion") / "robot.urdf"
    (folder / "robot.urdf").write_bytes(source.read_bytes())
    parts: dict[str, list[Array]] = {"fit": [], "heldout": []}
    for run in motions.runs:
        s = filtered(run, cutoff)
        parts["heldout" if run.name in HELD_OUT else "fit"].append(
            np.stack([s.q, s.v, s.a, CONSTANTS * s.effort])
        )
    fit, held = (np.concatenate(each, axis=1) for each in parts.values())
    np.savez(
        folder / "motions.npz", fit=fit, heldout=held[:3],
        joints=np.array(cell.robot.joints), gravity=cell.gravity,
    )  # fmt: skip
    return np.asarray(held[3])


if __name__ == "__main__":
    main()
