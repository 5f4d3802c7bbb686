"""What an identification says: errors before and after, the parameters, what to believe of them."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from calib.arrays import Array
from studies import document as doc
from studies.document import MRAD, Shown, listed, mm, plural
from studies.identify.budget import accepted, budget_section
from studies.identify.errors import Model, OfInstrument, rms_of, told_outliers
from studies.identify.parameters import (
    IdentifiedParameter,
    RedundantParameter,
    told_lenses,
)
from studies.identify.record import IdentifyRecord
from studies.noise import lacks, noise_words, unusual
from studies.plots.errors import by_pose
from studies.plots.style import Picture

_DRIFTS = 0.01  # p value below which repeated readings drift
_WRONG_TABLE_MM = 20.0  # no arm is so wrong, and none so well placed by guesses
_WRONG_TABLE = (
    "The readings do not fit this robot. Check units, signs and order of the joints, and the order of "
    "the rows."
)


def told(record: IdentifyRecord) -> doc.Document:
    """Errors before and after, the parameters, and the accuracy elsewhere."""
    lenses = tuple(told_lenses(record.lenses))
    return doc.Document(
        (_fell(record), *accepted(record.acceptance), _next(record)),
        (
            doc.Section("errors", "Errors before and after", tuple(_errors(record))),
            doc.Section("parameters", "What was identified", tuple(_parameters(record))),
            *([doc.Section("lenses", "Lenses", lenses)] if record.lenses else []),
            budget_section(record.budget, record.targets, record.noise.missing),
        ),
    )


def _fell(record: IdentifyRecord) -> doc.Sentence:
    error = record.error
    before, after, where = error.before, error.after, f"at {error.where}"
    old, new = (
        mm(own) if error.unit == "mm" else f"{MRAD(own)} {error.unit}" for own in (before, after)
    )
    if after >= before:
        return doc.Sentence(f"The error {where} did not fall: {old} before, {new} after.", "warn")
    converged = record.status == "converged"
    praised = record.status != "not_converged" and before >= 2.0 * after > 0.0
    ratio = before / after if praised else 1.0
    times = f", {ratio:.{int(ratio < 10.0)}f} times better" * praised
    said = f"The error {where} fell from {old} to {new}{times}."
    return doc.Sentence(said, "good" if converged else "warn")


def _next(record: IdentifyRecord) -> doc.Sentence:
    """What speaks against the result first, else the accuracy to expect."""
    before, after = record.error.before, record.error.after
    if record.error.unit == "mm" and min(before, after) > _WRONG_TABLE_MM:
        return doc.Sentence(_WRONG_TABLE, "warn")
    noise, lacking = record.noise, record.budget.of("model")
    if record.status != "converged":
        status = record.status.replace("_", " ").capitalize()
        return doc.Sentence(f"{status}: {record.advice}.", "warn")
    if lacking:
        said = lacks(lacking)
        return doc.Sentence(f"{said[0].upper()}{said[1:]}.", "warn")
    if after >= before and not record.noise.lacks and record.lenses:
        return doc.Sentence(
            "The nominal arm is as good: the lens that was found is the result.", "good"
        )
    if after >= before and not record.noise.lacks:
        return doc.Sentence("The nominal model is as good: there is nothing to correct.")
    if after >= before:
        said = "Do not use this model. Measure more poses, or identify fewer parameters."
        return doc.Sentence(said, "warn")
    if noise.louder and not noise.scatters:
        return doc.Sentence(
            f"{mm(noise.sigma_mm)} remains in each coordinate; the cell states "
            f"{mm(noise.believed_sigma_mm)}. Run `posecal diagnose`.",
            "warn",
        )
    if (scatters := unusual(noise)) is not None:
        return doc.Sentence(scatters, "warn")
    rms, worst = mm(record.task_rms_mm), mm(record.task_worst_mm)
    only = ", if the model lacks nothing" if noise.missing else ""
    return doc.Sentence(
        f"The parameters' uncertainty leaves {rms} RMS at the targets, {worst} at worst{only}."
    )


# -- errors ------------------------------------------------------------------------------------


_MODELS: dict[Model, str] = {
    "nominal": "fitted poses, nominal model",
    "fitted_all": "fitted poses, identified",
    "fitted": "fitted poses without outliers, identified",
    "heldout": "held-out poses, identified",
    "heldout_trimmed": "held-out poses without outliers, identified",
}
_FIGURES = ("RMS [mm]", "p95 [mm]", "max [mm]")
_ERRORS = doc.heads("distance measured - predicted", *_FIGURES)
_PAIRS = doc.heads("distance between two poses", *_FIGURES, Shown("pairs", doc.COUNT))
_OF_INSTRUMENTS = doc.columns(OfInstrument, "instrument unit nominal fitted_all heldout")


def _errors(record: IdentifyRecord) -> Iterator[doc.Part]:
    """How far the readings were off and are now, by model, by instrument and pose by pose."""
    floor = mm(3.0**0.5 * record.noise.instrument_mm)
    caption = f"Distances in space; the instrument alone would leave {floor} RMS"
    if rows := list(_models(record)):
        yield doc.Table(_ERRORS, rows, "Errors by model", caption)
    if len(record.instruments) > 1 or not rows:
        caption = "Root mean squares; of whole poses, the length of the translation and of the turn"
        yield doc.Table(_OF_INSTRUMENTS, record.instruments, "Errors by instrument", caption)
    every = {**_MODELS, "fitted": _MODELS["fitted_all"]}
    pairs = [
        (every[key], own.rms, own.p95, own.max, own.pairs)
        for key, own in record.pair_distances_mm.items()
    ]
    caption = (
        "Distances between points of two poses, measured minus predicted: a check that depends on no "
        "frame, since distances are the same wherever the instrument stands"
    )
    yield doc.Detail(
        (doc.Table(_PAIRS, pairs, "Distances between two poses", caption),) if pairs else ()
    )
    yield from told_outliers(record.outliers, record.heldout_outliers)
    if record.drift_p is not None and record.drift_p < _DRIFTS:
        said = f"poses read again moved steadily through the day (p {doc.P(record.drift_p)})"
        to_do = "Put base_drift into [model] effects, or measure again when all is warm"
        yield doc.Sentence(f"{said}. {to_do}", "warn", "drift")
    if not rows:
        return
    yield doc.Figure(lambda: errors_by_pose(record))
    yield doc.Detail((doc.Table(_POSES, _by_pose(record), "Errors pose by pose", fold=True),))


def _models(record: IdentifyRecord) -> Iterator[tuple[Any, ...]]:
    """RMS, 95th percentile and largest distance of each model, mm."""
    trimmed = {"fitted": record.outliers, "heldout_trimmed": record.heldout_outliers}
    for key, label in _MODELS.items():
        held = [r for r in record.residuals if r.heldout and r.metric] if key == "heldout" else []
        if held:
            lengths = np.array([np.linalg.norm(row.before) for row in held])
            p95, most = np.quantile(lengths, (0.95, 1.0)).tolist()
            yield "held-out poses, nominal model", rms_of(lengths), p95, most
        row = [getattr(figures, key) for figures in (record.rms_mm, record.p95_mm, record.max_mm)]
        if row[0] is not None and trimmed.get(key, True):
            yield label, *row


_POSES = doc.heads(
    "pose", "RMS before [mm]", "RMS after [mm]", Shown("markers seen", doc.COUNT), "use"
)


def _by_pose(record: IdentifyRecord) -> list[tuple[Any, ...]]:
    found = point_errors(record)
    before, after = (1e3 * found.by_pose(errors) for errors in (found.before, found.after))
    use = ["held out" if held else "fitted" for held in found.heldout]
    seen = found.seen.sum(axis=1).tolist()
    return list(zip(found.poses, before, after, seen, use, strict=True))


# -- parameters --------------------------------------------------------------------------------


_APPROACHES = {"points": "marker points", "pose": "full poses from the marker points"}
_METHODS = {"joint": "all parameters at once", "two-step": "base and tool in turn with the rest"}
_TOGETHER = 0.9  # correlation worth a line
_INTERVAL = doc.Rule(doc.TO_STD.show, absent="")
_PARAMETERS = doc.columns(
    IdentifiedParameter,
    "effect where name",
    doc.Column("value", lambda row: (row.value, row.std), doc.TO_STD),
    doc.Column("standard\ndeviation", lambda row: row.std and (row.std, row.std), doc.TO_STD),
    doc.Column(
        "95 % interval", lambda row: row.ci95 and (*row.ci95, row.std), _INTERVAL, detail=True
    ),
    "unit",
)
_CORRELATED = doc.heads("parameter", "parameter", Shown("correlation", doc.CORRELATION))
_ABSORBED = doc.columns(
    RedundantParameter, "id", doc.Column("does the same as", lambda row: ", ".join(row.absorbed_by))
)


def _parameters(record: IdentifyRecord) -> Iterator[doc.Part]:
    """The values, how sure they are, and what a reader should know of them."""
    yield doc.Sentence(
        f"{record.rank} of {plural(len(record.parameters), 'parameter')} from "
        f"{plural(record.poses, 'reading')}, {plural(record.points, 'point')}",
        label="identified",
    )
    yield doc.Sentence(f"{_APPROACHES[record.approach]}, {_METHODS[record.method]}", label="method")
    for k, words in enumerate(noise_words(record.noise)):
        yield doc.Sentence(words, label="" if k else "noise")
    caption = (
        "Parameters of the robot. Base and tool are estimated with them, and their uncertainty is "
        "counted; 95 of 100 such intervals hold the true value, if the model is right. The factor is "
        "Student's t at the effective degrees of freedom"
    )
    robot, placed = ([p for p in record.parameters if p.placed is own] for own in (False, True))
    yield doc.Table(_PARAMETERS, robot, "Parameters of the robot", caption, fold=False)
    where = doc.Table(_PARAMETERS, placed, "Where base and markers are", fold=True, paper=True)
    yield doc.Detail((where,) if placed else ())
    yield from _doubts(record)
    caption = (
        f"Pairs whose correlation is above {_TOGETHER}: their sum or difference is known better than "
        "each"
    )
    pairs = sorted(_correlated(record), key=lambda pair: -abs(pair[2]))
    table = doc.Table(_CORRELATED, pairs, "Correlated pairs", caption)
    yield doc.Detail((table,) if pairs else ())
    absorbed = doc.Table(_ABSORBED, record.absorbed, "Redundant parameters",
                     fold=True)  # fmt: skip
    yield doc.Detail((absorbed,) if record.absorbed else ())


def _doubts(record: IdentifyRecord) -> Iterator[doc.Sentence]:
    """What a reader of the values should know."""
    if record.noise.missing:
        said = "they hold only if the model lacks nothing. Run `posecal diagnose`"
        yield doc.Sentence(said, "warn", "intervals")
    for entry in record.unidentifiable:
        yield doc.Sentence(f"{listed(entry.names)}: {entry.reason}", "warn", "open")
    if record.sizes is not None:
        widths = [f"{w.effect} {doc.TWO(w.width)} {w.unit}" for w in record.sizes.widths]
        yield doc.Sentence(
            f"the readings barely determine about {doc.TENTH(record.sizes.parameters)} combinations "
            f"of parameters. There the result leans on usual sizes of errors: {listed(widths)}. "
            '[model] size_prior = "off" switches it off',
            "note",
            "sizes",
        )
    if record.weak:
        said = f"{listed(record.weak)}: the uncertainty is larger than such errors usually are"
        yield doc.Sentence(said, "warn", "weak")
    if any(p.effect == "backlash" for p in record.parameters):
        yield doc.Sentence(
            "half_width below zero is lost motion: the joint stops short. Above zero it overshoots",
            "note",
            "sign",
        )
    few = [name for name in record.unused_poses if name not in record.before_the_first_move]
    if few:
        yield doc.Sentence(f"{listed(few)}: too few markers for an orientation", "note", "unused")
    if record.absorbed:
        count = plural(len(record.absorbed), "redundant parameter")
        merged = "was" if len(record.absorbed) == 1 else "were"
        yield doc.Sentence(f"{count} {merged} merged into these (JSON: absorbed)", label="merged")


def _correlated(record: IdentifyRecord) -> Iterator[tuple[str, str, float]]:
    """Pairs of the robot's parameters that the data hardly tell apart."""
    own = [i for i, p in enumerate(record.parameters) if not p.placed and p.std]
    for n, a in enumerate(own):
        for b in own[n + 1 :]:
            r = record.correlation[a][b]
            if r is not None and abs(r) > _TOGETHER:
                yield record.parameters[a].id, record.parameters[b].id, r


