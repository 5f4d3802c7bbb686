"""Old results stay whole whatever happens while new ones are written."""

from __future__ import annotations

import os
import random
import resource
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from calib.errors import InputError
from calib.files.write import write_files

OLD = b"old\n"


@pytest.fixture
def old(tmp_path: Path) -> Path:
    path = tmp_path / "result.json"
    path.write_bytes(OLD)
    return path


def names(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir())


def child(code: str, *words: object, **options: object) -> subprocess.Popen[bytes]:
    call = [sys.executable, "-c", code, *map(str, words)]
    return subprocess.Popen(call, stderr=subprocess.PIPE, **options)  # type: ignore[call-overload]


TARGETS = {
    "a folder": ("folder", r"folder: cannot be written \(is a folder\); name a file in it"),
    "a missing folder": ("no/new.json", r"cannot be written \(no such folder\); make the folder"),
    "a file for a folder": ("result.json/new.json", r"cannot be written \(no such folder\)"),
    "a name too long": ("x" * 300, r"cannot be written \(File name too long\); name another"),
    "a NUL": ("a\0b", r"cannot be written \(no name of a file\); name another"),
    "a link to nowhere": ("broken", r"cannot be written \(No such file or directory\)"),
    "a full device": ("/dev/full", r"cannot be written \(No space left on device\)"),
}


@pytest.mark.parametrize("case", TARGETS)
def test_one_bad_target_leaves_everything_as_it_was(case: str, old: Path) -> None:
    folder = old.parent
    (folder / "folder").mkdir()
    (folder / "broken").symlink_to("nowhere/new.json")
    before = names(folder)
    target, said = TARGETS[case]
    for order in (1, -1):
        contents = [(old, b"new\n"), (folder / target, b"new\n")][::order]
        with pytest.raises(InputError, match=said):
            write_files(dict(contents))
        assert old.read_bytes() == OLD
        assert names(folder) == before


def test_links_are_followed_and_permissions_kept(old: Path) -> None:
    old.chmod(0o640)
    link, dangling = old.parent / "link", old.parent / "dangling"
    link.symlink_to(old.name)
    dangling.symlink_to("made.json")
    write_files({link: "new\n", dangling: "made\n"})
    assert link.is_symlink()
    assert old.read_text() == "new\n"
    assert old.stat().st_mode & 0o777 == 0o640
    assert (old.parent / "made.json").read_text() == "made\n"


def test_new_files_follow_the_umask(old: Path) -> None:
    before = os.umask(0o027)
    try:
        write_files({old.parent / "new": "x"})
    finally:
        os.umask(before)
    assert (old.parent / "new").stat().st_mode & 0o777 == 0o640


def test_no_space_in_the_middle_of_a_file(old: Path) -> None:
    """A limit on the size of files stands for a disk that fills while the second one is written."""
    small = old.parent / "small"
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (10_000, limits[1]))
    try:
        with pytest.raises(InputError, match=r"result.json: cannot be written \(File too large\)"):
            write_files({small: b"s", old: b"n" * 100_000})
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    assert old.read_bytes() == OLD
    assert names(old.parent) == ["result.json"]


# A shell that starts the tests in the background has them ignore interrupts, and so their children.
WRITER = """
import signal
import sys
from pathlib import Path
signal.signal(signal.SIGINT, signal.default_int_handler)
from calib.files.write import write_files
folder = Path(sys.argv[1])
n = 0
while True:
    n += 1
    write_files({folder / name: f"{n}\\n" * 100_000 for name in ("a", "b")})
"""


@pytest.mark.parametrize(("end", "times"), [(signal.SIGKILL, 2), (signal.SIGINT, 1)])
def test_ended_at_any_moment_every_file_is_whole(
    end: signal.Signals, times: int, tmp_path: Path
) -> None:
    rng = random.Random()
    for _ in range(times):
        process = child(WRITER, tmp_path)
        while not (tmp_path / "b").exists():
            time.sleep(0.005)
        time.sleep(rng.uniform(0.0, 0.1))
        process.send_signal(end)
        process.communicate()
        for name in ("a", "b"):
            rows = (tmp_path / name).read_text().split("\n")
            assert len(rows) == 100_001
            assert len(set(rows[:-1])) == 1
            (tmp_path / name).unlink()
        if end == signal.SIGINT:
            assert names(tmp_path) == [], "no temporary file is left"
        for left in tmp_path.iterdir():
            left.unlink()
