"""``posecal demo``: the whole way on the paper's robot, from an embedded cell."""

from __future__ import annotations

import contextlib
import functools
import io
import json
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from studies.command.deliver import deliver
from studies.command.options import result_options

if TYPE_CHECKING:
    from studies.results.demo import DemoResult

_GIVEN = {"cell.toml": "cell.toml", "kr270.urdf": "kr270.urdf", "table2.csv": "plan.csv"}
_CELL, _PLAN, _DATA, _CHECK = "cell.toml", "plan.csv", "measurements.csv", "check.csv"
_NEXT = """
Try next:
  posecal identify {0}/better_cell.toml {0}/measurements.csv --holdout {0}/check.csv
  posecal compensate {0}/cell.toml {0}/diagnose.json {0}/table2.csv -o corrected.csv
  posecal program {0}/cell.toml {0}/plan.csv -o {0}/plan.src"""


@click.command()
@click.argument("folder", type=click.Path(path_type=Path), default=Path("posecal-demo"))
@result_options(figures=False)
def demo(folder: Path, json_path: str | None, seed: int) -> None:
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
    result = Demonstration(folder, seed).run(functools.partial(click.echo, err=json_path == "-"))
    deliver(result, json_path, notes=[_NEXT.format(folder)])


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
        from studies.results.demo import DemoResult, DemoStep

        self._keep_what_was_edited()
        self.write({name: embedded_text(own) for name, own in _GIVEN.items()})
        steps = []
        for number, step in enumerate(STEPS, 1):
            say(f"[{number}/{len(STEPS)}] {(title := (step.__doc__ or '').rstrip('.'))}")
            start = time.monotonic()
            said = step(self)
            seconds = time.monotonic() - start
            say(f"      {said}  ({seconds:.0f} s)")
            steps.append(DemoStep(step=title, says=said, seconds=seconds))
        result = DemoResult(
            **envelope("", [], self.seed),
            folder=str(self.folder),
            withheld=self.read("truth.json")["withheld"],
            steps=tuple(steps),
            files=tuple(InputFile(file=n, sha256=sha256(self.folder / n)) for n in self.files),
        )
        write_files({self.folder / "demo.json": result.to_json()})
        return result

    def write(self, texts: dict[str, str]) -> None:
        """Write files of the folder, by name."""
        from calib.files.write import write_files

        write_files({self.folder / name: text for name, text in texts.items()})
        self.files.extend(texts)

    def read(self, name: str) -> Any:
        """A JSON file of the folder."""
        return json.loads((self.folder / name).read_text(encoding="utf-8"))

    def posecal(self, name: str, command: str, *args: str, **files: str) -> Any:
        """Run a command; what it prints becomes ``name.txt``; returns its result, ``name.json``.

        args : options, and names of files that the demonstration wrote; files : option -> new file
        """
        from calib.errors import CalibError
        from studies.cli import loaded

        words = [str(self.folder / arg) if arg in self.files else arg for arg in args]
        for option, file in {**files, "json": f"{name}.json"}.items():
            words += [f"--{option}", str(self.folder / file)]
            self.files.append(file)
        printed = io.StringIO()
        with contextlib.redirect_stdout(printed):
            program = f"posecal {command}"
            status = loaded(command).main(words, prog_name=program, standalone_mode=False)
        if status:
            raise CalibError(f"step {name} of the demonstration failed, see above")
        self.write({f"{name}.txt": printed.getvalue()})
        return self.read(f"{name}.json")

    def _keep_what_was_edited(self) -> None:
        from calib.errors import InputError
        from calib.files.read import sha256

        try:
            written = {own["file"]: own["sha256"] for own in self.read("demo.json")["files"]}
        except (OSError, ValueError, KeyError, TypeError):
            written = {}
        for name in (*_GIVEN, _PLAN, _DATA, _CHECK, *written):
            path = self.folder / name
            if path.exists() and (not path.is_file() or sha256(path) != written.get(name)):
                raise InputError(path, "", "is no file of an earlier demo, or was edited; it is kept",
                                 "name another folder for the demo")  # fmt: skip


