"""MuJoCo's sysid: friction, damping, armature of each joint, then masses and their centres with them.

Its optimiser fits the torques of ``mj_inverse`` at every twentieth sample. ``mj_inverse`` counts
friction as a constraint, so dry friction is a ``tanh`` of speed beside it. Pseudo-inertias of several
bodies do not compile in release 4.0.0.
"""

import json
import sys
import time
from importlib import import_module
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

sysid: Any = import_module("mujoco.sysid")  # the extra, which the checker of types need not see
EVERY = 20
SLOW = 0.02  # rad/s, of the tanh


def compiled(folder: Path) -> Any:
    """The arm's specification, without contacts and limits."""
    spec = mujoco.MjSpec.from_file(str(folder / "robot.urdf"))
    spec.compiler.inertiafromgeom = 0
    spec.option.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONSTRAINT
    return spec


def listed(spec: Any, joints: list[str], inertias: bool) -> Any:
    """The parameters that a user lists."""
    found = sysid.ParameterDict()
    for joint in joints:
        for name, start, most in (
            ("armature", 0.5, 20.0), ("damping", 5.0, 200.0), ("friction", 5.0, 100.0)
        ):  # fmt: skip
            found.add(sysid.Parameter(f"{joint} {name}", start, 0.0, most))
    if inertias:
        model = spec.compile()
        for k in range(model.njnt):
            body = model.body(model.jnt_bodyid[k]).name
            found.add(sysid.body_inertia_param(spec, model, body, scale_rot_inertia=True))
    return found


def torques(folder: Path, joints: list[str], params: Any, motion: Any) -> Any:
    """Torques (m, n) of the model with these parameters at angles, speeds and accelerations."""
    spec = sysid.apply_param_modifiers_spec(params, compiled(folder))
    model = spec.compile()
    data, found = mujoco.MjData(model), np.empty(motion[0].shape)
    for i, (q, v, a) in enumerate(zip(*motion[:3], strict=True)):
        data.qpos[:], data.qvel[:], data.qacc[:] = q, v, a
        mujoco.mj_inverse(model, data)
        found[i] = data.qfrc_inverse
    loss = {name: np.array([params[f"{j} {name}"].value[0] for j in joints])
            for name in ("armature", "damping", "friction")}  # fmt: skip
    _, v, a = motion[:3]
    friction = loss["friction"] * np.tanh(v / SLOW)
    return found + loss["armature"] * a + loss["damping"] * v + friction


def main(folder: Path, answer: Path) -> None:
    """Do the work and write the answer."""
    work = np.load(folder / "motions.npz")
    joints, few = work["joints"].tolist(), work["fit"][:, ::EVERY]
    size = np.sqrt((few[3] ** 2).mean(axis=0))
    runs = []
    for inertias in (False, True):
        begun = time.process_time()
        start = listed(compiled(folder), joints, inertias)

        def residual(x: Any, params: Any) -> Any:
            columns = []
            for own in np.reshape(x, (params.size, -1)).T:
                params.update_from_vector(own)
                columns.append(((torques(folder, joints, params, few) - few[3]) / size).ravel())
            return [np.array(columns).T if np.ndim(x) > 1 else columns[0]], None, None

        found, _ = sysid.optimize(start, residual, optimizer="mujoco", verbose=False, max_iters=30)
        seconds = time.process_time() - begun
        runs.append({
            "way": f"{found.size} listed: friction, damping, armature"
            + (", masses and their centres" if inertias else ""),
            "seconds": seconds,
            "heldout": torques(folder, joints, found, work["heldout"]).tolist(),
        })  # fmt: skip
    answer.write_text(json.dumps({"version": mujoco.__version__, "runs": runs}))


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[2]))
