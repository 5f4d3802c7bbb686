"""The identified parameters, and what the readings leave open: entries, and how they are told."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Annotated

import numpy as np

from studies import document as doc
from studies.document import Shown, listed, plural
from studies.identify.pictures import correlation
from studies.noise import noise_words
from studies.record import OWN_UNIT, Entry, From, Maybe, MaybePositive, Number, Positive

if TYPE_CHECKING:
    from calib import Identification
    from calib.population.sizes import Widths
    from studies.identify.record import IdentifyRecord

_PLACED = ("base", "tool")


class IdentifiedParameter(Entry):
    """An identified value; what belongs to its deviation is None where it was not estimated.

    degrees_of_freedom : behind ci95, None where the uncertainty counts as known
    std_by_pose : if the points of a pose err together, as under a model that lacks something
    step_two_optimism : factor by which it would be less if base and tool were known
    """

    id: str
    name: Annotated[str, Shown("parameter")]
    effect: str
    where: str
    value: Annotated[Number, OWN_UNIT]
    std: Annotated[MaybePositive, OWN_UNIT]
    ci95: Annotated[tuple[Number, Number] | None, OWN_UNIT]
    degrees_of_freedom: Maybe = None
    std_by_pose: Annotated[Maybe, OWN_UNIT]
    step_two_optimism: Maybe
    unit: str

    @property
    def placed(self) -> bool:
        """Whether it says where base or markers are."""
        return self.effect in _PLACED


class Absorbed(Entry):
    """A constant that others stand for at any pose."""

    id: Annotated[str, Shown("constant error")]
    absorbed_by: tuple[str, ...]


class Width(Entry):
    """Standard deviation, between such errors, of those of one effect that have one unit."""

    effect: Annotated[str, From("0")]
    width: Annotated[Positive, OWN_UNIT]
    unit: Annotated[str, From("1")]


class SizesEntry(Entry):
    """What holds the values that the readings leave open.

    parameters : how many of them it determines in place of the readings
    """

    parameters: Annotated[Positive, From("saved")]
    widths: tuple[Width, ...]


def parameter_entries(found: Identification) -> tuple[IdentifiedParameter, ...]:
    """The entries of all parameters, in the order of the model."""
    known = (found.std > 0.0) & np.isfinite(found.std)
    nothing = np.full(len(found.values), np.nan)
    return IdentifiedParameter.from_each(
        found.model.parameters,
        value=found.values,
        std=np.where(known, found.std, np.nan),
        ci95=[own if k else None for own, k in zip(found.interval().tolist(), known, strict=True)],
        degrees_of_freedom=np.where(known, found.freedoms, np.nan),
        std_by_pose=nothing if found.std_by_pose is None else found.std_by_pose,
        step_two_optimism=found.optimism,
    )


def absorbed_entries(found: Identification) -> tuple[Absorbed, ...]:
    """The entries of the constants left out for others."""
    by = [[name for name, _ in own.absorbed_by] for own in found.absorbed]
    return Absorbed.from_each(found.absorbed, absorbed_by=by)


def sizes_entry(found: Widths) -> SizesEntry:
    """The entry of the widths that an identification found."""
    of = found.of
    widths = Width.from_each(of.classes, width=found.widths, scale=of.scales)
    return SizesEntry.from_result(found, widths=widths)


_APPROACHES = {"points": "marker points", "pose": "full poses from the marker points"}
_METHODS = {"joint": "all parameters at once", "two-step": "base and tool in turn with the rest"}
_TOGETHER = 0.9  # correlation worth a line
_BY_POSE, _OPTIMISM = 1.2, 1.05  # ratios worth a line
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
    Absorbed, "id", doc.Column("does the same as", lambda row: ", ".join(row.absorbed_by))
)


def told_parameters(record: IdentifyRecord) -> Iterator[doc.Part]:
    """The values, how sure they are, and what a reader should know of them."""
    yield doc.Sentence(
        f"{record.rank} of {plural(len(record.parameters), 'parameter')} from "
        f"{plural(record.poses, 'reading')}, {plural(record.points, 'point')}",
        label="identified",
    )
    how = ", elastic parameters from differences" * record.differences
    yield doc.Sentence(
        f"{_APPROACHES[record.approach]}, {_METHODS[record.method]}{how}", label="method"
    )
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
    yield doc.Detail((doc.Figure(lambda: correlation(record)),), "Correlation of all parameters")
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
        yield _told_sizes(record.sizes)
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
    together = _common_error(record)
    if together > _BY_POSE:
        yield doc.Sentence(
            "the points of one pose err together. Counted by pose, the standard deviations are "
            f"{doc.TENTH(together)} times these (median; JSON: std_by_pose)",
            "note", "by pose",
        )  # fmt: skip
    worst = max((p.step_two_optimism or 0.0 for p in record.parameters), default=0.0)
    if worst > _OPTIMISM:
        yield doc.Sentence(
            "these uncertainties include those of base and tool. If both were known, they would be up "
            f"to {doc.TENTH(worst)} times smaller",
            label="include",
        )
    if record.absorbed:
        count = plural(len(record.absorbed), "redundant parameter")
        merged = "was" if len(record.absorbed) == 1 else "were"
        yield doc.Sentence(f"{count} {merged} merged into these (JSON: absorbed)", label="merged")


def _common_error(record: IdentifyRecord) -> float:
    """Median ratio of standard deviations by pose to those by point; 1 where it cannot be told."""
    ratios = [p.std_by_pose / p.std for p in record.parameters if p.std and p.std_by_pose]
    if not ratios or record.noise.source != "residual" or record.noise.scatters:
        return 1.0
    return float(np.median(ratios))


def _correlated(record: IdentifyRecord) -> Iterator[tuple[str, str, float]]:
    """Pairs of the robot's parameters that the data hardly tell apart."""
    own = [i for i, p in enumerate(record.parameters) if not p.placed and p.std]
    for n, a in enumerate(own):
        for b in own[n + 1 :]:
            r = record.correlation[a][b]
            if r is not None and abs(r) > _TOGETHER:
                yield record.parameters[a].id, record.parameters[b].id, r


def _told_sizes(sizes: SizesEntry) -> doc.Sentence:
    """That sizes decided, and which."""
    widths = [f"{own.effect} {doc.TWO(own.width)} {own.unit}" for own in sizes.widths]
    return doc.Sentence(
        f"the readings barely determine about {doc.TENTH(sizes.parameters)} combinations of "
        f"parameters. There the result leans on usual sizes of errors: {listed(widths)}. "
        '[model] size_prior = "off" switches it off',
        "note",
        "sizes",
    )
