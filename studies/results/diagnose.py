"""``diagnose --json``: where the gap lies, what causes it, how far it shrinks."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from typing import Literal, Self

import numpy as np
from pydantic import Field

from calib import Cell, Measurements
from calib.diagnosis import Diagnosis
from calib.diagnosis.causes import Cause as FittedCause
from calib.diagnosis.gap import Gap
from calib.diagnosis.spectra import Spectrum, spectra
from calib.effects import catalogue
from calib.instruments.protocol import Component
from calib.prediction.estimate import estimate_of
from studies.results.base import (
    BeforeAfter,
    Cause,
    DetectionLimit,
    Entry,
    Envelope,
    Maybe,
    NotAsked,
    NotNegative,
    Number,
    Outlier,
    Owner,
    Positive,
    Result,
    Unit,
)
from studies.results.curves import ErrorCurve, ErrorSteps
from studies.results.estimate import Estimated, Lengths, Pixels, Residual
from studies.results.expected import ExpectedErrors
from studies.results.noise import Noise
from studies.results.parts import Conditions

_MINOR = 0.005  # of the error
_DECIDED_BY = {
    "board_scale": "measure the board with a caliper, or add one known length ([[known_distances]])",
    "tracker_scale": "check the tracker's scale by one known length ([[known_distances]])",
}
"""What would tell a cause from those that look alike, beyond further poses."""


class LikelyCause(Cause):
    """A cause that may be it."""

    probability: Maybe


class CauseParameter(Entry):
    """A parameter of a cause; std is None where the data do not determine it."""

    name: str
    value: Number
    std: Maybe
    unit: str


class NamedCause(LikelyCause):
    """A cause that was found, and those it may be; standing : how sure it is."""

    p_value: Number
    alike: tuple[LikelyCause, ...] = Field(validation_alias="class", serialization_alias="class")
    share_of_gap: Maybe
    standing: Literal["established", "likely", "one_of"]


class FoundCause(NamedCause):
    """A cause of errors of poses.

    aliases : cycles that a ripple may have as well; far_out : what of it is larger than such errors
        usually are; decided_by : what would tell it from the others, beyond further poses
    chosen_again : share of ten halves of the configurations in which it, or one of its class, returns
    shape_p_value, shape_share : of the test of its form, and the part of itself that errs, in squares
    curve_ratio : evidence of the best curve at its place over its own
    """

    shape_p_value: Maybe = None
    shape_share: Maybe = None
    parameters: tuple[CauseParameter, ...]
    aliases: tuple[Number, ...] = ()
    far_out: str | None = None
    decided_by: str | None = None
    chosen_again: Maybe = None
    curve_ratio: Maybe = None

    @classmethod
    def of(cls, cause: FittedCause, spectra: Sequence[Spectrum], tip: str) -> Self:
        """The entry of a cause; tip : name of the frame that is the tool's."""
        effect, evidence = cause.named.candidate.effect, cause.evidence
        others = cause.members if len(cause.members) > 1 else ()
        cycles = [
            value / p.scale
            for p, value in zip(effect.parameters, cause.values, strict=True)
            if (effect.kind, p.name) == ("gear_ripple", "cycles")
        ]
        return cls(
            effect=cause.name,
            where=place(cause.where, tip),
            probability=cause.probability,
            p_value=cause.p,
            shape_p_value=cause.doubt.p,
            shape_share=evidence.form_share,
            alike=tuple(
                LikelyCause(effect=c.effect.kind, where=place(c.where, tip), probability=p)
                for c, p in cause.members
            ),
            parameters=tuple(
                CauseParameter(name=p.name, value=value / p.scale, std=std / p.scale, unit=p.unit)
                for p, value, std in zip(effect.parameters, cause.values, cause.std, strict=True)
            ),
            share_of_gap=cause.share,
            aliases=aliases_of(effect.where, cycles[0], spectra) if cycles else (),
            far_out=cause.far_out or None,
            standing=cause.standing,
            decided_by=next(
                filter(None, (_DECIDED_BY.get(o.effect.kind) for o, _ in others)), None
            ),
            chosen_again=evidence.again,
            curve_ratio=evidence.curve_ratio,
        )

    @property
    def one_of(self) -> bool:
        """Whether these data do not tell it from others."""
        return self.standing == "one_of"

    @property
    def minor(self) -> bool:
        """Whether it explains next to nothing of the error: other poses may show another name."""
        return self.share_of_gap is not None and self.share_of_gap < _MINOR

    @property
    def names(self) -> str:
        """The cause, or what may stand in its place."""
        return " or ".join(one.key for one in self.alike or (self,))

    @property
    def brief(self) -> str:
        """The same in few words."""
        others = len(self.alike) - 1
        return f"{self.key} (or {others} others)" if others > 1 else self.names


