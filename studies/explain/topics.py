"""The topics by name: written in ``topics``, or made from the package's own classes and schema."""

from __future__ import annotations

import ast
import difflib
import inspect
import itertools
import json
import re
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import cache
from importlib.resources import files
from types import ModuleType
from typing import TYPE_CHECKING, Any, NamedTuple

from calib.errors import InputError

if TYPE_CHECKING:
    from calib.effects import Context, Effect


Rows = tuple[tuple[str, ...], Sequence[tuple[str, ...]]]
"""Titles, and rows of cells."""

_MADE_HERE = re.compile(r"^\{([\w.]+)\}$", re.MULTILINE)


def title_of(text: str) -> str:
    r"""What a topic is about.

    >>> title_of("# What it is\n\nWords.")
    'What it is'
    """
    return text.partition("\n")[0].removeprefix("# ")


def table_of(rows: Rows) -> str:
    """Rows of cells as a table in Markdown."""
    heads, cells = rows
    lines = [heads, ("---",) * len(heads), *cells]
    return "\n".join(f"| {' | '.join(map(_cell, line))} |" for line in lines)


def _cell(text: str) -> str:
    r"""Text that is no markup.

    >>> _cell("a|b of <joint>")
    'a\\|b of \\<joint>'
    """
    return re.sub(r"(?=[|<*\[])", r"\\", text)


_ABOVE = ("schema", "name")
_TOLD = ("instruments.NAME.sigma_mm.", "instruments.NAME.common.")  # as under [instrument]
_COMMON = re.compile(r"^instrument\.common\.\w+\.")  # each key may have these
_WORDS = {
    "number": "number",
    "integer": "whole number",
    "string": "text",
    "boolean": "true or false",
}


TABLES = (
    "robot", "markers_mm", "instrument", "instruments", "bodies", "boards", "known_distances",
    "gravity", "payload", "load", "design", "timing", "diagnosis", "model", "acceptance",
)  # fmt: skip


class Key(NamedTuple):
    """What may stand at a key of the cell, and what it means, each once."""

    forms: dict[str, None]
    meanings: dict[str, None]


def rows(table: str) -> list[tuple[str, str, str]]:
    """Key, form and meaning of every key of a table; of those above all tables for an empty name."""
    return [
        (
            key.removeprefix(table).lstrip("[].") or table,
            " or ".join(found.forms),
            "; ".join(found.meanings),
        )
        for key, found in keys().items()
        if table == ("" if key in _ABOVE else re.split(r"\W", key)[0])
    ]


@cache
def keys() -> dict[str, Key]:
    """Every key of the cell. ``NAME`` is the user's; ``[]`` an entry of a list of tables."""
    from calib.files.schema import CellFile

    schema = CellFile.model_json_schema()
    found: dict[str, Key] = {}
    known = {"CellFile": schema, **schema["$defs"]}
    told = _told_below(sys.modules)
    for name, table in known.items():
        for key, own_key in table.get("properties", {}).items():
            own_key["description"] = _inherited(told, name, key)
    for path, form, meaning in _keys(schema, known, "", ""):
        own = found.setdefault(_COMMON.sub("instrument.common.KEY.", path), Key({}, {}))
        own.forms[form] = None
        if meaning:
            own.meanings[meaning] = None
    for path, own in found.items():  # those of kind points stand under [instrument]
        tracker = found.get(path.replace("instruments.NAME", "instrument"), own)
        for meaning in tracker.meanings.keys() & own.meanings if tracker is not own else ():
            del own.meanings[meaning]
    return {path: own for path, own in found.items() if not path.startswith(_TOLD)}


_WITH_TABLES = ("calib.files.schema", "calib.cell.planned", "calib.instruments.")


def _told_below(modules: Mapping[str, ModuleType]) -> dict[str, dict[str, str]]:
    """By class, what stands below each field, by its key; of its bases by ``""``.

    pydantic would read it at every start, for a tenth of a second.
    """
    found: dict[str, dict[str, str]] = {}
    for module in [own for name, own in modules.items() if name.startswith(_WITH_TABLES)]:
        for table in ast.parse(inspect.getsource(module)).body:
            if isinstance(table, ast.ClassDef):
                own = found[table.name] = {"": " ".join(map(ast.unparse, table.bases))}
                for field, below in itertools.pairwise(table.body):
                    if isinstance(field, ast.AnnAssign) and isinstance(below, ast.Expr):
                        named = re.search(r"key\('(\w+)'\)", ast.unparse(field.annotation))
                        text = ast.literal_eval(below.value)
                        own[named[1] if named else ast.unparse(field.target)] = " ".join(
                            text.split()
                        )
    return found


