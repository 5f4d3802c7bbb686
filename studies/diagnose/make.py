"""From a session to its diagnosis, to the record of that with its figures, and to a better cell."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from calib import Cell
from calib.arm.robot import Robot
from calib.arrays import Array
from calib.diagnosis import Diagnosis
from calib.diagnosis.candidates import Candidate
from calib.diagnosis.causes import Cause
from calib.diagnosis.diagnose import diagnose
from calib.diagnosis.error_curve import ErrorCurve, error_curve
from calib.diagnosis.gap import rms, side_of, squared_errors
from calib.diagnosis.spectra import Spectrum, spectra
from calib.effects import Effect
from calib.files.cell_out import extended_cell
from calib.identification.residuals import Residuals
from calib.poses import Measurements
from calib.prediction.estimate import estimate_of
from calib.threads import one_blas_thread
from studies.command.options import faults_in
from studies.command.session import MeasuredTable
from studies.diagnose.record import (
    CauseParameter,
    CurvePanel,
    DiagnoseNoise,
    DiagnoseRecord,
    DiagnoseResidual,
    ErrorCurveEntry,
    ErrorSteps,
    FoundCause,
    GapEntry,
    LikelyCause,
    LocatedPlace,
    RefusedCause,
    SpectrumEntry,
    SpectrumLine,
)
from studies.entries import DetectionLimitEntry
from studies.fitted import estimated
from studies.identify.errors import read_falsely
from studies.noise import noise_fields
from studies.record import Envelope, Outlier, envelope

_MOST_CYCLES = 800  # in a file: several at each pixel of a figure
SECONDS = 50e-3
"""What each reading takes, s, as measured (``studies.research.benchmarks.speeds``)."""


def inputs_of(session: MeasuredTable) -> list[Path]:
    """What the record is made from, the cell first."""
    return [*session.read, *session.held.files]


def diagnosed(session: MeasuredTable, *, figures: bool = True) -> tuple[Diagnosis, DiagnoseRecord]:
    """Diagnose a session.

    figures : whether the record holds what they show

    Raises InputError naming the file that is at fault.
    """
    cell, held = session.cell, session.held
    with faults_in(session.data_path, effects_of=cell.path):
        found = diagnose(cell, held.data, heldout=held.heldout)
    record = diagnose_record(
        found,
        envelope(cell.name, inputs_of(session), session.seed, cell.about),
        spectra=spectra(found),
        shown=shown(found) if figures else None,
        holdout=session.holdout,
        targets_after=cell.design.targets_after or 0.0,
        warnings=(*held.warnings, *found.warnings),
    )
    return found, record


def diagnose_record(
    found: Diagnosis,
    made_from: Envelope,
    *,
    spectra: Sequence[Spectrum] = (),
    shown: DiagnosisShown | None = None,
    holdout: str | None = None,
    targets_after: float = 0.0,
    warnings: tuple[str, ...] = (),
) -> DiagnoseRecord:
    """The record of a diagnosis.

    shown : for figures; holdout : as the user gave it
    targets_after : s after the last reading at which the arm comes to its targets
    warnings : of the tables
    """
    noise, model, poses = found.noise, found.after.model, found.data.poses
    footprint, tip = model.footprint(found.after.values, found.data), model.robot.tip

    def where(entries: Iterable[Any]) -> list[str]:
        return [_at(entry.where, tip) for entry in entries]

    return DiagnoseRecord.from_result(
        shown or DiagnosisShown(None, (), ()),
        found,
        **made_from,
        warnings=warnings,
        holdout=holdout,
        estimate=estimated(estimate_of(found, targets_after)),
        noise=DiagnoseNoise.from_result(
            noise,
            **noise_fields(noise, found.after.levels, found.stage.scatter, model, footprint),
        ),
        effects=[_effect(cause, spectra, tip) for cause in found.causes],
        possible=[_effect(cause, spectra, tip) for cause in found.possible],
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
    """What a spectrum shows of gears."""
    return SpectrumEntry.from_result(
        spectrum,
        lines=SpectrumLine.from_each(
            spectrum.lines, aliases=[_rounded(line.aliases) for line in spectrum.lines]
        ),
    )


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


_LEVELS = 3  # knots up to which a variable takes a few values only
_LEAVES_ZERO = 3.0  # standard deviations by which a direction must leave zero to be shown
_MICRO = 1e6
_COMPONENTS = ("x", "y", "z", "rx", "ry", "rz")


class DiagnosisShown(NamedTuple):
    """All of it, by the names that it has in the record."""

    steps: ErrorSteps | None
    curves: tuple[ErrorCurveEntry, ...]
    residuals: tuple[DiagnoseResidual, ...]


@one_blas_thread
def shown(found: Diagnosis) -> DiagnosisShown:
    """Fit the model again with one more effect each time, and a free curve in place of each."""
    all_found = [(cause.share, cause.named.candidate) for cause in found.fitted_causes]
    shares = {(place.where, place.depends_on): place.share for place in found.located}
    for entry in found.outcome.entries:
        own = entry.candidate
        if not own.named:
            all_found.append((shares.get((own.where, own.depends_on), np.nan), own))
    all_found.sort(key=lambda pair: -np.nan_to_num(pair[0], nan=-np.inf))
    added = [own for _, own in all_found]
    robot, each = found.before.model.robot, enumerate((error_curve(found, c) for c in added), 1)
    curves = [_curve(own, number, robot) for number, own in each if own is not None]
    residuals = list(_residuals(found, found.data, False))
    if found.heldout is not None:
        residuals += _residuals(found, found.heldout, True)
    return DiagnosisShown(_steps(found, added), tuple(curves), tuple(residuals))


def _steps(found: Diagnosis, added: list[Candidate]) -> ErrorSteps:
    stage = found.stage
    data = stage.data.take(~stage.dropped) if found.heldout is None else found.heldout
    fits, like, sizes = [found.before], found.outcome.fit, found.after.amplitudes
    fits += [
        stage.fit([c.effect for c in added[:n]], found.before.values, sizes, like.variances)
        for n in range(1, len(added))
    ]
    fits += [found.after] if added else []
    shown = found.before.model.readout.channels.shown
    return ErrorSteps(
        unit="mm" if shown.unit == "mm" else "px",
        of="fitted poses" if found.heldout is None else "held-out poses",
        added=tuple(map(label, added)),
        rms_mm=tuple(rms(squared_errors(fit, data)) / shown.scale for fit in fits),
    )


def _residuals(found: Diagnosis, data: Measurements, heldout: bool) -> Iterator[DiagnoseResidual]:
    """Measured minus predicted at each point, before and after the found effects; no turns."""
    before, after = (fit.model.off(fit.values, data) for fit in (found.before, found.after))
    return DiagnoseResidual.of_readings(found.before.model, data, before, after, heldout)


def label(candidate: Candidate) -> str:
    """A cause by its name, a place without a name by what it depends on."""
    if candidate.named:
        return f"{candidate.effect.kind}:{candidate.where}"
    return f"{candidate.where} by {candidate.depends_on}, no name"


def _curve(found: ErrorCurve, number: int, robot: Robot) -> ErrorCurveEntry:
    candidate = found.candidate
    variable, named = candidate.depends_on, candidate.named
    scale, variable_label = _variable(found, robot)
    few = len(found.knots) <= _LEVELS
    on_grid = np.isin(found.grid, found.knots) if few else np.ones(len(found.grid), dtype=bool)

    columns = {
        "value": found.value[on_grid],
        "std": found.std[on_grid],
        "at_poses": found.at_poses,
        "std_at_poses": found.std_at_poses,
        "single": found.single,
        "effect": found.effect if named else None,
    }
    plain = re.sub(r"[^A-Za-z0-9]+", "_", f"{candidate.where} by {variable}")
    return ErrorCurveEntry.from_result(
        found,
        name=f"error_{number}_{plain}",
        title=f"Error of {candidate.where} over {variable}",
        caption=_caption(found),
        effect=label(candidate) if named else None,
        levels=few,
        variable_label=variable_label,
        grid=found.grid[on_grid] * scale,
        variable=found.variable * scale,
        panels=[
            CurvePanel.from_result(
                {n: v if v is None else v[:, c] * _MICRO for n, v in columns.items()},
                label=_axis_label(found, c, robot),
                line=found.function[c],
            )
            for c in _clear(found)
        ],
    )


def _clear(found: ErrorCurve) -> list[int]:
    """Directions in which the curve leaves zero; the clearest one where none does."""
    clear = np.max(np.abs(found.value) / np.where(found.std > 0.0, found.std, np.inf), axis=0)
    chosen = [c for c in range(len(clear)) if clear[c] > _LEAVES_ZERO]
    return chosen or [int(np.argmax(clear))]


def _variable(found: ErrorCurve, robot: Robot) -> tuple[float, str]:
    """Factor from SI, and the label of the axis."""
    kind, _, joint = found.candidate.depends_on.partition(":")
    slides = joint in robot.joints and bool(robot.prismatic[robot.joints.index(joint)])
    factor, unit = (1e3, "mm") if slides else (180.0 / np.pi, "deg")
    if found.load is not None:
        part = int(np.argmax(np.abs(found.load)))
        axis = "" if found.candidate.where in robot.joints else f" {'xyz'[part % 3]}"
        what, own = ("force", "N") if part < 3 else ("moment", "N m")
        return 1.0, f"transmitted {what}{axis} [{own}]"
    return {
        "q": (factor, f"{joint} [{unit}]"),
        "motion": (factor, f"last motion of {joint} [{unit}]"),
        "approach": (1.0, f"last motion of {joint}, its sign"),
        "time": (1.0 / 3600.0, "time [h]"),
        "temperature": (1.0, "temperature [degC]"),
    }[kind]


def _axis_label(found: ErrorCurve, c: int, robot: Robot) -> str:
    where, column = found.candidate.where, found.directions[:, c]
    unit = "um" if column[:3].any() else "urad"
    if where not in robot.joints:
        return f"{where} {_COMPONENTS[int(np.argmax(np.abs(column)))]} [{unit}]"
    if found.directions.shape[1] == 1:
        return f"error of {where} [{unit}]"
    axis = " ".join(f"{x:.2f}" for x in column[3:] + 0.0).replace("-", "\N{MINUS SIGN}")
    return f"tilt of {where}\nabout ({axis}) [{unit}]"


def _caption(found: ErrorCurve) -> str:
    candidate, name = found.candidate, label(found.candidate)
    where, variable = candidate.where, candidate.depends_on
    parts = [
        f"The error of {where} over {variable}: a line through knots, fitted in place of {name}, with "
        "its 95 % band. Grey points are what each pose says by itself."
        if candidate.named
        else f"The error of {where} over {variable}: a line through knots with its 95 % band. Grey "
        "points are what each pose says by itself. No cause in the catalogue has this shape."
    ]
    if candidate.named and all(found.function[c] for c in _clear(found)):
        parts.append(f"Where {name}, as fitted, keeps within the band it has the right shape.")
    elif candidate.named:
        parts.append(
            f"{name} depends on more than {variable}: a cross for each pose, to be compared with the "
            "pose's grey point."
        )
    if found.absorbed:
        parts.append(
            f"Of {len(found.knots) * found.directions.shape[1]} coefficients {found.absorbed} combined "
            "(such as a constant part) might as well be errors of what the model contains; they are "
            "taken out of all that is drawn."
        )
    return " ".join(parts)
