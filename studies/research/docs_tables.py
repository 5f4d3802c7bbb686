"""The tables of ``studies/docs`` that follow from code: effects, criteria, instruments, cell keys.

    python -m studies.research.docs_tables

writes them anew between the marks ``<!-- name -->`` and ``<!-- end -->`` of the pages; a test says when
that is due.
"""

from __future__ import annotations

import ast
import inspect
import itertools
import json
import re
import sys
from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

from calib.errors import CalibError
from studies.command.explain import paragraphs

if TYPE_CHECKING:
    from calib.effects import Context

DOCS = Path(__file__).parents[1] / "docs"
_MARKED = re.compile(r"(<!-- ([\w.]+) -->\n).*?(<!-- end -->)", re.DOTALL)
_MOST = 6  # parameters that are named


def main() -> None:
    """Write every page anew."""
    for path in DOCS.glob("*.md"):
        path.write_text(made_anew(path.read_text(encoding="utf-8")), encoding="utf-8")


def made_anew(text: str) -> str:
    """A page with its tables as the code has them."""
    return _MARKED.sub(lambda found: f"{found[1]}{table(found[2])}\n{found[3]}", text)


def table(name: str) -> str:
    """The table of a mark: ``effects``, .., or ``cell.robot`` for the keys of ``[robot]``."""
    kind, _, part = name.partition(".")
    if kind == "cell":
        return markdown(("key", "is", "means"), rows_of_cell(part))
    return {"effects": effects, "criteria": criteria, "instruments": instruments}[kind]()


