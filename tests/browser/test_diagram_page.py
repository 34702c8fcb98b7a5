"""The page of a block diagram in headless Chromium: three depths, zoom about the pointer, dragging, no network."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from browser.chromium import Page

from ortilo_drake.scenario import load_scenario
from ortilo_drake.views.page.diagram_page import DEPTHS, diagram_page
from ortilo_drake.views.wiring_text import wiring_of

pytestmark = pytest.mark.long
UNDER = """(() => {
    const p = new DOMPoint(%d, %d).matrixTransform(pictures[shown].getScreenCTM().inverse());
    return [p.x, p.y];
})()"""  # where in the picture a point of the window is


@pytest.fixture(scope="module")
def file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    found = tmp_path_factory.mktemp("diagram") / "loop.html"
    wiring = wiring_of(load_scenario("imu_uwb_yolo", ("camera.kind=projected",)))
    found.write_text(diagram_page("imu_uwb_yolo", wiring), encoding="utf-8")
    return found


@pytest.fixture(params=[1280, 390])
def page(tab: Page, file: Path, request: pytest.FixtureRequest) -> Iterator[Page]:
    tab.errors.clear()
    tab.requests.clear()
    tab.open(file.as_uri(), request.param)
    yield tab
    assert tab.errors == []
    assert all(url.startswith(("file:", "data:")) for url in tab.requests)


def box(page: Page) -> list[float]:
    found: list[float] = page.run("views[shown].now")
    return found


def mouse(page: Page, kind: str, x: float, y: float, **more: Any) -> None:
    page.call("Input.dispatchMouseEvent", type=kind, x=x, y=y, **more)


def test_each_depth_shows_more_than_the_one_before(page: Page) -> None:
    said = []
    for i in range(len(DEPTHS)):
        page.run(f"document.querySelectorAll('button[data-depth]')[{i}].click()")
        assert page.run("[...document.querySelectorAll('.depth')].filter((part) => !part.hidden).length") == 1
        said.append(page.run("pictures[shown].querySelectorAll('.node text').length"))
    assert said == sorted(set(said))
    assert page.run("document.documentElement.scrollWidth <= window.innerWidth")


def test_the_wheel_zooms_about_the_pointer_and_the_whole_comes_back(page: Page) -> None:
    before = box(page)
    under = UNDER % (200, 300)
    at = page.run(under)
    mouse(page, "mouseWheel", 200, 300, deltaX=0, deltaY=-400)
    page.until(f"views[shown].now[2] < {before[2]}")
    assert page.run(under) == pytest.approx(at, rel=1e-3, abs=0.5)
    assert box(page)[3] / box(page)[2] == pytest.approx(before[3] / before[2])
    page.run("document.getElementById('whole').click()")
    assert box(page) == page.run("views[shown].whole")
    page.run("document.querySelectorAll('button[data-depth]')[shown].click()")
    assert box(page) == page.run("views[shown].whole")


def test_each_depth_begins_with_letters_that_can_be_read(page: Page) -> None:
    for i in range(len(DEPTHS)):
        page.run(f"document.querySelectorAll('button[data-depth]')[{i}].click()")
        letters = (
            "[...pictures[shown].querySelectorAll('.node text')].map((t) => parseFloat(getComputedStyle(t).fontSize))"
        )
        assert page.run(f"Math.min(...{letters}) * pictures[shown].getScreenCTM().a") > 9.0


def test_dragging_moves_the_picture_with_the_pointer(page: Page) -> None:
    at = page.run(UNDER % (150, 300))
    mouse(page, "mousePressed", 150, 300, button="left", clickCount=1)
    mouse(page, "mouseMoved", 210, 340, button="left", buttons=1)
    mouse(page, "mouseReleased", 210, 340, button="left", clickCount=1)
    assert page.run(UNDER % (210, 340)) == pytest.approx(at, abs=1.0)
