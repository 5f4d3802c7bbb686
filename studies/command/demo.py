"""``posecal demo``: the whole way on the paper's robot, from an embedded cell."""

from __future__ import annotations

import contextlib
import functools
import io
import json
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from studies.command import options
from studies.command.call import Call

if TYPE_CHECKING:
    from studies.results.written import DemoResult

_GIVEN = {"cell.toml": "cell.toml", "kr270.urdf": "kr270.urdf", "table2.csv": "plan.csv"}
_CELL, _PLAN, _DATA, _CHECK = "cell.toml", "plan.csv", "measurements.csv", "check.csv"
_MEASURED = f"--holdout {_CHECK} {_CELL} {_DATA}"
_STEPS = {
    "design: which fifteen poses to measure, three at each of five angles of A2":
        f"design design --candidates 5000 --against table2.csv {_CELL} --output {_PLAN}",
    "measure: simulated, free and with 250 kg on the tool": "",
    "identify: base, tool, geometry and compliances":
        f"identify identify {_MEASURED} --urdf kr270_calibrated.urdf",
    "compare: marker points and full pose, with simulated experiments":
        f"compare compare --monte-carlo 100 --workers 2 {_CELL} {_PLAN} table2.csv",
    "foresee: which causes the plan can show": f"foresight diagnose --plan-only {_CELL} {_PLAN}",
    "diagnose: what the model lacks":
        f"diagnose diagnose {_MEASURED} --cell-out better_cell.toml",
    "report: a page for a colleague, to open in a browser":
        "report report --instrument simulated identify.json diagnose.json design.json "
        "foresight.json compare.json --output report.html",
}  # fmt: skip
"""Title of a step -> name of its files, and the call that makes them; the measurement is simulated."""
_WRITTEN = ("--output", "--urdf", "--cell-out", "--json")
_NEXT = """
Try next:
  posecal identify {0}/better_cell.toml {0}/measurements.csv --holdout {0}/check.csv
  posecal compensate {0}/cell.toml {0}/diagnose.json {0}/table2.csv -o corrected.csv
  posecal program {0}/cell.toml {0}/plan.csv -o {0}/plan.src"""


@click.command()
@click.argument("folder", type=click.Path(path_type=Path), default=Path("posecal-demo"))
@options.result(figures=False)
def demo(call: Call, folder: Path) -> None:
    """Run the whole way in FOLDER: plan, measure, identify, compare, diagnose, report.

    The robot is the paper's KR 270. It is measured by simulation, free and with 250 kg on the tool. It
    has an error that its model lacks; another --seed selects another error. All inputs and results are
    files. Edit them and run the commands again.

    \b
    Example:
      posecal demo my-first-calibration
    """
    from calib.files.write import make_folder

    make_folder(folder)
    say = functools.partial(click.echo, err=call.json_path == "-")
    call.deliver(Demonstration(folder, call.seed).run(say), notes=[_NEXT.format(folder)])


@dataclass(frozen=True)
class Demonstration:
    """A demonstration in a folder, and the files that it has written."""

    folder: Path
    seed: int
    files: list[str] = field(default_factory=list)

    def run(self, say: Callable[[str], None]) -> DemoResult:
        """All steps; returns the result, which is written as ``demo.json`` too.

        Raises InputError where a file in the folder is not as a demonstration left it.
        """
        from calib.files.read import sha256
        from calib.files.write import write_files
        from studies.demo.embedded import embedded_text
        from studies.results.base import InputFile, envelope
        from studies.results.written import DemoResult, DemoStep

        self._keep_what_was_edited()
        self._write({name: embedded_text(own) for name, own in _GIVEN.items()})
        steps = []
        for number, (title, words) in enumerate(_STEPS.items(), 1):
            say(f"[{number}/{len(_STEPS)}] {title}")
            start = time.monotonic()
            said = self._posecal(*words.split()) if words else self._measure()
            seconds = time.monotonic() - start
            say(f"      {said}  ({seconds:.0f} s)")
            steps.append(DemoStep(step=title, says=said, seconds=seconds))
        result = DemoResult(
            **envelope("", [], self.seed),
            folder=str(self.folder),
            withheld=self._read("truth.json")["withheld"],
            steps=tuple(steps),
            files=tuple(InputFile(file=n, sha256=sha256(self.folder / n)) for n in self.files),
        )
        write_files({self.folder / "demo.json": result.to_json()})
        return result

    def _posecal(self, name: str, command: str, *words: str) -> str:
        """Run a command whose files are of the folder; what it prints becomes ``name.txt``.

        Returns what it says first.
        """
        from calib.errors import CalibError
        from studies.cli import loaded

        given, new = [*words, "--json", f"{name}.json"], list[str]()
        if command not in ("report", "program"):
            given += ["--seed", str(self.seed)]
        for before, word in pairwise(given):
            new += [word] if before in _WRITTEN else []
        known = {*self.files, *new}
        call = [str(self.folder / word) if word in known else word for word in given]
        printed, program = io.StringIO(), f"posecal {command}"
        with contextlib.redirect_stdout(printed):
            status = loaded(command).main(call, prog_name=program, standalone_mode=False)
        if status:
            raise CalibError(f"step {name} of the demonstration failed, see above")
        self.files.extend(new)
        self._write({f"{name}.txt": printed.getvalue()})
        answer = " ".join(printed.getvalue().partition("\n\n")[0].split())
        return answer.removeprefix("kr270 milling cell: ")

    def _measure(self) -> str:
        """Measure the plan by simulation, and further poses as a check."""
        from calib import load_cell, load_plan
        from calib.files.write import json_text
        from calib.files.write_tables import measurements_csv
        from studies.demo.embedded import session

        cell = load_cell(self.folder / _CELL)
        day = session(cell, load_plan(cell, self.folder / _PLAN), self.seed)
        each = zip(day.model.parameters, day.values, strict=True)
        truth = {p.id: {"value": value / p.scale, "unit": p.unit} for p, value in each}
        known = {"seed": self.seed, "withheld": day.withheld, "parameters": truth}
        tables = {
            _DATA: measurements_csv(cell, day.plan),
            _CHECK: measurements_csv(cell, day.check),
        }
        self._write({**tables, "truth.json": json_text(known)})
        readings, markers = day.plan.seen.shape
        return (
            f"{readings} readings of {markers} markers, and {len(day.check)} more to check; the robot "
            f"has an error that its model lacks ({day.withheld})"
        )

    def _write(self, texts: dict[str, str]) -> None:
        from calib.files.write import write_files

        write_files({self.folder / name: text for name, text in texts.items()})
        self.files.extend(texts)

    def _read(self, name: str) -> Any:
        return json.loads((self.folder / name).read_text(encoding="utf-8"))

    def _keep_what_was_edited(self) -> None:
        from calib.errors import InputError
        from calib.files.read import sha256

        try:
            written = {own["file"]: own["sha256"] for own in self._read("demo.json")["files"]}
        except (OSError, ValueError, KeyError, TypeError):
            written = {}
        for name in (*_GIVEN, _PLAN, _DATA, _CHECK, *written):
            path = self.folder / name
            if path.exists() and (not path.is_file() or sha256(path) != written.get(name)):
                what = "is no file of an earlier demo, or was edited; it is kept"
                raise InputError(path, "", what, "name another folder for the demo")
