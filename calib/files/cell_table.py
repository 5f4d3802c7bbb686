"""Read ``cell.toml`` as a checked table; what is wrong with it is one line that names the key."""

from __future__ import annotations

import difflib
import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from calib.cell.tables import CellFile
from calib.errors import InputError
from calib.files.read import ORDER, read_text
from calib.instruments import KINDS

_ALIKE = 0.75  # of keys that may be meant for each other
_LARGEST_FILE = 2_000_000  # bytes; the parser of the standard library is slow
_UNKNOWN = ("extra_forbidden", "unexpected_keyword_argument")
_NAMED = ("markers_mm", "instruments", "bodies", "boards")  # below these stand the user's own names
_TAGS = {*KINDS, "number", "polar", "mpe", "plain", "table", "box", "sphere", "halfspace"}
_LIST, _TABLE = "should be a list in brackets", "should be a table of its own"
_LACKS = "add it, as in the cell that `posecal demo` writes"
_PLAINLY = {
    "tuple_type": "should be a list of numbers in brackets",
    "list_type": _LIST,
    "dict_type": _TABLE,
    "model_type": _TABLE,
    "dataclass_type": _TABLE,
    "too_short": "has no entry; at least one is needed",
}


def cell_table(path: Path) -> CellFile:
    """The checked tables of a cell file, as they stand in it. Raises InputError."""
    try:
        return CellFile.model_validate(_read_toml(path))
    except ValidationError as error:
        # A misspelt key is both unknown and missing: the unknown one is what the user sees.
        problems = sorted(error.errors(include_url=False), key=lambda p: p["type"] not in _UNKNOWN)
        keys = _keys(problems[0]["loc"])
        more = f" (and {len(problems) - 1} more)" if len(problems) > 1 else ""
        raise InputError(path, ".".join(keys), _plain(problems[0], keys) + more) from None


def _read_toml(path: Path) -> dict[str, Any]:
    text = read_text(path, _LARGEST_FILE)
    if text.startswith("{"):
        raise InputError(path, "", "is a JSON and no cell", ORDER)
    try:
        return tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise InputError(path, "", f"is not valid TOML: {str(error).splitlines()[0]}") from None
    except ValueError:  # an integer of thousands of digits
        raise InputError(path, "", "holds a number with too many digits") from None
    except RecursionError:
        raise InputError(path, "", "is nested too deeply") from None


def _keys(location: tuple[int | str, ...]) -> list[str]:
    """Keys of the file; which of several forms it is (number, box ..) stands in the location alone."""
    return [
        str(key)
        for before, key in zip((None, *location), location, strict=False)
        if before in _NAMED or not (key in _TAGS or "[" in str(key) or key == "IntrinsicsStd")
    ]


def _plain(problem: Mapping[str, Any], keys: list[str]) -> str:
    kind, tag, value = problem["type"], problem.get("ctx", {}), problem.get("input")
    if kind == "missing":
        few = "is missing: the list has too few numbers"
        return few if keys[-1].isdigit() else f"is missing; {_LACKS}"
    if kind in _UNKNOWN:
        return f"is not a known key{_meant(keys[-1])}"
    if kind in ("union_tag_invalid", "union_tag_not_found"):
        of = tag.get("discriminator", "type").strip("'")
        known = "box, sphere or halfspace" if of == "type" else ", ".join(sorted(KINDS))
        lacks = "has no known" if kind == "union_tag_invalid" else "lacks its"
        return f"{lacks} {of}; write {known}"
    if kind in _PLAINLY:
        return _PLAINLY[kind]
    text = str(problem["msg"]).removeprefix("Value error, ")
    text = text[0].lower() + text[1:]
    return text + (f", found {value!r}" if isinstance(value, str | int | float) else "")


def _meant(key: str) -> str:
    """What to do with an unknown key: keys that are most like it, all that are equally so, if any."""
    schema = CellFile.model_json_schema()
    tables = (schema, *schema["$defs"].values())
    known = sorted({key for table in tables for key in table.get("properties", ())})
    if key in known:
        return " of this table; take it out, or move it to where it belongs (posecal explain cell)"
    close = difflib.get_close_matches(key, known, n=3, cutoff=_ALIKE)
    ratios = [difflib.SequenceMatcher(None, own, key).ratio() for own in close]
    best = [repr(own) for own, ratio in zip(close, ratios, strict=True) if ratio == ratios[0]]
    if not best:
        return "; take it out, or name another (posecal explain cell)"
    return f"; did you mean {' or '.join(sorted(best))}?"