def place(where: str, tip: str) -> str:
    """A place as results name it: what ends at the tip belongs to the tool."""
    return "tool" if where == tip else where


def aliases_of(joint: str, cycles: float, spectra: Sequence[Spectrum]) -> tuple[float, ...]:
    """The cycles a turn that these poses cannot tell from those of a ripple of a joint."""
    for spectrum in spectra:
        for named, aliases in spectrum.named if spectrum.joint == joint else ():
            if abs(named - cycles) < 0.01 * spectrum.width:
                return _rounded(aliases)
    return ()


def _rounded(values: Iterable[float]) -> tuple[float, ...]:
    return tuple(round(float(value), 2) for value in values)


class LocatedPlace(Entry):
    """Where a part of the gap sits, and on what it depends."""

    where: str
    depends_on: str
    share_of_gap: Maybe


class GapErrors(Entry):
    """RMS errors before and after.

    crossvalidated : each tenth of the configurations by the others
    over_time : each quarter of the session by the others, likewise
    unit : of all of them, mm but where no reading is a length
    heldout_rose : whether held-out poses are predicted no better with what was found, None where
        nothing was found or held out
    """

    unit: Unit
    floor_mm: Positive
    fit_before_mm: NotNegative
    fit_after_mm: NotNegative
    heldout_before_mm: NotNegative | None
    heldout_after_mm: NotNegative | None
    heldout_rose: bool | None
    crossvalidated_before_mm: NotNegative | None
    crossvalidated_after_mm: NotNegative | None
    over_time_before_mm: NotNegative | None
    over_time_after_mm: NotNegative | None
    closed: Maybe
    closed_ci95: tuple[Number, Number] | None

    @classmethod
    def of(cls, gap: Gap, shown: Component) -> Self:
        """The entry of a gap; shown : the unit of its errors."""
        scale, names = shown.scale, ("fit", "heldout", "crossvalidated", "over_time")
        pairs = (
            (gap.fit_before, gap.fit_after),
            (gap.heldout_before, gap.heldout_after),
            gap.crossed or (None, None),
            gap.over_time or (None, None),
        )
        errors = {
            f"{name}_{when}_mm": None if value is None else value / scale
            for name, pair in zip(names, pairs, strict=True)
            for when, value in zip(("before", "after"), pair, strict=True)
        }
        return cls.from_object(gap, **errors, unit=shown.unit, floor_mm=gap.floor / scale)

    @property
    def rows(self) -> list[tuple[str, float, float | None]]:
        """Of which poses, before, after: as far as they are known."""
        known = (
            ("fitted poses", self.fit_before_mm, self.fit_after_mm),
            ("held out", self.heldout_before_mm, self.heldout_after_mm),
            ("cross-validated", self.crossvalidated_before_mm, self.crossvalidated_after_mm),
            ("cross-validated in time", self.over_time_before_mm, self.over_time_after_mm),
        )
        return [(name, before, after) for name, before, after in known if before is not None]

    def error(self, of: str, fitted: str, unit: str) -> BeforeAfter:
        """Before and after, held out where anything was, else ``fitted``; of : which error."""
        if self.heldout_before_mm is not None and self.heldout_after_mm is not None:
            return BeforeAfter(self.heldout_before_mm, self.heldout_after_mm, of, unit, True)
        before, after = (
            getattr(self, f"{fitted}_{when}_mm") or 0.0 for when in ("before", "after")
        )
        return BeforeAfter(before, after, of, unit)


