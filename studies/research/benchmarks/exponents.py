"""How cost grows with candidates, parameters and poses, and how far it is above what must be done.

    python -m studies.research.benchmarks.exponents [--only NAME] .. [--quick] [--json FILE]

Seconds of this process, one thread, the median of three, over sizes that double; the exponent is the
slope of their logarithms, with its standard error from the scatter about the line. The limit is what
cannot be done without: the bytes that must pass once, or the multiplications, at the rates of one pass
over a large array and of one large matrix product here. Times above it are told for the largest size.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial

import click
import numpy as np

import calib
from calib.threads import one_blas_thread
from doe.optimal.blocks import Blocks, packed_size
from doe.optimal.relax import relax
from doe.optimal.search import best_plan
from studies.research.bench import Output, Row, bench, data_folder, real_data, table
from studies.research.benchmarks import design
from studies.research.benchmarks.design import any_of, timed

_BASE, _POSES = 20_000, 20  # candidates and poses while something else grows
_CASES = ("elastic", "elastic + base", "elastic + base, tool", "geometric", "all")
_GREW = {"n": (10_000, 20_000, 40_000, 80_000, 160_000), "poses": (15, 20, 40, 80, 160)}
_READ = (100, 200, 400, 800, 1495)
_GEOMETRY = ("base", "tool", "geometry")
_EFFECTS: tuple[tuple[str, ...], ...] = (
    ("base", "tool"),
    ("base", "tool", "joint_offset"),
    _GEOMETRY,
    (*_GEOMETRY, "joint_compliance"),
    (*_GEOMETRY, "transmission_harmonic"),
)


@dataclass(frozen=True)
class Run:
    """One size: seconds, and what cannot be done without, bytes and multiplications."""

    size: float
    seconds: float
    read: float = 0.0
    multiplied: float = 0.0


@dataclass(frozen=True)
class Machine:
    """Rates of one thread, bytes and multiplications a second."""

    read: float
    multiplied: float

    @classmethod
    def measured(cls) -> Machine:
        rng = np.random.default_rng(0)
        large, square = rng.normal(size=(1_000_000, 45)), rng.normal(size=(1000, 1000))
        _, passed = timed(lambda: large @ large[0])
        _, product = timed(lambda: square @ square)
        return cls(large.nbytes / passed, square.shape[0] ** 3 / product)

    def limit(self, run: Run) -> float:
        """Least seconds of such a run."""
        return max(run.read / self.read, run.multiplied / self.multiplied)


@dataclass(frozen=True)
class Line:
    """Runs over sizes of one kind."""

    what: str
    grows: str
    runs: tuple[Run, ...]

    @cached_property
    def exponent(self) -> tuple[float, float]:
        """Slope of log seconds over log size and its standard error."""
        x, y = np.log([[r.size, r.seconds] for r in self.runs]).T
        x, y = x - x.mean(), y - y.mean()
        slope = float(x @ y / (x @ x))
        scatter = float(((y - slope * x) ** 2).sum()) / max(len(x) - 2, 1)
        return slope, float(np.sqrt(scatter / (x @ x)))


def pools(quick: bool) -> Iterator[Line]:
    """Candidates linearised: each row times each, and every matrix written."""

    def run(case: str, count: int, size: float) -> Run:
        posed = design.problem(case, "D")
        design.pool(posed, 4096)
        found, seconds = timed(lambda: design.pool(posed, count))
        p = posed.regressor.T.shape[1]
        rows = posed.regressor.rank
        return Run(size, seconds, float(found.packed.nbytes), float(count * rows * packed_size(p)))

    sizes = _GREW["n"][: 3 if quick else None]
    yield Line("pool", "n", tuple(run("elastic", n, n) for n in sizes))
    yield Line("pool", "p", tuple(run(c, _BASE // 4, _parameters(c)) for c in _CASES))


def plans(quick: bool) -> Iterator[Line]:
    """Weights: every candidate read in every round. Plans: each priced once in place of each pose."""

    def relaxed(blocks: Blocks, case: str, poses: int, size: float) -> Run:
        posed, rules = design.problem(case, "D"), any_of(len(blocks), poses)
        found, seconds = timed(lambda: relax(posed.criterion, blocks, rules))
        return Run(size, seconds, float(found.rounds * blocks.packed.nbytes))

    def searched(blocks: Blocks, case: str, poses: int, size: float) -> Run:
        posed, rules = design.problem(case, "D"), any_of(len(blocks), poses)
        found = relax(posed.criterion, blocks, rules)
        _, seconds = timed(lambda: best_plan(posed.criterion, blocks, rules, found, seed=0))
        return Run(size, seconds, 0.0, float(poses * blocks.packed.size))

    sizes, poses = (_GREW[key][: 3 if quick else None] for key in ("n", "poses"))
    whole = {case: _blocks(case, max(sizes) if case == "elastic" else _BASE) for case in _CASES}
    some = partial(_first, whole["elastic"])
    for what, run in (("relaxation", relaxed), ("search", searched)):
        yield Line(what, "n", tuple(run(some(n), "elastic", _POSES, n) for n in sizes))
        grown = [(some(_BASE // 10), "elastic", k, k) for k in poses]
        yield Line(what, "poses", tuple(run(*own) for own in grown))
        own = [(_first(whole[c], _BASE // 10), c, 2 * _POSES, _parameters(c)) for c in _CASES]
        yield Line(what, "p", tuple(run(*each) for each in own))


def identifications(quick: bool) -> Iterator[Line]:
    """Real readings of a UR10: each row times each parameters' pair in every step of the last fit."""
    if not data_folder("ur10_leica_b").exists():
        return
    cell, data = real_data("ur10_leica_b")

    def run(effects: Sequence[str], count: int) -> tuple[int, Run]:
        own, chosen = replace(cell, effects=tuple(effects)), np.linspace(0, len(data) - 1, count)
        found, seconds = timed(lambda: calib.identify(own, data.take(chosen.astype(int))))
        p = len(found.values)
        steps = float(found.iterations * 3 * int(data.seen[chosen.astype(int)].sum()))
        return p, Run(count, seconds, 0.0, steps * packed_size(p))

    counts = _READ[: 3 if quick else None]
    yield Line("identify", "poses", tuple(run(cell.effects, m)[1] for m in counts))
    grown = [run(effects, counts[-1]) for effects in _EFFECTS]
    yield Line("identify", "p", tuple(replace(own, size=p) for p, own in grown))


