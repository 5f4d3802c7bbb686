"""What ``posecal diagnose`` finds."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Literal, Self

import numpy as np
from pydantic import Field, model_validator

from studies.causes import Cause, NotAsked, Sought
from studies.diagnose.shown import Curve, Residual, Shown, Steps
from studies.estimate import Estimated, estimated
from studies.joints import JointValues, check_same_joints, shown_joints
from studies.noise import NoiseEntry, by_level
from studies.record import Entry, Envelope, Maybe, NotNegative, Number, Positive, Record

if TYPE_CHECKING:
    from calib.arm.robot import Robot
    from calib.diagnosis import Diagnosis
    from calib.diagnosis.causes import Cause as Found
    from calib.diagnosis.gap import Gap as Shrinkage
    from calib.diagnosis.spectra import Line as FoundLine
    from calib.diagnosis.spectra import Spectrum as FoundSpectrum
    from calib.instruments import Channels
    from doe.ahead.next_poses import NextPoses
    from doe.ahead.next_poses import Prediction as Predicted

_MM, _URAD = 1e3, 1e6
_MOST = 800  # numbers of cycles in a file: several at each pixel of a figure
_LOUD = 4.0  # times the stated noise that no instrument exceeds by itself


class Growth(Entry):
    """Standard deviation at the ends of the range, over the mean one."""

    nearest: Number
    farthest: Number


class DiagnoseNoise(NoiseEntry):
    """The noise, which may grow with range where the cell does not say so."""

    grows_with_range: Growth | None = None

    @property
    def loud(self) -> str:
        """What to suspect where it is far from what the cell states; empty where it is not."""
        factor = self.sigma_mm / self.believed_sigma_mm
        if factor < _LOUD:
            return ""
        return (
            f"but the noise is {factor:.0f} times sigma_mm of the cell. Check sigma_mm, and that every "
            "load is in the table"
        )


class Likely(Cause):
    """A cause that may be it."""

    probability: Maybe


class Value(Entry):
    """A parameter of a cause; std is None where the data do not determine it."""

    name: str
    value: Number
    std: Maybe
    unit: str


class Effect(Likely):
    """A cause that was found, what these data cannot tell from it, and the cycles that a ripple may
    have as well.

    far_out : what of it is larger than such errors usually are, None where nothing is
    standing : how sure it is, None in old files
    chosen_again : share of the folds without which it, or one of its class, is chosen again
    curve_ratio : evidence of the best curve at its place over its own
    """

    p_value: Number
    shape_p_value: Maybe
    shape_power: Maybe = None
    shape_tested: bool = True
    alike: tuple[Likely, ...] = Field(validation_alias="class", serialization_alias="class")
    parameters: tuple[Value, ...]
    share_of_gap: Maybe
    aliases: tuple[Number, ...] = ()
    far_out: str | None = None
    standing: Literal["established", "likely", "one_of"] | None = None
    chosen_again: Maybe = None
    curve_ratio: Maybe = None

    @property
    def one_of(self) -> bool:
        """Whether these data do not tell it from others."""
        return self.standing == "one_of" or (self.standing is None and len(self.alike) > 1)

    @property
    def names(self) -> str:
        """Itself or what may stand in its place."""
        return " or ".join(one.key for one in self.alike or (self,))


class Place(Entry):
    """Where a part of the gap sits, and on what it depends."""

    where: str
    depends_on: str
    share_of_gap: Maybe

    @property
    def unfollowed(self) -> bool:
        """Whether it is what differs from pose to pose and follows no column."""
        return self.depends_on == "pose"


class Gap(Entry):
    """RMS errors before and after.

    crossvalidated : each tenth of the configurations by the others, names chosen anew without it
    over_time : each quarter of the session by the others, likewise

    unit : of all of them, mm but where no reading is a length
    heldout_rose : whether held-out poses are predicted no better with what was found, None where
        nothing was found or held out
    """

    unit: Literal["mm", "mrad", "px"] = "mm"
    floor_mm: Positive
    fit_before_mm: NotNegative
    fit_after_mm: NotNegative
    heldout_before_mm: NotNegative | None
    heldout_after_mm: NotNegative | None
    heldout_rose: bool | None = None
    crossvalidated_before_mm: NotNegative | None = None
    crossvalidated_after_mm: NotNegative | None = None
    over_time_before_mm: NotNegative | None = None
    over_time_after_mm: NotNegative | None = None
    closed: Maybe
    closed_ci95: tuple[Number, Number] | None


class Rest(Entry):
    """What remains beside the causes: a standard deviation of one coordinate, beyond the instrument's.

    repeatability_mm : of the arm, against which it is held; stated, measured by second approaches, or
        assumed from data sheets of arms of its size
    """

    mm: NotNegative
    kind: Literal["none", "scatter", "structure", "too_large"]
    of: Literal["instrument", "arm", "model", "undecided"]
    repeatability_mm: NotNegative
    repeatability_source: Literal["stated", "measured", "assumed"]


class Refused(Cause):
    """A cause that the contest held and that is not named all the same."""

    reason: str


class Outlier(Entry):
    """A pose that was left out."""

    pose: str
    reason: str


class Line(Entry):
    """A line of a spectrum with the gear ratios that it would mean, and what else it might be."""

    cycles: Number
    std: Maybe
    amplitude_urad: Maybe
    amplitude_std_urad: Maybe
    fall: NotNegative
    ratios: tuple[Number, Number]
    aliases: tuple[Number, ...]


class Spectrum(Entry):
    """The residual along a joint's axis; repeats is None where its steps are not equal."""

    joint: str
    cycles_1_turn: tuple[Number, ...]
    fall: tuple[Number, ...]
    false_alarm: Positive
    width_1_turn: NotNegative
    repeats_1_turn: Positive | None
    lines: tuple[Line, ...]

    @model_validator(mode="after")
    def _one_each(self) -> Self:
        if len(self.fall) != len(self.cycles_1_turn):
            raise ValueError("fall and cycles_1_turn are of different lengths")
        return self