class Rest(Entry):
    """What remains beside the causes: a standard deviation of one coordinate, beyond the instrument's.

    repeatability_mm : of the arm, with which it is compared; stated, measured by second approaches, or
        assumed from data sheets of arms of its size
    """

    mm: NotNegative
    kind: Literal["none", "scatter", "structure", "too_large"]
    of: Owner
    repeatability_mm: NotNegative
    repeatability_source: Literal["stated", "measured", "assumed"]


class RefusedCause(Cause):
    """A cause that was selected and that is not named all the same."""

    reason: str


class SpectrumLine(Entry):
    """A line of a spectrum with the gear ratios that it would mean, and what else it might be."""

    cycles: Number
    std: Maybe
    amplitude_urad: Maybe
    amplitude_std_urad: Maybe
    fall: NotNegative
    ratios: tuple[Number, Number]
    aliases: tuple[Number, ...]


class SpectrumLines(Entry):
    """Lines of the residual along a joint's axis; repeats is None where its steps are not equal."""

    joint: str
    false_alarm: Positive
    repeats_1_turn: Positive | None
    lines: tuple[SpectrumLine, ...]

    @classmethod
    def of(cls, spectrum: Spectrum) -> Self:
        """What a spectrum shows of gears."""
        lines = (
            SpectrumLine.from_object(line, aliases=_rounded(line.aliases))
            for line in spectrum.lines
        )
        return cls.from_object(spectrum, repeats_1_turn=spectrum.repeats, lines=tuple(lines))


class DiagnoseResidual(Residual):
    """Measured minus predicted reading, with what was found and before."""

    other = "before"
    before_mm: Lengths | None = None
    before_px: Pixels | None = None

    @classmethod
    def of_both(cls, result: Diagnosis, data: Measurements, heldout: bool) -> Iterator[Self]:
        """Every reading of a table; no turns."""
        before, after = (fit.model.off(fit.values, data) for fit in (result.before, result.after))
        return cls.each(result.before.model, data, before, after, heldout)


