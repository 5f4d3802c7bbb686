"""Write results: complete under a temporary name first, then renamed, so nothing is half written."""

from __future__ import annotations

import json
import math
import os
import secrets
import shutil
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from calib.errors import InputError


def check_target(path: Path) -> None:
    """Refuse what cannot become a file. Raises InputError."""
    what, remedy = "", "name another"
    try:
        if "\0" in str(path):
            what = "no name of a file"
        elif path.is_dir():
            what, remedy = "is a folder", "name a file in it"
        elif not path.parent.is_dir():
            what, remedy = "no such folder", "make the folder first"
    except OSError as error:  # a name too long
        what = str(error.strerror)
    if what:
        raise InputError(path, "", f"cannot be written ({what})", remedy)


def make_folder(folder: Path) -> None:
    """Make a folder, and those above it, if it is not there. Raises InputError."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except (OSError, ValueError) as error:
        said = error.strerror if isinstance(error, OSError) else "no name of a folder"
        raise InputError(folder, "", f"cannot be made ({said})", "name another") from None


def write_files(contents: Mapping[Path, str | bytes]) -> None:
    """Write several files, all or none: every content is on disk before the first is renamed.

    Text is written as UTF-8 with its line ends as they are, bytes unchanged. A link is followed: the
    file that it names is replaced.

    Raises InputError where a folder is missing, read-only or full; existing files stay whole.
    """
    prepared: list[tuple[Path, Path]] = []
    path = Path()
    for path in contents:
        check_target(path)
    try:
        for path, content in contents.items():
            data = content if isinstance(content, bytes) else content.encode("utf-8")
            if path.exists() and not path.is_file():
                path.write_bytes(data)  # a device or a pipe is written in place
                continue
            target = path.resolve()
            name = target.parent / f".posecal-{secrets.token_hex(8)}"
            prepared.append((name, target))  # before it is made: Ctrl-C may come at any moment
            with name.open("xb") as file:
                file.write(data)
                file.flush()
                os.fsync(file.fileno())
            if target.exists():
                shutil.copymode(target, name)
        for name, path in prepared:
            os.replace(name, path)
    except OSError as error:
        what = f"cannot be written ({error.strerror})"
        raise InputError(path, "", what, "choose another folder or free space") from None
    finally:
        for name, _ in prepared:
            name.unlink(missing_ok=True)


def json_text(result: Any) -> str:
    """JSON without NaN: what is undefined becomes null."""
    return json.dumps(_plain(result), indent=1, allow_nan=False) + "\n"


def _plain(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {str(k): _plain(v) for k, v in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(v) for v in value]
    if hasattr(value, "tolist"):
        return _plain(value.tolist())
    return None if isinstance(value, float) and not math.isfinite(value) else value
