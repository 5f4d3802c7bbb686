"""YAML as programs write it, against what the same text holds for the YAML readers of others."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from calib.errors import InputError
from calib.files.plain_yaml import Node, Scalar, read_yaml, rewritten

MATRIX = """%YAML:1.0
---
made: "Thu Jan 30 # 14:43"   # by hand
K: !!opencv-matrix
   rows: 1
   cols: 3
   dt: d
   data: [ 1.5e+03, 0.,
       -4., ]
last: 'x y'
"""
LISTS = """-\x20
  a:
    - 0.5
    - -0.25
  b:
  - 1
-
  a: [1, {x: 2, 'y': [3]}]
- - 4
  - 5
- c: 6
  d: 7
"""


def plain(node: Node) -> Any:
    if isinstance(node, Scalar):
        return node.word
    if isinstance(node, dict):
        return {key: plain(own) for key, own in node.items()}
    return [plain(own) for own in node]


def scalars(node: Node) -> list[Scalar]:
    if isinstance(node, Scalar):
        return [node]
    below = node.values() if isinstance(node, dict) else node
    return [own for part in below for own in scalars(part)]


@pytest.mark.parametrize(
    ("text", "holds"),
    [
        (
            MATRIX,
            {
                "made": "Thu Jan 30 # 14:43",
                "K": {"rows": "1", "cols": "3", "dt": "d", "data": ["1.5e+03", "0.", "-4."]},
                "last": "x y",
            },
        ),
        (
            LISTS,
            {
                "": [
                    {"a": ["0.5", "-0.25"], "b": ["1"]},
                    {"a": ["1", {"x": "2", "y": ["3"]}]},
                    ["4", "5"],
                    {"c": "6", "d": "7"},
                ]
            },
        ),
        ("a:\n- 1\n- 2\nb: 3\n", {"a": ["1", "2"], "b": "3"}),
        ("---\n\na:   {x: 1,y: 2}   # z\n'b': \"c d\"\n", {"a": {"x": "1", "y": "2"}, "b": "c d"}),
        ("a:\nb: {}\n---\n", {"a": {}, "b": {}}),
        ('{"a": [1,\n  -2.5], "b":{"c" : "x, y"}}\n', {"a": ["1", "-2.5"], "b": {"c": "x, y"}}),
        ("[1, [2]]", {"": ["1", ["2"]]}),
        ("", {}),
    ],
)
@pytest.mark.parametrize("end", ["\n", "\r\n"])
def test_what_is_read_and_where_it_stands(tmp_path: Path, text: str, holds: Any, end: str) -> None:
    path = tmp_path / "x.yaml"
    path.write_bytes(text.replace("\n", end).encode())
    file = read_yaml(path)
    assert plain(file.root) == holds
    assert file.text == text.replace("\n", end)
    for own in scalars(file.root):
        assert file.text[own.start : own.stop] == own.text
        assert own.text in file.text.split("\n")[own.line - 1]


def test_other_numbers_in_the_same_text(tmp_path: Path) -> None:
    path = tmp_path / "x.yaml"
    path.write_text(MATRIX)
    file = read_yaml(path)
    data = scalars(file.root["K"])[-3:]
    assert rewritten(file.text, dict(zip(data, ("1", "22", "333"), strict=True))) == MATRIX.replace(
        "1.5e+03, 0.,\n       -4.", "1, 22,\n       333"
    )


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("a: &x 1\n", "line 1: '&x 1' is no number or word"),
        ("a: !!python/object:os.system x\n", "line 1: '!!python/object:os.system x' is no number"),
        ("a: 1\na: 2\n", "line 2: key 'a' stands twice"),
        ("a: {x: 1, x: 2}\n", "line 1: key 'x' stands twice"),
        ("a: 1\n  b: 2\n", "line 2: is none of the YAML"),
        ("a:\n  b: 1\n c: 2\n", "line 3: is none of the YAML"),
        ("- 1\nb: 2\n", "line 2: is none of the YAML"),
        ("[1]\na: 2\n", "line 2: is none of the YAML"),
        ("words\n", "line 1: is none of the YAML"),
        ("a: [1, 2\n", r"line 1: '\[1, 2' is no list of numbers"),
        ("a: {x: 1, 2}\n", "line 1: '{x: 1, 2}' is no map of numbers"),
        ("a: [1,\n 2] 3\n", "line 2: '3' follows a bracket"),
        ("a: 1\n---\nb: 1\n", "line 3: begins a second document"),
        ("- " * 5000 + "1\n", "line 1: is nested too deeply"),
        ("a: " + "[" * 5000 + "\n", "line 1: .* is no list of numbers"),
    ],
)
def test_what_is_none_of_it(tmp_path: Path, text: str, said: str) -> None:
    path = tmp_path / "x.yaml"
    path.write_text(text)
    with pytest.raises(InputError, match=said):
        read_yaml(path)
