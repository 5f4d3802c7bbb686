"""Everything a user may get wrong ends in one line, status 2, and no file touched."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.bad_inputs.faults import FAULTS, Fault
from tests.bad_inputs.run import committed, row

LIST = (Path(__file__).parent / "messages.md").read_text(encoding="utf-8")
ALL = [fault for faults in FAULTS.values() for fault in faults]


def contents(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in folder.rglob("*") if path.is_file()}


@pytest.mark.parametrize("fault", ALL, ids=lambda fault: fault.did)
def test_one_line_says_what_where_and_what_to_do(fault: Fault, good: Path, tmp_path: Path) -> None:
    status, out, err = committed(fault, good, tmp_path / "cell")
    assert (status, out) == (2, ""), err
    assert err.count("\n") == 1, err
    assert err.strip().isprintable()
    assert row(fault, err.strip()) in LIST
    left, before = contents(tmp_path / "cell"), contents(good)
    changed = {name for name in left | before if left.get(name) != before.get(name)}
    assert changed <= {fault.file, "cell.toml" if fault.file == "targets.csv" else ""}


def test_the_list_holds_these_and_no_others() -> None:
    assert len({fault.did for fault in ALL}) == len(ALL)
    assert LIST.count("`posecal: ") + LIST.count("`posecal identify: ") >= 60
    assert sum(line.startswith("| ") for line in LIST.splitlines()) == len(ALL) + len(FAULTS)