def _blocks(case: str, count: int) -> Blocks:
    posed = design.problem(case, "D")
    return posed.blocks(design.pool(posed, count))


def _parameters(case: str) -> int:
    return len(design.problem(case, "D").model.parameters)


def _first(blocks: Blocks, count: int) -> Blocks:
    return blocks.take(np.arange(count))


LINES: dict[str, Callable[[bool], Iterator[Line]]] = {
    "pool": pools,
    "plans": plans,
    "identify": identifications,
}


@bench(
    click.option(
        "--only", "names", multiple=True, type=click.Choice(list(LINES)), help="These alone."
    ),
    click.option("--quick", is_flag=True, help="Three sizes of each."),
)
@one_blas_thread
def main(names: tuple[str, ...], quick: bool, seed: int) -> Output:
    """Measure how cost grows; some minutes."""
    del seed
    machine = Machine.measured()
    found = [line for name in names or LINES for line in LINES[name](quick)]
    rates = (
        f"one thread reads {machine.read / 1e9:.1f} GB/s and makes {machine.multiplied / 1e9:.1f} "
        "billion multiplications a second\n"
    )
    rows = [
        {"what": line.what, "grows": line.grows, "exponent": line.exponent,
         "runs": [vars(r) | {"limit": machine.limit(r)} for r in line.runs]}
        for line in found
    ]  # fmt: skip
    shown = table(_told(line, machine) for line in found)
    return [rates, shown], {"machine": vars(machine), "lines": rows}


def _told(line: Line, machine: Machine) -> Row:
    first, last = line.runs[0], line.runs[-1]
    slope, error = line.exponent
    return {
        "what": line.what,
        "grows": line.grows,
        "from .. to": f"{first.size:g} .. {last.size:g}",
        "seconds": f"{first.seconds:.4g} .. {last.seconds:.4g}",
        "exponent": f"{slope:.2f} +- {error:.2f}",
        "limit [s]": machine.limit(last),
        "times the limit": last.seconds / machine.limit(last),
    }


if __name__ == "__main__":
    main()
