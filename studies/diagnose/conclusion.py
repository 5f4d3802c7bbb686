"""What a diagnosis concludes, in three sentences: the causes, the error, what remains."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence

from calib.effects import catalogue
from studies import document as doc
from studies.diagnose.record import DiagnoseRecord, FoundCause
from studies.document import fitting, mm, plural

_SAYS = {
    "stated": "the cell states {}",
    "measured": "repeat visits show {}",
    "assumed": "data sheets of arms of this size state {} at most",
}
_NEXT = {
    "no_gap": "use the model: run `posecal compensate`",
    "explained": "add the causes to the model (`--cell-out`) and identify again",
    "apart": "measure poses that tell them apart (`posecal design --discriminate`)",
    "alike": "correct for any of them: they act alike here",
    "confirm": "measure more poses to confirm the causes",
    "rose": "first find what differs between held-out and fitted poses: day, load, joint range",
    "structure": "check the places below: no cause in the catalogue acts like this",
    "form": "more poses would check the exact form of the causes",
    "too_large": "check that all loads, moves and times are in the table, then visit some poses again",
}
_SURE = {"established": "confirmed", "likely": "probable"}
_PPM = 1e4  # to a per cent
_UNSAID = 0.005  # of the unmodelled error
_SINGLY = 3  # causes that a sentence names one by one


def headline(record: DiagnoseRecord) -> Iterator[doc.Sentence]:
    """The verdict; the error before and after; what remains, and what to do."""
    rose = bool(record.gap.heldout_rose)
    good = record.verdict in ("no_gap", "explained") and not (record.noise.loud or rose)
    yield doc.Sentence(verdict_sentence(record), "good" if good else "warn")
    yield doc.Sentence(_fell(record))
    said = _remains(record)
    if said:
        yield doc.Sentence(said)


def verdict_sentence(record: DiagnoseRecord) -> str:
    """The verdict in words: what it is, or where it sits; and what held-out poses say against it."""
    rose = " The error at held-out poses did not fall."
    return _verdict_alone(record) + rose * bool(record.gap.heldout_rose)


def _verdict_alone(record: DiagnoseRecord) -> str:
    room = doc.LINE - len(f"{record.cell}: ")
    match record.verdict:
        case "no_gap":
            return _no_gap(record)
        case "explained":
            return fitting((f"{own}." for own in _found(record.effects)), room)
        case "ambiguous":
            return fitting([*_board_or_links(record.effects), *_unsure(record.effects)], room)
    if not record.effects:
        return _somewhere(record)
    rest = record.rest
    more = "something systematic remains"
    if rest.kind == "too_large":
        more = "more remains than an arm scatters by"
    elif _form_alone(record):
        more = "the exact form may differ"
    return fitting((f"{own}; {more}." for own in _found(record.effects)), room)


def _form_alone(record: DiagnoseRecord) -> bool:
    """Whether nothing of size remains, though a cause may act by another formula."""
    rest = record.rest
    return bool(record.effects) and rest.kind == "structure" and not rest.mm


def _no_gap(record: DiagnoseRecord) -> str:
    if record.noise.loud:
        return f"No unmodelled error found, {record.noise.loud}."
    scatter = record.rest.kind == "scatter"
    arm = " and the arm's repeatability" * scatter
    return f"No unmodelled error found: the residuals are noise{arm}."


def _found(effects: Sequence[FoundCause]) -> Iterator[str]:
    """The causes after what they are."""
    sure = any(effect.standing == "established" or effect.one_of for effect in effects)
    one, some = ("Cause found", "causes found") if sure else ("Probable cause", "probable causes")
    lead = one if len(effects) == 1 else f"{len(effects)} {some}"
    yield from (f"{lead}: {own}" for own in _causes(effects))
    yield lead


def _causes(effects: Sequence[FoundCause]) -> Iterator[str]:
    """The causes in shorter and shorter forms: names, kinds with the count of places, a count."""
    if len(effects) <= _SINGLY:
        yield _and([effect.names for effect in effects])
        more = [
            f" (or {plural(n, 'other')})" if (n := len(e.alike) - 1) > 0 else "" for e in effects
        ]
        yield _and([f"{own.key}{also}" for own, also in zip(effects, more, strict=True)])
    counts = Counter(effect.effect for effect in effects)
    kinds = [f"{kind} ({n} places)" if n > 1 else kind for kind, n in counts.most_common()]
    for most in range(len(kinds), 0, -1):
        left = sum(n for _, n in counts.most_common()[most:])
        yield _and([*kinds[:most], *([f"{left} more"] if left else [])])


def _board_or_links(effects: Sequence[FoundCause]) -> Iterator[str]:
    """That a board of another size reads as an arm of another size, where that is all there is."""
    if [own.effect for own in effects] != ["board_scale"] or not effects[0].one_of:
        return
    size = effects[0].parameters[0].value / _PPM
    larger, shorter = ("larger", "shorter") if size > 0.0 else ("smaller", "longer")
    off = f"{abs(size):.2g} %"
    yield (
        f"The board is {off} {larger} than the cell says, or all links are {off} {shorter}. These data "
        "cannot tell which."
    )
    yield f"The board is {off} {larger}, or all links {shorter}. These data cannot tell which."


def _unsure(effects: Sequence[FoundCause]) -> Iterator[str]:
    """Causes of which some are not certain, in shorter and shorter forms."""
    forms = list(_found(effects))
    if any(effect.one_of for effect in effects):
        if all(len(effect.alike) < 2 for effect in effects if effect.one_of):
            yield from (f"{form}. Its cycles per turn may be others." for form in forms)
            return
        yield f"{forms[0]}. These data cannot tell which."
        yield from (f"{form}." for form in forms[1:2] if len(effects) <= _SINGLY)
        yield from (f"{form}: these data cannot tell all apart." for form in forms[1:])
        return
    likely = [effect.key for effect in effects if effect.standing != "established"]
    if len(likely) == len(effects):
        yield from (f"{form}; not confirmed." for form in forms)
        return
    yield f"{forms[0]}. {_and(likely)}: probable, not confirmed."
    yield from (f"{form}. Not all are confirmed." for form in forms)


def _somewhere(record: DiagnoseRecord) -> str:
    """The verdict where no name stands, and perhaps no column either."""
    for place in record.located:
        if not place.unfollowed:
            return (
                f"Unmodelled error at {place.where}, which depends on {place.depends_on}. No cause "
                "in the catalogue fits."
            )
    if record.refused:
        return "Unmodelled error found. No cause of it holds in cross-validation."
    for place in record.located:
        who = "the arm" if place.where == "arm" else place.where
        return f"Unmodelled error at {who}, from pose to pose. No cause in the catalogue fits."
    return "Unmodelled error found, but neither its place nor its cause."


def _sides(record: DiagnoseRecord) -> str:
    """Camera, board or arm: what share each has, and what is left; empty where nothing is shared."""
    shown = sorted(record.sides, key=lambda own: -own.share_of_gap)
    told = [
        f"{doc.SHARE(own.share_of_gap)} of it the {own.side}'s"
        for own in shown
        if own.share_of_gap > _UNSAID
    ]
    left = 1.0 - sum(own.share_of_gap for own in record.sides)
    told += [f"{doc.SHARE(left)} without a cause"] if told and left > _UNSAID else []
    return _and([told[0], *(own.replace(" of it", "") for own in told[1:])]) if told else ""


def _fell(record: DiagnoseRecord) -> str:
    """The error before and after, at poses held out where there are any."""
    error = record.error
    before, after, unit = error.before, error.after, error.unit
    where = error.where.removeprefix("the ")
    noise = _sides(record) or f"the instrument alone leaves {doc.MM(record.gap.floor_mm)} {unit}"
    if not record.effects:
        return f"Error at {where}: {doc.MM(before)} {unit}; {noise}."
    return (
        f"Error at {where}: {doc.MM(before)} {unit} before, {doc.MM(after)} {unit} after; {noise}."
    )


def _remains(record: DiagnoseRecord) -> str:
    """What remains beside the causes, and what to do."""
    rest = record.rest
    todo = to_do(record)
    todo = todo and f"{todo[0].upper()}{todo[1:]}."
    if record.gap.heldout_rose:
        return todo
    match rest.kind:
        case "none":
            return f"Nothing remains beyond noise. {todo}".strip()
        case "scatter" if rest.of == "undecided":
            return (
                f"{mm(rest.mm)} remains; the arm's repeatability may be the reason. Visit some poses "
                "again to be sure."
            )
        case "scatter":
            return f"{mm(rest.mm)} remains: the arm's repeatability. {todo}".strip()
    return f"{mm(rest.mm)} remains. {todo}" if rest.mm else todo


def rest_words(record: DiagnoseRecord) -> Iterator[str]:
    """What remains beside the causes, and what it is held against."""
    rest = record.rest
    if rest.kind == "none":
        return
    arm = _SAYS[rest.repeatability_source].format(mm(rest.repeatability_mm))
    size = f"{mm(rest.mm)} in each coordinate" if rest.mm else "something"
    match rest.kind:
        case "structure":
            yield f"{size}, systematic, and no cause in the catalogue fits"
        case "too_large":
            yield f"{size}, more than the repeatability of the arm: {arm}"
            yield "the model lacks something"
        case _:
            yield f"{size}, as large as the repeatability of such an arm: {arm}"


def standing_words(effect: FoundCause) -> str:
    """How sure a cause is, and its share."""
    several = f"one of {len(effect.alike)}" if len(effect.alike) > 1 else "probable"
    how = several if effect.one_of else _SURE.get(effect.standing, "")
    said = f"{how} (probability {doc.PROBABILITY(effect.probability)})"
    if effect.share_of_gap is None and effect.decided_by:
        return f"{said}; the geometry that was fitted stands for it"
    return f"{said}, {doc.SHARE(effect.share_of_gap)} of the unmodelled error"


def to_do(record: DiagnoseRecord) -> str:
    """What a reader should do with this; nothing where the noise is to be looked at first."""
    decided = [own.decided_by for own in record.effects if own.one_of and own.decided_by]
    if decided and record.verdict == "ambiguous" and not record.gap.heldout_rose:
        return decided[0]
    return "" if record.noise.loud else _NEXT[_situation(record)]


def _situation(record: DiagnoseRecord) -> str:
    """What the advice depends on, a key of ``_NEXT``."""
    if record.gap.heldout_rose:
        return "rose"
    if record.verdict in ("unknown", "partly"):
        large = record.rest.kind == "too_large"
        return "form" if _form_alone(record) else "too_large" if large else "structure"
    if record.verdict == "ambiguous":
        several = any(effect.one_of for effect in record.effects)
        return "apart" if rivals(record) else "alike" if several else "confirm"
    return record.verdict


def rivals(record: DiagnoseRecord) -> list[str]:
    """Two causes that the data cannot tell apart and a choice of poses may, ``effect:where``."""
    for effect in record.effects:
        joints = [own for own in effect.alike if not catalogue()[own.effect].uses]
        if effect.one_of and len(joints) > 1:
            return [f"{own.effect}:{own.where}" for own in joints[:2]]
    return []


def _and(parts: Sequence[str]) -> str:
    return " and ".join([", ".join(parts[:-1]), parts[-1]] if len(parts) > 1 else parts)