class DiagnoseResult(Result):
    """Where the gap lies, what causes it, and how far it shrinks."""

    command: Literal["diagnose"] = "diagnose"
    verdict: Literal["no_gap", "explained", "partly", "ambiguous", "unknown"]
    noise: Noise
    effects: tuple[FoundCause, ...]
    possible: tuple[FoundCause, ...] = ()
    rest: Rest
    located: tuple[LocatedPlace, ...]
    gap: GapErrors
    could_not_see: tuple[DetectionLimit, ...]
    refused: tuple[RefusedCause, ...]
    not_asked: tuple[NotAsked, ...]
    approach_derived: bool
    not_fitted: tuple[str, ...]
    outliers: tuple[Outlier, ...]
    spectra: tuple[SpectrumLines, ...]
    holdout: str | None
    expected: ExpectedErrors
    estimate: Estimated
    steps: ErrorSteps | None
    curves: tuple[ErrorCurve, ...]
    residuals: tuple[DiagnoseResidual, ...]
    conditions: tuple[Conditions, ...]

    @classmethod
    def of(
        cls,
        result: Diagnosis,
        cell: Cell,
        made_from: Envelope,
        *,
        figures: bool = True,
        warnings: Iterable[str] = (),
        holdout: str | None = None,
    ) -> Self:
        """The result of a diagnosis of a cell.

        figures : whether it holds what they show: further fits; warnings : of the data
        """
        after, poses, rest = result.after, result.data.poses, result.rest
        model, tip, lines = after.model, after.model.robot.tip, spectra(result)
        footprint = model.footprint(after.values, result.data)
        estimate = estimate_of(result, cell.design.targets_after or 0.0)
        steps: ErrorSteps | None = None
        curves: tuple[ErrorCurve, ...] = ()
        residuals: list[DiagnoseResidual] = []
        if figures:
            steps, curves = ErrorSteps.of_diagnosis(result), tuple(ErrorCurve.each(result))
            residuals = [*DiagnoseResidual.of_both(result, result.data, False)]
            if result.heldout is not None:
                residuals += DiagnoseResidual.of_both(result, result.heldout, True)
        return cls(
            **made_from,
            warnings=(*warnings, *result.warnings),
            holdout=holdout,
            verdict=result.verdict,
            noise=Noise.of(result.noise, after.levels, result.stage.scatter, model, footprint),
            effects=tuple(FoundCause.of(cause, lines, tip) for cause in result.causes),
            possible=tuple(FoundCause.of(cause, lines, tip) for cause in result.possible),
            rest=Rest.from_object(rest, mm=rest.size * 1e3, repeatability_source=rest.source),
            located=tuple(
                LocatedPlace.from_object(
                    entry, where=place(entry.where, tip), share_of_gap=entry.share
                )
                for entry in result.located
            ),
            gap=GapErrors.of(result.gap, model.readout.channels.shown),
            could_not_see=tuple(
                DetectionLimit.from_object(
                    entry,
                    where=place(entry.where, tip),
                    minimum_detectable=entry.smallest / entry.scale,
                )
                for entry in result.hidden
            ),
            refused=tuple(
                RefusedCause.from_object(entry, where=place(entry.where, tip))
                for entry in result.refused
            ),
            not_asked=tuple(map(NotAsked.from_object, result.not_asked)),
            approach_derived=bool(poses.approach is not None and poses.approach_derived),
            not_fitted=tuple(np.array(poses.names)[result.waiting].tolist()),
            outliers=tuple(
                Outlier(
                    pose=poses.names[i],
                    reason=f"mean square {result.statistic[i]:.1f} of its own spread, "
                    f"limit {result.limit:.1f}",
                )
                for i in np.flatnonzero(result.outlier).tolist()
            ),
            spectra=tuple(map(SpectrumLines.of, lines)),
            expected=ExpectedErrors.at_targets(cell, estimate),
            estimate=Estimated.of(estimate),
            steps=steps,
            curves=curves,
            residuals=tuple(residuals),
            conditions=tuple(Conditions.each(model.robot, result.data, False)),
        )

    @property
    def error(self) -> BeforeAfter:
        """RMS before and after, at poses held out where there are any."""
        of = "RMS error at {where}, with the model as given and with the causes found"
        return self.gap.error(of, "fit", self.gap.unit)

    @property
    def main_table(self) -> tuple[FoundCause, ...]:
        return self.effects

    @property
    def worst_hidden(self) -> DetectionLimit | None:
        """What would leave most of all that these data could not show, None where nothing would."""
        known = [entry for entry in self.could_not_see if entry.left_mm is not None]
        return max(known, key=lambda entry: entry.left_mm or 0.0, default=None)

    @staticmethod
    def kinds(causes: Sequence[FoundCause]) -> list[str]:
        """The effects of causes, ``effect (3 places)``, the most frequent first."""
        counts = Counter(cause.effect for cause in causes).most_common()
        return [f"{kind} ({n} places)" if n > 1 else kind for kind, n in counts]

    @property
    def main(self) -> list[FoundCause]:
        """The causes that are named first; all where those that explain something are not sure."""
        large = [cause for cause in self.effects if not cause.minor]
        return large if any(c.standing != "likely" for c in large) else list(self.effects)

    @property
    def form_alone(self) -> bool:
        """Whether nothing of size remains, though a cause may act by another formula."""
        return bool(self.effects) and self.rest.kind == "structure" and not self.rest.mm

    @property
    def rivals(self) -> list[str]:
        """Two causes that the data cannot tell apart and a choice of poses may, ``effect:where``."""
        for effect in self.main:
            joints = [entry.key for entry in effect.alike if not catalogue()[entry.effect].uses]
            if effect.one_of and len(joints) > 1:
                return joints[:2]
        return []

    @property
    def located_causes(self) -> list[tuple[LocatedPlace, str]]:
        """Places, each with the cause that is named for it."""
        left, named = [*self.effects, *self.possible], []
        for located in self.located:
            key = located.where, located.share_of_gap
            cause = next((e for e in left if (e.where, e.share_of_gap) == key), None)
            if cause is not None:
                left.remove(cause)
            named.append((located, "unknown" if cause is None else cause.effect))
        return named
