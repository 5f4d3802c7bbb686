"""What ``posecal diagnose`` finds, with what its figures show."""

from __future__ import annotations

from functools import partial
from typing import Annotated, Literal

from pydantic import Field

from studies.document import Shown
from studies.entries import (
    CauseEntry,
    DetectionLimitEntry,
    NotAskedEntry,
)
from studies.fitted import Estimated, Lengths, Pixels, ResidualEntry
from studies.noise import NoiseEntry
from studies.record import (
    OWN_UNIT,
    BeforeAfter,
    Entry,
    From,
    Maybe,
    NotNegative,
    Number,
    Outlier,
    Owner,
    Positive,
    Record,
)

_LOUD = 4.0  # times the stated noise that no instrument exceeds by itself
Row = tuple[Maybe, ...]


def _absent(value: object) -> bool:
    """Whether a key of days with a camera says nothing, and is left out of the file."""
    return not value


class DiagnoseNoise(NoiseEntry):
    """The noise, and what to suspect where it is large."""

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


class LikelyCause(CauseEntry):
    """A cause that may be it."""

    probability: Maybe


class CauseParameter(Entry):
    """A parameter of a cause; std is None where the data do not determine it."""

    name: Annotated[str, Shown("parameter")]
    value: Annotated[Number, OWN_UNIT]
    std: Annotated[Maybe, OWN_UNIT]
    unit: str


class FoundCause(LikelyCause):
    """A cause that was found, what these data cannot tell from it, and the cycles that a ripple may
    have as well.

    far_out : what of it is larger than such errors usually are, None where nothing is
    standing : how sure it is
    decided_by : what would tell it from the others, beyond further poses
    chosen_again : share of ten halves of the configurations in which it, or one of its class, returns
    curve_ratio : evidence of the best curve at its place over its own
    """

    p_value: Annotated[Number, From("p")]
    shape_p_value: Annotated[Maybe, From("doubt.p")]
    shape_power: Annotated[Maybe, From("doubt.power")] = None
    shape_tested: Annotated[bool, From("doubt.tested")] = True
    alike: tuple[LikelyCause, ...] = Field(validation_alias="class", serialization_alias="class")
    parameters: tuple[CauseParameter, ...]
    share_of_gap: Annotated[Maybe, From("share")]
    aliases: tuple[Number, ...] = ()
    far_out: str | None = None
    standing: Literal["established", "likely", "one_of"]
    decided_by: str | None = Field(default=None, exclude_if=_absent)
    chosen_again: Annotated[Maybe, From("evidence.again")] = None
    curve_ratio: Annotated[Maybe, From("evidence.curve_ratio")] = None

    @property
    def one_of(self) -> bool:
        """Whether these data do not tell it from others."""
        return self.standing == "one_of"

    @property
    def names(self) -> str:
        """Itself or what may stand in its place."""
        return " or ".join(one.key for one in self.alike or (self,))


class SideEntry(Entry):
    """Camera, board or arm, and its share of the unmodelled error; the shares add up."""

    side: Literal["camera", "board", "arm"]
    share_of_gap: Annotated[Number, From("share")]


class LocatedPlace(Entry):
    """Where a part of the gap sits, and on what it depends."""

    where: str
    depends_on: str
    share_of_gap: Annotated[Maybe, From("share")]

    @property
    def unfollowed(self) -> bool:
        """Whether it is what differs from pose to pose and follows no column."""
        return self.depends_on == "pose"


_crossed = partial(From, own_unit=True)


class GapEntry(Entry):
    """RMS errors before and after.

    crossvalidated : each tenth of the configurations by the others
    over_time : each quarter of the session by the others, likewise

    unit : of all of them, mm but where no reading is a length
    heldout_rose : whether held-out poses are predicted no better with what was found, None where
        nothing was found or held out
    """

    unit: Literal["mm", "mrad", "px"]
    floor_mm: Annotated[Positive, OWN_UNIT]
    fit_before_mm: Annotated[NotNegative, OWN_UNIT]
    fit_after_mm: Annotated[NotNegative, OWN_UNIT]
    heldout_before_mm: Annotated[NotNegative | None, OWN_UNIT]
    heldout_after_mm: Annotated[NotNegative | None, OWN_UNIT]
    heldout_rose: bool | None
    crossvalidated_before_mm: Annotated[NotNegative | None, _crossed("crossed.0")]
    crossvalidated_after_mm: Annotated[NotNegative | None, _crossed("crossed.1")]
    over_time_before_mm: Annotated[NotNegative | None, _crossed("over_time.0")]
    over_time_after_mm: Annotated[NotNegative | None, _crossed("over_time.1")]
    closed: Maybe
    closed_ci95: tuple[Number, Number] | None


