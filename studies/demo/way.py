"""The whole way, step by step: plan, measure, identify, compare, diagnose, report."""

from __future__ import annotations

import contextlib
import io
import math
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import click

from calib import load_cell, load_plan
from calib.errors import CalibError, InputError
from calib.files.read import sha256
from calib.files.write import json_text, write_files
from calib.files.write_tables import measurements_csv
from studies.command.diagnose import diagnose
from studies.command.identify import identify
from studies.command.report import report
from studies.compare.command import compare
from studies.compare.record import CompareRecord
from studies.demo.embedded import embedded_text, session
from studies.demo.record import DemoRecord, DemoStep
from studies.design.command import design
from studies.design.record import DesignRecord
from studies.record import InputFile, envelope
from studies.results.diagnose import DiagnoseResult
from studies.results.identify import IdentifyResult
from studies.results.read import read_as

RECORD = "demo.json"
_GIVEN = {"cell.toml": "cell.toml", "kr270.urdf": "kr270.urdf", "table2.csv": "plan.csv"}
_CELL, _PLAN, _DATA, _CHECK = "cell.toml", "plan.csv", "measurements.csv", "check.csv"


@dataclass
class Demonstration:
    """A demonstration in a folder: what was written, and what each step said."""

    folder: Path
    seed: int
    say: Callable[[str], None]
    steps: list[DemoStep] = field(default_factory=list)
    files: list[str] = field(default_factory=list)
    withheld: str = ""

    def go(self) -> DemoRecord:
        """All steps; returns the record, which is written as ``demo.json`` too.

        Raises InputError where a file in the folder is not as a demonstration left it.
        """
        self._keep_what_was_edited()
        self.write({name: embedded_text(own) for name, own in _GIVEN.items()})
        for number, (title, step) in enumerate(STEPS, 1):
            self.say(f"[{number}/{len(STEPS)}] {title}")
            begun = time.monotonic()
            said = step(self)
            seconds = time.monotonic() - begun
            self.say(f"      {said}  ({seconds:.0f} s)")
            self.steps.append(DemoStep(step=title, says=said, seconds=seconds))
        record = DemoRecord(
            **envelope("", [], self.seed),
            folder=str(self.folder),
            withheld=self.withheld,
            steps=tuple(self.steps),
            files=tuple(InputFile(file=n, sha256=sha256(self.folder / n)) for n in self.files),
        )
        write_files({self.folder / RECORD: record.dumps()})
        return record

    def write(self, texts: dict[str, str]) -> None:
        """Files of the folder, by name."""
        write_files({self.folder / name: text for name, text in texts.items()})
        self.files += texts

    def run(self, command: click.Command, name: str, *args: str, **files: str) -> None:
        """Run a command; what it prints becomes ``name.txt``, its result ``name.json``.

        args : options, and names of files that the demonstration wrote; files : option -> new file
        """
        own = [str(self.folder / arg) if arg in self.files else arg for arg in args]
        for option, file in {**files, "json": f"{name}.json"}.items():
            own += [f"--{option}", str(self.folder / file)]
            self.files.append(file)
        printed = io.StringIO()
        with contextlib.redirect_stdout(printed):
            status = command.main(own, prog_name=f"posecal {command.name}", standalone_mode=False)
        if status:
            raise CalibError(f"step {name} of the demonstration failed, see above")
        self.write({f"{name}.txt": printed.getvalue()})

    def _keep_what_was_edited(self) -> None:
        try:
            earlier = read_as(self.folder / RECORD, DemoRecord).files
        except InputError:
            earlier = ()
        written = {entry.file: entry.sha256 for entry in earlier}
        for name in (*_GIVEN, _PLAN, _DATA, _CHECK, *written):
            path = self.folder / name
            if path.exists() and (not path.is_file() or sha256(path) != written.get(name)):
                raise InputError(path, "", "is no file of an earlier demo, or was edited; it is kept",
                                 "name another folder for the demo")  # fmt: skip


def plan(way: Demonstration) -> str:
    """Choose fifteen poses and prove how good they are."""
    way.run(
        design, "design", "--candidates", "5000", "--against", "table2.csv",
        "--seed", str(way.seed), _CELL, output=_PLAN,
    )  # fmt: skip
    found = read_as(way.folder / "design.json", DesignRecord)
    papers = found.against["table2.csv"].efficiency or math.nan
    return (
        f"{len(found.poses)} poses with a certified efficiency of {100 * found.efficiency:.0f} % "
        f"(the paper's Table II: {100 * papers:.0f} %)"
    )


