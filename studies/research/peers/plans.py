"""posecal's plans beside FIGAROH's Detmax: the same candidates of the embedded cell, for D.

    python -m studies.research.peers.plans FOLDER [--problems 4] [--json FILE]

Each problem has links and compliances that are drawn anew, 500 to 2000 candidates, and 1.2 to 2.5 times
the poses that could do. Seconds are CPU of one thread; those of posecal hold the relaxation that its
proof needs. Detmax starts three times at random, its best plan counts, and its seconds are those of all
starts. Values and times are multiples of posecal's.
"""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import click
import numpy as np

from calib.arrays import Array
from calib.cell.planned import Planned
from doe.optimal.function import Selection
from doe.optimal.relax import relax
from doe.optimal.search import best_plan
from doe.problem import problem_of
from doe.request import Request
from studies.demo.embedded import embedded_cell
from studies.research.bench import Output, Row, bench, clocked, count, each, table
from studies.research.peers.__main__ import PROGRAMS, environment, said_by
from studies.research.problems import pool

_LIMIT = 1200.0  # s, for Detmax on all problems
_POOL, _RANK = (500, 2000), 6  # candidates; of what a pose tells
_SPARE = (1.2, 2.5)  # poses over the least that could do


def posed(index: int, seed: int) -> tuple[Selection, int]:
    """A problem, and how many poses it asks for."""
    rng = np.random.default_rng([seed, index])
    cell = embedded_cell()
    joints = np.array(cell.robot.joints)
    links, drives = (
        ",".join(joints[np.sort(rng.choice(len(joints), rng.integers(1, 6), replace=False))])
        for _ in range(2)
    )
    effects = ("base", f"geometry:{links}", f"joint_compliance:{drives}")
    cell = replace(cell, effects=effects, design=Planned())
    whole = problem_of(cell, Request(_POOL[0], "D"))
    poses = max(3, round(len(whole.model.parameters) / _RANK * rng.uniform(*_SPARE)))
    candidates = int(rng.integers(*_POOL, endpoint=True))
    asked = replace(whole, request=replace(whole.request, poses=poses))
    return pool(asked, candidates), poses


def one(index: int, seed: int) -> Row:
    """posecal's plan of a problem."""
    asked, poses = posed(index, seed)
    relaxed, before = clocked(lambda: relax(asked))
    found, searched = clocked(lambda: best_plan(asked, relaxed, seed=seed))
    return {
        "problem": str(index),
        "parameters": len(asked.blocks.fixed),
        "poses": poses,
        "candidates": len(asked),
        "value": found.value,
        "proved": found.value / relaxed.bound,
        "seconds": before + searched,
    }


@bench(
    click.argument("folder", type=click.Path(path_type=Path, file_okay=False)),
    count("--problems", 4),
)
def main(folder: Path, problems: int, seed: int) -> Output:
    """Set posecal and FIGAROH the same problems."""
    rows = each(one, [(index,) for index in range(problems)], seed=seed)
    for row, runs in zip(rows, _detmax(folder, problems, seed), strict=True):
        row["Detmax [x]"] = max(run["value"] for run in runs) / row["value"]
        row["Detmax, time [x]"] = sum(run["seconds"] for run in runs) / row["seconds"]
    return [table(rows)], {"seed": seed, "problems": rows}


def _detmax(folder: Path, problems: int, seed: int) -> list[list[Row]]:
    """Runs of each problem: their CPU seconds and the value of the plan."""
    folder.mkdir(parents=True, exist_ok=True)
    python = environment((folder / "figaroh").resolve(), PROGRAMS["figaroh"])
    drawn = {str(index): posed(index, seed) for index in range(problems)}
    work, answer = folder / "problems.npz", folder / "plans.json"
    arrays: Row = {name: _levelled(own) for name, (own, _) in drawn.items()}
    arrays |= {f"{name}_poses": np.array(poses) for name, (_, poses) in drawn.items()}
    np.savez(work, **arrays)
    driver = Path(__file__).with_name("drive_figaroh_plans.py")
    said_by([str(python), "-P", str(driver), str(work), str(answer)], _LIMIT)
    runs = json.loads(answer.read_text())["runs"]
    return [
        [{**run, "value": own.value(np.array(run["plan"]))} for run in runs if run["problem"] == n]
        for n, (own, _) in drawn.items()
    ]


def _levelled(asked: Selection) -> Array:
    """Information of every candidate, (n, p, p), in coordinates in which the mean is the identity.

    Detmax multiplies pivots, so that determinants in the cell's units are below what a float holds.
    """
    T = np.linalg.inv(np.linalg.cholesky(asked.blocks.mean))
    return np.asarray(T @ asked.blocks.matrices(np.arange(len(asked))) @ T.T)


if __name__ == "__main__":
    main()