class RestEntry(Entry):
    """What remains beside the causes: a standard deviation of one coordinate, beyond the instrument's.

    repeatability_mm : of the arm, against which it is held; stated, measured by second approaches, or
        assumed from data sheets of arms of its size
    """

    mm: Annotated[NotNegative, From("size")]
    kind: Literal["none", "scatter", "structure", "too_large"]
    of: Owner
    repeatability_mm: NotNegative
    repeatability_source: Annotated[Literal["stated", "measured", "assumed"], From("source")]


class RefusedCause(CauseEntry):
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


class SpectrumEntry(Entry):
    """Lines of the residual along a joint's axis; repeats is None where its steps are not equal."""

    joint: str
    false_alarm: Positive
    repeats_1_turn: Positive | None
    lines: tuple[SpectrumLine, ...]


class ErrorSteps(Entry):
    """RMS error before and after each effect, added one to the other by their share of the gap."""

    of: str
    unit: Literal["mm", "mrad", "px"]
    added: tuple[str, ...]
    rms_mm: tuple[NotNegative, ...]


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


class ErrorCurveEntry(Entry):
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
    pose_names: Annotated[tuple[str, ...], From("poses.names")]
    panels: tuple[CurvePanel, ...] = Field(min_length=1)


class DiagnoseResidual(ResidualEntry):
    """Measured minus predicted reading, with what was found and before."""

    beside = "before"
    before_mm: Lengths | None = None
    before_px: Pixels | None = None


class DiagnoseRecord(Record):
    """Where the gap lies, what causes it, and how far it shrinks."""

    command: Literal["diagnose"] = "diagnose"
    verdict: Literal["no_gap", "explained", "partly", "ambiguous", "unknown"]
    noise: DiagnoseNoise
    effects: tuple[FoundCause, ...]
    possible: tuple[FoundCause, ...] = ()
    rest: RestEntry
    sides: tuple[SideEntry, ...] = Field(default=(), exclude_if=_absent)
    located: tuple[LocatedPlace, ...]
    gap: GapEntry
    could_not_see: tuple[DetectionLimitEntry, ...]
    refused: tuple[RefusedCause, ...]
    not_asked: tuple[NotAskedEntry, ...]
    approach_derived: bool
    not_fitted: tuple[str, ...]
    outliers: tuple[Outlier, ...]
    spectra: tuple[SpectrumEntry, ...]
    holdout: str | None
    estimate: Estimated
    steps: ErrorSteps | None
    curves: tuple[ErrorCurveEntry, ...]
    residuals: tuple[DiagnoseResidual, ...]

    @property
    def error(self) -> BeforeAfter:
        """RMS before and after, at poses held out where there are any."""
        return self.error_at(heldout=self.gap.heldout_before_mm is not None)

    def error_at(self, *, heldout: bool) -> BeforeAfter:
        """RMS before and after, at the fitted poses or at those held out."""
        gap = self.gap
        before, after = gap.fit_before_mm, gap.fit_after_mm
        if heldout and gap.heldout_before_mm is not None and gap.heldout_after_mm is not None:
            before, after = gap.heldout_before_mm, gap.heldout_after_mm
        of = "RMS error at {where}, with the model as given and with the causes found"
        return BeforeAfter(before, after, of, gap.unit, heldout)

    @property
    def worst_hidden(self) -> DetectionLimitEntry | None:
        """What would leave most of all that these data could not show, None where nothing would."""
        known = [entry for entry in self.could_not_see if entry.left_mm is not None]
        return max(known, key=lambda entry: entry.left_mm or 0.0, default=None)
