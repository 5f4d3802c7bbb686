"""The lowest declared versions and the newest ones go the short way: python -m tests.versions.

Each gets an environment of its own. A Python that is not there, and versions that the package index
does not have, are said and skipped.
"""

from __future__ import annotations

import shutil
import subprocess
import sys
import tomllib
from pathlib import Path
from tempfile import TemporaryDirectory

from tests.helpers import measured_cell

_ROOT = Path(__file__).resolve().parent.parent
_ASKED = (("3.11", "lowest"), ("3.13", "newest"))
_TARGETS = "A1_deg,A2_deg,A3_deg,A4_deg,A5_deg,A6_deg\n12,-60,70,20,45,10\n-30,-90,100,0,30,0\n"
_WAY = (
    "explain cell",
    "init kr270.urdf -o my-cell",
    "design cell.toml --candidates 300 --criterion D -o plan.csv --json d.json",
    "identify cell.toml measurements.csv --json i.json --urdf better.urdf --figures figures",
    "enough cell.toml measurements.csv --goal-mm 0.02",
    "compensate cell.toml i.json targets.csv -o corrected.csv",
    "report i.json d.json -o report.html",
)

_NOWHERE = ("No matching distribution", "NewConnectionError", "Failed to establish")


def heard(*command: object, folder: Path = _ROOT) -> subprocess.CompletedProcess[str]:
    texts = list(map(str, command))
    return subprocess.run(texts, cwd=folder, capture_output=True, text=True, check=False)


def lowest() -> list[str]:
    """Every dependency at the lowest version that is declared."""
    declared = tomllib.loads((_ROOT / "pyproject.toml").read_text())["project"]["dependencies"]
    return [one.replace(">=", "==") for one in declared]


def went(python: str, which: str, folder: Path) -> bool:
    """Whether every command ends well, where this Python is found."""
    found = shutil.which(f"python{python}")
    if found is None or heard(found, "-m", "venv", folder / "venv").returncode:
        print(f"Python {python}, {which}: skipped, no such Python here")
        return True
    own = folder / "venv" / ("Scripts" if sys.platform == "win32" else "bin")
    pinned = lowest() if which == "lowest" else []
    installed = heard(own / "python", "-m", "pip", "install", "-q", ".", *pinned)
    if installed.returncode:
        absent = any(sign in installed.stderr for sign in _NOWHERE)
        what = "skipped, the index has not all of it" if absent else "not installed"
        print(f"Python {python}, {which}: {what}\n{installed.stderr}")
        return absent
    data = folder / "data"
    data.mkdir()
    measured_cell(data)
    (data / "targets.csv").write_text(_TARGETS)
    for command in _WAY:
        done = heard(own / "posecal", *command.split(), folder=data)
        if done.returncode:
            print(f"Python {python}, {which}: posecal {command}\n{done.stderr}")
            return False
    print(f"Python {python}, {which}: {len(_WAY)} commands went well")
    return True


def main() -> int:
    """Each in turn; one where any failed."""
    all_well = True
    for python, which in _ASKED:
        with TemporaryDirectory() as name:
            all_well &= went(python, which, Path(name))
    return 0 if all_well else 1


if __name__ == "__main__":
    sys.exit(main())
