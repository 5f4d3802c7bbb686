"""Causes, their probabilities, their places, and the verdict that follows.

How likely it is that a name, or one of its class, is right is a frequency, not a p value: a logistic
model of what speaks against a name. Its weights follow names of days and sealed cases
(``studies.research.sealed``) whose errors follow other formulas than the catalogue's, or are in no
catalogue at all. ``studies/research/RESULTS.md`` has the count on fresh days.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from math import exp, log10
from typing import Literal

import numpy as np

from calib.arrays import Array
from calib.diagnosis.candidates import Candidate
from calib.diagnosis.equivalence import Named
from calib.diagnosis.finding import Finding, is_weak
from calib.diagnosis.refused import Why
from calib.diagnosis.rest import Rest
from calib.diagnosis.serial import SmoothRun
from calib.diagnosis.shape import Doubt, shape_doubt
from calib.diagnosis.stage import Fit
from calib.effects import catalogue
from calib.effects.context import ARM
from calib.effects.elastic import StiffnessVsAngle
from calib.effects.timed import Timed
from calib.model.covariance import determined

VerdictName = Literal["no_gap", "explained", "partly", "ambiguous", "unknown"]
Standing = Literal["established", "likely", "one_of"]

_EVEN = 0.5  # probability below which a cause is no more than a possibility
_SURE = 0.9  # probability from which on a cause is taken for certain
_ALONE = 0.9  # of what scatters, that one joint must hold to be named in place of the arm
_LEAST_P = 1e-4  # of the test of its form, below which it is as doubtful as it gets
_MINOR = 0.1  # of what a cause explains: an error of its form of less leaves it what it is
_LEAST_RATIO = 0.9  # of a curve's evidence over its own, from which on that speaks against a name
_NEARLY = 0.6, 0.9  # from which on, and in full, against what follows anything
_NO_SHARE, _SMALL = 0.005, 0.05  # of the gap: what reads as nothing, and what is a small part
_WEIGHTY = 0.25  # of the gap: from there on what is fitted and not named is no chance
_AT_REST = ("base", "instrument")  # whose moments and warm-ups nothing else imitates

_INTERCEPT = 3.5
_WEIGHTS = (
    0.27,  # a decade of the p value of its form, where that errs by more than a minor part
    -2.5,  # a curve at its place does as much again
    -5.3,  # returns in no half of the configurations
    -0.4,  # something else is found at its place
    -2.75,  # a compliance by angles follows what it likes, and a curve there nearly does as much
    -2.05,  # so does a moment, or a time constant, chosen at a joint or a marker
)


@dataclass(frozen=True)
class NameEvidence:
    """Evidence for and against the name that a cause was given.

    key : str, ``effect:where``
    form_p, form_share : of the test of its form, and by how much of itself that errs, in squares
    curve_ratio : evidence of the best curve at its place over its own
    again : share of ten halves of the configurations in which it, or one of its class, returns
    company : whether anything else is found at its place
    """

    key: str
    form_p: float
    form_share: float
    curve_ratio: float
    again: float
    company: bool

    @property
    def probability(self) -> float:
        """Probability that the name, or one equivalent to it, is right."""
        log_odds = _INTERCEPT + sum(w * x for w, x in zip(_WEIGHTS, self.against, strict=True))
        return 1.0 / (1.0 + exp(-log_odds))

    @property
    def against(self) -> tuple[float, ...]:
        """Terms of the logistic model of the probability, one for each of its weights."""
        kind, where = self.key.split(":", 1)
        effect = catalogue()[kind]
        low, high = _NEARLY
        close = min(max((self.curve_ratio - low) / (high - low), 0.0), 1.0)
        nearly = max(close, float(self.company))
        return (
            min(self.form_share / _MINOR, 1.0) * log10(max(self.form_p, _LEAST_P)),
            min(max(self.curve_ratio - _LEAST_RATIO, 0.0), 1.0),
            1.0 - self.again,
            float(self.company),
            nearly * issubclass(effect, StiffnessVsAngle),
            nearly * (issubclass(effect, Timed) and _on_the_arm(where)),
        )


def _on_the_arm(where: str) -> bool:
    """Whether a place is a joint or a marker."""
    return where.startswith("marker:") or not (":" in where or where in _AT_REST)


@dataclass(frozen=True, eq=False)
class Cause:
    """An effect of the catalogue that was found.

    values, std : ndarray, shape (k,), SI, std NaN where the data do not determine the value
    p : float, over all that was asked
    share : float, of the gap, NaN where there is none
    evidence : NameEvidence, what speaks for and against it
    standing : how sure it is
    far_out : str, what of it is larger than such errors usually are, empty where nothing is
    """

    named: Named
    doubt: Doubt
    values: Array
    std: Array
    p: float
    share: float
    evidence: NameEvidence
    standing: Standing
    far_out: str = ""

    @property
    def name(self) -> str:
        """The effect, as the catalogue calls it."""
        return self.named.candidate.effect.kind

    @property
    def where(self) -> str:
        """The place at which it acts."""
        return self.named.candidate.where

    @property
    def probability(self) -> float:
        """Probability that this effect at this place is the cause."""
        return self.members[0][1]

    def __repr__(self) -> str:
        return f"{self.name} at {self.where}, probability {self.probability:.2f} ({self.standing})"

    @property
    def members(self) -> tuple[tuple[Candidate, float], ...]:
        """Causes that the data cannot tell apart, with probabilities, best first."""
        return tuple((c, self.evidence.probability * share) for c, share in self.named.members)

    @property
    def likely(self) -> bool:
        """Whether it, or one of its class, is there as likely as not."""
        return self.evidence.probability >= _EVEN

    @property
    def misshapen(self) -> bool:
        """Whether the cause is there in another form than the catalogue's."""
        return self.doubt.stands

    @property
    def displaced(self) -> bool:
        """Whether nothing of the cause is needed beside what its size varies with."""
        return self.misshapen and not self.doubt.also_there