class NextPose(JointValues):
    """A pose to measure next, and the pairs of causes that it helps to tell apart."""

    pose: str
    splits: tuple[tuple[str, str], ...]


class Remedy(Entry):
    """What would tell two causes apart, and how likely then the true one is preferred."""

    intervention: str
    says: str
    probability: Number


class Prediction(Entry):
    """Two causes in doubt, and how likely the true one is preferred, now and after the next poses."""

    rivals: tuple[str, str]
    probability_now: Number
    probability_after: Number
    interventions: tuple[Remedy, ...]
    inseparable: bool


class Findings(Entry):
    """The diagnosis itself."""

    verdict: Literal["no_gap", "explained", "ambiguous", "unknown"]
    noise: DiagnoseNoise
    effects: tuple[Effect, ...]
    rest: Rest | None = None
    located: tuple[Place, ...]
    gap: Gap
    could_not_see: tuple[Sought, ...]
    refused: tuple[Refused, ...] = ()
    not_asked: tuple[NotAsked, ...]
    approach_derived: bool = False
    not_fitted: tuple[str, ...] = ()
    outliers: tuple[Outlier, ...]
    spectra: tuple[Spectrum, ...] = ()


class DiagnoseRecord(Findings, Record):
    """Where the gap lies, what causes it, how far it shrinks, and what to measure next."""

    command: Literal["diagnose"] = "diagnose"
    holdout: str | None
    next_poses: tuple[NextPose, ...] = ()
    next_poses_predicted: tuple[Prediction, ...] = ()
    next_poses_assume: tuple[str, ...] = ()
    estimate: Estimated
    steps: Steps | None = None
    curves: tuple[Curve, ...] = ()
    residuals: tuple[Residual, ...] = ()

    @model_validator(mode="after")
    def _belongs_together(self) -> Self:
        check_same_joints(self.next_poses)
        if self.verdict != "no_gap" and self.verdict != "unknown" and not self.effects:
            raise ValueError(f"verdict is {self.verdict} without effects")
        gap = self.gap
        if (gap.heldout_before_mm is None) != (gap.heldout_after_mm is None):
            raise ValueError("gap has one of heldout_before_mm and heldout_after_mm only")
        if (gap.over_time_before_mm is None) != (gap.over_time_after_mm is None):
            raise ValueError("gap has one of over_time_before_mm and over_time_after_mm only")
        return self

    @property
    def worst_hidden(self) -> Sought | None:
        """What would leave most of all that these data could not have shown; None in old files."""
        known = [entry for entry in self.could_not_see if entry.left_mm is not None]
        return max(known, key=lambda entry: entry.left_mm or 0.0, default=None)


