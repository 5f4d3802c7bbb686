"""Who computes the trials changes no digit; interruptions and faults end in one line."""

from __future__ import annotations

import json
import multiprocessing
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from concurrent.futures import Executor, Future, ThreadPoolExecutor
from contextlib import ExitStack, contextmanager
from dataclasses import replace
from multiprocessing.process import BaseProcess
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import Result

from studies import engines
from studies.compare import command, montecarlo
from studies.compare.experiment import SimulatedExperiment, experiment_of
from studies.compare.montecarlo import MOST_TRIALS, Refits, refits
from studies.compare.prediction import Prediction, predict
from studies.demo.embedded import embedded_text
from studies.engines import engine
from tests.helpers import cell_of, random_poses, random_robot
from tests.studies.command_line import paper_cell, run

pytestmark = pytest.mark.long

Study = tuple[SimulatedExperiment, list[Prediction]]
COUNTS = (1, MOST_TRIALS - 1, MOST_TRIALS, 2 * MOST_TRIALS + 17)
RUN = [sys.executable, "-c", "from studies.cli import run; run()", "compare"]
NOWHERE = "tcp://127.0.0.1:1"


@pytest.fixture(scope="module")
def study() -> Study:
    rng = np.random.default_rng(3)
    robot = random_robot(rng, 3)
    cell = cell_of(robot, rng.uniform(-0.2, 0.2, (3, 3)), ["tool", "joint_compliance"])
    experiment = experiment_of(cell, random_poses(rng, robot, 5))
    return experiment, [predict(experiment, way) for way in experiment.ways]


def children(*, of_dask: bool) -> set[BaseProcess]:
    """Processes of this one; dask starts its own anew where one died, whenever it likes."""
    return {p for p in multiprocessing.active_children() if ("Dask" in p.name) == of_dask}


@pytest.fixture(scope="module")
def scheduler() -> Iterator[str]:
    """Address of a dask cluster of two processes, where the first death of a worker is a fault."""
    dask = pytest.importorskip("dask")
    distributed = pytest.importorskip("distributed")
    with (
        dask.config.set({"distributed.scheduler.allowed-failures": 0}),
        distributed.LocalCluster(
            n_workers=2, threads_per_worker=1, host="127.0.0.1", dashboard_address="127.0.0.1:0"
        ) as cluster,
    ):
        yield cluster.scheduler_address
    assert not children(of_dask=True)


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


def same(a: Refits, b: Refits) -> bool:
    return a.errors.keys() == b.errors.keys() and all(
        np.array_equal(a.errors[way], b.errors[way])
        and np.array_equal(a.settled[way], b.settled[way])
        for way in a.errors
    )


@pytest.mark.parametrize("trials", COUNTS)
def test_no_digit_depends_on_who_computes(
    study: Study, executor: Executor | None, trials: int
) -> None:
    here = refits(*fresh(study), trials, seed=(5, 1))
    there = refits(*fresh(study), trials, seed=(5, 1), executor=executor)
    assert here.trials == there.trials == trials
    assert len(here.errors) == 4
    assert np.stack(list(here.errors.values())).any()
    assert same(here, there)


# -- interruption --------------------------------------------------------------------------------


def interrupt_at(count: int) -> Callable[[int], None]:
    done: list[int] = []

    def progress(trials: int) -> None:
        done.append(trials)
        if len(done) == count:
            raise KeyboardInterrupt

    return progress


def test_an_interruption_keeps_what_is_done(study: Study, executor: Executor | None) -> None:
    found = refits(*fresh(study), 10 * MOST_TRIALS, executor=executor, progress=interrupt_at(2))
    assert found.asked == 10 * MOST_TRIALS
    assert found.trials == 2 * MOST_TRIALS
    again = refits(*fresh(study), 3, executor=executor)
    assert again.trials == 3, "the executor can be used again"


class Interrupting(ThreadPoolExecutor):
    """Ctrl-C comes while a block is submitted, when a lock may be taken."""

    through = 0

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        signal.raise_signal(signal.SIGINT)
        self.through += 1
        return super().submit(fn, *args, **kwargs)


def test_an_interruption_waits_until_no_lock_is_taken(study: Study) -> None:
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        with Interrupting(2) as executor:
            found = refits(*fresh(study), 10 * MOST_TRIALS, executor=executor)
        assert executor.through == 10
        assert found.trials < found.asked
        assert signal.getsignal(signal.SIGINT) is signal.default_int_handler
    finally:
        signal.signal(signal.SIGINT, before)


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


