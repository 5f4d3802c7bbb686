"""The figure of the arm and the page's script in a real browser."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
import pytest
from markupsafe import Markup

from calib import Cell, Poses
from calib.poses import poses_at
from studies.report.arm_scene import ArmScene, scene
from studies.report.arm_view import figure_html
from studies.report.page import asset
from tests.helpers import read_by
from tests.studies.report.cells import HOSTILE, hostile, shaped
from tests.studies.report.test_arm_fixtures import Q, cameras_of

Open: TypeAlias = Callable[..., Any]

COLOURS = (
    ":root{--ink:#111;--soft:#666;--faint:#ddd;--paper:#fff;--accent:#06a;--warn:#a30;--good:#063}"
)
AT_STATIC_SIZE = ".arm-view{width:722px;margin:0}"  # the stage has a border of 1 px
PLACES = "['x', 'y', 'cx', 'cy', 'r', 'stroke-width', 'opacity']"
PARTS = f"""() => [...document.querySelectorAll('.arm-parts *')].map((e) =>
  [e.tagName, e.getAttribute('class'), e.getAttribute('d') ?? '', e.textContent,
   {PLACES}.map((a) => e.getAttribute(a) ?? '').join(' ')])"""
HEARD = """() => { window.heard = [];
  document.addEventListener('posecal:pose', (e) => window.heard.push(e.detail)); }"""


def page_of(*pictures: ArmScene, style: str = "") -> str:
    """A page with figures and a table of their poses."""
    row = Markup('<tr data-pose="{0}" tabindex="0"><td>{0}</td><td>{1:.2f}</td></tr>')
    rows = [
        row.format(name, values[0])
        for name, values in zip(pictures[0].poses, pictures[0].values, strict=True)
    ]
    figures = [figure_html(picture, f"arm{i}") for i, picture in enumerate(pictures)]
    return (
        '<!doctype html><html lang="en"><meta charset="utf-8"><title>test</title>'
        '<meta name="viewport" content="width=device-width">'
        f"<style>{COLOURS}body{{margin:8px}}{asset('arm_view.css')}{asset('highlight.css')}{style}</style>"
        f"{''.join(figures)}<table data-sortable><thead><tr><th>pose</th><th>angle</th></tr></thead>"
        f"<tbody>{''.join(rows)}</tbody></table>"
        f"<script>{asset('arm_view.js')}</script><script>{asset('page.js')}</script></html>"
    )


@pytest.fixture(scope="module")
def plain(kr270: Cell, table_two: Poses) -> ArmScene:
    return scene(kr270, table_two, level_joint="A2")


@pytest.fixture(scope="module")
def full(kr270: Cell, table_two: Poses) -> ArmScene:
    drawn = scene(shaped(kr270), table_two, level_joint="A2")
    return replace(drawn, hidden={**drawn.hidden, (0, 1): "behind A2"})


def settled(page: Any) -> None:
    """Wait for the next drawing."""
    page.evaluate("() => new Promise((f) => requestAnimationFrame(() => requestAnimationFrame(f)))")


def parts(page: Any) -> list[list[str]]:
    settled(page)
    return list(page.evaluate(PARTS))


def readout(page: Any, figure: str = "#arm0") -> list[str]:
    settled(page)
    return list(
        page.eval_on_selector_all(
            f"{figure} .arm-now > *", "(all) => all.map((e) => e.textContent)"
        )
    )


def split(text: str) -> tuple[list[str], np.ndarray[Any, np.dtype[np.float64]]]:
    """Words and numbers of an element's attributes, apart."""
    number = r"-?\d+(?:\.\d+)?"
    return re.split(number, text), np.array([float(n) for n in re.findall(number, text)])


@pytest.mark.parametrize("which", ["plain", "full", "far", "cameras"])
def test_script_and_python_draw_the_same(
    which: str,
    open_page: Open,
    plain: ArmScene,
    full: ArmScene,
    kr270: Cell,
    table_two: Poses,
    tmp_path: Path,
) -> None:
    far = replace(kr270, instruments=read_by(stands=np.array([-9.0, -7.0, 1.0])))
    picture = {"plain": plain, "full": full, "far": scene(far, table_two)}.get(which)
    picture = picture or scene(cameras_of(tmp_path)[0], poses_at(Q))
    html = page_of(picture, style=AT_STATIC_SIZE)
    static = open_page(html, java_script_enabled=False).evaluate(PARTS)
    same(static, parts(open_page(html)))


def test_any_pose_is_drawn_as_python_draws_it(
    open_page: Open, kr270: Cell, table_two: Poses
) -> None:
    """Python draws the first pose: a plan that begins with another."""
    cell, pose = shaped(kr270), 7
    order = [pose, *(i for i in range(len(table_two)) if i != pose)]
    plan, other = scene(cell, table_two), scene(cell, table_two.take(order))
    assert plan.lost(pose) == other.lost(0) != plan.lost(0)
    static = open_page(page_of(other, style=AT_STATIC_SIZE), java_script_enabled=False)
    page = open_page(page_of(plan, style=AT_STATIC_SIZE))
    page.get_by_role("combobox", name="Pose").select_option(plan.poses[pose])
    picked = [[part for part in drawn if part[1] not in ("arm-all", "arm-tips")]
              for drawn in (static.evaluate(PARTS), parts(page))]  # fmt: skip
    same(*picked)


