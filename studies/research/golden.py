"""What must not move while code changes: results of the demo, of real sets and of sealed cases.

    python -m studies.research.golden run FOLDER [--only WORD ..] [--workers 2]
    python -m studies.research.golden compare BEFORE AFTER [--tolerance 1e-12]

``run`` writes one JSON a case by the command line of this checkout. ``compare`` lists the values that
differ, and the keys that only one side has; it ends with status 1 where a value differs.
"""

from __future__ import annotations

import json
import math
import os
import re
import shlex
import subprocess
import sys
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import click

ROOT = Path(__file__).parents[2]
DATA = Path(os.environ.get("POSECAL_DATA", ROOT.parent / "shared" / "data")).resolve()
DIAGNOSED = (
    "fanuc_r2000", "iiwa7_torque", "irb120_wu2015", "ma1400_cameras", "meca500_right80",
    "panda_sockets_2", "positioner_poses", "tiago",
)  # fmt: skip
IDENTIFIED = (*DIAGNOSED, "fr3_eye_in_hand", "irb120_faro", "ur10_leica_b")
OTHERWISE = {
    "justin_left": "justin/left.toml justin/left.csv",
    "justin_right": "justin/right.toml justin/right.csv",
    "hilti_flat": "hilti_column/cell.toml hilti_column/flat.csv",
    "hilti_seesaw": "hilti_column/cell.toml hilti_column/seesaw.csv",
}
DESIGNED = ("meca500_right80", "hilti_column", "tiago")
SEALED = "48 --seed 47"
UNSTEADY = {
    "seconds", "seconds_by_part", "cpu_seconds", "version", "inputs", "sha256", "holdout", "page",
    "commit", "commitment",
}  # fmt: skip
"""Keys whose values differ from run to run, or name files of the run."""
_WITHIN = {"posecal": ["-c", "from studies.cli import run; run()"],
           "sealed": ["-m", "studies.research.sealed"]}  # fmt: skip


def cases(out: Path) -> dict[str, list[str]]:
    """Name -> the calls that write its results into OUT, with the demo's folder below it."""
    usual = {name: f"{name}/cell.toml {name}/measurements.csv" for name in IDENTIFIED}
    found = {"demo": [f"posecal demo {out}/demo"]}
    for name, files in (usual | OTHERWISE).items():
        held = f"{DATA}/tiago/validation.csv" if name == "tiago" else "0.3"
        tables = " ".join(f"{DATA}/{file}" for file in files.split())
        for verb in ("identify", "diagnose")[: 1 + (name in DIAGNOSED)]:
            case = f"{verb}-{name}"
            found[case] = [f"posecal {verb} {tables} --holdout {held} --json {out}/{case}.json"]
    for name in ("no_effect", "one_effect"):
        at, case = DATA / "examples" / name, f"diagnose-{name}"
        tables = f"{at}/cell.toml {at}/measurements.csv --holdout {at}/heldout.csv"
        found[case] = [f"posecal diagnose {tables} --json {out}/{case}.json"]
    for name in DESIGNED:
        plan = f"-o {out}/design-{name}.csv --poses 20 --json {out}/design-{name}.json"
        found[f"design-{name}"] = [f"posecal design {DATA}/{name}/cell.toml {plan}"]
    folder = f"{out}/sealed"
    steps = (f"make {SEALED} {folder}", f"run {folder}", f"score {folder} --json {folder}.json")
    return {**found, "sealed": [f"sealed {step}" for step in steps]}


@click.group(help=(__doc__ or "").replace("\n\n", "\n\n\b\n"))
def main() -> None:
    """Group of both steps."""


@main.command()
@click.argument("out", type=click.Path(path_type=Path, file_okay=False))
@click.option("--only", multiple=True, help="Cases whose names hold this word; several allowed.")
@click.option("--workers", type=click.IntRange(min=1), default=1, show_default=True)
def run(out: Path, only: tuple[str, ...], workers: int) -> None:
    """Write the results of this checkout into OUT."""
    out.mkdir(parents=True, exist_ok=True)
    every = cases(out.resolve()).items()
    chosen = [case for case in every if not only or any(word in case[0] for word in only)]
    with ThreadPoolExecutor(workers) as pool:
        for name, fault in pool.map(_one, chosen):
            click.echo(f"{name}: {fault or 'done'}")


def _one(case: tuple[str, list[str]]) -> tuple[str, str]:
    """Name of a case, and what went wrong."""
    name, calls = case
    env = {**os.environ, "PYTHONPATH": str(ROOT), "COLUMNS": "100"}
    for call in calls:
        program, *words = shlex.split(call)
        command = [sys.executable, *_WITHIN[program], *words]
        done = subprocess.run(  # noqa: S603
            command, cwd=ROOT, capture_output=True, text=True, check=False, env=env
        )
        if done.returncode:
            return name, done.stderr.strip().splitlines()[-1]
    return name, ""


@main.command()
@click.argument("before", type=click.Path(path_type=Path, exists=True, file_okay=False))
@click.argument("after", type=click.Path(path_type=Path, exists=True, file_okay=False))
@click.option("--tolerance", type=float, default=1e-12, show_default=True)
def compare(before: Path, after: Path, tolerance: float) -> None:
    """Say which values of AFTER are not those of BEFORE."""
    moved = False
    for path in sorted(after.rglob("*.json")):
        name = path.relative_to(after)
        if not (before / name).exists():
            click.echo(f"{name}: only after")
            continue
        old, new = (json.loads((folder / name).read_text()) for folder in (before, after))
        found = list(differences(old, new, tolerance))
        values = [text for kind, text in found if kind == "value"]
        moved |= bool(values)
        for text in (*values[:8], *sorted({text for kind, text in found if kind == "key"})):
            click.echo(f"{name}: {text}")
        click.echo(f"{name}: {f'{len(values)} values differ' if values else 'equal'}")
    sys.exit(int(moved))


def differences(old: Any, new: Any, tolerance: float, where: str = "") -> Iterator[tuple[str, str]]:
    """Values that differ ("value"), and keys that one side lacks ("key"), with their places."""
    if isinstance(old, dict) and isinstance(new, dict):
        for key in sorted((old.keys() | new.keys()) - UNSTEADY):
            place = f"{where}.{key}"
            if key in old and key in new:
                yield from differences(old[key], new[key], tolerance, place)
            else:
                general = re.sub(r"\[\d+\]", "[]", place)
                yield "key", f"{general} only {'before' if key in old else 'after'}"
    elif isinstance(old, list) and isinstance(new, list):
        if len(old) != len(new):
            yield "value", f"{where}: {len(old)} entries -> {len(new)}"
        for i, pair in enumerate(zip(old, new, strict=False)):
            yield from differences(*pair, tolerance, f"{where}[{i}]")
    elif not _same(old, new, tolerance):
        yield "value", f"{where}: {old!r} -> {new!r}"


def _same(old: Any, new: Any, tolerance: float) -> bool:
    if any(isinstance(v, bool) or not isinstance(v, int | float) for v in (old, new)):
        return bool(old == new)
    return math.isclose(old, new, rel_tol=tolerance, abs_tol=tolerance)


if __name__ == "__main__":
    main()
