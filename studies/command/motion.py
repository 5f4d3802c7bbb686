"""Motions in the place of measured points: ``diagnose`` and ``identify`` of joint torques."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Literal, TypeAlias

from studies.command import options
from studies.command.call import Call, working
from studies.command.session import share_or_file

if TYPE_CHECKING:
    from calib import Cell
    from calib.motion.diagnose import MotionDiagnosis
    from calib.motion.motions import Motions

Form: TypeAlias = Literal["urdf", "mjcf"]
mjcf = options.value("--mjcf mjcf_path", "OUT", "The same of motions as MJCF, with armatures.")


def deliver_motions(
    call: Call,
    cell: Cell,
    data_path: Path,
    holdout: str | None,
    command: Literal["diagnose", "identify"],
    outputs: dict[Form, Path | None],
    cell_out: Path | None = None,
    **refused: object,
) -> None:
    """Read, diagnose or identify, and deliver.

    outputs : where the robot is written; refused : options that go with poses alone, by name

    Raises InputError.
    """
    from calib.files.cell_out import cell_with_terms
    from calib.files.motions import load_motions
    from calib.motion.diagnose import diagnose_motions, identify_motions
    from calib.threads import one_blas_thread
    from studies.results.motion import MotionResult

    options.refuse("motions", refused)
    with working(f"reading {data_path.name}"):
        share, path = share_or_file(holdout)
        motions = kept = load_motions(cell, data_path)
        held = None if path is None else load_motions(cell, path)
        if share is not None:
            kept, held = motions.split(share, call.seed)
    inputs = [cell.path, *cell.robot_files, data_path, *filter(None, [path])]
    call.check(inputs, *outputs.values(), cell_out)
    run = one_blas_thread(diagnose_motions if command == "diagnose" else identify_motions)
    with (
        options.faults_in(data_path, effects_of=cell.path),
        working(f"{command} {len(kept)} samples"),
    ):
        found = run(cell, kept, heldout=held)
        texts, notes = robot_files(found, held, outputs)
    if cell_out is not None:
        texts[cell_out], added = cell_with_terms(found, cell_out)
        said = ", ".join(added) or "nothing more; no term was found"
        notes.append(f"{cell_out}: model with {said}")
    result = MotionResult.of(
        found,
        call.envelope(cell, inputs),
        command=command,
        holdout=holdout,
        warnings=motions.warnings,
    )
    call.deliver(result, texts, notes=notes)


def robot_files(
    found: MotionDiagnosis, heldout: Motions | None, outputs: dict[Form, Path | None]
) -> tuple[dict[Path, str | bytes], list[str]]:
    """Texts of the robot's files where the error falls, and lines on them. Raises InputError."""
    wanted = {form: path for form, path in outputs.items() if path is not None}
    if not wanted:
        return {}, []
    import numpy as np

    from calib.files.motion_out import own_links, robot_with
    from calib.motion.diagnose import products_of
    from calib.motion.held import held_by_file

    cell, joints = found.cell, found.cell.robot.joints
    apart = None if heldout is None else products_of(cell, heldout, whole=True)
    held = held_by_file(found, own_links(cell.robot)[0], apart)
    where = "left-out" if heldout is None else "held-out"
    error = f"error of the torque at {where} runs {100 * held.before:.3g} % with the file as it was"
    if not held.after < held.before:
        said = f"{error}, and {100 * held.after:.3g} % with what was found: it did not fall"
        return {}, [f"{path} is not written: {said}" for path in wanted.values()]
    texts, notes = dict[Path, str | bytes](), list[str]()
    for form, path in wanted.items():
        made = robot_with(cell, held, form, path)
        texts[path] = made.text
        notes += [f"{path}: {error}, {100 * held.after:.3g} % with this one"]
        notes += [f"{path} {lack}" for lack in made.lacks]
    if held.lacking:
        said = f"files hold no {', '.join(held.lacking)}"
        notes.append(f"{said}: dry friction and damping stand for other friction")
    if held.unknown.any():
        names = ", ".join(np.array(joints)[held.unknown].tolist())
        notes.append(f"friction and armature of {names} stay: state [robot.torque_constant_Nm_A]")
    return texts, notes