def same(static: list[list[str]], drawn: list[list[str]]) -> None:
    """The same elements in the same order, each where the other is."""
    for one, other in zip(static, drawn, strict=True):
        assert one[:2] + one[3:4] == other[:2] + other[3:4]
        for a, b in ((one[2], other[2]), (one[4], other[4])):
            (words_a, numbers_a), (words_b, numbers_b) = split(a), split(b)
            assert words_a == words_b
            np.testing.assert_allclose(numbers_a, numbers_b, atol=0.11)


def test_line_about_the_pose(open_page: Open, full: ArmScene) -> None:
    page = open_page(page_of(full))
    forward = page.get_by_role("button", name="Next pose")
    for i, name in enumerate(full.poses):
        assert readout(page) == [name, *full.readout(i)]
        forward.click()
    assert readout(page)[0] == full.poses[0], "after the last comes the first"
    page.get_by_role("button", name="Previous pose").click()
    assert readout(page)[0] == full.poses[-1]
    page.get_by_role("combobox", name="Pose").select_option("p07")
    assert readout(page) == ["p07", *full.readout(6)]
    assert page.locator(".arm-now").get_attribute("aria-live") == "polite"


def test_turning_by_keys_and_by_dragging(open_page: Open, plain: ArmScene) -> None:
    page = open_page(page_of(plain))
    first = parts(page)
    stage = page.locator(".arm-stage")
    stage.focus()
    for key in ("ArrowLeft", "ArrowUp", "+"):
        page.keyboard.press(key)
    turned = parts(page)
    assert turned != first
    for key in ("-", "ArrowDown", "ArrowRight"):
        page.keyboard.press(key)
    assert parts(page) == first, "back by the same keys"
    box = stage.bounding_box()
    x, y = box["x"] + 40, box["y"] + 40
    page.mouse.move(x, y)
    page.mouse.down()
    page.mouse.move(x + 25, y, steps=5)
    page.mouse.up()
    dragged = parts(page)
    assert dragged != first
    page.get_by_role("button", name="Reset view").click()
    assert parts(page) == first
    # 25 px to the right turn by ten degrees, as two presses do.
    stage.focus()
    page.keyboard.press("ArrowRight")
    page.keyboard.press("ArrowRight")
    assert parts(page) == dragged


def tip(page: Any) -> list[float]:
    """Where the tip of the picked arm is in the drawing."""
    settled(page)
    d = page.locator(".arm-drop").first.get_attribute("d")
    return [float(v) for v in re.findall(r"-?[\d.]+", d)[:2]]


def test_views(open_page: Open, plain: ArmScene) -> None:
    page = open_page(page_of(plain))
    for name, shown in (("Top", "XY"), ("Front", "YZ"), ("Side", "XZ")):
        page.get_by_role("button", name=f"{name} view").click()
        settled(page)
        letters = page.locator(".arm-base-axis-name").all_text_contents()
        assert "".join(letters) == shown
    # From the side, x runs to the right and z up.
    (x0, y0), (x1, y1) = np.reshape(
        split(page.locator(".arm-base-axis").nth(0).get_attribute("d"))[1], (2, 2)
    )
    assert x1 > x0
    assert y1 == y0
    (x0, y0), (x1, y1) = np.reshape(
        split(page.locator(".arm-base-axis").nth(2).get_attribute("d"))[1], (2, 2)
    )
    assert y1 < y0


def highlight(page: Any) -> list[str]:
    return list(page.eval_on_selector_all(".highlight", "(all) => all.map((e) => e.dataset.pose)"))


def test_one_pose_everywhere(open_page: Open, plain: ArmScene, full: ArmScene) -> None:
    page = open_page(page_of(plain, full))
    page.evaluate(HEARD)
    row = page.locator('tr[data-pose="p03"]')
    row.hover()
    assert highlight(page) == ["p03"]
    assert [readout(page, f)[0] for f in ("#arm0", "#arm1")] == ["p03", "p03"]
    page.mouse.move(1, 1)
    assert highlight(page) == []
    assert readout(page)[0] == "p01", "what the controls say comes back"
    row.click()
    page.mouse.move(1, 1)
    assert highlight(page) == ["p03"], "pinned"
    assert readout(page)[0] == "p03"
    page.locator('tr[data-pose="p05"]').hover()
    assert highlight(page) == ["p05"]
    page.mouse.move(1, 1)
    assert highlight(page) == ["p03"]
    page.keyboard.press("Escape")
    assert highlight(page) == []
    page.locator("#arm1 select").select_option("p09")
    assert highlight(page) == ["p09"]
    assert readout(page)[0] == "p09", "the other figure follows"
    assert page.evaluate("() => window.heard.at(-1)") == {
        "pose": "p09", "source": "arm1", "pinned": True
    }  # fmt: skip


