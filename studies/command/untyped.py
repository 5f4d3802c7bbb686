"""The way of results that are not yet records: their envelope as a dictionary, and their JSON."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click


def envelope(command: str, inputs: list[Path], seed: int) -> dict[str, Any]:
    """Fields that every result carries."""
    from importlib.metadata import version

    from calib.files.read import sha256

    return {
        "schema": 1,
        "command": command,
        "version": version("posecal"),
        "seed": seed,
        "inputs": [{"file": str(path), "sha256": sha256(path)} for path in inputs],
    }


def output_texts(json_path: str | None, result: dict[str, Any]) -> dict[Path, str]:
    """The JSON as a file to write; with ``-`` it goes to standard output at once."""
    from calib.files.write import json_text

    if json_path is None:
        return {}
    if json_path == "-":
        click.echo(json_text(result), nl=False)
        return {}
    return {Path(json_path): json_text(result)}
