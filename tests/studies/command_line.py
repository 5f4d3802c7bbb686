"""Commands run in this process, the paper's cell on disk, and what a page may not do."""

from __future__ import annotations

import contextlib
import functools
import io
import json
import re
import shlex
import sys
from html.parser import HTMLParser
from pathlib import Path
from typing import Any, NamedTuple
from unittest import mock

import jsonschema
import pytest
from click.testing import CliRunner, Result

from studies import cli
from studies.cli import main
from studies.demo.embedded import INPUTS, embedded_text
from studies.results.read import json_schema


def run(*arguments: object) -> Result:
    """What ``posecal`` ends with, words and paths as they come."""
    return CliRunner().invoke(main, [str(a) for a in arguments])


def ran(*arguments: object) -> str:
    """What a call that succeeds prints, in one line."""
    done = run(*arguments)
    assert done.exit_code == 0, done.output
    return " ".join(done.output.split())


def refused(*arguments: object) -> str:
    """The one line with which a call ends that the user must mend."""
    done = run(*arguments)
    assert done.exit_code == 2, done.output
    (line,) = done.stderr.splitlines()
    return line


class Heard(NamedTuple):
    """How a call ended: its status, and what it wrote to both streams."""

    status: int
    out: str
    err: str


def heard(call: str, folder: Path) -> Heard:
    """Words after ``posecal``, said in a folder."""
    out, err, status = io.StringIO(), io.StringIO(), 0
    with (
        contextlib.chdir(folder),
        mock.patch.object(sys, "argv", ["posecal", *shlex.split(call)]),
        contextlib.redirect_stdout(out),
        contextlib.redirect_stderr(err),
    ):
        try:
            cli.run()
        except SystemExit as end:
            status = end.code if isinstance(end.code, int) else 0
        except Exception as error:
            status = 1  # with which Python ends then
            err.write(f"traceback: {type(error).__name__}: {error}")
    return Heard(status, out.getvalue(), err.getvalue())


def result(out: Path, *arguments: object, kind: str = "") -> tuple[dict[str, Any], str]:
    """What ``posecal`` writes to ``out`` as JSON, of a kind, and what it prints, in one line.

    No printed line is too long for a page, but where it names a file or is to be typed.
    """
    done = run(*arguments, "--json", out)
    assert done.exit_code == 0, done.output
    apart = re.compile(rf"wrote|ros2 run|{re.escape(str(out.parent))}")
    lines = [line for line in done.stdout.splitlines() if not apart.search(line)]
    assert max(map(len, lines)) <= 120, max(lines, key=len)
    fields = json.loads(out.read_text(), parse_constant=pytest.fail)
    if kind:
        checked(fields, kind)
    return fields, " ".join(done.output.split())


def checked(fields: object, kind: str) -> None:
    """Fail where fields are not what the schema of a kind of result says."""
    schema_of(kind).validate(fields)


@functools.cache
def schema_of(kind: str) -> Any:
    """What checks results of a kind; the schema itself is checked once."""
    schema = json_schema(kind)
    made = jsonschema.validators.validator_for(schema)
    made.check_schema(schema)
    return made(schema)


def paper_cell(folder: Path, *effects: str) -> Path:
    """The demonstration's inputs in a folder; its cell, with other effects where some are given."""
    for name in INPUTS:
        (folder / name).write_text(embedded_text(name))
    path = folder / "cell.toml"
    if effects:
        listed = ", ".join(f'"{effect}"' for effect in effects)
        path.write_text(
            re.sub(r"^effects = .*$", f"effects = [{listed}]", path.read_text(), flags=re.M)
        )
    return path


def without_load(cell: Path) -> None:
    """Take the load out of a cell's file: its plans are of free readings then."""
    cell.write_text(re.sub(r"^\[load\]\n(?:\w.*\n)*", "", cell.read_text(), flags=re.M))


_NEVER = {"img", "iframe", "object", "embed", "link", "base", "form", "applet", "audio", "video"}
_OWN = ("data:image/png;base64,", "#")  # a picture is a cloud of points within a figure


class _Outline(HTMLParser):
    """What a page could do."""

    def __init__(self) -> None:
        super().__init__(convert_charrefs=True)
        self.harm: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        if tag in _NEVER | {"script"}:
            self.harm.append(tag)
        for key, value in attrs:
            text = value or ""
            refers = key.endswith(("href", "src", "action", "srcdoc", "data"))
            outside = refers and not text.startswith(_OWN)
            styled = key == "style" and ("url(" in text.replace("url(#", "") or "@import" in text)
            if key.startswith("on") or outside or styled:
                self.harm.append(f"{tag} {key}={text:.80}")


def check_harmless(html: str) -> None:
    """Fail where a page has scripts, events or references beyond its own."""
    outline = _Outline()
    outline.feed(html)
    outline.close()
    assert not outline.harm, outline.harm