def plan(way: Demonstration) -> str:
    """design: which fifteen poses to measure, three at each of five angles of A2."""
    words = ("--candidates", "5000", "--against", "table2.csv", "--seed", str(way.seed), _CELL)
    found = way.posecal("design", "design", *words, output=_PLAN)
    ours, paper = found["efficiency"], found["against"]["table2.csv"]["efficiency"]
    return (
        f"{len(found['poses'])} poses with a certified efficiency of {100 * ours:.0f} % (the paper's "
        f"Table II: {100 * paper:.0f} %)"
    )


def measure(way: Demonstration) -> str:
    """measure: simulated, free and with 250 kg on the tool."""
    from calib import load_cell, load_plan
    from calib.files.write import json_text
    from calib.files.write_tables import measurements_csv
    from studies.demo.embedded import session

    cell = load_cell(way.folder / _CELL)
    day = session(cell, load_plan(cell, way.folder / _PLAN), way.seed)
    each = zip(day.model.parameters, day.values, strict=True)
    truth = {p.id: {"value": value / p.scale, "unit": p.unit} for p, value in each}
    known = {"seed": way.seed, "withheld": day.withheld, "parameters": truth}
    tables = {_DATA: measurements_csv(cell, day.plan), _CHECK: measurements_csv(cell, day.check)}
    way.write({**tables, "truth.json": json_text(known)})
    return (
        f"{len(day.plan)} readings of {day.plan.seen.shape[1]} markers, and {len(day.check)} more to "
        "check; the robot has one error that its model lacks"
    )


def fit(way: Demonstration) -> str:
    """identify: base, tool, geometry and compliances."""
    words = ("--holdout", _CHECK, "--seed", str(way.seed), _CELL, _DATA)
    found = way.posecal("identify", "identify", *words, urdf="kr270_calibrated.urdf")
    rms, floor = found["rms_mm"], 3.0**0.5 * found["noise"]["believed_sigma_mm"]
    return (
        f"error {rms['nominal']:.2f} mm before, {rms['fitted_all']:.3f} mm after; noise alone leaves "
        f"{floor:.3f} mm"
    )


def simulate_both(way: Demonstration) -> str:
    """compare: marker points and full pose, with simulated experiments."""
    words = ("--monte-carlo", "100", "--workers", "2", "--seed", str(way.seed), _CELL)
    found = way.posecal("compare", "compare", *words, _PLAN, "table2.csv")
    (plain, *_, ours), (*_, theirs) = (
        [own["task_rms_mm"] for own in plan["approaches"]] for plan in found["plans"]
    )
    return (
        f"#2 is {plain / ours:.1f} times more accurate than plain #1, this plan {theirs / ours:.1f} "
        f"times more than Table II; {found['agreement']['says']}"
    )


def ask_why(way: Demonstration) -> str:
    """diagnose: what the model lacks."""
    way.posecal("foresight", "diagnose", "--plan-only", _CELL, _PLAN)
    words = ("--holdout", _CHECK, "--seed", str(way.seed), _CELL, _DATA)
    found = way.posecal("diagnose", "diagnose", *words, **{"cell-out": "better_cell.toml"})
    gap, causes = found["gap"], (f"{own['effect']}:{own['where']}" for own in found["effects"])
    return (
        f"{found['verdict']}: {', '.join(causes) or 'no cause'}. Held-out poses: "
        f"{gap['heldout_before_mm']:.3f} to {gap['heldout_after_mm']:.3f} mm (hidden: "
        f"{way.read('truth.json')['withheld']})"
    )


def hand_on(way: Demonstration) -> str:
    """report: a page for a colleague."""
    names = ("identify", "diagnose", "design", "foresight", "compare")
    instrument = ("--instrument", "simulated tracker, 0.010 mm")
    way.posecal(
        "report", "report", *instrument, *(f"{n}.json" for n in names), output="report.html"
    )
    return f"{way.folder / 'report.html'}: open it in a browser"


STEPS = (plan, measure, fit, simulate_both, ask_why, hand_on)
