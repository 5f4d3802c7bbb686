"""What the figures of a diagnosis show: how the error falls, and its curve at each place."""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import TYPE_CHECKING, Self

import numpy as np
from pydantic import Field

from studies.results.base import MICRO, Entry, NotNegative, Number, Row, Unit, tuples

if TYPE_CHECKING:
    from calib.arm.robot import Robot
    from calib.diagnosis import Diagnosis
    from calib.diagnosis.candidates import Candidate
    from calib.diagnosis.error_curve import ErrorCurve as FittedCurve

_LEVELS = 3  # knots up to which a variable takes a few values only
_LEAVES_ZERO = 3.0  # standard deviations by which a direction must leave zero to be shown
_COMPONENTS = ("x", "y", "z", "rx", "ry", "rz")


def _added(result: Diagnosis) -> list[Candidate]:
    """All that was fitted, by name or as a curve, the largest share of the gap first."""
    shares = {(place.where, place.depends_on): place.share for place in result.located}
    every = [(cause.share, cause.named.candidate) for cause in result.fitted_causes]
    every += [
        (shares.get((candidate.where, candidate.depends_on), np.nan), candidate)
        for candidate in (entry.candidate for entry in result.outcome.entries)
        if not candidate.named
    ]
    return [
        candidate
        for _, candidate in sorted(every, key=lambda pair: -np.nan_to_num(pair[0], nan=-np.inf))
    ]


def _label(candidate: Candidate) -> str:
    """A cause by its name, a place without a name by what it depends on."""
    if candidate.named:
        return f"{candidate.effect.kind}:{candidate.where}"
    return f"{candidate.where} by {candidate.depends_on}, no name"


class ErrorSteps(Entry):
    """RMS error before and after each effect, added one to the other by their share of the gap."""

    of: str
    unit: Unit
    added: tuple[str, ...]
    rms_mm: tuple[NotNegative, ...]

    @classmethod
    def of_diagnosis(cls, result: Diagnosis) -> Self:
        """Fit the model again with one more effect each time."""
        from calib.diagnosis.gap import rms, squared_errors

        added, stage, before = _added(result), result.stage, result.before
        data = stage.data.take(~stage.dropped) if result.heldout is None else result.heldout
        between = [
            stage.fit(
                [c.effect for c in added[:n]],
                before.values,
                result.after.amplitudes,
                result.after.variances,
            )
            for n in range(1, len(added))
        ]
        fits = [before, *between, *([result.after] if added else [])]
        shown = before.model.readout.channels.shown
        return cls(
            unit="mm" if shown.unit == "mm" else "px",
            of="fitted poses" if result.heldout is None else "held-out poses",
            added=tuple(map(_label, added)),
            rms_mm=tuple(rms(squared_errors(fit, data)) / shown.scale for fit in fits),
        )


class CurvePanel(Entry):
    """One direction of an error, in the units shown.

    value, std : the curve on the grid, and at_poses, std_at_poses at the poses
    single : what each pose says by itself; effect : what was named, at the poses, None where nothing
    line : whether that is a line over the variable; else it is a point at each pose
    """

    label: str
    value: Row
    std: Row
    at_poses: Row
    std_at_poses: Row
    single: Row
    effect: Row | None
    line: bool