@dataclass(frozen=True)
class GapPlace:
    """Where a part of the gap sits, and on what it depends."""

    where: str
    depends_on: str
    share: float

    def __repr__(self) -> str:
        share = "" if np.isnan(self.share) else f", {self.share:.0%} of the gap"
        return f"{self.where} by {self.depends_on}{share}"


def causes_of(finding: Finding, asked: int, again: Mapping[str, float]) -> Iterator[Cause]:
    """The named causes of a finding, with values, probabilities and shares of the gap.

    asked : int, over how many its p counts; again : share of the halves in which each entry returns
    """
    if not finding.named:
        return
    stage, after = finding.stage, finding.after
    std = _deviations(after, finding.scale)
    for named in finding.named:
        if _no_cause(finding, named):
            continue
        effect, entry = named.candidate.effect, named.entry
        own = after.positions(effect)
        doubt = shape_doubt(stage, after, effect, len(finding.named))
        others = (c for c in finding.outcome.active if c is not entry.candidate)
        form = min(1.0, doubt.fall / max(entry.fall, 1e-9))
        misshapen = doubt.stands and form > _MINOR
        evidence = NameEvidence(
            key=f"{effect.kind}:{effect.where}",
            form_p=doubt.p,
            form_share=form,
            curve_ratio=named.curve_ratio,
            again=again[entry.candidate.key],
            company=misshapen or any(c.where == effect.where for c in others),
        )
        yield Cause(
            named=named,
            doubt=doubt,
            values=after.values[own],
            std=std[own],
            p=min(1.0, entry.p * asked),
            share=_share_of(finding, entry.candidate),
            evidence=evidence,
            standing=standing_of(named, evidence.probability),
            far_out=far_out(after, named.candidate),
        )


@dataclass(frozen=True, eq=False)
class Unnamed:
    """What is fitted and not named, why, and its share of the gap, NaN where there is none."""

    candidate: Candidate
    why: Why
    share: float

    @property
    def weighty(self) -> bool:
        """Whether so much of the gap is no chance."""
        return self.share > _WEIGHTY


def unnamed_of(finding: Finding) -> Iterator[Unnamed]:
    """Everything that is fitted and not named."""
    for named in finding.named:
        if why := _no_cause(finding, named):
            yield Unnamed(named.candidate, why, _share_of(finding, named.entry.candidate))


def _no_cause(finding: Finding, named: Named) -> Why | None:
    """Why what was fitted is no cause: it predicts nothing, or its sizes are wide open.

    Two amounts that hardly differ may be open together and pass for strong.
    """
    fit, candidate = finding.after, named.candidate
    if why := finding.in_vain.get(named.entry.candidate.key):
        return why
    std = finding.scale * fit.std_of(fit.model.amounts(candidate.effect))
    share = _share_of(finding, named.entry.candidate)
    open_wide = share < _NO_SHARE and (std > candidate.limits).all()
    return "weak" if is_weak(fit, candidate) or open_wide else None


