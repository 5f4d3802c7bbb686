"""YAML whose numbers can be replaced in place, and what is refused of it."""

from __future__ import annotations

from pathlib import Path

import pytest

from calib.errors import InputError
from calib.files.yaml_text import Node, Scalar, read_yaml, rewritten

MATRIX = """%YAML:1.0
---
made: "Thu Jan 30 # 14:43"   # by hand
K: !!opencv-matrix
   rows: 1
   data: [ 1.5e+03, 0.,
       -4., ]
none:
last: 'x y'
"""


def scalars(node: Node) -> list[Scalar]:
    if isinstance(node, Scalar):
        return [node]
    below = node.values() if isinstance(node, dict) else node
    return [own for part in below for own in scalars(part)]


@pytest.mark.parametrize("end", ["\n", "\r\n"])
def test_words_stand_where_they_are_said_to(tmp_path: Path, end: str) -> None:
    path = tmp_path / "x.yaml"
    path.write_bytes(MATRIX.replace("\n", end).encode())
    file = read_yaml(path)
    found = scalars(file.root)
    assert [own.word for own in found] == [
        "Thu Jan 30 # 14:43", "1", "1.5e+03", "0.", "-4.", "x y",
    ]  # fmt: skip
    assert [own.line for own in found] == [3, 5, 6, 6, 7, 9]
    assert file.root["none"] == {}
    changed = rewritten(file.text, dict(zip(found[2:5], ("1", "22", "333"), strict=True)))
    numbers = MATRIX.replace("1.5e+03, 0.,\n       -4.", "1, 22,\n       333")
    assert changed == numbers.replace("\n", end)


def test_a_list_or_nothing_at_the_top(tmp_path: Path) -> None:
    path = tmp_path / "x.yaml"
    path.write_text("- 1\n- a: 2\n---\n")
    assert [own.word for own in scalars(read_yaml(path).root[""])] == ["1", "2"]
    path.write_text("# nothing\n")
    assert read_yaml(path).root == {}


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("a: &x 1\nb: [*x, *x]\n", "line 1: &x and references to it are not read"),
        ("a: 1\nb: {x: 1, x: 2}\n", "line 2: key 'x' stands twice"),
        ("a:\n  b: 1\n c: 2\n", "line 3: is no YAML: expected <block end>"),
        ("words\n", "line 1: holds neither 'key: value' nor '- value'"),
        ("[a]: 1\n", "line 1: has a key that is no word"),
        (
            "a: !!python/object/apply:os.system [x]\n",
            "line 1: has the tag '.*os.system', which is not",
        ),
        ("a: \0\n", "x.yaml: is no YAML"),
        ("a: 1\n---\nb: 1\n", "holds a second document"),
        ("- " * 50 + "1\n", "line 1: is nested too deeply"),
        ("- " * 5000 + "1\n", "x.yaml: is nested too deeply"),
    ],
)
def test_what_is_refused(tmp_path: Path, text: str, said: str) -> None:
    path = tmp_path / "x.yaml"
    path.write_text(text)
    with pytest.raises(InputError, match=said):
        read_yaml(path)
