"""What the figures of a diagnosis show: the fall of the error, its curves, what is left.

A report draws them from the JSON, long after the diagnosis itself is gone.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from calib.threads import one_blas_thread
from studies.diagnose.record import CurvePanel, DiagnoseResidual, ErrorCurveEntry, ErrorSteps
from studies.fitted import residual_fields

if TYPE_CHECKING:
    from calib.arm.robot import Robot
    from calib.arrays import Array
    from calib.diagnosis import Diagnosis
    from calib.diagnosis.candidates import Candidate
    from calib.diagnosis.error_curve import ErrorCurve
    from calib.poses import Measurements

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
    all_found = [(cause.share, cause.named.candidate) for cause in found.causes]
    shares = {(place.where, place.depends_on): place.share for place in found.located}
    for entry in found.outcome.entries:
        own = entry.candidate
        if not own.named:
            all_found.append((shares.get((own.where, own.depends_on), np.nan), own))
    all_found.sort(key=lambda pair: -np.nan_to_num(pair[0], nan=-np.inf))
    added = [own for _, own in all_found]
    residuals = list(_residuals(found, found.data, False))
    if found.heldout is not None:
        residuals += _residuals(found, found.heldout, True)
    return DiagnosisShown(_steps(found, added), tuple(_curves(found, added)), tuple(residuals))


def _steps(found: Diagnosis, added: list[Candidate]) -> ErrorSteps:
    from calib.diagnosis.gap import rms, squared_errors

    stage = found.stage
    data = stage.data.take(~stage.dropped) if found.heldout is None else found.heldout
    fits = [found.before]
    fits += [found.linear.fit([c.effect for c in added[:n]]) for n in range(1, len(added))]
    fits += [found.after] if added else []
    shown = found.before.model.readout.channels.shown
    return ErrorSteps(
        unit=shown.unit,
        of="fitted poses" if found.heldout is None else "held-out poses",
        added=tuple(map(label, added)),
        rms_mm=tuple(rms(squared_errors(fit, data)) / shown.scale for fit in fits),
    )


def _residuals(found: Diagnosis, data: Measurements, heldout: bool) -> Iterator[DiagnoseResidual]:
    """Measured minus predicted at each point, before and after the found effects; no turns."""
    before, after = (fit.model.off(fit.values, data) for fit in (found.before, found.after))
    every = residual_fields(
        found.before.model, data, before, after, heldout, "before", first_unit_only=True
    )
    for fields in every:
        fields.pop("at_px", None)
        yield DiagnoseResidual(**fields)


def label(candidate: Candidate) -> str:
    """A cause by its name, a place without a name by what it depends on."""
    if candidate.named:
        return f"{candidate.effect.kind}:{candidate.where}"
    return f"{candidate.where} by {candidate.depends_on}, no name"


def _curves(result: Diagnosis, added: list[Candidate]) -> Iterator[ErrorCurveEntry]:
    from calib.diagnosis.error_curve import error_curve

    for number, candidate in enumerate(added, 1):
        found = error_curve(result, candidate)
        if found is not None:
            yield _curve(found, number, result.before.model.robot)


def _curve(found: ErrorCurve, number: int, robot: Robot) -> ErrorCurveEntry:
    candidate = found.candidate
    variable, named = candidate.depends_on, candidate.named
    scale, variable_label = _variable(found, robot)
    few = len(found.knots) <= _LEVELS
    on_grid = np.isin(found.grid, found.knots) if few else np.ones(len(found.grid), dtype=bool)

    def shown(values: Array, c: int) -> tuple[float, ...]:
        return tuple((values[:, c] * _MICRO).tolist())

    plain = re.sub(r"[^A-Za-z0-9]+", "_", f"{candidate.where} by {variable}")
    return ErrorCurveEntry(
        name=f"error_{number}_{plain}",
        title=f"Error of {candidate.where} over {variable}",
        caption=_caption(found),
        effect=label(candidate) if named else None,
        levels=few,
        variable_label=variable_label,
        grid=tuple((found.grid[on_grid] * scale).tolist()),
        variable=tuple((found.variable * scale).tolist()),
        pose_names=found.poses.names,
        panels=tuple(
            CurvePanel(
                label=_axis_label(found, c, robot),
                value=shown(found.value[on_grid], c),
                std=shown(found.std[on_grid], c),
                at_poses=shown(found.at_poses, c),
                std_at_poses=shown(found.std_at_poses, c),
                single=shown(found.single, c),
                effect=shown(found.effect, c) if named else None,
                line=bool(found.function[c]),
            )
            for c in _clear(found)
        ),
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
    if not found.converged:
        parts.append("The fit did not converge: take it as a sketch.")
    return " ".join(parts)