def far_out(fit: Fit, candidate: Candidate) -> str:
    """What of a cause is larger than such errors usually are, empty where nothing is."""
    amounts, values = candidate.amounts, fit.values[fit.model.amounts(candidate.effect)]
    worst = int(np.argmax(np.abs(values) / candidate.limits))
    p, limit = amounts[worst], float(candidate.limits[worst])
    if abs(values[worst]) <= limit:
        return ""
    return (
        f"its {p.name} of {values[worst] / p.scale:.3g} {p.unit} is far out: beyond "
        f"{limit / p.scale:.3g} {p.unit} such an error is seldom met"
    )


def _deviations(after: Fit, scale: float) -> Array:
    """Standard deviations of all values, shape (p,), NaN where the data do not determine the value."""
    return np.where(determined(after.span), scale * np.sqrt(np.diag(after.covariance)), np.nan)


def standing_of(named: Named, probability: float) -> Standing:
    """How sure a cause is: established where it is nearly certain and alone in its class.

    probability : that it, or one of its class, is there
    """
    if named.aliased or named.lead < _SURE:
        return "one_of"
    return "established" if probability * named.lead >= _SURE else "likely"


def parted(causes: Sequence[Cause]) -> tuple[tuple[Cause, ...], tuple[Cause, ...]]:
    """The causes that were found, and those that are no more than possible.

    Beside one that is established, or one of several, what is merely likely must be worth a part of the
    gap.
    """
    likely = [c for c in causes if c.likely]
    sure = [c for c in likely if c.standing != "likely"]
    found = tuple(c for c in likely if not sure or c in sure or not c.share < _SMALL)
    return found, tuple(c for c in causes if c not in found)


def verdict_of(standings: Sequence[Standing], more: bool, rest: Rest) -> VerdictName:
    """The verdict of a diagnosis.

    standings : of the causes that were found; more : whether more is fitted than these
    """
    closed = rest.closed and not more
    match sorted(set(standings)):
        case []:
            return "no_gap" if closed else "unknown"
        case ["likely"]:
            return "unknown"
        case ["established"]:
            return "explained" if closed else "partly"
    return "ambiguous"


def located(
    finding: Finding,
    causes: Sequence[Cause],
    unnamed: Sequence[Unnamed],
    left: bool,
    run: SmoothRun | None,
) -> tuple[GapPlace, ...]:
    """Where the gap lies and on what it depends, largest share first.

    unnamed : what is fitted beside the causes
    left : whether more remains than such an arm scatters by; run : of what passes for scatter
    """
    outcome, after = finding.outcome, finding.after
    found = [
        GapPlace(c.where, c.named.candidate.depends_on, c.share) for c in causes if not c.displaced
    ]
    for c in causes:
        if c.misshapen:
            share = c.share if c.displaced else c.evidence.form_share * c.share
            place = GapPlace(c.where, c.doubt.depends_on, share)
            if (place.where, place.depends_on) not in {(p.where, p.depends_on) for p in found}:
                found.append(place)
    curves = [e.candidate for e in outcome.entries if not e.candidate.named]
    found += [GapPlace(c.where, c.depends_on, _share_of(finding, c)) for c in curves]
    found += [GapPlace(u.candidate.where, u.candidate.depends_on, u.share) for u in unnamed]
    if left and (after.variances.configuration.any() or not found):
        # Beside a cause its share is undefined: it is no effect that could be taken out again.
        noise, before = after.dof * after.variances.scale**2, outcome.before.cost
        share = np.nan
        if not found and before > noise:
            share = max(after.cost - noise, 0.0) / (before - noise)
        where, by = (run.where, run.depends_on) if run else (_scattering(finding), "pose")
        found.append(GapPlace(where, by, share))
    return tuple(sorted(found, key=lambda place: -np.nan_to_num(place.share)))


def _share_of(finding: Finding, candidate: Candidate) -> float:
    """By how much the sum of squares would rise without it, over its excess before; NaN without one."""
    return finding.shares.get(candidate.key, np.nan)


def _scattering(finding: Finding) -> str:
    """The joint that nearly all comes from which differs from pose to pose; else the arm."""
    stage, after = finding.stage, finding.after
    variances, robot = after.variances.configuration, after.model.robot
    each = [
        float(stage.scatter.point_variance(variances * (np.arange(len(variances)) == k)).mean())
        for k in range(len(variances))
    ]
    first = int(np.argmax(each))
    alone = first < robot.dof and each[first] > _ALONE * sum(each)
    return robot.joints[first] if alone else ARM
