"""Texts of results are no markup in a page, and the check of a page can fail."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from studies.report import Reported, page_of
from tests.fuzz.report import check_harmless
from tests.fuzz.small_cell import put_small_cell, small_results

_SCRIPT = "</script><script>alert(1)</script><!--\"'><img src=x onerror=alert(2)>&lt;"


def _hostile(value: Any) -> Any:
    """Texts with a script behind them, wherever a user writes them."""
    if isinstance(value, dict):
        own = ("pose", "marker", "name", "reason", "cell", "targets", "instrument")
        return {
            k: v + _SCRIPT if k in own and isinstance(v, str) else _hostile(v)
            for k, v in value.items()
        }
    return [_hostile(own) for own in value] if isinstance(value, list) else value


def test_texts_of_results_do_nothing_in_a_page(tmp_path: Path) -> None:
    put_small_cell(tmp_path)
    paths = []
    for name in ("identified", "diagnosed", "designed", "compensated"):
        paths.append(tmp_path / f"{name}.json")
        paths[-1].write_text(json.dumps(_hostile(small_results()[name])))
    html = page_of([Reported.read(path) for path in paths], None, {}).html
    assert "alert(1)" in html
    check_harmless(html)


@pytest.mark.parametrize(
    "harm",
    [
        "<img src='data:image/png;base64,'>",
        "<p onclick='x'>",
        "<a href='javascript:x'>",
        "<p style='background: url(http://x)'>",
        "<script>1</script>",
        "<script type='module'>1</script>",
    ],
)
def test_harm_is_seen(harm: str) -> None:
    own = "<a href='#x'>x</a>"
    check_harmless(own)
    with pytest.raises(AssertionError):
        check_harmless(own + harm)