def test_an_interrupted_command_writes_what_is_done(
    small: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    @contextmanager
    def progress(*_: object) -> Iterator[Callable[[int], None]]:
        yield interrupt_at(2)

    monkeypatch.setattr(command, "progress_bar", progress)
    out = tmp_path / "result.json"
    done = compare(*small, "--monte-carlo", "170", "--workers", "1", "--json", str(out))
    assert done.exit_code == 0, done.output
    fields = json.loads(out.read_text())
    assert (fields["trials"], fields["trials_asked"]) == (2 * MOST_TRIALS, 170)
    assert "stopped    plan.csv: 100 of 170 experiments simulated" in done.stdout


def alive(session: int) -> list[str]:
    """Processes of a session that have not ended."""
    found = []
    for path in Path("/proc").glob("[0-9]*/stat"):
        try:
            fields = path.read_text().rpartition(")")[2].split()
        except OSError:
            continue  # it ended meanwhile
        if int(fields[3]) == session and fields[0] != "Z":
            found.append(path.parent.name)
    return found


def wait_until(fact: Callable[[], bool], seconds: float) -> bool:
    end = time.monotonic() + seconds
    while not fact() and time.monotonic() < end:
        time.sleep(0.05)
    return fact()


@contextmanager
def started(*options: str) -> Iterator[subprocess.Popen[str]]:
    """A comparison in a process group of its own, as a terminal would start it."""
    with subprocess.Popen(
        [*RUN, *options],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    ) as process:
        try:
            yield process
        finally:
            if alive(process.pid):
                os.killpg(process.pid, signal.SIGKILL)


linux = pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="no /proc")


@linux
@pytest.mark.parametrize("after", [0.0, 0.3, 2.5], ids=["at once", "workers start", "at work"])
def test_ctrl_c_ends_the_command_and_its_workers(
    small: list[str], tmp_path: Path, after: float
) -> None:
    out = tmp_path / "result.json"
    before = sorted(p.name for p in tmp_path.iterdir())
    options = ("--monte-carlo", "200000", "--workers", "2", "--json", str(out))
    with started(*small, *options) as process:
        # The command, a resource tracker, two workers.
        assert wait_until(lambda: len(alive(process.pid)) >= 4, 30.0)
        time.sleep(after)
        os.killpg(process.pid, signal.SIGINT)
        begun = time.monotonic()
        stdout, stderr = process.communicate(timeout=30.0)
        assert time.monotonic() - begun < 10.0
        assert wait_until(lambda: not alive(process.pid), 5.0), "no worker is left"
    assert "Traceback" not in stdout + stderr
    if out.exists():
        fields = json.loads(out.read_text())
        assert fields["trials"] < fields["trials_asked"]
        assert "experiments simulated" in stdout
        assert process.returncode == 0
        assert not stderr
    else:
        assert process.returncode != 0
        assert len(stderr.strip().splitlines()) == 1
        assert "interrupted" in stderr
        assert sorted(p.name for p in tmp_path.iterdir()) == before


# -- faults --------------------------------------------------------------------------------------


def one_line(done: Result, *words: str) -> None:
    assert done.exit_code == 2, done.output
    assert len(done.stderr.splitlines()) == 1, done.stderr
    assert done.stderr.startswith("posecal: --")
    assert all(word in done.stderr for word in words), done.stderr


def test_nothing_listens(
    small: list[str], monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    pytest.importorskip("distributed")
    monkeypatch.setattr(engines, "_PATIENCE_S", 1)
    begun = time.monotonic()
    one_line(compare(*small, "--scheduler", NOWHERE), NOWHERE)
    assert time.monotonic() - begun < 5.0
    assert capfd.readouterr() == ("", ""), "nor does dask say more"


def test_a_cluster_without_workers(small: list[str]) -> None:
    distributed = pytest.importorskip("distributed")
    with distributed.LocalCluster(
        n_workers=0, host="127.0.0.1", dashboard_address="127.0.0.1:0"
    ) as cluster:
        address = cluster.scheduler_address
        one_line(compare(*small, "--scheduler", address), address, "has no workers")


def test_dask_is_not_installed(small: list[str], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "distributed", None)
    one_line(compare(*small, "--scheduler", NOWHERE), "dask is not installed", "pip install")


def die(*_: object) -> None:
    os._exit(1)


def test_a_worker_that_dies(
    small: list[str],
    monkeypatch: pytest.MonkeyPatch,
    capfd: pytest.CaptureFixture[str],
) -> None:
    before = children(of_dask=False)
    monkeypatch.setattr(montecarlo, "refit", die)
    done = compare(*small, "--monte-carlo", "200", "--workers", "2")
    one_line(done, "--workers: 2", "a worker died")
    assert not children(of_dask=False) - before
    assert capfd.readouterr() == ("", ""), "nor does the worker say more"


def test_a_worker_of_the_cluster_that_dies(
    small: list[str], scheduler: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(montecarlo, "refit", die)
    one_line(compare(*small, "--scheduler", scheduler), scheduler, "its workers died")


def test_a_fault_of_a_block_is_not_hidden(
    small: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(montecarlo, "refit", divmod)
    done = compare(*small, "--monte-carlo", "200", "--workers", "2")
    assert isinstance(done.exception, TypeError)
