"""Commands run in this process, and the paper's cell on disk."""

from __future__ import annotations

import re
from pathlib import Path

from click.testing import CliRunner, Result

from studies.cli import main
from studies.demo.embedded import INPUTS, embedded_text


def run(*arguments: object) -> Result:
    """What ``posecal`` ends with, words and paths as they come."""
    return CliRunner().invoke(main, [str(a) for a in arguments])


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
