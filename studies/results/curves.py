"""What the figures of a diagnosis show: how the error falls, and its curve at each place."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Self

import numpy as np
from pydantic import Field

from calib.arm.robot import Robot
from calib.diagnosis import Diagnosis
from calib.diagnosis.candidates import Candidate
from calib.diagnosis.error_curve import ErrorCurve as FittedCurve
from calib.diagnosis.error_curve import error_curve
from calib.diagnosis.gap import rms, squared_errors
from studies.results.base import MICRO, Count, Entry, NotNegative, Number, Row, Unit

_LEVELS = 3  # knots up to which a variable takes a few values only
_LEAVES_ZERO = 3.0  # standard deviations by which a direction must leave zero to be shown
_COMPONENTS = ("x", "y", "z", "rx", "ry", "rz")


def _added(result: Diagnosis) -> list[Candidate]:
    """All that was fitted, by name or as a curve, the largest share of the gap first."""
    shares = {(place.where, place.depends_on): place.share for place in result.located}
    every = [(cause.share, cause.named.candidate) for cause in result.fitted_causes]
    every += [
        (shares.get((entry.candidate.where, entry.candidate.depends_on), np.nan), entry.candidate)
        for entry in result.outcome.entries
        if not entry.candidate.named
    ]
    largest_first = sorted(every, key=lambda pair: -np.nan_to_num(pair[0], nan=-np.inf))
    return [candidate for _, candidate in largest_first]


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
        added, stage, before, after = _added(result), result.stage, result.before, result.after
        data = stage.data.take(~stage.dropped) if result.heldout is None else result.heldout
        effects = [candidate.effect for candidate in added]
        between = [
            stage.fit(effects[:n], before.values, after.amplitudes, after.variances)
            for n in range(1, len(added))
        ]
        fits = [before, *between, *([after] if added else [])]
        shown = before.model.readout.channels.shown
        return cls(
            unit="mm" if shown.unit == "mm" else "px",
            of="fitted poses" if result.heldout is None else "held-out poses",
            added=tuple(map(_label, added)),
            rms_mm=tuple(rms(squared_errors(fit, data)) / shown.scale for fit in fits),
        )


class CurvePanel(Entry):
    """One direction of an error, in the units shown.

    value, std : the curve on the grid; single : what each pose says by itself
    effect : what was named, at the poses, None where nothing; line : whether that is a line over the
        variable; else it is a point at each pose
    """

    label: str
    value: Row
    std: Row
    single: Row
    effect: Row | None
    line: bool


class ErrorCurve(Entry):
    """The error of one place over what it depends on.

    effect : the cause that was named, None where nothing
    levels : whether the variable takes a few values only, between which there is nothing
    coefficients, absorbed : of the curve, and how many combined the model contains as well
    """

    where: str
    depends_on: str
    effect: str | None
    levels: bool
    coefficients: Count
    absorbed: Count
    variable_label: str
    grid: tuple[Number, ...] = Field(min_length=2)
    variable: Row
    panels: tuple[CurvePanel, ...] = Field(min_length=1)

    @classmethod
    def each(cls, result: Diagnosis) -> Iterator[Self]:
        """A free curve in place of everything that was found and can be drawn."""
        robot = result.before.model.robot
        for candidate in _added(result):
            fitted = error_curve(result, candidate)
            if fitted is not None:
                yield cls.of(fitted, robot)

    @classmethod
    def of(cls, fitted: FittedCurve, robot: Robot) -> Self:
        """The entry of a curve."""
        candidate, knots = fitted.candidate, fitted.knots
        few = len(knots) <= _LEVELS
        on_grid = np.isin(fitted.grid, knots) if few else np.ones(len(fitted.grid), bool)
        scale, variable_label = _variable(fitted, robot)
        return cls(
            where=candidate.where,
            depends_on=candidate.depends_on,
            effect=_label(candidate) if candidate.named else None,
            levels=few,
            coefficients=len(knots) * fitted.directions.shape[1],
            absorbed=fitted.absorbed,
            variable_label=variable_label,
            grid=(fitted.grid[on_grid] * scale).tolist(),
            variable=(fitted.variable * scale).tolist(),
            panels=tuple(
                CurvePanel(
                    label=_axis_label(fitted, c, robot),
                    value=(fitted.value[on_grid, c] * MICRO).tolist(),
                    std=(fitted.std[on_grid, c] * MICRO).tolist(),
                    single=(fitted.single[:, c] * MICRO).tolist(),
                    effect=(fitted.effect[:, c] * MICRO).tolist() if candidate.named else None,
                    line=fitted.function[c],
                )
                for c in _clear(fitted)
            ),
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