K = TypeVar("K")
HELD_OUT = " (held out)"
"""After the name of a held-out pose that is called as a fitted one."""

_MM = 1e3


@dataclass(frozen=True, eq=False)
class PointErrors:
    """Measured minus predicted points of m poses and M markers.

    poses, markers : tuple of str, names in the order of the rows
    before, after : ndarray, shape (m, M, 3), m, by the nominal model and as found; zero where hidden
    seen : ndarray of bool, shape (m, M)
    heldout : ndarray of bool, shape (m,), poses that took no part in the fit
    """

    poses: tuple[str, ...]
    markers: tuple[str, ...]
    before: Array
    after: Array
    seen: NDArray[np.bool_]
    heldout: NDArray[np.bool_]

    def take(self, chosen: NDArray[np.bool_]) -> PointErrors:
        """The poses of a mask, shape (m,)."""
        return replace(
            self,
            poses=tuple(name for name, own in zip(self.poses, chosen, strict=True) if own),
            **{
                name: getattr(self, name)[chosen] for name in ("before", "after", "seen", "heldout")
            },
        )

    def by_pose(self, errors: Array) -> Array:
        """RMS over the markers of each pose, shape (m,), of ``before`` or ``after``."""
        squared = np.where(self.seen, (errors**2).sum(axis=-1), np.nan)
        return np.asarray(np.sqrt(np.nanmean(squared, axis=1)))


