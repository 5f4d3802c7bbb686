"""The topics by name: written in ``topics``, or made from the package's own classes and tables."""

from __future__ import annotations

import difflib
import inspect
import re
import sys
from collections.abc import Callable, Iterator
from dataclasses import replace
from importlib.resources import files
from typing import TYPE_CHECKING

from calib.errors import InputError
from studies.document import Document
from studies.explain.text import Rows, document_of, title_of

if TYPE_CHECKING:
    from calib.effects import Context, Effect

_FIRST = ("words", "cell", "columns", "instruments", "effects", "conventions", "limits")
_MEASURED = "measured-"
_COVARIATES = {
    "approach": "approach_<joint>, or the order of the poses",
    "motion": "the order of the poses",
    "time": "time_s, or the order of the poses (time in readings)",
    "temperature": "temperature_degC",
    "torque": "<joint>_Nm",
    "velocity": "<joint>_deg_s, or time_s of an arm that moves",
}
_MOST = 12  # parameters that are named


def written() -> dict[str, str]:
    """Texts by name: what one meets first, then the rest, then what was measured."""
    found = {
        file.name.removesuffix(".md"): file.read_text(encoding="utf-8")
        for file in (files("studies.explain") / "topics").iterdir()
        if file.name.endswith(".md")
    }
    order = [*_FIRST, *sorted(found, key=lambda name: (name.startswith(_MEASURED), name))]
    return {name: found[name] for name in dict.fromkeys(order)}


def titles() -> dict[str, str]:
    """What each written topic is about."""
    return {name: title_of(text) for name, text in written().items()}


def topic(name: str) -> Document:
    """A topic. Raises InputError, naming the closest, where there is none of this name."""
    from calib.effects import catalogue as effects_known
    from doe.criteria import catalogue as criteria_known

    texts = written()
    if name in texts:
        text = texts[name]
    elif name in effects_known():
        text = effect_text(name)
    elif name in criteria_known():
        text = criterion_text(name)
    else:
        close = difflib.get_close_matches(name, [*texts, *effects_known(), *criteria_known()], n=1)
        hint = f"did you mean {close[0]}?" if close else "posecal explain lists them"
        raise InputError("explain", "", f"no topic {name!r}", hint)
    return document_of(text, made)


def effects() -> Rows:
    """Every effect: what it is, and what data it needs."""
    from calib.effects import catalogue

    rows = [(name, _summary(kind), "; ".join(_needs(kind))) for name, kind in catalogue().items()]
    return ("effect", "what it is", "needs"), rows


def criteria() -> Rows:
    """Every criterion that is chosen by name: what it makes best, and in which figure it is read."""
    from doe.criteria import UNASKED, catalogue

    return ("criterion", "is about", "shown as"), [
        (
            name,
            _summary(kind).removeprefix(f"{name}: "),
            f"{kind.unit}, {_sense(kind.larger_is_better)}",
        )
        for name, kind in catalogue().items()
        if name != UNASKED
    ]


def instruments() -> Rows:
    """Every kind of instrument: its columns, and its keys in the cell."""
    from calib.files.readings import reading_names
    from calib.instruments import KINDS

    rows = []
    for name, (kind, table) in KINDS.items():
        columns = sorted(reading_names([kind]))
        shown = ", ".join(column for column in columns if not column.endswith(("_m", "_rad")))
        own = [key for key in table.model_fields if key not in ("kind", "on")]
        keys = ", ".join([*own, *["on"] * table.rides])
        rows.append((name, _summary(kind), shown, keys))
    return ("kind", "reads", "columns", "keys"), rows


def cell_table(table: str) -> Rows:
    """Every key of one table of the cell."""
    from studies.explain.text import rows

    return ("key", "is", "means"), rows(table)


def made(name: str) -> Rows:
    """The table that ``{name}`` stands for in a topic; ``{cell.robot}`` for keys of ``[robot]``."""
    kind, _, table = name.partition(".")
    return cell_table(table) if kind == "cell" else _MADE[kind]()


_MADE: dict[str, Callable[[], Rows]] = {
    "effects": effects,
    "criteria": criteria,
    "instruments": instruments,
}


def effect_text(name: str) -> str:
    """The topic of one effect: its docstring, parameters and needs."""
    from calib.effects import catalogue

    kind = catalogue()[name]
    needs = "; ".join(_needs(kind)) or "only joints and readings"
    return "\n\n".join(
        (f"# {name}", *map(_clean, _told(kind)), f"**Needs**: {needs}.", _parameters(name))
    )