def measure(way: Demonstration) -> str:
    """Simulate a day of measurement, of the plan and of poses that check the result."""
    cell = load_cell(way.folder / _CELL)
    day = session(cell, load_plan(cell, way.folder / _PLAN), way.seed)
    way.withheld = day.withheld
    truth = {
        p.id: {"value": value / p.scale, "unit": p.unit}
        for p, value in zip(day.model.parameters, day.values, strict=True)
    }
    told = {"seed": way.seed, "withheld": day.withheld, "parameters": truth}
    way.write(
        {
            _DATA: measurements_csv(cell, day.plan),
            _CHECK: measurements_csv(cell, day.check),
            "truth.json": json_text(told),
        }
    )
    return (
        f"{len(day.plan)} readings of {day.plan.seen.shape[1]} markers, and {len(day.check)} more to "
        "check; the robot has one error that its model lacks"
    )


def fit(way: Demonstration) -> str:
    """Identify the cell's model."""
    way.run(
        identify, "identify", "--holdout", _CHECK, "--seed", str(way.seed), _CELL, _DATA,
        urdf="kr270_calibrated.urdf",
    )  # fmt: skip
    found = read_as(way.folder / "identify.json", IdentifyResult)
    rms, noise = found.rms_mm, found.noise
    floor = 3.0**0.5 * noise.believed_sigma_mm
    missing = ": the model lacks something" if noise.lacks else ""
    return (
        f"error {rms.nominal:.2f} mm before, {rms.fitted_all:.3f} mm after; noise alone leaves "
        f"{floor:.3f} mm{missing}"
    )


def simulate_both(way: Demonstration) -> str:
    """Both approaches at the plan and at the paper's, predicted and simulated."""
    way.run(
        compare, "compare", "--monte-carlo", "100", "--workers", "2", "--seed", str(way.seed),
        _CELL, _PLAN, "table2.csv",
    )  # fmt: skip
    found = read_as(way.folder / "compare.json", CompareRecord)
    ours, theirs = (
        {
            own.weighting if own.approach == "pose" else "points": own.task_rms_mm or math.nan
            for own in plan.approaches
        }
        for plan in found.plans
    )
    return (
        f"#2 is {ours['plain'] / ours['points']:.1f} times more accurate than plain #1, this plan "
        f"{theirs['points'] / ours['points']:.1f} times more than Table II; {found.agreement.says}"
    )


def ask_why(way: Demonstration) -> str:
    """Find the error that the model lacks."""
    way.run(diagnose, "foresight", "--plan-only", _CELL, _PLAN)
    way.run(
        diagnose, "diagnose", "--holdout", _CHECK, "--seed", str(way.seed), _CELL, _DATA,
        **{"cell-out": "better_cell.toml"},
    )  # fmt: skip
    found = read_as(way.folder / "diagnose.json", DiagnoseResult)
    before, after = found.gap.heldout_before_mm, found.gap.heldout_after_mm
    return (
        f"{found.verdict}: {', '.join(own.names for own in found.effects)}. Held-out poses: "
        f"{before:.3f} to {after:.3f} mm (hidden: {way.withheld})"
    )


def tell(way: Demonstration) -> str:
    """The page for a colleague."""
    results = [
        f"{name}.json" for name in ("identify", "diagnose", "design", "foresight", "compare")
    ]
    way.run(
        report, "report", "--instrument", "simulated tracker, 0.010 mm", *results,
        output="report.html",
    )  # fmt: skip
    return f"{way.folder / 'report.html'}: open it in a browser"


STEPS: tuple[tuple[str, Callable[[Demonstration], str]], ...] = (
    ("design: which fifteen poses to measure, three at each of five angles of A2", plan),
    ("measure: simulated, free and with 250 kg on the tool", measure),
    ("identify: base, tool, geometry and compliances", fit),
    ("compare: marker points and full pose, with simulated experiments", simulate_both),
    ("diagnose: what the model lacks", ask_why),
    ("report", tell),
)
