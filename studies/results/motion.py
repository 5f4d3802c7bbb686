"""``diagnose`` and ``identify`` of motions: the terms that the torques need."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from typing import Literal, Self

import numpy as np

from calib.arrays import Array
from calib.motion.causes import MotionCause, MotionParameter
from calib.motion.diagnose import MotionDiagnosis, TorqueGap
from calib.motion.encoders import NAMES, UNITS
from studies.results.base import (
    BeforeAfter,
    DetectionLimit,
    Entry,
    Envelope,
    Maybe,
    NotNegative,
    Number,
    Outlier,
    Result,
)
from studies.results.diagnose import (
    CauseParameter,
    GapErrors,
    LikelyCause,
    LocatedPlace,
    NamedCause,
)


class TermParameter(CauseParameter):
    """A parameter of a term; std by the jackknife over runs, ci95 by Student's t."""

    ci95: tuple[Maybe, Maybe]

    @classmethod
    def of(cls, own: MotionParameter, unit: str) -> Self:
        """The entry; unit : of the efforts, in which torques stand."""
        named = own.unit if unit == "Nm" else _of_current(own.unit)
        return cls.from_object(own, unit=named, ci95=(own.low, own.high))


def _of_current(unit: str) -> str:
    of_torque = {"kg m^2": "A s^2/rad", "Nm/Nm": "A/Nm"}
    return of_torque.get(unit, unit.replace("Nm", "A"))


class TorqueTerm(NamedCause):
    """A term that was found, and those that these motions cannot tell from it.

    gain_percent : mean growth of the squared error of left-out runs without it
    """

    gain_percent: Number
    parameters: tuple[TermParameter, ...]

    @classmethod
    def of(cls, cause: MotionCause, unit: str) -> Self:
        """The entry of a cause."""
        first = (cause.effect, cause.where, cause.probability)
        of_links = cause.effect in ("inertials", "payload")
        return cls.from_object(
            cause,
            p_value=cause.evidence.p,
            gain_percent=100.0 * cause.evidence.gain,
            alike=tuple(
                LikelyCause(effect=effect, where=where, probability=p)
                for effect, where, p in (first, *cause.rivals)
            ),
            parameters=tuple(
                TermParameter.of(own, "Nm" if of_links else unit) for own in cause.parameters
            ),
            share_of_gap=cause.share,
        )


class JointError(Entry):
    """Errors of a joint in percent of its torque's RMS; moving : after, where it moves."""

    before: Maybe
    after: Maybe
    moving: Maybe


class TorqueErrors(GapErrors):
    """Errors in percent of the torque's RMS, quadratic mean over joints.

    joints : each of them, held out where runs were, else of runs left out in turn
    """

    floor_mm: NotNegative
    joints: dict[str, JointError]

    @classmethod
    def of_motions(cls, found: MotionDiagnosis) -> Self:
        """The entry of a diagnosis."""
        gap, held, of = found.gap, found.heldout, type(found.gap).overall
        joints = zip(found.cell.robot.joints, gap.before, gap.after, gap.moving, strict=True)
        first, last, floor = of(gap.before), of(gap.after), found.floor
        return cls(
            unit="percent",
            floor_mm=100.0 * floor,
            fit_before_mm=100.0 * of(found.fitted.before),
            fit_after_mm=100.0 * of(found.fitted.after),
            heldout_before_mm=None if held is None else 100.0 * first,
            heldout_after_mm=None if held is None else 100.0 * last,
            heldout_rose=None if held is None or not found.fitted_causes else last >= first,
            crossvalidated_before_mm=100.0 * of(found.crossed.before),
            crossvalidated_after_mm=100.0 * of(found.crossed.after),
            over_time_before_mm=None,
            over_time_after_mm=None,
            closed=(first**2 - last**2) / (first**2 - floor**2) if first > floor else None,
            closed_ci95=None,
            joints={j: JointError(before=100.0 * b, after=100.0 * a, moving=100.0 * m)
                    for j, b, a, m in joints},
        )  # fmt: skip


class TorqueRest(Entry):
    """What remains beside the terms: percent of the torque beyond the sensors' noise."""

    mm: None = None
    percent: NotNegative
    kind: Literal["none", "structure"]
    of: Literal["instrument", "model"]


class TorqueConstant(Entry):
    """Torque at a joint for one ampere, None where its torque does not tell."""

    joint: str
    value_nm_a: Maybe
    std_nm_a: Maybe


class GearEntry(Entry):
    """Of one gear; RMS difference of both encoders before and after."""

    joint: str
    values: tuple[CauseParameter, ...]
    before_urad: NotNegative
    after_urad: NotNegative