def criterion_text(name: str) -> str:
    """The topic of one criterion: the docstrings of its module and class."""
    from doe.criteria import catalogue

    kind = catalogue()[name]
    shown = f"Shown as: {kind.unit}, {_sense(kind.larger_is_better)}."
    own = (inspect.getdoc(kind) or "").split("\n\n")
    told = [_clean(paragraph) for paragraph in own if not _FIELDS.match(paragraph)]
    every = (*map(_clean, _told(kind)), *told)
    texts = dict.fromkeys(text.removeprefix(f"{name}: ") for text in every)
    return "\n\n".join((f"# {name}", *(text[0].upper() + text[1:] for text in texts), shown))


def _sense(larger_is_better: bool) -> str:
    return "larger is better" if larger_is_better else "smaller is better"


def _needs(kind: type[Effect]) -> Iterator[str]:
    from calib.effects.protocol import ElasticEffect, LoadEffect

    if issubclass(kind, ElasticEffect):
        yield "load: a wrench, a payload, or link masses"
    if issubclass(kind, LoadEffect):
        yield "an elastic joint (joint_compliance)"
    if kind.turns:
        yield "a joint that turns"
    covariates = kind.uses if "motion" not in kind.uses else ("motion",)
    yield from (_COVARIATES[own] for own in covariates)


def _parameters(name: str) -> str:
    """Names and units, on the arm of the demonstration, where the effect can stand there."""
    from calib.effects import catalogue
    from calib.errors import CalibError
    from calib.model.build import context_of
    from studies.demo.embedded import embedded_cell

    kind, context = catalogue()[name], context_of(embedded_cell(), None)
    for cell, own_context in (
        ("the demonstration", context),
        ("a cell with a board, sockets and a wire", seeing := _seeing(context)),
        ("a cell with a camera alone", replace(seeing, instruments=seeing.instruments[:1])),
    ):
        for where in kind.places(own_context):
            try:
                own = kind.at(own_context, where).parameters
            except CalibError:
                continue
            shown = [f"{p.name} [{p.unit}]" for p in own[:_MOST]]
            more = f" and {len(own) - _MOST} more" if len(own) > _MOST else ""
            return f"**Parameters**, for example at {where} of {cell}: {', '.join(shown)}{more}."
    return "It cannot act in the cell of the demonstration."


def _seeing(context: Context) -> Context:
    """The same arm, read by a camera on the tip that sees a board, in two sockets, and by a wire."""
    import numpy as np

    from calib.instruments.camera import ArmCamera
    from calib.instruments.detection import Board
    from calib.instruments.distance import Distance
    from calib.instruments.socket import Socket

    board = Board("BOARD", slice(0, 3), np.diag([1.0, 1.0, 0.0]))
    sites = ("SOCKET", "another")
    return replace(
        context,
        instruments=(
            ArmCamera(name="CAMERA", boards=(board,)),
            Socket(name=sites[0], sites=sites),
            Distance(name="WIRE"),
        ),
        bodies={"BOARD": slice(0, 3)},
    )


def _summary(kind: type) -> str:
    """First sentence of what is told of a class, without marks.

    >>> from calib.effects.last_move import Backlash
    >>> _summary(Backlash)
    'Lost motion of a joint: its position depends on the approach direction'
    """
    text = _clean(_told(kind)[0])
    return re.split(r"(?<!\.)\.(?:\s|$)", text)[0].replace("`", "")


def _told(kind: type) -> list[str]:
    """Paragraphs of a module's docstring; of one that shares its file those of its own."""
    from calib.effects import catalogue as effects_known
    from doe.criteria import catalogue as criteria_known

    known = (*effects_known().values(), *criteria_known().values())
    shared = [own for own in known if own.__module__ == kind.__module__]
    if len(shared) > 1:
        own = (inspect.getdoc(kind) or "").split("\n\n")
        return [text for text in own if not _FIELDS.match(text)]
    return (inspect.getdoc(sys.modules[kind.__module__]) or "").split("\n\n")


_FIELDS = re.compile(r"[\w, ]+ : ")  # how a paragraph of fields begins


def _clean(text: str) -> str:
    """Running words, with references to code as names."""
    text = re.sub(r":\w+:`~?([^`]+)`", r"`\1`", text.replace("``", "`"))
    return " ".join(text.split())