def diagnose_record(
    found: Diagnosis,
    spectra: Sequence[FoundSpectrum],
    chosen: NextPoses | None,
    shown: Shown | None,
    holdout: str | None,
    made_from: Envelope,
    warnings: tuple[str, ...] = (),
) -> DiagnoseRecord:
    """The record of a diagnosis.

    chosen : the next poses, None where none were asked for; shown : for figures, None for none
    holdout : as the user gave it; warnings : of the tables
    """
    from calib.compensation.estimate import estimate_of

    return DiagnoseRecord(
        **made_from,
        **dict(findings(found, spectra)),
        warnings=warnings,
        holdout=holdout,
        next_poses=() if chosen is None else _next_poses(chosen, found.after.model.robot),
        next_poses_predicted=() if chosen is None else tuple(map(_prediction, chosen.predictions)),
        next_poses_assume=() if chosen is None else chosen.assumptions,
        estimate=estimated(estimate_of(found)),
        **({} if shown is None else shown._asdict()),
    )


def findings(found: Diagnosis, spectra: Sequence[FoundSpectrum] = ()) -> Findings:
    """The diagnosis without what it was made from; spectra : of it, where they are asked for."""
    noise, tip, poses = found.noise, found.after.model.robot.tip, found.data.poses
    mm = found.after.model.footprint(found.after.values, found.data) * _MM
    return Findings(
        verdict=found.verdict,
        noise=DiagnoseNoise(
            sigma_mm=noise.sigma * mm,
            believed_sigma_mm=noise.believed * mm,
            source=noise.source,
            grows_with_range=None
            if found.growth is None
            else Growth(nearest=found.growth.nearest, farthest=found.growth.farthest),
            **by_level(found.after.levels, found.stage.scatter, found.after.model.robot.reach),
        ),
        effects=tuple(_effect(cause, spectra, tip) for cause in found.causes),
        rest=Rest(
            mm=found.rest.size * _MM,
            kind=found.rest.kind,
            of=found.rest.of,
            repeatability_mm=found.rest.repeatability * _MM,
            repeatability_source=found.rest.source,
        ),
        located=tuple(
            Place(where=_at(p.where, tip), depends_on=p.depends_on, share_of_gap=p.share)
            for p in found.located
        ),
        gap=_gap(found.gap, found.after.model.readout.channels),
        could_not_see=tuple(
            Sought(
                effect=entry.effect,
                where=_at(entry.where, tip),
                minimum_detectable=entry.smallest / entry.scale,
                unit=entry.unit,
                left_mm=entry.left * _MM,
            )
            for entry in found.hidden
        ),
        refused=tuple(
            Refused(effect=r.effect, where=_at(r.where, tip), reason=r.reason)
            for r in found.refused
        ),
        not_asked=tuple(NotAsked(effect=n.effect, reason=n.reason) for n in found.not_asked),
        approach_derived=bool(poses.approach is not None and poses.approach_derived),
        not_fitted=tuple(n for n, waits in zip(poses.names, found.waiting, strict=True) if waits),
        outliers=tuple(_outliers(found)),
        spectra=tuple(map(spectrum_entry, spectra)),
    )


def _at(where: str, tip: str) -> str:
    """The place in the words of the results: what ends at the tip belongs to the tool."""
    return "tool" if where == tip else where


def _gap(gap: Shrinkage, channels: Channels) -> Gap:
    each = [gap.crossed or (None, None), gap.over_time or (None, None)]
    scale = 1.0 / channels.shown.scale

    def shown(error: float | None) -> float | None:
        return None if error is None else error * scale

    return Gap(
        unit=channels.shown.unit,
        floor_mm=gap.floor * scale,
        fit_before_mm=gap.fit_before * scale,
        fit_after_mm=gap.fit_after * scale,
        heldout_before_mm=shown(gap.heldout_before),
        heldout_after_mm=shown(gap.heldout_after),
        heldout_rose=gap.heldout_rose,
        crossvalidated_before_mm=shown(each[0][0]),
        crossvalidated_after_mm=shown(each[0][1]),
        over_time_before_mm=shown(each[1][0]),
        over_time_after_mm=shown(each[1][1]),
        closed=gap.closed,
        closed_ci95=gap.closed_ci95,
    )