def _located(joints: Sequence[str], after: Array) -> Iterator[LocatedPlace]:
    """What remains at the three joints at which it is largest, with its share of all that remains."""
    squares = np.nan_to_num(after) ** 2
    for j in np.argsort(-squares)[:3].tolist():
        share = float(squares[j] / squares.sum())
        yield LocatedPlace(where=joints[j], depends_on=f"motion:{joints[j]}", share_of_gap=share)


class MotionResult(Result):
    """Which terms the torques of a robot need beside its model.

    motions : by which it is known from a diagnosis of poses
    runs : of each part that evidence stands on its run; blocks : whether parts are stretches of runs
    """

    command: Literal["diagnose", "identify"]
    motions: Literal[True] = True
    verdict: Literal["no_gap", "explained", "partly", "ambiguous", "unknown"]
    effort: Literal["Nm", "A"]
    effects: tuple[TorqueTerm, ...]
    possible: tuple[TorqueTerm, ...] = ()
    rest: TorqueRest
    located: tuple[LocatedPlace, ...]
    gap: TorqueErrors
    could_not_see: tuple[DetectionLimit, ...]
    torque_constants: tuple[TorqueConstant, ...]
    gears: tuple[GearEntry, ...]
    runs: tuple[str, ...]
    blocks: bool
    holdout: str | None
    outliers: tuple[Outlier, ...] = ()

    @classmethod
    def of(
        cls,
        found: MotionDiagnosis,
        made_from: Envelope,
        *,
        command: Literal["diagnose", "identify"] = "diagnose",
        holdout: str | None = None,
        warnings: Iterable[str] = (),
    ) -> Self:
        """The result of a diagnosis of motions."""
        gap: TorqueGap = found.gap
        left = max(gap.overall(gap.after) ** 2 - found.floor**2, 0.0) ** 0.5
        joints = found.cell.robot.joints
        return cls(
            **made_from,
            command=command,
            warnings=tuple(warnings),
            verdict=found.verdict,
            effort=found.unit,
            effects=tuple(TorqueTerm.of(cause, found.unit) for cause in found.causes),
            possible=tuple(TorqueTerm.of(cause, found.unit) for cause in found.possible),
            rest=TorqueRest(percent=100.0 * left, kind=found.rest,
                            of="instrument" if found.rest == "none" else "model"),
            located=tuple(_located(joints, gap.after)) if found.rest == "structure" else (),
            gap=TorqueErrors.of_motions(found),
            could_not_see=tuple(
                DetectionLimit(effect=own.effect, where=own.where, minimum_detectable=own.smallest,
                               unit=own.unit if found.unit == "Nm" else _of_current(own.unit))
                for own in found.hidden
            ),
            torque_constants=() if found.constants is None else tuple(
                TorqueConstant(joint=joint, value_nm_a=value, std_nm_a=std)
                for joint, (value, std) in zip(joints, found.constants, strict=True)
            ),
            gears=tuple(
                GearEntry(
                    joint=own.joint,
                    values=tuple(
                        CauseParameter(name=name, value=value, std=std, unit=unit)
                        for name, value, std, unit in zip(
                            NAMES, own.values, own.std, UNITS, strict=True
                        )
                    ),
                    before_urad=own.before * 1e6,
                    after_urad=own.after * 1e6,
                )
                for own in found.gears
            ),
            runs=found.runs,
            blocks=found.blocks,
            holdout=holdout,
        )  # fmt: skip

    @property
    def error(self) -> BeforeAfter:
        """Percent of the torque, at held-out runs where there are any."""
        of = "error of the torque, with the model as given and with the terms found"
        return self.gap.error(of, "crossvalidated", "%")

    @property
    def where(self) -> str:
        """At which runs the error stands."""
        if self.gap.heldout_before_mm is not None:
            return "held-out runs"
        return "stretches left out in turn" if self.blocks else "runs left out in turn"

    @property
    def main_table(self) -> tuple[TorqueTerm, ...]:
        return self.effects

    @property
    def by_effect(self) -> list[tuple[str, list[TorqueTerm]]]:
        """Terms of each kind, the kinds with the largest share first, in the order of the joints."""
        order = dict(zip(self.gap.joints, range(len(self.gap.joints)), strict=True))
        by_kind: dict[str, list[TorqueTerm]] = {}
        for own in self.effects:
            by_kind.setdefault(own.effect, []).append(own)
        return [
            (kind, sorted(terms, key=lambda own: order.get(own.where, 0)))
            for kind, terms in by_kind.items()
        ]
