"""Fuzz one reader, guided by coverage: ``python -m tests.fuzz measurements --seconds 600``.

Needs the extra ``fuzz`` (atheris). Findings are named as they come, one for each place in
the code, their inputs go to ``--findings``; the last lines are libFuzzer's own figures.
"""

from __future__ import annotations

import argparse
import random
import sys
import tempfile
import traceback
from pathlib import Path

import atheris

with atheris.instrument_imports(include=["calib", "doe", "studies", "tomllib", "xml", "json"]):
    from tests.fuzz.check import broken_rule, prepared
    from tests.fuzz.readers import READERS

from tests.fuzz.reader import neighbour

_MEGABYTES = 2500


def main() -> None:
    """Run libFuzzer on the reader; ends with status 0 where nothing hangs or swells."""
    parser = argparse.ArgumentParser(prog="python -m tests.fuzz", description=__doc__)
    parser.add_argument("reader", choices=sorted(READERS))
    parser.add_argument("--seconds", type=int, default=600)
    parser.add_argument("--findings", type=Path, default=Path("fuzz-findings"))
    given = parser.parse_args()

    reader = READERS[given.reader]
    given.findings.mkdir(parents=True, exist_ok=True)
    folder = prepared(Path(tempfile.mkdtemp(prefix="posecal-fuzz-")))
    corpus = folder / "corpus"
    corpus.mkdir()
    for i, seed in enumerate(reader.seeds):
        (corpus / str(i)).write_text(seed, encoding="utf-8")
    known: set[str] = set()

    def one_input(content: bytes) -> None:
        error = broken_rule(reader, folder, content)
        if error is None:
            return
        place = "|".join(
            f"{Path(f.filename).name}:{f.lineno}" for f in traceback.extract_tb(error.__traceback__)
        )
        if place not in known:
            known.add(place)
            file = given.findings / f"{given.reader}-{len(known)}"
            file.write_bytes(content)
            print(f"FINDING {file}: {type(error).__name__}: {error!s:.300} at {place}", flush=True)

    def mutate(content: bytes, most: int, seed: int) -> bytes:
        rng = random.Random(seed)
        if rng.random() < 0.2:
            return atheris.Mutate(content, most)
        text = content.decode("utf-8", "surrogateescape")
        return neighbour(reader, text, rng).encode("utf-8", "surrogatepass")[:most]

    atheris.Setup(
        [
            sys.argv[0],
            f"-max_total_time={given.seconds}",
            f"-timeout={reader.seconds}",
            f"-rss_limit_mb={_MEGABYTES}",
            f"-max_len={max(20_000, 4 * max(map(len, reader.seeds)))}",
            "-len_control=0",
            "-print_final_stats=1",
            f"-artifact_prefix={given.findings / given.reader}-",
            str(corpus),
        ],
        one_input,
        custom_mutator=mutate,
    )
    atheris.Fuzz()


main()