def point_errors(record: IdentifyRecord) -> PointErrors:
    """Arrays from the residuals of a record that are lengths."""
    rows = [row for row in record.residuals if row.metric]
    # Two tables of a session may call their poses alike.
    poses = _places((row.pose, row.heldout) for row in rows)
    read = {(row.pose, row.heldout, row.marker) for row in rows}
    alone = len(read) == len(rows)  # several instruments may read one marker at a pose
    what = [row.marker if alone else f"{row.instrument}: {row.marker}" for row in rows]
    markers = _places(what)
    shape = len(poses), len(markers), 3
    before, after = np.zeros(shape), np.zeros(shape)
    seen = np.zeros(shape[:2], dtype=bool)
    at = [poses[row.pose, row.heldout] for row in rows], [markers[name] for name in what]
    before[at] = np.array([_in_space(row.before) for row in rows]).reshape(-1, 3) / _MM
    after[at] = np.array([_in_space(row.vector) for row in rows]).reshape(-1, 3) / _MM
    seen[at] = True
    names = tuple(name + HELD_OUT * (held and (name, False) in poses) for name, held in poses)
    heldout = np.array([held for _, held in poses], dtype=bool)
    return PointErrors(names, tuple(markers), before, after, seen, heldout)


def _in_space(error: Sequence[float]) -> tuple[float, ...]:
    """Three numbers; one length by itself takes the place of the first."""
    return (*error, *[0.0] * (3 - len(error)))


def _places(keys: Iterable[K]) -> dict[K, int]:
    """The place of each key, in the order in which they come first."""
    return {key: i for i, key in enumerate(dict.fromkeys(keys))}


def errors_by_pose(record: IdentifyRecord) -> Picture:
    """How far each pose was off and is now."""
    found, sigma = point_errors(record), record.noise.instrument_mm / _MM
    before, after = (found.by_pose(own) for own in (found.before, found.after))
    return by_pose(found.poses, before, after, found.heldout, sigma)
