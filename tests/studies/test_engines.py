"""Who computes the trials changes no digit; faults end in one line."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator
from concurrent.futures import Executor, ThreadPoolExecutor
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from click.testing import Result

from studies.compare import engine as engines
from studies.compare import simulate
from studies.compare.engine import engine
from studies.compare.experiment import Prediction, SimulatedExperiment, experiment_of, predict
from studies.compare.simulate import MOST_TRIALS, Refits, refits
from studies.demo.embedded import embedded_text
from tests.helpers import cell_of, random_poses, random_robot
from tests.studies.command_line import paper_cell, run

Study = tuple[SimulatedExperiment, list[Prediction]]
COUNTS = (1, MOST_TRIALS - 1, MOST_TRIALS, 2 * MOST_TRIALS + 17)
NOWHERE = "tcp://127.0.0.1:1"


@pytest.fixture(scope="module")
def study() -> Study:
    rng = np.random.default_rng(3)
    robot = random_robot(rng, 3)
    cell = cell_of(robot, rng.uniform(-0.2, 0.2, (3, 3)), ["tool", "joint_compliance"])
    experiment = experiment_of(cell, random_poses(rng, robot, 5))
    return experiment, [predict(experiment, way) for way in experiment.ways]


@pytest.fixture(scope="module")
def scheduler() -> Iterator[str]:
    """Address of a dask cluster of two processes."""
    distributed = pytest.importorskip("distributed")
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, host="127.0.0.1", dashboard_address="127.0.0.1:0"
    ) as cluster:
        yield cluster.scheduler_address


@pytest.fixture(scope="module", params=["threads", "processes", "dask"])
def executor(request: pytest.FixtureRequest) -> Iterator[Executor | None]:
    with ExitStack() as stack:
        if request.param == "threads":
            yield stack.enter_context(ThreadPoolExecutor(4))
        elif request.param == "processes":
            yield stack.enter_context(engine(workers=2))
        else:
            address = request.getfixturevalue("scheduler")
            yield stack.enter_context(engine(scheduler=address))


def fresh(study: Study) -> Study:
    """The study without what its model remembers."""
    experiment, predictions = study
    return replace(experiment, model=replace(experiment.model)), predictions


def same(a: dict[str, Refits], b: dict[str, Refits]) -> bool:
    return a.keys() == b.keys() and all(
        np.array_equal(a[way].errors, b[way].errors)
        and np.array_equal(a[way].settled, b[way].settled)
        for way in a
    )


@pytest.mark.long
@pytest.mark.parametrize("trials", COUNTS)
def test_no_digit_depends_on_who_computes(
    study: Study, executor: Executor | None, trials: int
) -> None:
    here = refits(*fresh(study), trials, seed=(5, 1))
    there = refits(*fresh(study), trials, seed=(5, 1), executor=executor)
    assert {len(own.cost) for own in (*here.values(), *there.values())} == {trials}
    assert len(here) == 4
    assert np.stack([own.errors for own in here.values()]).any()
    assert same(here, there)


@pytest.fixture
def small(tmp_path: Path) -> list[str]:
    """Arguments of a comparison whose blocks are fast."""
    paper_cell(tmp_path, "tool", "joint_compliance:A3,A4")
    plan = embedded_text("plan.csv").splitlines()
    (tmp_path / "plan.csv").write_text("\n".join(plan[:5]) + "\n")
    (tmp_path / "other.csv").write_text("\n".join([plan[0], *plan[5:9]]) + "\n")
    return [str(tmp_path / "cell.toml"), str(tmp_path / "plan.csv")]


def compare(*options: str) -> Result:
    return run("compare", *options)


def one_line(done: Result, *words: str) -> None:
    assert done.exit_code == 2, done.output
    assert len(done.stderr.splitlines()) == 1, done.stderr
    assert done.stderr.startswith("posecal: --")
    assert all(word in done.stderr for word in words), done.stderr


@pytest.mark.long
def test_nothing_listens(small: list[str], monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("distributed")
    monkeypatch.setattr(engines, "_PATIENCE_S", 1)
    one_line(compare(*small, "--scheduler", NOWHERE), NOWHERE)


@pytest.mark.long
def test_dask_is_not_installed(small: list[str], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "distributed", None)
    one_line(compare(*small, "--scheduler", NOWHERE), "dask is not installed", "pip install")


def die(*_: object) -> None:
    os._exit(1)


@pytest.mark.long
def test_a_worker_that_dies(small: list[str], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(simulate, "refit", die)
    done = compare(*small, "--monte-carlo", "200", "--workers", "2")
    one_line(done, "--workers: 2", "a worker died")


@pytest.mark.long
def test_a_fault_of_a_block_is_not_hidden(
    small: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(simulate, "refit", divmod)
    done = compare(*small, "--monte-carlo", "200", "--workers", "2")
    assert isinstance(done.exception, TypeError)
