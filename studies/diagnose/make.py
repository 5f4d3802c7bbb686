"""From a session to its diagnosis, to the record of that, and to a cell with what was found."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from calib import Cell
from calib.arm.robot import Robot
from calib.arrays import Array
from calib.compensation.estimate import estimate_of
from calib.diagnosis import Diagnosis
from calib.diagnosis.candidates import Candidate
from calib.diagnosis.causes import Cause
from calib.diagnosis.diagnose import diagnose
from calib.diagnosis.gap import side_of
from calib.diagnosis.imitated import Imitated
from calib.diagnosis.spectra import Spectrum, spectra
from calib.effects import Effect
from calib.errors import CalibError
from calib.files.cell_out import extended_cell
from calib.identification.residuals import Residuals
from doe.ahead.next_poses import NextPoses, next_poses
from studies.command.options import faults_in
from studies.command.session import MeasuredTable
from studies.diagnose import NEXT
from studies.diagnose.record import (
    CauseParameter,
    DiagnoseNoise,
    DiagnoseRecord,
    Findings,
    FoundCause,
    GapEntry,
    LikelyCause,
    LocatedPlace,
    NextPose,
    RefusedCause,
    SpectrumEntry,
    SpectrumLine,
)
from studies.diagnose.shown import DiagnosisShown, shown
from studies.entries import DetectionLimitEntry, shown_joints
from studies.fitted import estimated
from studies.identify.errors import read_falsely
from studies.noise import noise_fields
from studies.record import Envelope, Outlier, envelope

_MOST_CYCLES = 800  # in a file: several at each pixel of a figure
SECONDS = 50e-3
"""What each reading takes, s, as measured (``studies.research.benchmarks.speeds``)."""


def inputs_of(session: MeasuredTable) -> list[Path]:
    """What the record is made from, the cell first."""
    prior = session.cell.prior_file
    return [*session.read, *session.held.files, *([prior] if prior else [])]


def diagnosed(
    session: MeasuredTable, next_count: int = NEXT, *, figures: bool = True
) -> tuple[Diagnosis, DiagnoseRecord]:
    """Diagnose a session.

    next_count : poses to propose; figures : whether the record holds what they show

    Raises InputError naming the file that is at fault.
    """
    cell, held = session.cell, session.held
    with faults_in(session.data_path, effects_of=cell.path):
        found = diagnose(cell, held.data, heldout=held.heldout)
    chosen, failed = _next(cell, found, next_count, session.seed)
    record = diagnose_record(
        found,
        spectra(found),
        chosen,
        shown(found) if figures else None,
        session.holdout,
        envelope(cell.name, inputs_of(session), session.seed, cell.about),
        (*held.warnings, *found.warnings, *failed),
    )
    return found, record


def _next(
    cell: Cell, found: Diagnosis, count: int, seed: int
) -> tuple[NextPoses | None, tuple[str, ...]]:
    """Poses that tell rivals apart, and why there are none: the diagnosis stands without them."""
    try:
        return (next_poses(cell, found, count=count, seed=seed) if count else None), ()
    except CalibError as error:
        return None, (f"no next poses: {error}",)


def diagnose_record(
    found: Diagnosis,
    spectra: Sequence[Spectrum],
    chosen: NextPoses | None,
    shown: DiagnosisShown | None,
    holdout: str | None,
    made_from: Envelope,
    warnings: tuple[str, ...] = (),
) -> DiagnoseRecord:
    """The record of a diagnosis.

    chosen : the next poses, None where none were asked for; shown : for figures, None for none
    holdout : as the user gave it; warnings : of the tables
    """
    further = chosen or NextPoses(found.data.poses.take(slice(0, 0)))
    return DiagnoseRecord.from_result(
        findings(found, spectra),
        shown or DiagnosisShown(None, (), ()),
        further,
        **made_from,
        warnings=warnings,
        holdout=holdout,
        next_poses=_next_poses(further, found.after.model.robot),
        estimate=estimated(estimate_of(found)),
    )


def findings(found: Diagnosis, spectra: Sequence[Spectrum] = ()) -> Findings:
    """The diagnosis without what it was made from; spectra : of it, where they are asked for."""
    noise, model, poses = found.noise, found.after.model, found.data.poses
    footprint, tip = model.footprint(found.after.values, found.data), model.robot.tip

    def where(entries: Iterable[Any]) -> list[str]:
        return [_at(entry.where, tip) for entry in entries]

    return Findings.from_result(
        found,
        noise=DiagnoseNoise.from_result(
            noise,
            grows_with_range=found.growth,
            **noise_fields(noise, found.after.levels, found.stage.scatter, model, footprint),
        ),
        effects=[
            *(_effect(cause, spectra, tip) for cause in found.causes),
            *(_imitated(own) for own in found.imitated),
        ],
        located=LocatedPlace.from_each(found.located, where=where(found.located)),
        gap=GapEntry.from_result(found.gap, model.readout.channels.shown),
        could_not_see=DetectionLimitEntry.from_each(found.hidden, where=where(found.hidden)),
        refused=RefusedCause.from_each(found.refused, where=where(found.refused)),
        approach_derived=bool(poses.approach is not None and poses.approach_derived),
        not_fitted=[name for name, waits in zip(poses.names, found.waiting, strict=True) if waits],
        outliers=_outliers(found),
        spectra=map(spectrum_entry, spectra),
    )


def _at(where: str, tip: str) -> str:
    """The place in the words of the results: what ends at the tip belongs to the tool."""
    return "tool" if where == tip else where


def _effect(cause: Cause, spectra: Sequence[Spectrum], tip: str) -> FoundCause:
    parameters = cause.named.candidate.effect.parameters
    return FoundCause.from_result(
        cause,
        effect=cause.name,
        where=_at(cause.where, tip),
        alike=_alike(cause.members, tip),
        parameters=CauseParameter.from_each(parameters, value=cause.values, std=cause.std),
        aliases=_aliases(cause, spectra),
        decided_by=_decided_by([c.effect for c in cause.named.causes]),
        far_out=cause.far_out or None,
    )


def _alike(members: Iterable[tuple[Candidate, float]], tip: str = "") -> tuple[LikelyCause, ...]:
    """Causes that the data cannot tell apart, the likeliest first."""
    return tuple(
        LikelyCause(effect=own.effect.kind, where=_at(own.where, tip), probability=probability)
        for own, probability in members
    )


def _imitated(own: Imitated) -> FoundCause:
    """A cause that the parameters of the user's model stand for."""
    effect = own.candidate.effect
    return FoundCause(
        effect=effect.kind,
        where=own.where,
        probability=own.members[0][1],
        p_value=own.p,
        shape_p_value=None,
        alike=_alike(own.members),
        parameters=CauseParameter.from_each(effect.parameters, value=[own.value], std=[own.std]),
        share_of_gap=None,
        standing="one_of",
        decided_by=_decided_by([c.effect for c, _ in own.members]),
    )


