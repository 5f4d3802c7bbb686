"""What a diagnosis concludes, in words: the causes and how sure they are, and what remains."""

from __future__ import annotations

from collections.abc import Sequence

from studies.diagnose.record import DiagnoseRecord, Effect, Rest
from studies.document import PROBABILITY, SHARE, Sentence, mm

_SAYS = {
    "stated": "the cell says {}",
    "measured": "second approaches show {}",
    "assumed": "data sheets of arms of its size say {} at most",
}
_NEXT = {
    "no_gap": "nothing is missing that these data could show; posecal compensate uses the model",
    "explained": "put the found effects into the model (posecal diagnose --cell-out) and identify "
    "again; posecal compensate then uses them",
    "ambiguous": "posecal diagnose --next chooses poses that tell the causes apart",
    "structure": "check these places on the arm; what errs there is in no catalogue",
    "too_large": "check that loads, moves and times are in the table; approach some poses again; "
    "measure poses closer together, or give the gear ratios",
}
_ROSE = (
    "look at what tells the held-out poses from the fitted ones (day, load, range of the joints) "
    "before what was found is used"
)


def headline(record: DiagnoseRecord) -> Sentence:
    """The verdict, and how far the error fell at poses held out."""
    sentence, closed = verdict_sentence(record), record.gap.closed
    rose = bool(record.gap.heldout_rose)
    good = record.verdict in ("no_gap", "explained") and not (record.noise.loud or rose)
    proof = ""
    if closed is not None and record.effects and not rose:
        proof = (
            f" At poses that the choice never saw, {SHARE(closed)} of the gap is gone."
            if closed > 0.0
            else " At poses that the choice never saw, the error did not shrink."
        )
    return Sentence(f"{sentence[0].upper()}{sentence[1:]}.{proof}", "good" if good else "warn")


def verdict_sentence(record: DiagnoseRecord) -> str:
    """The verdict in words: what it is, or where it sits; and what held-out poses say against it."""
    rose = "; poses held out are predicted no better with what was found"
    return _verdict_alone(record) + rose * bool(record.gap.heldout_rose)


def _verdict_alone(record: DiagnoseRecord) -> str:
    causes = _and([effect.names for effect in record.effects])
    match record.verdict:
        case "no_gap":
            loud = record.noise.loud
            return (
                f"no gap beyond noise, {loud}" if loud else f"no gap beyond {_noise(record.rest)}"
            )
        case "explained":
            return f"the gap is explained by {causes}"
        case "ambiguous":
            return f"the gap is explained by {causes}; {_unsure(record.effects)}"
    if record.effects:
        return f"the gap is more than {causes}; {_more(record)}"
    return _somewhere(record)


def _noise(rest: Rest | None) -> str:
    scatter = rest is not None and rest.kind == "scatter"
    return "noise and the arm's repeatability" if scatter else "noise"


def _unsure(effects: Sequence[Effect]) -> str:
    if any(effect.one_of for effect in effects):
        return "these data cannot tell which"
    likely = [effect.key for effect in effects if effect.standing != "established"]
    return f"{_and(likely)} {'are' if len(likely) > 1 else 'is'} likely, not certain"


def _more(record: DiagnoseRecord) -> str:
    rest = record.rest
    if rest is not None and rest.kind == "too_large":
        return f"{mm(rest.mm)} remains, more than such an arm repeats to"
    return "the rest has no cause in the catalogue"


def _somewhere(record: DiagnoseRecord) -> str:
    """The verdict where no name stands, and perhaps no column either."""
    for place in record.located:
        if not place.unfollowed:
            return (
                f"a gap at {place.where} that depends on {place.depends_on}; "
                "no cause in the catalogue does the same"
            )
    if record.refused:
        return "more is left than noise, and nothing that was tried predicts other poses better"
    for place in record.located:
        who = "the arm" if place.where == "arm" else place.where
        return f"{who} errs from pose to pose as no cause in the catalogue and no column does"
    return "more is left than noise, and neither its place nor its cause was found"


def standing_words(effect: Effect) -> str:
    """How sure a cause is, and its share."""
    several = f"one of {len(effect.alike)}" if len(effect.alike) > 1 else "likely"
    how = several if effect.one_of else effect.standing or "found"
    probability, share = PROBABILITY(effect.probability), SHARE(effect.share_of_gap)
    return f"{how} (probability {probability}), {share} of the gap"


def rest_words(record: DiagnoseRecord) -> str:
    """What remains beside the causes: how much, and whose it is."""
    rest = record.rest
    if rest is None:
        return ""
    if rest.kind == "none":
        return "Nothing remains beyond the instrument's noise."
    size = f"{mm(rest.mm)} in each coordinate remains"
    arm = _SAYS[rest.repeatability_source].format(mm(rest.repeatability_mm))
    match rest.kind:
        case "structure":
            much = size if rest.mm else "Something remains"
            return f"{much} with a structure that has no name in the catalogue."
        case "too_large":
            return (
                f"{size}. This is more than the arm repeats to: {arm}. The model lacks something."
            )
    if rest.of == "undecided":
        return (
            f"{size} that the model does not explain. The arm's repeatability may be the reason: "
            f"{arm}. Approach some poses again to be sure."
        )
    return f"{size}. It is the arm's repeatability: {arm}."


def to_do(record: DiagnoseRecord) -> str:
    """What a reader should do with this; nothing where the noise is to be looked at first."""
    if record.noise.loud:
        return ""
    if record.gap.heldout_rose:
        return _ROSE
    if record.verdict == "unknown":
        large = record.rest is not None and record.rest.kind == "too_large"
        return _NEXT["too_large" if large else "structure"]
    return _NEXT[record.verdict]


def _and(parts: Sequence[str]) -> str:
    return " and ".join([", ".join(parts[:-1]), parts[-1]] if len(parts) > 1 else parts)
