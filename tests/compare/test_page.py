"""The report in a real browser: it draws, zooms, plays, and fits a phone."""

from __future__ import annotations

import shutil
from collections.abc import Iterator

import pytest

from robolamp.compare.compare_logs import compare_log

from .lamps import ASSETS, CALIBRATION, write_run

BROWSER = shutil.which("chromium")
pytestmark = pytest.mark.skipif(BROWSER is None, reason="needs Debian's package chromium")


@pytest.fixture(scope="module")
def report(tmp_path_factory) -> str:
    folder = tmp_path_factory.mktemp("page")
    log, truth = write_run(folder, noise=0.001)
    result = compare_log(
        log, truth=truth, assets=ASSETS, calibration=CALIBRATION, out=folder / "r.html", diagnosis=False
    )
    return result.report.as_uri()


@pytest.fixture(scope="module")
def browser() -> Iterator:
    sync_api = pytest.importorskip("playwright.sync_api")
    with sync_api.sync_playwright() as playwright:
        chromium = playwright.chromium.launch(executable_path=BROWSER, args=["--no-sandbox"])
        yield chromium
        chromium.close()


@pytest.mark.parametrize("width", [1200, 390])
def test_the_page_draws_every_plot_and_is_no_wider_than_the_window(browser, report, width):
    page = browser.new_page(viewport={"width": width, "height": 900})
    wrong: list[str] = []
    page.on("pageerror", lambda error: wrong.append(str(error)))
    page.on("request", lambda request: wrong.append(request.url) if not request.url.startswith("file:") else None)
    page.goto(report)
    page.wait_for_selector("html[data-ready=yes]", state="attached")
    assert wrong == []
    assert page.locator(".u-over").count() == page.locator("[data-panel]").count() == 13
    assert page.evaluate("document.documentElement.scrollWidth") <= width
    page.close()


def test_dragging_zooms_all_plots_and_hovering_tells_the_values_and_moves_the_figure(browser, report):
    page = browser.new_page(viewport={"width": 1200, "height": 900})
    page.goto(report)
    page.wait_for_selector("html[data-ready=yes]", state="attached")
    plot = page.locator("[data-panel=knee] .u-over")
    plot.scroll_into_view_if_needed()
    box = plot.bounding_box()
    middle = box["y"] + box["height"] / 2
    before = page.locator("#clock").inner_text()
    page.mouse.move(box["x"] + 0.6 * box["width"], middle)
    readout = page.locator(".panel:has([data-panel=knee]) .readout").inner_text()
    assert "twin" in readout
    assert readout.strip().endswith("rad")
    assert page.locator("#clock").inner_text() != before
    page.mouse.move(box["x"] + 0.4 * box["width"], middle)
    early = page.locator("#clock").inner_text()
    page.mouse.down()
    page.mouse.move(box["x"] + 0.6 * box["width"], middle, steps=4)
    page.mouse.up()
    other = page.locator("[data-panel=ankle] .u-over")
    other.scroll_into_view_if_needed()
    box = other.bounding_box()
    page.mouse.move(box["x"] + 2, box["y"] + box["height"] / 2)  # zoomed along: its left edge is where the drag began
    assert abs(float(page.locator("#clock").inner_text().split()[0]) - float(early.split()[0])) < 0.06
    page.close()