def _decided_by(members: Sequence[Effect]) -> str | None:
    """What tells causes of different sides apart, beyond further poses."""
    if len({side_of(effect.where) for effect in members}) < 2:
        return None
    return next((effect.decided_by for effect in members if effect.decided_by), None)


def _aliases(cause: Cause, spectra: Sequence[Spectrum]) -> tuple[float, ...]:
    effect = cause.named.candidate.effect
    if effect.kind != "gear_ripple":
        return ()
    own = [p.name for p in effect.parameters].index("cycles")
    cycles = float(cause.values[own]) / effect.parameters[own].scale
    return aliases_of(effect.where, cycles, spectra)


def aliases_of(joint: str, cycles: float, spectra: Sequence[Spectrum]) -> tuple[float, ...]:
    """The cycles a turn that these poses cannot tell from those of a ripple of a joint."""
    for spectrum in spectra:
        for named, aliases in spectrum.named if spectrum.joint == joint else ():
            if abs(named - cycles) < 0.01 * spectrum.width:
                return _rounded(aliases)
    return ()


def _rounded(values: Sequence[float] | Array) -> tuple[float, ...]:
    return tuple(round(float(value), 2) for value in values)


def _outliers(found: Diagnosis) -> Iterator[Outlier]:
    model = found.after.model
    part = Residuals.of(model, found.data, found.after.values, found.outlier)
    for i in np.flatnonzero(found.outlier):
        reason = read_falsely(part, model, int(i)) or (
            f"mean square {found.statistic[i]:.1f} of its own spread, limit {found.limit:.1f}"
        )
        yield Outlier(pose=found.data.poses.names[i], reason=reason)


def spectrum_entry(spectrum: Spectrum) -> SpectrumEntry:
    """Thinned to the highest of every few that follow each other, so that every peak stays."""
    cycles, fall = spectrum.cycles, spectrum.fall
    step = -(-len(cycles) // _MOST_CYCLES)
    kept = [i + int(np.argmax(fall[i : i + step])) for i in range(0, len(cycles), max(step, 1))]
    return SpectrumEntry.from_result(
        spectrum,
        cycles_1_turn=_rounded(cycles[kept]),
        fall=_rounded(fall[kept]),
        lines=SpectrumLine.from_each(
            spectrum.lines, aliases=[_rounded(line.aliases) for line in spectrum.lines]
        ),
    )


def _next_poses(chosen: NextPoses, robot: Robot) -> Iterator[NextPose]:
    for name, q, splits in zip(chosen.poses.names, chosen.poses.q, chosen.splits, strict=True):
        yield NextPose(pose=name, **shown_joints(robot, q), splits=splits)


def better_cell(cell: Cell, result: Diagnosis, target: Path) -> tuple[str, list[str]]:
    """The text of the cell for a target file, and a line for everything the reader must know.

    Raises InputError where the cell file cannot be read any more.
    """
    found = [cause.named.candidate.effect for cause in result.causes]
    made = extended_cell(cell, found, result.data.poses, target)
    notes = [
        f"{target}: model with {', '.join(made.added)}"
        if made.added
        else f"{target}: the model as it was; no effect was found that could be added"
    ]
    if made.replaced:
        notes.append(f"{target}: they contain, and replace, {', '.join(made.replaced)}")
    notes += [f"{target}: without {effect}; {reason}" for effect, reason in made.refused]
    for cause in result.causes:
        alike = [f"{c.effect.kind}:{c.where}" for c, _ in cause.named.members[1:]]
        if alike:
            first = cause.named.candidate
            notes.append(
                f"{target}: {first.effect.kind}:{first.where} stands for {' or '.join(alike)} too, "
                "which these data cannot tell from it"
            )
    unnamed = [
        f"{entry.candidate.where} by {entry.candidate.depends_on}"
        for entry in result.outcome.entries
        if not entry.candidate.named
    ]
    if unnamed:
        notes.append(f"{target}: without {', '.join(unnamed)}; a curve without a name is no effect")
    return made.text, notes
