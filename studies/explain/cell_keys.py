"""Every key of the cell: its form from the schema, its meaning told here."""

from __future__ import annotations

import json
import re
import tomllib
from collections.abc import Iterator
from importlib.resources import files
from typing import Any

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
    "gravity", "payload", "load", "design", "diagnosis", "model", "acceptance",
)  # fmt: skip


def meanings() -> dict[str, str]:
    """What each key means. ``NAME`` is the user's; ``[]`` an entry of a list of tables."""
    text = (files("studies.explain") / "cell_keys.toml").read_text(encoding="utf-8")
    return tomllib.loads(text)


def rows(table: str) -> list[tuple[str, str, str]]:
    """Key, form and meaning of every key of a table; of those above all tables for an empty name."""
    told = meanings()
    return [
        (key.removeprefix(table).lstrip("[].") or table, " or ".join(found), told[key])
        for key, found in forms().items()
        if table == ("" if key in _ABOVE else re.split(r"\W", key)[0])
    ]


def forms() -> dict[str, dict[str, None]]:
    """What may stand at every key of the cell, from its schema."""
    from calib.files.schema import CellFile

    schema = CellFile.model_json_schema()
    found: dict[str, dict[str, None]] = {}
    for key, form in _keys(schema, schema["$defs"], ""):
        found.setdefault(_COMMON.sub("instrument.common.KEY.", key), {})[form] = None
    return {key: own for key, own in found.items() if not key.startswith(_TOLD)}


def _keys(schema: Any, known: dict[str, Any], path: str) -> Iterator[tuple[str, str]]:
    """Keys and forms below a path, every choice in turn."""
    if "$ref" in schema:
        schema = known[schema["$ref"].rpartition("/")[2]]
    for choice in schema.get("anyOf", schema.get("oneOf", ())):
        yield from _keys(choice, known, path)
    dot = f"{path}." if path else ""
    if "properties" in schema:
        for key, own in schema["properties"].items():
            yield from _keys(own, known, f"{dot}{key}")
    elif isinstance(own := schema.get("additionalProperties"), dict):
        inner = [*_keys(own, known, f"{dot}NAME")]
        yield path, f"by name: {_either(form for key, form in inner if key == f'{dot}NAME')}"
        yield from (pair for pair in inner if pair[0] != f"{dot}NAME")
    elif schema.get("type") == "array" and "$ref" in str(schema.get("items")):
        yield path, "list of tables"
        yield from _keys(schema["items"], known, f"{path}[]")
    elif form := _form(schema):
        yield path, form


def _either(forms: Iterator[str]) -> str:
    return " or ".join(dict.fromkeys(forms)) or "table"


def _form(schema: Any) -> str:
    """What stands at a key that holds no table; nothing where it may be left out."""
    choices = [schema["const"]] if "const" in schema else schema.get("enum", [])
    if choices:
        return ", ".join(map(json.dumps, choices))
    if schema.get("type") == "array":
        many = len(schema.get("prefixItems", ()))
        return f"list of {many}" if many else "list"
    return _WORDS.get(schema.get("type", ""), "")
