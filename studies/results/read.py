"""Results read again: what is wrong in a file is stated with its place, as one line."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

from pydantic import BaseModel, Field, ValidationError
from pydantic_core import ErrorDetails

from calib.errors import InputError
from calib.files.read import read_text, sha256
from studies.kinds import KINDS, result_type
from studies.results.base import InputFile, Result, named_kind

_MOST_BYTES = 200_000_000
_ANEW = "write it anew with this version"

R = TypeVar("R", bound=Result)


class _Head(BaseModel):
    """By which a result is known before it is read."""

    format: int = Field(alias="schema")
    command: str
    plan_only: bool = False
    motions: bool = False
    inputs: list[InputFile]


def read(path: Path) -> Result:
    """The result in a file.

    Raises InputError naming the file and the place in it, also for another schema.
    """
    text = read_text(path, _MOST_BYTES)
    try:
        head = _Head.model_validate_json(text)
    except ValidationError:
        remedy = "write one with --json of a command"
        raise InputError(path, "", "is no result of posecal", remedy) from None
    if head.format != 1:
        raise InputError(path, "schema", "is not 1", "write the result anew with this version")
    kind = named_kind(head)
    if kind not in KINDS:
        raise InputError(
            path, "command", f"{kind[:40]!r} is no kind of result", f"known are {', '.join(KINDS)}"
        )
    try:
        return result_type(kind).model_validate_json(text)
    except ValidationError as error:
        first, *others = error.errors(include_url=False, include_input=False)
        more = f" (and {len(others)} more)" if others else ""
        raise InputError(path, _place(first), f"{_fault(first)}{more}", _ANEW) from None


def read_as(path: Path, kind: type[R]) -> R:
    """The result in a file that is known to be of a kind. Raises InputError."""
    result = read(path)
    if not isinstance(result, kind):
        raise InputError(path, "command", f"is {result.command}", "name another result")
    return result


@dataclass(frozen=True)
class Input:
    """A file that a result was made from; state: "unchanged", "changed since" or "not found"."""

    file: str
    sha256: str
    state: str
    path: Path | None


def located(result: Path, file: str, digest: str) -> Input:
    """The file where it was, or beside the result."""
    state = "not found"
    for path in (Path(file), result.parent / Path(file).name):
        try:
            if not path.is_file():
                continue
            if sha256(path) == digest:
                return Input(file, digest, "unchanged", path)
        except (OSError, ValueError):
            continue
        state = "changed since"
    return Input(file, digest, state, None)


def _place(error: ErrorDetails) -> str:
    """``rms_mm.heldout``, ``targets[3].left_mm``: where in the file, empty for the whole."""
    parts = (f"[{part}]" if isinstance(part, int) else f".{part}" for part in error["loc"])
    return "".join(parts).removeprefix(".")


def _fault(error: ErrorDetails) -> str:
    message = error["msg"].removeprefix("Input ")
    return "is missing" if error["type"] == "missing" else message[:1].lower() + message[1:]


def json_schema(kind: str) -> dict[str, Any]:
    """The JSON Schema of a kind of result, as it is written."""
    return result_type(kind).model_json_schema(mode="serialization")
