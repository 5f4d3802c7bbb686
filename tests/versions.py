"""The lowest declared versions and the newest ones go the short way: python -m tests.versions.

Each gets an environment of its own, made by uv. A Python that is not there is said and skipped.
"""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path
from tempfile import TemporaryDirectory

from tests.helpers import measured_cell

_ROOT = Path(__file__).resolve().parent.parent
_ASKED = (("3.11", "lowest-direct"), ("3.13", "highest"))
_TARGETS = "A1_deg,A2_deg,A3_deg,A4_deg,A5_deg,A6_deg\n12,-60,70,20,45,10\n-30,-90,100,0,30,0\n"
_WAY = (
    "design cell.toml --candidates 300 --criterion D -o plan.csv --json d.json",
    "identify cell.toml measurements.csv --json i.json --urdf better.urdf --figures figures",
    "enough cell.toml measurements.csv --goal-mm 0.02",
    "compensate cell.toml i.json targets.csv -o corrected.csv",
    "report i.json d.json -o report.html",
)


def uv(*arguments: object) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "uv", *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, check=False)


def went(python: str, resolution: str, folder: Path) -> bool:
    """Whether every command ends well, where this Python is found."""
    made = uv("venv", "--no-python-downloads", "-p", python, folder / "venv")
    if made.returncode:
        print(f"Python {python}, {resolution}: skipped, no such Python here")
        return True
    own = folder / "venv" / ("Scripts" if sys.platform == "win32" else "bin")
    installed = uv("pip", "install", "-p", own / "python", "--resolution", resolution, _ROOT)
    if installed.returncode:
        print(f"Python {python}, {resolution}: not installed\n{installed.stderr}")
        return False
    data = folder / "data"
    data.mkdir()
    measured_cell(data)
    (data / "targets.csv").write_text(_TARGETS)
    for command in _WAY:
        done = subprocess.run(
            [own / "posecal", *command.split()],
            cwd=data,
            capture_output=True,
            text=True,
            check=False,
        )
        if done.returncode:
            print(f"Python {python}, {resolution}: posecal {command}\n{done.stderr}")
            return False
    print(f"Python {python}, {resolution}: {len(_WAY)} commands went well")
    return True


def main() -> int:
    """Each resolution in turn; one where any failed."""
    all_well = True
    for python, resolution in _ASKED:
        with TemporaryDirectory() as name:
            all_well &= went(python, resolution, Path(name))
    return 0 if all_well else 1


if __name__ == "__main__":
    sys.exit(main())