def _inherited(told: dict[str, dict[str, str]], table: str, key: str) -> str:
    """What a table says of a key, or else its bases."""
    own = told.get(table, {"": ""})
    return own.get(key) or next(
        filter(None, (_inherited(told, b, key) for b in own[""].split())), ""
    )


def _keys(
    schema: Any, known: dict[str, Any], path: str, meaning: str
) -> Iterator[tuple[str, str, str]]:
    """Keys, forms and meanings below a path, every choice in turn."""
    if "$ref" in schema:
        schema = known[schema["$ref"].rpartition("/")[2]]
    for choice in schema.get("anyOf", schema.get("oneOf", ())):
        yield from _keys(choice, known, path, meaning)
    dot = f"{path}." if path else ""
    if "properties" in schema:
        for key, own in schema["properties"].items():
            yield from _keys(own, known, f"{dot}{key}", own.get("description", ""))
    elif isinstance(own := schema.get("additionalProperties"), dict):
        inner = [*_keys(own, known, f"{dot}NAME", meaning)]
        forms = dict.fromkeys(form for key, form, _ in inner if key == f"{dot}NAME")
        yield path, f"by name: {' or '.join(forms) or 'table'}", meaning
        yield from (entry for entry in inner if entry[0] != f"{dot}NAME")
    elif schema.get("type") == "array" and "$ref" in str(schema.get("items")):
        yield path, "list of tables", meaning
        yield from _keys(schema["items"], known, f"{path}[]", meaning)
    elif form := _form(schema):
        yield path, form, meaning


def _form(schema: Any) -> str:
    """What stands at a key that holds no table; nothing where it may be left out."""
    choices = [schema["const"]] if "const" in schema else schema.get("enum", [])
    if choices:
        return ", ".join(map(json.dumps, choices))
    if schema.get("type") == "array":
        many = len(schema.get("prefixItems", ()))
        return f"list of {many}" if many else "list"
    return _WORDS.get(schema.get("type", ""), "")


_FIRST = ("words", "cell", "columns", "instruments", "effects", "conventions", "limits")
_COVARIATES = {
    "approach": "approach_<joint>, or the order of the poses",
    "motion": "the order of the poses",
    "time": "time_s, or the order of the poses (time in readings)",
    "temperature": "temperature_degC",
    "torque": "<joint>_Nm",
}
_MOST = 12  # parameters that are named


def written() -> dict[str, str]:
    """Texts by name: what one meets first, then the rest."""
    found = {
        file.name.removesuffix(".md"): file.read_text(encoding="utf-8")
        for file in (files("studies.explain") / "topics").iterdir()
        if file.name.endswith(".md")
    }
    return {name: found[name] for name in dict.fromkeys((*_FIRST, *sorted(found)))}


def titles() -> dict[str, str]:
    """What each written topic is about."""
    return {name: title_of(text) for name, text in written().items()}


def topic(name: str) -> str:
    """A topic in Markdown. Raises InputError, naming the closest, where there is none of this name."""
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
    return _MADE_HERE.sub(lambda found: table_of(made(found[1])), text)


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
        own = [f.alias or k for k, f in table.model_fields.items() if k not in ("kind", "on")]
        keys = ", ".join([*own, *["on"] * table.rides])
        rows.append((name, _summary(kind), shown, keys))
    return ("kind", "reads", "columns", "keys"), rows


def made(name: str) -> Rows:
    """The table that ``{name}`` stands for in a topic; ``{cell.robot}`` for keys of ``[robot]``."""
    kind, _, table = name.partition(".")
    return (("key", "is", "means"), rows(table)) if kind == "cell" else _MADE[kind]()


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
        (f"# {name}", *map(_clean, _told(kind)), f"**Needs**: {_cell(needs)}.", _parameters(name))
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

    from calib.instruments.board import Board
    from calib.instruments.camera import ArmCamera
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