def markdown(heads: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    r"""A pipe table; marks in the cells are no markup.

    >>> markdown(["key"], [["a|b of <joint>"]]).splitlines()[-1]
    '| a\\|b of \\<joint> |'
    """
    cells = [[re.sub(r"(?=[|<*\[])", r"\\", cell) for cell in row] for row in rows]
    head, *lines = (f"| {' | '.join(line)} |" for line in (heads, *cells))
    return "\n".join([head, f"|{'---|' * len(heads)}", *lines])


# -- effects, criteria, instruments ----------------------------------------------------------------


def effects() -> str:
    """Every effect: what it is, what data it needs, and its parameters at one place."""
    from calib.effects import EFFECTS

    rows = [
        (n, summary(k, EFFECTS), "; ".join(needs(k)), parameters(k)) for n, k in EFFECTS.items()
    ]
    return markdown(("effect", "what it is", "needs", "parameters (at a place)"), rows)


def criteria() -> str:
    """Every criterion that is chosen by name, and the figure in which it is read."""
    from doe.criteria import CRITERIA, UNASKED

    rows = [
        (
            name,
            summary(kind, CRITERIA).removeprefix(f"{name}: "),
            f"{kind.unit}, {'larger' if kind.larger_is_better else 'smaller'} is better",
        )
        for name, kind in CRITERIA.items()
        if name != UNASKED
    ]
    return markdown(("criterion", "is about", "shown as"), rows)


def instruments() -> str:
    """Every kind of instrument: its columns, and its keys in the cell."""
    from calib.files.readings import reading_names
    from calib.instruments import KINDS

    rows = []
    for name, (kind, fields) in KINDS.items():
        columns = sorted(reading_names([kind]))
        shown = ", ".join(column for column in columns if not column.endswith(("_m", "_rad")))
        keys = [f.alias or k for k, f in fields.model_fields.items() if k not in ("kind", "on")]
        shared = {key: kind for key, (kind, _) in KINDS.items()}
        rows.append(
            (name, summary(kind, shared), shown, ", ".join([*keys, *["on"] * fields.rides]))
        )
    return markdown(("kind", "reads", "columns", "keys"), rows)


def summary(kind: type, others: dict[str, Any]) -> str:
    """The first sentence that docstrings say of a class, without marks."""
    text = paragraphs(kind, [*others.values()])[0]
    return re.split(r"(?<!\.)\.(?:\s|$)", text)[0].replace("`", "")


_COVARIATES = {
    "approach": "approach_<joint>, or the order of the poses",
    "motion": "the order of the poses",
    "time": "time_s, or the order of the poses (time in readings)",
    "temperature": "temperature_degC",
    "torque": "<joint>_Nm",
}


def needs(kind: Any) -> Iterator[str]:
    """What data an effect needs beside joints and readings."""
    import numpy as np

    from calib.effects.protocol import ElasticEffect, LoadEffect

    if issubclass(kind, ElasticEffect):
        yield "load: a wrench, a payload, or link masses"
    if issubclass(kind, LoadEffect):
        yield "an elastic joint (joint_compliance)"
    context = contexts()[0]
    sliding = replace(context.robot, prismatic=np.ones(context.robot.dof, dtype=bool))
    if len(kind.places(replace(context, robot=sliding))) < len(kind.places(context)):
        yield "a joint that turns"
    covariates = kind.uses if "motion" not in kind.uses else ("motion",)
    yield from (_COVARIATES[name] for name in covariates)


def parameters(kind: Any) -> str:
    """Names and units at the first place of the demonstration, or of another cell, that has some."""
    for context in contexts():
        for where in kind.places(context):
            try:
                found = kind.at(context, where).parameters
            except CalibError:
                continue
            shown = [f"{p.name} [{p.unit}]" for p in found[:_MOST]]
            more = f" and {len(found) - _MOST} more" if len(found) > _MOST else ""
            return f"{', '.join(shown)}{more} ({where})"
    return ""


@cache
def contexts() -> tuple[Context, ...]:
    """The demonstration; the same arm with a camera that sees a board, sockets and a wire; a camera."""
    import numpy as np

    from calib.instruments.board import Board
    from calib.instruments.camera import ArmCamera
    from calib.instruments.distance import Distance
    from calib.instruments.socket import Socket
    from calib.model.build import context_of
    from studies.demo.embedded import embedded_cell

    demo = context_of(embedded_cell(), None)
    board = Board("BOARD", slice(0, 3), np.diag([1.0, 1.0, 0.0]))
    camera = ArmCamera(name="CAMERA", boards=(board,))
    sites = ("SOCKET", "another")
    several = (camera, Socket(name=sites[0], sites=sites), Distance(name="WIRE"))
    both = (several, several[:1])
    bodies = {"BOARD": slice(0, 3)}
    return demo, *(replace(demo, instruments=seen, bodies=bodies) for seen in both)


# -- keys of the cell ------------------------------------------------------------------------------

_ABOVE = ("schema", "name")
_SHARED = "instruments.NAME.sigma_mm."  # as under [instrument]
_WORDS = {
    "number": "number",
    "integer": "whole number",
    "string": "text",
    "boolean": "true or false",
}
_SOURCES = ("calib.cell.", "calib.instruments.")
Key = tuple[dict[str, None], dict[str, None]]
"""What may stand at a key, and what it means, each once."""


def rows_of_cell(part: str) -> list[tuple[str, str, str]]:
    """Key, form and meaning of every key of a table; of those above all tables for an empty name."""
    return [
        (key.removeprefix(part).lstrip("[].") or part, " or ".join(forms), "; ".join(meanings))
        for key, (forms, meanings) in cell_keys().items()
        if part == ("" if key in _ABOVE else re.split(r"\W", key)[0])
    ]


@cache
def cell_keys() -> dict[str, Key]:
    """Every key of the cell. ``NAME`` is the user's; ``[]`` an entry of a list of tables."""
    from calib.cell.tables import CellFile

    schema = CellFile.model_json_schema()
    classes, below = {"CellFile": schema, **schema["$defs"]}, descriptions()
    for name, fields in classes.items():
        for key, field in fields.get("properties", {}).items():
            field["description"] = described(below, name, key)
    found: dict[str, Key] = {}
    for path, form, meaning in keys_below(schema, classes, "", ""):
        forms, meanings = found.setdefault(path, ({}, {}))
        forms[form] = None
        meanings |= {meaning: None} if meaning else {}
    for path, (_, meanings) in found.items():  # those of kind points stand under [instrument]
        tracker = found.get(path.replace("instruments.NAME", "instrument"))
        for meaning in (
            tracker[1].keys() & meanings if tracker and tracker[1] is not meanings else ()
        ):
            del meanings[meaning]
    return {path: key for path, key in found.items() if not path.startswith(_SHARED)}


def descriptions() -> dict[str, dict[str, str]]:
    """By class, the text below each field by its key; its bases by ``""``.

    pydantic would read it at every start, for a tenth of a second.
    """
    found: dict[str, dict[str, str]] = {}
    for module in [own for name, own in sys.modules.items() if name.startswith(_SOURCES)]:
        for part in ast.parse(inspect.getsource(module)).body:
            if isinstance(part, ast.ClassDef):
                texts = found[part.name] = {"": " ".join(map(ast.unparse, part.bases))}
                for field, text in itertools.pairwise(part.body):
                    if isinstance(field, ast.AnnAssign) and isinstance(text, ast.Expr):
                        named = re.search(r"key\('(\w+)'\)", ast.unparse(field.annotation))
                        key = named[1] if named else ast.unparse(field.target)
                        texts[key] = " ".join(ast.literal_eval(text.value).split())
    return found


def described(below: dict[str, dict[str, str]], name: str, key: str) -> str:
    """What a class says of a key, or else its bases."""
    texts = below.get(name, {"": ""})
    bases = (described(below, base, key) for base in texts[""].split())
    return texts.get(key) or next(filter(None, bases), "")


def keys_below(
    schema: Any, classes: dict[str, Any], path: str, meaning: str
) -> Iterator[tuple[str, str, str]]:
    """Keys, forms and meanings below a path, every choice in turn."""
    if "$ref" in schema:
        schema = classes[schema["$ref"].rpartition("/")[2]]
    for choice in schema.get("anyOf", schema.get("oneOf", ())):
        yield from keys_below(choice, classes, path, meaning)
    dot = f"{path}." if path else ""
    if "properties" in schema:
        for key, field in schema["properties"].items():
            yield from keys_below(field, classes, f"{dot}{key}", field.get("description", ""))
    elif isinstance(named := schema.get("additionalProperties"), dict):
        inner = [*keys_below(named, classes, f"{dot}NAME", meaning)]
        forms = dict.fromkeys(form for key, form, _ in inner if key == f"{dot}NAME")
        yield path, f"by name: {' or '.join(forms) or 'table'}", meaning
        yield from (entry for entry in inner if entry[0] != f"{dot}NAME")
    elif schema.get("type") == "array" and "$ref" in str(schema.get("items")):
        yield path, "list of tables", meaning
        yield from keys_below(schema["items"], classes, f"{path}[]", meaning)
    elif form := form_of(schema):
        yield path, form, meaning


def form_of(schema: Any) -> str:
    """What stands at a key that holds no table; nothing where it may be left out."""
    choices = [schema["const"]] if "const" in schema else schema.get("enum", [])
    if choices:
        return ", ".join(map(json.dumps, choices))
    if schema.get("type") == "array":
        many = len(schema.get("prefixItems", ()))
        return f"list of {many}" if many else "list"
    return _WORDS.get(schema.get("type", ""), "")


if __name__ == "__main__":
    main()