def _effect(cause: Found, spectra: Sequence[FoundSpectrum], tip: str) -> Effect:
    candidate, doubt = cause.named.candidate, cause.doubt
    values = zip(
        candidate.effect.parameters, cause.values.tolist(), cause.std.tolist(), strict=True
    )
    return Effect(
        effect=candidate.effect.kind,
        where=_at(candidate.where, tip),
        probability=cause.members[0][1],
        standing=cause.standing,
        chosen_again=cause.evidence.again,
        curve_ratio=cause.evidence.curve_ratio,
        p_value=cause.p,
        shape_p_value=doubt.p,
        shape_power=doubt.power,
        shape_tested=doubt.tested,
        alike=tuple(
            Likely(effect=own.effect.kind, where=_at(own.where, tip), probability=probability)
            for own, probability in cause.members
        ),
        parameters=tuple(
            Value(name=p.name, value=value / p.scale, std=std / p.scale, unit=p.unit)
            for p, value, std in values
        ),
        share_of_gap=cause.share,
        aliases=_aliases(cause, spectra),
        far_out=cause.far_out or None,
    )


def _aliases(cause: Found, spectra: Sequence[FoundSpectrum]) -> tuple[float, ...]:
    effect = cause.named.candidate.effect
    if effect.kind != "gear_ripple":
        return ()
    own = [p.name for p in effect.parameters].index("cycles")
    cycles = float(cause.values[own]) / effect.parameters[own].scale
    return aliases_of(effect.where, cycles, spectra)


def aliases_of(joint: str, cycles: float, spectra: Sequence[FoundSpectrum]) -> tuple[float, ...]:
    """The cycles a turn that these poses cannot tell from those of a ripple of a joint."""
    for spectrum in spectra:
        for named, aliases in spectrum.named if spectrum.joint == joint else ():
            if abs(named - cycles) < 0.01 * spectrum.width:
                return _rounded(aliases)
    return ()


def _rounded(
    values: Sequence[float] | np.ndarray[tuple[int], np.dtype[np.float64]],
) -> tuple[float, ...]:
    return tuple(round(float(value), 2) for value in values)


def _outliers(found: Diagnosis) -> Iterator[Outlier]:
    for i in np.flatnonzero(found.outlier):
        reason = f"mean square {found.statistic[i]:.1f} of its own spread, limit {found.limit:.1f}"
        yield Outlier(pose=found.data.poses.names[i], reason=reason)


def spectrum_entry(spectrum: FoundSpectrum) -> Spectrum:
    """Thinned to the highest of every few that follow each other, so that every peak stays."""
    cycles, fall = spectrum.cycles, spectrum.fall
    step = -(-len(cycles) // _MOST)
    kept = [i + int(np.argmax(fall[i : i + step])) for i in range(0, len(cycles), max(step, 1))]
    return Spectrum(
        joint=spectrum.joint,
        cycles_1_turn=_rounded(cycles[kept]),
        fall=_rounded(fall[kept]),
        false_alarm=spectrum.false_alarm,
        width_1_turn=spectrum.width,
        repeats_1_turn=spectrum.repeats,
        lines=tuple(map(_line, spectrum.lines)),
    )


def _line(line: FoundLine) -> Line:
    return Line(
        cycles=line.cycles,
        std=line.std,
        amplitude_urad=line.amplitude * _URAD,
        amplitude_std_urad=line.amplitude_std * _URAD,
        fall=line.fall,
        ratios=line.ratios,
        aliases=_rounded(line.aliases),
    )


def _next_poses(chosen: NextPoses, robot: Robot) -> tuple[NextPose, ...]:
    found = []
    for name, q, splits in zip(chosen.poses.names, chosen.poses.q, chosen.splits, strict=True):
        at = shown_joints(robot, q)
        found.append(NextPose(pose=name, joints_deg=at.deg, joints_mm=at.mm, splits=splits))
    return tuple(found)


def _prediction(predicted: Predicted) -> Prediction:
    return Prediction(
        rivals=predicted.rivals,
        probability_now=predicted.now,
        probability_after=predicted.after,
        interventions=tuple(
            Remedy(intervention=r.name, says=r.says, probability=r.probability)
            for r in predicted.remedies
        ),
        inseparable=predicted.inseparable,
    )