class ErrorCurve(Entry):
    """The error of one place over what it depends on.

    levels : whether the variable takes a few values only, between which there is nothing
    """

    name: str
    title: str
    caption: str
    effect: str | None
    levels: bool
    variable_label: str
    grid: tuple[Number, ...] = Field(min_length=2)
    variable: Row
    pose_names: tuple[str, ...]
    panels: tuple[CurvePanel, ...] = Field(min_length=1)

    @classmethod
    def each(cls, result: Diagnosis) -> Iterator[Self]:
        """A free curve in place of everything that was found and can be drawn."""
        from calib.diagnosis.error_curve import error_curve

        robot = result.before.model.robot
        for number, candidate in enumerate(_added(result), 1):
            fitted = error_curve(result, candidate)
            if fitted is not None:
                yield cls._of(fitted, number, robot)

    @classmethod
    def _of(cls, fitted: FittedCurve, number: int, robot: Robot) -> Self:
        candidate, named = fitted.candidate, fitted.candidate.named
        where, variable = candidate.where, candidate.depends_on
        scale, variable_label = _variable(fitted, robot)
        few = len(fitted.knots) <= _LEVELS
        on_grid = np.isin(fitted.grid, fitted.knots) if few else np.ones(len(fitted.grid), bool)

        def panel(c: int) -> CurvePanel:
            return CurvePanel(
                label=_axis_label(fitted, c, robot),
                value=tuples(fitted.value[on_grid, c] * MICRO),
                std=tuples(fitted.std[on_grid, c] * MICRO),
                at_poses=tuples(fitted.at_poses[:, c] * MICRO),
                std_at_poses=tuples(fitted.std_at_poses[:, c] * MICRO),
                single=tuples(fitted.single[:, c] * MICRO),
                effect=tuples(fitted.effect[:, c] * MICRO) if named else None,
                line=fitted.function[c],
            )

        plain = re.sub(r"[^A-Za-z0-9]+", "_", f"{where} by {variable}")
        return cls(
            name=f"error_{number}_{plain}",
            title=f"Error of {where} over {variable}",
            caption=_caption(fitted),
            effect=_label(candidate) if named else None,
            levels=few,
            variable_label=variable_label,
            grid=tuples(fitted.grid[on_grid] * scale),
            variable=tuples(fitted.variable * scale),
            pose_names=fitted.poses.names,
            panels=tuple(map(panel, _clear(fitted))),
        )


def _clear(fitted: FittedCurve) -> list[int]:
    """Directions in which the curve leaves zero; the clearest one where none does."""
    clear = np.max(np.abs(fitted.value) / np.where(fitted.std > 0.0, fitted.std, np.inf), axis=0)
    return np.flatnonzero(clear > _LEAVES_ZERO).tolist() or [int(np.argmax(clear))]


def _variable(fitted: FittedCurve, robot: Robot) -> tuple[float, str]:
    """Factor from SI, and the label of the axis."""
    kind, _, joint = fitted.candidate.depends_on.partition(":")
    slides = joint in robot.joints and bool(robot.prismatic[robot.joints.index(joint)])
    factor, unit = (1e3, "mm") if slides else (180.0 / np.pi, "deg")
    if fitted.load is not None:
        part = int(np.argmax(np.abs(fitted.load)))
        axis = "" if fitted.candidate.where in robot.joints else f" {'xyz'[part % 3]}"
        what, unit = ("force", "N") if part < 3 else ("moment", "N m")
        return 1.0, f"transmitted {what}{axis} [{unit}]"
    return {
        "q": (factor, f"{joint} [{unit}]"),
        "motion": (factor, f"last motion of {joint} [{unit}]"),
        "approach": (1.0, f"last motion of {joint}, its sign"),
        "time": (1.0 / 3600.0, "time [h]"),
        "temperature": (1.0, "temperature [degC]"),
    }[kind]


def _axis_label(fitted: FittedCurve, c: int, robot: Robot) -> str:
    where, column = fitted.candidate.where, fitted.directions[:, c]
    unit = "um" if column[:3].any() else "urad"
    if where not in robot.joints:
        return f"{where} {_COMPONENTS[int(np.argmax(np.abs(column)))]} [{unit}]"
    if fitted.directions.shape[1] == 1:
        return f"error of {where} [{unit}]"
    axis = " ".join(f"{x:.2f}" for x in column[3:] + 0.0).replace("-", "\N{MINUS SIGN}")
    return f"tilt of {where}\nabout ({axis}) [{unit}]"


def _caption(fitted: FittedCurve) -> str:
    """How to read the curve."""
    candidate, name = fitted.candidate, _label(fitted.candidate)
    where, variable = candidate.where, candidate.depends_on
    line = f"The error of {where} over {variable}: a line through knots"
    grey = "Grey points are what each pose says by itself."
    if not candidate.named:
        said = f"{line} with its 95 % band. {grey} No cause in the catalogue has this shape."
    elif all(fitted.function[c] for c in _clear(fitted)):
        said = (
            f"{line}, fitted in place of {name}, with its 95 % band. {grey} Where {name}, as fitted, "
            "keeps within the band it has the right shape."
        )
    else:
        said = (
            f"{line}, fitted in place of {name}, with its 95 % band. {grey} {name} depends on more "
            f"than {variable}: a cross for each pose, to be compared with the pose's grey point."
        )
    if fitted.absorbed:
        said += (
            f" Of {len(fitted.knots) * fitted.directions.shape[1]} coefficients {fitted.absorbed} "
            "combined (such as a constant part) might as well be errors of what the model contains; "
            "they are taken out of all that is drawn."
        )
    return said
