"""Motions in the place of measured points: ``diagnose`` and ``identify`` of joint torques."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Literal

from studies.command import options
from studies.command.call import Call, working

if TYPE_CHECKING:
    from calib import Cell
    from calib.motion.motions import Motions


def deliver_motions(
    call: Call,
    cell: Cell,
    data_path: Path,
    holdout: str | None,
    command: Literal["diagnose", "identify"],
    **refused: object,
) -> None:
    """Read, diagnose or identify, and deliver.

    refused : options that go with poses alone, by name

    Raises InputError.
    """
    from calib.errors import InputError
    from calib.motion.diagnose import diagnose_motions, identify_motions
    from calib.threads import one_blas_thread
    from studies.results.motion import MotionResult

    for name, given in refused.items():
        if given:
            raise InputError(name, "", "does not go with motions", "leave it out")
    with working(f"reading {data_path.name}"):
        motions, kept, held, files = _session(cell, data_path, holdout, call.seed)
    inputs = [cell.path, *cell.robot_files, data_path, *files]
    call.check(inputs)
    run = one_blas_thread(diagnose_motions if command == "diagnose" else identify_motions)
    with (
        options.faults_in(data_path, effects_of=cell.path),
        working(f"{command} {len(kept)} samples"),
    ):
        found = run(cell, kept, heldout=held)
    result = MotionResult.of(
        found,
        call.envelope(cell, inputs),
        command=command,
        holdout=holdout,
        warnings=motions.warnings,
    )
    call.deliver(result)


def _session(
    cell: Cell, path: Path, holdout: str | None, seed: int
) -> tuple[Motions, Motions, Motions | None, list[Path]]:
    """All runs, those that are fitted, those held out, and further files. Raises InputError."""
    from calib.errors import InputError
    from calib.files.motions import load_motions

    motions = load_motions(cell, path)
    if holdout is None:
        return motions, motions, None, []
    try:
        share = float(holdout)
    except ValueError:
        return motions, motions, load_motions(cell, Path(holdout)), [Path(holdout)]
    if not 0.0 < share < 1.0:
        raise InputError("--holdout", "", f"{holdout} is not between 0 and 1", "use 0.3, or a file")
    return motions, *motions.split(share, seed), []
