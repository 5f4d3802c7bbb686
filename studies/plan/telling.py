"""What a plan can tell: the smallest sizes by cause and place, what is hidden, what looks alike."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from itertools import groupby

from studies import document as doc
from studies.document import labelled, plural
from studies.entries import by_reason, gathered, not_asked
from studies.plan.record import EquivalentCauses, LookAlike, PlanRecord, SeenCause

_MOST_PAIRS = 12
_INVISIBLE = 1e3  # times what is usual: rounding shows it, not these poses
_LONG = 8  # letters of a joint's name that a column takes


def _shown(cause: SeenCause) -> str:
    size = doc.STD(cause.size)
    never = cause.size is not None and cause.plausible and cause.size > _INVISIBLE * cause.plausible
    return "hidden" if cause.reason or never else f"({size})" if cause.unusual else size


_SIZE = doc.Rule(lambda cause: _shown(cause), absent="")
"""The smallest size of a cause, in brackets where it is more than is usual."""
_NEVER = doc.Rule(doc.STD.show, absent="never")


def told(record: PlanRecord) -> doc.Document:
    """How many causes the plan could find, and each."""
    sections = (
        doc.Section("sight", "What the plan shows", tuple(_parts(record))),
        doc.Section(
            "alike",
            "What is hard to tell apart",
            tuple(_alike(record)),
        ),
    )
    return doc.Document((_headline(record),), tuple(s for s in sections if s.parts))


def _headline(record: PlanRecord) -> doc.Sentence:
    seen, asked = len(record.seen), len(record.could_not_see)
    said = f"This plan shows {seen} of {asked} causes of error, above their detection limits"
    groups = len(record.twins)
    if groups:
        said += f"; {plural(groups, 'group')} of them cannot be told apart"
    return doc.Sentence(f"{said}.")


def _parts(record: PlanRecord) -> Iterator[doc.Part]:
    yield doc.Sentence(
        "Detection limits: the smallest size of each cause that is found "
        f"{round(100 * record.power)} times in 100, if the model lacks nothing else."
    )
    yield from _reads(record)
    rows = list(_by_effect(record))
    yield doc.Table(_by_joint(record.joints), rows, "Detection limits by joint", fold=False)
    elsewhere = [cause for cause in record.seen if cause.where not in record.joints]
    yield doc.Table(_CAUSES, elsewhere, "Detection limits elsewhere")
    if any(cause.unusual for cause in record.seen):
        yield doc.Sentence("In brackets: larger than such errors usually are.")
    if rows:
        sizes = doc.Table(_CAUSES, record.seen, fold=False)
        yield doc.Detail((sizes,), f"Every cause with its usual size ({len(record.seen)})")
    yield from labelled("hidden", _hidden(record.could_not_see))
    yield from not_asked(record.not_asked)


def _reads(record: PlanRecord) -> Iterator[doc.Sentence]:
    said = [plural(record.readings, "reading"), plural(record.points, "point")]
    if record.hidden_markers:
        said.append(f"{plural(record.hidden_markers, 'point')} out of sight")
    first = len(record.before_the_first_move)
    if first:
        said.append(f"{first} of unknown approach direction not used")
    yield doc.Sentence(", ".join(said), label="reads")
    if record.approach_derived:
        yield doc.Sentence("from the order of the poses", label="direction")
    if record.elastic_assumed:
        said_of = "usual joint stiffness is assumed where the model has none"
        yield doc.Sentence(said_of, label="stiffness")
    lost = (f"{', '.join(entry.names)}: {entry.reason}" for entry in record.unidentifiable)
    yield from labelled("open", lost)


# -- smallest sizes ----------------------------------------------------------------------------


@dataclass(frozen=True)
class _Effect:
    """Causes of one kind by place, one of them at least seen; of : what the size is of, its unit."""

    effect: str
    of: str
    own: dict[str, SeenCause]


def _by_effect(record: PlanRecord) -> Iterator[_Effect]:
    for effect, group in groupby(record.could_not_see, key=lambda cause: cause.effect):
        own = {cause.where: cause for cause in group if cause.where in record.joints}
        seen = [cause for cause in own.values() if not cause.reason]
        if seen:
            names, units = {c.parameter for c in seen}, {c.unit for c in seen}
            many = max(len(c.parameters) for c in seen)
            what = names.pop() if len(names) == 1 else f"best of {many}"
            unit = units.pop() if len(units) == 1 else "by joint"
            yield _Effect(effect, f"{what} [{unit}]", own)


def _by_joint(joints: Sequence[str]) -> tuple[doc.Column[_Effect], ...]:
    """Names of joints stand in narrow columns, the long ones broken at underscores."""

    def at(joint: str) -> Callable[[_Effect], SeenCause | None]:
        return lambda row: row.own.get(joint)

    heads = ((joint, joint.replace("_", "\n") if len(joint) > _LONG else joint) for joint in joints)
    return (
        doc.Column("cause", lambda row: row.effect),
        doc.Column("of", lambda row: row.of),
        *(doc.Column(head, at(joint), _SIZE) for joint, head in heads),
    )


_CAUSES = doc.columns(
    SeenCause, "key parameter", doc.Column("limit", lambda row: row, _SIZE), "plausible unit"
)


def _hidden(causes: Sequence[SeenCause]) -> Iterator[str]:
    """Hidden causes, by reason."""
    of = Counter(cause.effect for cause in causes)
    hidden = ((cause, cause.reason) for cause in causes if cause.reason)
    for reason, own in by_reason(hidden).items():
        yield f"{gathered(own, of)}: {reason}"


# -- what looks alike --------------------------------------------------------------------------


def _twins(group: EquivalentCauses) -> str:
    names = " = ".join(member.key for member in group.members)
    return f"{names}: observationally equivalent at these poses"


_ALIKE = doc.columns(
    LookAlike,
    "key",
    doc.Column("looks like", lambda row: row.like.key),
    "rho",
    doc.Column("told apart\nabove", lambda row: row.told_apart_from, _NEVER),
    doc.Column("unit", lambda row: row.unit if row.told_apart_times else None, doc.TEXT),
    doc.Column(
        "times its\nlimit", lambda row: row.told_apart_times, doc.Rule(doc.TENTH.show, absent="")
    ),
)


def _alike(record: PlanRecord) -> Iterator[doc.Part]:
    """Equivalent causes, and each other two causes once, the harder way round, which comes first."""
    yield from labelled("equivalent", map(_twins, record.twins))
    twins = [{member.key for member in group.members} for group in record.twins]
    once: dict[frozenset[str], LookAlike] = {}
    for pair in record.look_alikes:
        both = frozenset({pair.key, pair.like.key})
        if not any(both <= group for group in twins):
            once.setdefault(both, pair)
    if once:
        told = "The size above which a cause is told apart from the one it looks like"
        yield doc.Table(
            _ALIKE, list(once.values()), "Causes that look similar", told, most=_MOST_PAIRS
        )