def test_rows_by_keyboard(open_page: Open, plain: ArmScene) -> None:
    page = open_page(page_of(plain))
    page.locator('tr[data-pose="p04"]').focus()
    assert highlight(page) == ["p04"]
    page.keyboard.press("Enter")
    page.keyboard.press("Tab")
    assert highlight(page) == ["p05"]
    page.evaluate("() => document.activeElement.blur()")
    assert highlight(page) == ["p04"]


def tip_of(page: Any, i: int) -> tuple[float, float]:
    """Where the tip of a pose is on the screen."""
    settled(page)
    points = split(page.locator(".arm-tips").get_attribute("d"))[1].reshape(-1, 3)
    box = page.locator(".arm-drawing").bounding_box()
    return box["x"] + points[i, 0], box["y"] + points[i, 1]


def test_a_tip_is_picked_in_the_drawing(open_page: Open, plain: ArmScene) -> None:
    page = open_page(page_of(plain))
    page.mouse.move(*tip_of(page, 7))
    assert readout(page)[0] == "p08"
    assert highlight(page) == ["p08"]
    page.mouse.move(2, 2)
    assert readout(page)[0] == "p01"
    page.mouse.click(*tip_of(page, 7))
    page.mouse.move(2, 2)
    assert readout(page)[0] == "p08"
    assert page.locator("select").input_value() == "7"


def test_on_a_phone(open_page: Open, full: ArmScene) -> None:
    page = open_page(page_of(full), width=390, height=844, has_touch=True, is_mobile=True)
    assert page.evaluate("() => document.documentElement.scrollWidth") <= 390
    page.touchscreen.tap(*tip_of(page, 7))
    assert readout(page)[0] == "p08"
    size = page.evaluate("() => Math.min(...[...document.querySelectorAll('.arm-bar button')]"
                         ".map((e) => e.getBoundingClientRect().height))")  # fmt: skip
    assert size >= 24
    texts = page.eval_on_selector_all(
        ".arm-parts text", "(all) => all.map((e) => e.getBoundingClientRect().height)"
    )
    assert min(texts) > 9, "letters keep their size"


def test_without_scripts_there_are_no_dead_controls(open_page: Open, full: ArmScene) -> None:
    page = open_page(page_of(full), java_script_enabled=False)
    assert page.locator("button:visible, select:visible").count() == 0
    assert page.locator(".arm-drawing").is_visible()


def test_hostile_names(open_page: Open, kr270: Cell, table_two: Poses) -> None:
    names = tuple(f"{name}{HOSTILE}" for name in table_two.names)
    page = open_page(page_of(scene(hostile(kr270), replace(table_two, names=names))))
    assert page.locator("img").count() == 0
    assert page.locator("script").count() == 3
    page.get_by_role("button", name="Next pose").click()
    assert readout(page)[0] == names[1]
    assert page.locator("option").nth(1).text_content() == names[1]
    assert highlight(page) == [names[1]]
    assert page.locator(".arm-name").all_text_contents() == [f"m{j}{HOSTILE}" for j in (1, 2, 3)]


def test_sorting(open_page: Open, plain: ArmScene) -> None:
    page = open_page(page_of(plain))
    column = "td:nth-child(2)"
    angles = [float(v) for v in plain.values[:, 0]]
    button = page.get_by_role("button", name="angle")
    button.click()
    assert [float(t) for t in page.locator(column).all_text_contents()] == sorted(angles)
    head = page.locator("th").nth(1)
    assert head.get_attribute("aria-sort") == "ascending"
    button.focus()
    page.keyboard.press("Enter")
    assert [float(t) for t in page.locator(column).all_text_contents()] == sorted(angles)[::-1]
    assert head.get_attribute("aria-sort") == "descending"
    page.get_by_role("button", name="pose", exact=True).click()
    assert page.locator("td:nth-child(1)").all_text_contents() == sorted(plain.poses)
    assert head.get_attribute("aria-sort") is None


def test_sorting_of_signs_words_and_gaps(open_page: Open) -> None:
    cells = ["10.5 mm", "\N{EN DASH}", "\N{MINUS SIGN}3", "2", "", "p10", "p9"]
    rows = "".join(f"<tr><td>{cell}</td></tr>" for cell in cells)
    page = open_page(
        '<!doctype html><html lang="en"><meta charset="utf-8"><table data-sortable><thead><tr>'
        f"<th>a</th></tr></thead><tbody>{rows}</tbody></table>"
        f"<script>{asset('page.js')}</script></html>"
    )
    page.get_by_role("button").click()
    up = ["\N{MINUS SIGN}3", "2", "10.5 mm", "p9", "p10", "\N{EN DASH}", ""]
    assert page.locator("td").all_text_contents() == up
    page.get_by_role("button").click()
    down = ["p10", "p9", "10.5 mm", "2", "\N{MINUS SIGN}3", "\N{EN DASH}", ""]
    assert page.locator("td").all_text_contents() == down
