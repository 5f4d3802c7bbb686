"""Making sealed cases: the same seed gives the same cases, whatever is made beside them."""

from __future__ import annotations

import secrets
from collections.abc import Callable
from pathlib import Path

import numpy as np

from studies.research.withheld.case_files import write_case
from studies.research.withheld.draw import Case, draw_case, families
from studies.research.withheld.keys import key_of
from studies.research.withheld.real import draw as real
from studies.research.withheld.seal import COMMITMENT, commit_keys, write_json
from studies.research.withheld.sensed import draw as sensed
from studies.research.withheld.sensed import files as sensed_files


def make(
    folder: Path,
    count: int,
    seed: int,
    progress: Callable[[int], None] = lambda _: None,
    *,
    arm_noise: bool = False,
    real_arms: bool = False,
    instruments: bool = False,
) -> None:
    """Write cases, keys, and last the commitment.

    arm_noise : the arms scatter from approach to approach
    real_arms : in place of the first families, arms as real ones are (``withheld.real``)
    instruments : in their place, arms that other instruments read (``withheld.sensed``)
    Raises FileExistsError where the folder holds cases already.
    """
    if (folder / COMMITMENT).exists() or (folder / "cases").exists():
        raise FileExistsError(f"{folder}: holds cases already; name a new folder")
    (folder / "keys").mkdir(parents=True)
    order = real.families if real_arms else sensed.families if instruments else families
    drawn = order(np.random.default_rng([seed, count]), count)
    for index, family in enumerate(drawn):
        name = f"case_{index:04d}"
        # The salt keeps the hash from being found by trying all that could have been drawn.
        salt = secrets.token_hex(16)
        if instruments:
            read = sensed.draw_sensed(np.random.default_rng([seed, index]), family)
            sensed_files.write_case(folder / "cases" / name, read)
            key = sensed_files.key_of(read, name, index, salt)
        else:
            case = numbered(seed, index, family, arm_noise, real_arms)
            write_case(folder / "cases" / name, case)
            key = key_of(case, name, index, salt)
        write_json(folder / "keys" / f"{name}.json", key)
        progress(index + 1)
    drawn_by = {"seed": seed, "count": count} | ({"arm_noise": True} if arm_noise else {})
    drawn_by |= {"real_arms": True} if real_arms else {}
    drawn_by |= {"instruments": True} if instruments else {}
    write_json(folder / "keys" / "seed.json", drawn_by)
    commit_keys(folder)


def numbered(
    seed: int, index: int, family: str, arm_noise: bool = False, real_arms: bool = False
) -> Case:
    """One case; each index has its own stream of random numbers."""
    if real_arms:
        return real.draw_real_case(np.random.default_rng([seed, index]), family)
    return draw_case(np.random.default_rng([seed, index]), family, arm_noise)
