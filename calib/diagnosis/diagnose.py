"""Where the gap between model and measurement lies, and what causes it."""

from __future__ import annotations

from dataclasses import dataclass, replace

from calib.arrays import Mask
from calib.cell import Cell
from calib.cell.targets import targets_of
from calib.diagnosis.candidates import Candidate, NotAsked, candidates
from calib.diagnosis.causes import (
    Cause,
    GapPlace,
    VerdictName,
    causes_of,
    located,
    parted,
    unnamed_of,
    verdict_of,
)
from calib.diagnosis.detection_limit import DetectionLimit, detection_limits
from calib.diagnosis.finding import Finding, finding_of
from calib.diagnosis.gap import Gap, gap_of
from calib.diagnosis.gate import BY_TIME, crossed
from calib.diagnosis.part import part_of
from calib.diagnosis.refused import Refused
from calib.diagnosis.rest import Rest, rest_of
from calib.diagnosis.search import search
from calib.diagnosis.serial import smooth_run
from calib.diagnosis.stability import stability
from calib.diagnosis.stage import Stage
from calib.identification.checks import check_counts
from calib.identification.fit import Fit
from calib.identification.fit import search as fit_without_outliers
from calib.identification.identify import identify
from calib.identification.mistakes import refuse_mistakes
from calib.identification.residuals import with_stations_of
from calib.identification.start import initial_values, whitening
from calib.model.build import build
from calib.observations import Points
from calib.poses import Measurements
from calib.poses.moves import before_the_first_move, in_one_session
from calib.result import Result, fields_of
from calib.threads import one_blas_thread

_MOST = 5  # places that a summary names


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class Diagnosis(Result, Finding):
    """Result of :func:`diagnose`: what was found, and what follows from it.

    causes, possible : tuple of Cause, those that were found, and the others: all are fitted
    rest : Rest, what remains beside the causes
    outlier : ndarray of bool, shape (m,), poses that were left out
    waiting : ndarray of bool, shape (m,), poses from before the first move, left out where approaches
        follow from the order: the arm came there from a side that nothing tells
    not_asked : causes that the table's columns cannot speak of
    warnings : tuple of str, what of a large table was diagnosed
    """

    cell: Cell
    verdict: VerdictName
    causes: tuple[Cause, ...]
    possible: tuple[Cause, ...]
    rest: Rest
    located: tuple[GapPlace, ...]
    gap: Gap
    hidden: tuple[DetectionLimit, ...]
    not_asked: tuple[NotAsked, ...]
    outlier: Mask
    waiting: Mask
    heldout: Measurements | None
    warnings: tuple[str, ...] = ()

    @property
    def data(self) -> Measurements:
        """The measurements that were diagnosed, those that were left out included."""
        return self.stage.data

    @property
    def fitted_causes(self) -> tuple[Cause, ...]:
        """All causes by name that the model was fitted with."""
        return self.causes + self.possible

    @property
    def suspects(self) -> tuple[Candidate, ...]:
        """Every candidate cause of the diagnosis."""
        return tuple(c for c in self.outcome.suspects if not c.echo)

    def sentences(self) -> list[str]:
        gap, (_, unit, scale) = self.gap, self.before.model.readout.channels.shown
        both = {
            "fitted poses": (gap.fit_before, gap.fit_after),
            "held out": (gap.heldout_before, gap.heldout_after),
            "cross-validated": gap.crossed or (None, None),
        }
        errors = [
            f"{where} {before / scale:.3g} -> {after / scale:.3g} {unit}"
            for where, (before, after) in both.items()
            if before is not None and after is not None
        ]
        places = () if self.causes else self.located[:_MOST]
        return [
            f"Diagnosis: {self.verdict}; what remains: {self.rest.kind}",
            f"RMS error: {', '.join(errors)}; noise {gap.floor / scale:.3g} {unit}",
            *self.warnings,
            *(f"no cause named: {place!r}" for place in places),
        ]

    def rows(self) -> list[dict[str, object]]:
        return [
            {
                "cause": cause.name,
                "where": cause.where,
                "probability": cause.probability,
                "standing": cause.standing,
                "share_of_gap": cause.share,
            }
            for cause in self.causes
        ]


@one_blas_thread
def diagnose(cell: Cell, data: Measurements, *, heldout: Measurements | None = None) -> Diagnosis:
    """Find the unmodelled effects that the measurements show.

    heldout : measurements that take no part: what is found does not depend on them, and is told by
        how far it shrinks their error; of a large table what is not in the part that is diagnosed

    Raises UnknownEffect, EffectCannotAct, TooFewPoses, ImplausibleData, CalibError.
    """
    if heldout is not None:
        data, heldout = in_one_session(data, with_stations_of(data, heldout))
    data, others, warnings = part_of(data)
    if heldout is None and len(others):
        heldout = others
    waiting = before_the_first_move(data.poses)
    stage = _stage(cell, data, waiting)
    suspects, missing = candidates(cell, stage.model, data)
    finding = finding_of(search(stage, suspects, waiting))
    stage, outcome = finding.stage, finding.outcome
    targets, weights = targets_of(cell)
    again = stability(outcome.judged, finding.named) if finding.named else {}
    causes = tuple(causes_of(finding, len(suspects), again))
    outlier = stage.dropped & ~waiting
    run = smooth_run(stage, finding.after)
    smooth = run is not None or any(c.misshapen for c in causes)
    rest = rest_of(finding, smooth, int(outlier.sum()), heldout)
    found, possible = parted([c for c in causes if not c.displaced])
    unnamed = tuple(unnamed_of(finding))
    more = len(causes) > len(found) or any(u.weighty for u in unnamed)
    concluded = verdict_of([c.standing for c in found], more, rest)
    places = located(finding, causes, unnamed, not rest.closed, run)
    by_time = any(place.depends_on in BY_TIME for place in places)
    before, after = finding.before, finding.after
    effects = [c.effect for c in outcome.active]
    gap = gap_of(before, after, finding.counted, heldout, finding.floor, by_time)
    gap = replace(
        gap,
        crossed=crossed(stage, outcome.fit, effects),
        over_time=crossed(stage, outcome.fit, effects, by_time=True) if by_time else None,
    )
    entered = {c.named.candidate.key for c in causes}
    refused = (*finding.refused, *(Refused.of(u.candidate, u.why) for u in unnamed))
    return Diagnosis(
        **fields_of(replace(finding, refused=refused)),
        cell=cell,
        verdict=concluded,
        causes=found,
        possible=possible,
        rest=rest,
        located=places if concluded != "no_gap" else (),
        gap=gap,
        hidden=detection_limits(stage, outcome, entered, (targets, weights)),
        not_asked=tuple(missing),
        outlier=outlier,
        waiting=waiting,
        heldout=heldout,
        warnings=warnings,
    )


def _stage(cell: Cell, data: Measurements, waiting: Mask) -> Stage:
    """What the readings are fitted by, refused where they cannot be; without those that stand out."""
    model = build(cell, data.poses).model
    check_counts(model, data, 0.5 if cell.size_prior == "estimated" else 1.0)
    start = initial_values(model, data)
    weights = whitening(cell, model, start, data)
    refuse_mistakes(model, data, start)
    if model.prior_rows or cell.size_prior == "estimated":
        # What these readings let be believed of the sizes of errors.
        found: Fit = identify(cell, data)
        model = replace(model, prior=found.model.prior)
    else:
        found = fit_without_outliers("joint", Points(model, data, weights), start)
    return Stage(data, model, found.values, weights, waiting | ~found.kept, cell.repeatability)
