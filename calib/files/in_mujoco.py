"""MuJoCo, where it is installed: what it refuses ends in one line, what it warns of in silence."""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from calib.errors import InputError


@contextmanager
def mujoco_for(path: Path) -> Iterator[Any]:
    """The module, to compile what stands in a file.

    Raises InputError where it is not installed, and for what it refuses.
    """
    try:
        import mujoco
    except ImportError:
        raise InputError(
            path, "", "needs MuJoCo, which is not installed", "pip install 'posecal[sim]'"
        ) from None
    mujoco.set_mju_user_warning(lambda _: None)  # its own handler writes MUJOCO_LOG.TXT
    try:
        yield mujoco
    except (ValueError, mujoco.FatalError) as error:
        said = re.sub(r"(, id \d+)?, line \d+", "", str(error))
        said = "; ".join(line.strip() for line in said.splitlines() if line.strip())
        raise InputError(path, "", f"is refused by MuJoCo: {said}") from None
    finally:
        mujoco.set_mju_user_warning(None)
