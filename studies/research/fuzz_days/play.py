"""The commands of one day, in this process, and what is wrong with how they ended."""

from __future__ import annotations

import contextlib
import io
import json
import re
import signal
import traceback
import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import click
import numpy as np

from studies.cli import main
from studies.research.fuzz_days.day import Day, draw_day

_LONGEST = 1100  # characters of a line that says what is wrong
_SECONDS = 90  # that a command of a small day may take
_NUMBER = re.compile(r"(?<![\w.])[-+]?(nan|inf)(?![\w.])", re.IGNORECASE)
_RARELY = {"diagnose": 0.05, "compare": 0.05, "design": 0.07, "enough": 0.07,
           "compensate": 0.15, "changes": 0.07, "report": 0.05}  # fmt: skip


class Fault(NamedTuple):
    """What went wrong: under which kind it counts, and where in full."""

    kind: str
    text: str


class Ended(NamedTuple):
    """How a command ended. status : None where it did not end by itself."""

    status: int | None
    output: str
    errors: str
    fault: Fault | None = None


class _TooLong(BaseException):
    pass


def _calls(rng: np.random.Generator, plain: bool) -> Iterator[list[str]]:
    """Commands of a day, those that wait on others' results after them; plain : a tracker reads."""
    first = ["identify", "cell.toml", "measurements.csv", "--json", "identified.json"]
    draw = rng.random(3)
    first += ["--holdout", "0.3"] if draw[0] < 0.25 else []
    first += ["--approach", "pose"] if draw[1] < 0.2 and plain else []
    first += ["--method", "two-step"] if draw[2] < 0.1 else []
    yield first
    data, small = ["cell.toml", "measurements.csv"], ["--candidates", "60"]
    further = {
        "diagnose": [*data, "--json", "diagnosed.json"],
        "enough": [*data, "--json", "enough.json"],
        "design": [
            "cell.toml",
            "--poses",
            str(rng.integers(3, 16)),
            *small,
            "--json",
            "design.json",
        ],
        "compare": ["cell.toml", "plan.csv", "--monte-carlo", "20", "--json", "compare.json"],
        "compensate": ["cell.toml", "identified.json", "targets.csv", "--json", "compensate.json"],
        "changes": ["identified.json", "identified.json", "--json", "changes.json"],
        "report": ["identified.json", "-o", "report.html"],
    }
    chance = rng.random(len(further))
    for (verb, rest), drawn in zip(further.items(), chance, strict=True):
        if drawn < _RARELY[verb]:
            yield [verb, *rest]


def one_day(seed: int, folder: Path) -> tuple[Day, list[tuple[str, Ended, Fault | None]]]:
    """The day of a seed, its files in a folder, and what became of its commands."""
    rng = np.random.default_rng(seed)
    day = draw_day(rng, folder)
    return day, list(played(rng, day, folder))


def played(
    rng: np.random.Generator, day: Day, folder: Path
) -> Iterator[tuple[str, Ended, Fault | None]]:
    """Each command that ran, how it ended, and its fault."""
    for call in _calls(rng, " points " in day.name):
        if (
            "identified.json" in call[1:]
            and call[0] != "identify"
            and not (folder / "identified.json").exists()
        ):
            continue
        ended = _run(call, folder)
        yield " ".join(call), ended, ended.fault or _judged(call, ended, day, folder)


def _run(call: list[str], folder: Path) -> Ended:
    output, errors = io.StringIO(), io.StringIO()
    fault, status = None, None
    before = signal.signal(signal.SIGALRM, lambda *_: _stop())
    signal.alarm(_SECONDS)
    try:
        with (
            warnings.catch_warnings(),
            contextlib.chdir(folder),
            contextlib.redirect_stdout(output),
            contextlib.redirect_stderr(errors),
        ):
            warnings.simplefilter("error", RuntimeWarning)
            status = main(call, prog_name="posecal", standalone_mode=False)
    except click.ClickException as error:
        status = 2
        errors.write(f"{error.format_message()}\n")
    except _TooLong:
        fault = Fault(f"{call[0]}: longer than {_SECONDS} s", "")
    except Exception as error:
        fault = Fault(f"{call[0]}: {_place(error)}", traceback.format_exc())
    finally:
        signal.alarm(0)
        signal.signal(signal.SIGALRM, before)
    return Ended(
        status or 0 if fault is None else None, output.getvalue(), errors.getvalue(), fault
    )


def _stop() -> None:
    raise _TooLong


def _place(error: Exception) -> str:
    """Kind of an error and the last line of ours that it went through."""
    own = [f for f in traceback.extract_tb(error.__traceback__) if "/calib/" in f.filename
           or "/doe/" in f.filename or "/studies/" in f.filename]  # fmt: skip
    at = f"{Path(own[-1].filename).name}:{own[-1].name}" if own else "?"
    return (
        f"{type(error).__name__} at {at}: {str(error).splitlines()[0][:60] if str(error) else ''}"
    )


def _judged(call: list[str], ended: Ended, day: Day, folder: Path) -> Fault | None:
    """What is wrong with how a command ended by itself."""
    verb = call[0]
    if ended.status not in (0, 2):
        return Fault(f"{verb}: status {ended.status}", ended.errors)
    said = [line for line in ended.errors.splitlines() if line.startswith("posecal:")]
    if ended.status == 2 and (
        len(said) > 1 or max(map(len, ended.errors.splitlines()), default=0) > _LONGEST
    ):
        return Fault(f"{verb}: not one line", ended.errors)
    if ended.status == 2:
        return None
    if _NUMBER.search(ended.output):
        line = next(x for x in ended.output.splitlines() if _NUMBER.search(x))
        return Fault(f"{verb}: a number that is none", line)
    if "--json" not in call:
        return None
    text = (folder / call[call.index("--json") + 1]).read_text(encoding="utf-8")
    if re.search(r"\b(NaN|Infinity)\b", text):
        return Fault(f"{verb}: NaN in JSON", "")
    return _strayed(json.loads(text), day) if verb == "identify" else None


def _strayed(record: dict[str, Any], day: Day) -> Fault | None:
    """A place that left the room."""
    for p in record["parameters"]:
        placed = p["effect"] in ("base", "tool") and p["unit"] == "mm"
        if placed and p["value"] is not None and abs(p["value"]) > 1e3 * day.room:
            name = f"{p['effect']}:{p['where']}.{p['name']}"
            text = f"{name} = {p['value']:.4g} mm of {1e3 * day.room:.4g}"
            return Fault(f"identify: {p['effect']} left the room", text)
    return None
