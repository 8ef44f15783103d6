"""`robolamp replay`, looked at in a real browser."""

from __future__ import annotations

import io
import json
import signal
import subprocess
import sys
import urllib.error
import urllib.request
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from robolamp.cli.main import main
from robolamp.log.reader import read_run

from .browser import needs_browser, opened


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A short hop of the emulated lamp, in virtual time."""
    out = tmp_path_factory.mktemp("player") / "run"
    command = [sys.executable, "-m", "robolamp", "dry-run", "hop", "--goal", "0.20", "--duration", "2", "--lockstep"]
    subprocess.run([*command, "-o", str(out)], check=True, capture_output=True, timeout=120)
    return out


@pytest.fixture(scope="module")
def html(folder: Path) -> Path:
    out = folder / "replay.html"
    command = [sys.executable, "-m", "robolamp", "replay", str(folder / "log.mcap"), "-o", str(out), "--json"]
    done = subprocess.run(command, check=True, capture_output=True, text=True, timeout=120)
    assert json.loads(done.stdout) == {"page": str(out), "bytes": out.stat().st_size}
    return out


def shot(page, selector: str = "#view") -> np.ndarray:
    picture = Image.open(io.BytesIO(page.locator(selector).screenshot())).convert("RGB")
    return np.asarray(picture).astype(int)


def test_the_page_is_small_and_needs_nothing_else(html: Path) -> None:
    text = html.read_text(encoding="utf-8")
    assert html.stat().st_size < 1_000_000
    for outside in ("http://", "https://", "src=", "@import"):
        assert outside not in text, outside


@needs_browser
def test_the_lamp_is_seen_to_move_as_time_is_scrubbed(html: Path) -> None:
    with opened(html.as_uri()) as page:
        assert page.locator("h1").inner_text() == "hop, sent 20 cm"
        assert page.locator(".chart b").all_inner_texts() == ["ankle", "knee", "neck", "floor force", "travel"]
        page.locator("#scrub").evaluate("(e) => { e.value = 0.5; e.oninput(); }")
        clock = page.locator("#clock").inner_text()
        now, end = (float(part.split()[0]) for part in clock.split("/"))
        assert now == pytest.approx(end / 2, abs=0.01)
        middle = shot(page)
        assert len(np.unique(middle.reshape(-1, 3), axis=0)) > 500  # shades, not a flat field
        page.locator("#on").click()
        assert float(page.locator("#clock").inner_text().split()[0]) == pytest.approx(now + 0.02, abs=0.011)
        page.locator("#scrub").evaluate("(e) => { e.value = 1; e.oninput(); }")
        assert (np.abs(shot(page) - middle).sum(axis=2) > 40).mean() > 0.01
        before = shot(page)
        page.locator("#show-twin").click()
        assert page.locator("#show-twin").get_attribute("aria-pressed") == "false"
        assert (np.abs(shot(page) - before).sum(axis=2) > 20).mean() > 0.003
        before = shot(page)
        page.mouse.move(200, 300)
        page.mouse.down()
        page.mouse.move(320, 330)
        page.mouse.up()
        assert (np.abs(shot(page) - before).sum(axis=2) > 40).mean() > 0.05


@needs_browser
def test_a_click_on_a_trace_goes_there_and_the_legend_says_what_was_logged(folder: Path, html: Path) -> None:
    run = read_run(folder / "log.mcap")
    with opened(html.as_uri()) as page:
        page.locator("#speed").select_option("0.1")
        knee = page.locator(".chart").nth(1)
        box = knee.locator("canvas").bounding_box()
        assert box is not None
        page.mouse.click(box["x"] + 0.7 * box["width"], box["y"] + 20)
        now = float(page.locator("#clock").inner_text().split()[0])
        assert 0.5 < now / (run.write_done[-1] - run.began[0]) < 0.7  # an axis is left of the traces
        legend = dict(text.split()[:2] for text in knee.locator("span").all_inner_texts())
        told = page.locator(".chart span").all_inner_texts()
        assert not [text for text in told if " -0.0" in text and not float(text.split()[1])]  # no "-0.000"
        places = {text.split()[2]: len(text.split()[1].partition(".")[2]) for text in told}
        assert {unit: places.get(unit) for unit in ("rad", "N", "cm")} == {"rad": 3, "N": 2, "cm": 1}
        row = np.searchsorted(run.write_done - run.began[0], now, side="right") - 1
        assert any(abs(float(legend["goal"]) - value) < 6e-4 for value in run.goal[row - 1 : row + 2, 1])
        page.keyboard.press("Space")
        page.wait_for_function("(from) => now > from + 0.02", arg=now)
        page.locator("#play").click()
        assert page.locator("#play").get_attribute("aria-label") == "Play"


@needs_browser
def test_it_fits_a_phone(html: Path) -> None:
    with opened(html.as_uri(), viewport={"width": 390, "height": 844}, color_scheme="dark") as page:
        assert page.evaluate("document.documentElement.scrollWidth") <= 390
        for name in ("#view", "#play", "#scrub", "#speed"):
            box = page.locator(name).bounding_box()
            assert box is not None
            assert box["width"] > 30
            assert box["y"] + box["height"] <= 844


def test_the_page_is_served_on_this_computer_until_ctrl_c(folder: Path) -> None:
    command = [sys.executable, "-m", "robolamp", "replay", str(folder / "log.mcap"), "--no-browse", "--json"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as server:
        assert server.stdout is not None
        url = json.loads(server.stdout.readline())["url"]
        assert url.startswith("http://127.0.0.1:")
        with urllib.request.urlopen(url) as answer:
            assert b"sent 20 cm" in answer.read()
        with pytest.raises(urllib.error.HTTPError, match="404") as caught:
            urllib.request.urlopen(url + "etc/passwd")
        caught.value.close()
        server.send_signal(signal.SIGINT)
        _, err = server.communicate(timeout=20)
    assert (server.returncode, err) == (130, "")


def test_what_cannot_be_played_is_said_in_one_line(
    capsys: pytest.CaptureFixture[str], folder: Path, tmp_path: Path
) -> None:
    log = folder / "log.mcap"
    for words, told in (
        ((folder / "truth.mcap",), "holds no /lamp/tick messages"),
        ((tmp_path / "none.mcap",), "No such file"),
        ((log, "--port", "70000"), "70000 is no port"),
        ((log, "--truth", log), "no /truth/base messages"),
        ((log, "-o", tmp_path), "cannot be written"),
    ):
        with pytest.raises(SystemExit) as ended:
            main(["replay", *map(str, words)])
        out, err = capsys.readouterr()
        assert (ended.value.code, out) == (2, "")
        assert told in err
        assert err.count("\n") == 1
