"""`robolamp score` and `robolamp render`: poles, times to take, controllers that see all."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import av
import numpy as np
import pytest
from PIL import Image

from robolamp.assets import shipped
from robolamp.cli.main import main
from robolamp.log.reader import read_run, read_truth

from .test_main import call


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "c.toml"


def written(path: Path, ankle: str, knee: str) -> Path:
    """A controller of two joints' texts; the neck keeps still."""
    path.write_text(f'schema = 1\nname = "c"\n[joints]\nankle = "{ankle}"\nknee = "{knee}"\nneck = "0"\n')
    return path


def test_a_pole_is_scored(capsys: pytest.CaptureFixture[str], path: Path) -> None:
    words = ("score", written(path, "(* 0.4 goal_dist)", "0.1"), "--goals", "0.01:0.6:2", "--duration", "1")
    assert "pole_hits" not in json.loads(call(capsys, *words, "--json")[1])
    said = json.loads(call(capsys, *words, "--pole", "19cm", "--pole-at", "0.101", "--json")[1])
    assert (said["pole_hits"], said["upright"], said["runs"]) == (1, 2, 2)
    assert said["median_abs_error_m"] == pytest.approx(0.3, abs=0.05)
    assert said["flight_share_median"] is None
    assert json.loads(call(capsys, *words, "--pole", "0.5", "--json")[1])["pole_hits"] == 0
    code, out, err = call(capsys, *words, "--pole", "190 mm", "--pole-at", "0.101")
    assert (code, err) == (0, "")
    assert "a pole 19.0 cm high at 10 cm" in out
    assert "1 pole hit;" in out


@pytest.mark.parametrize("verb", ["score", "explain"])
def test_how_a_controller_was_made_is_said(capsys: pytest.CaptureFixture[str], path: Path, verb: str) -> None:
    words = (verb, written(path, "0", "0"), "--goals", "0.3", "--duration", "0.5")
    assert json.loads(call(capsys, *words, "--json")[1])["origin"] is None  # a file of 0.1.0 does not say
    path.write_text('origin = "by hand"\n' + path.read_text())
    assert json.loads(call(capsys, *words, "--json")[1])["origin"] == "by hand"
    assert "c (by hand)" in call(capsys, *words)[1]


def test_a_time_to_take_is_scored(capsys: pytest.CaptureFixture[str], path: Path) -> None:
    timed = written(path, "(ifltz (- goal_time 1) 0 0.6)", "(ifltz (- goal_time 1) 0 -1)")
    words = ("score", timed, "--goals", "0.3", "--duration", "2", "--json")
    assert [json.loads(call(capsys, *words, "--goal-time", time)[1])["falls"] for time in ("0.9", "1.1")] == [0, 1]


def test_lamps_are_drawn_from_what_a_fit_left_open(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, path: Path
) -> None:
    words = (
        "score",
        written(path, "0.3", "-0.5"),
        "--goals",
        "0.3",
        "--duration",
        "1",
        "--lamps",
        "2",
        "--spread",
        "1",
    )
    plain = json.loads(call(capsys, *words, "--json")[1])
    assert plain["drawn_from"] == "spread.toml"
    mine = tmp_path / "mine.toml"
    text = (shipped() / "calibration/nominal.toml").read_text()
    own = '[joint.ankle]\ntorque_constant = {value = 0.37, unit = "Nm/A", stderr = 0.03}\n'
    matrix = '[provenance.covariance]\nparameters = ["ankle.torque_constant"]\nmatrix = [[9e-4]]\n'
    mine.write_text(text + own + matrix)
    fitted = json.loads(call(capsys, *words, "--calibration", mine, "--json")[1])
    assert fitted["drawn_from"] == "nominal's covariance and spread.toml"
    assert fitted["errors_m"] != plain["errors_m"]
    mine.write_text((text + own + matrix).replace("[[9e-4]]", "[[-1.0]]"))
    code, out, _ = call(capsys, *words, "--calibration", mine, "--json")
    assert code == 2
    assert "provenance.covariance" in json.loads(out)["error"]


@pytest.mark.parametrize(("ankle", "knee", "falls"), [("(* 0.1 px)", "0", 0), ("(- 0 (* 2 px))", "-1", 1)])
def test_pictures_of_controllers_that_see_all(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, path: Path, ankle: str, knee: str, falls: int
) -> None:
    words = ("--duration", "2", "--pole", "30cm", "--json")
    sees = written(path, ankle, knee)
    picture = tmp_path / "strip.png"
    code, out, err = call(capsys, "render", sees, "-o", picture, "--goal", "0.3", "--no-opengl", *words)
    assert (code, err) == (0, "")
    with Image.open(picture) as image:
        assert image.size == (8 * 224 - 4, 284)
    assert 0 < json.loads(out)["duration_s"] <= 2
    assert json.loads(call(capsys, "score", sees, "--goals", "0.3", *words)[1])["falls"] == falls


def test_a_picture_shows_what_is_scored(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    words = ("--duration", "4", "--json")
    strip = tmp_path / "a.png"
    drawn = json.loads(call(capsys, "render", "hop", "-o", strip, "--goal", "20cm", "--no-opengl", *words)[1])
    scored = json.loads(call(capsys, "score", "hop", "--goals", "20cm", *words)[1])
    assert drawn["travel_m"] == pytest.approx(0.2 + scored["errors_m"][0], abs=0.002)


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A log of the emulated lamp, whose truth lies beside it; its report is not asked for."""
    folder = tmp_path_factory.mktemp("render") / "run"
    with pytest.raises(SystemExit):
        main(["dry-run", "hop", "--goal", "0.1", "--duration", "1", "--lockstep", "-o", str(folder), "--json"])
    return folder / "log.mcap"


def test_a_log_is_drawn_as_the_lamp_went_with_the_twin_beside_it(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, log: Path
) -> None:
    truth = read_truth(log.with_name("truth.mcap"))
    strip = tmp_path / "strip.png"
    said = json.loads(call(capsys, "render", log, "-o", strip, "--twin", "--no-opengl", "--json")[1])
    run = read_run(log)
    driven = run.scheduled[run.phase == "run"]
    x = np.interp(driven, run.at(truth.log_time), truth.base_x)
    assert said["travel_m"] == pytest.approx(np.ptp(x[x >= x[0]]), abs=0.01)
    with Image.open(strip) as image:
        assert image.size == (8 * 224 - 4, 2 * 264 - 4 + 24)
        sheet = np.asarray(image.convert("RGB")).astype(int)
    lamp, twin = sheet[30:260], sheet[294:524]
    assert 0.0005 < (np.abs(lamp - twin).sum(axis=2) > 60).mean() < 0.2  # alike, and not the same
    log.with_name("truth.mcap").rename(tmp_path / "truth.mcap")
    try:
        without = json.loads(call(capsys, "render", log, "-o", strip, "--no-opengl", "--json")[1])
        given = call(capsys, "render", log, "-o", strip, "--no-opengl", "--json", "--truth", tmp_path / "truth.mcap")
    finally:
        (tmp_path / "truth.mcap").rename(log.with_name("truth.mcap"))
    assert json.loads(given[1])["travel_m"] == said["travel_m"] != without["travel_m"]


@pytest.mark.parametrize(("ending", "codec"), [("mp4", "h264"), ("gif", "gif")])
def test_an_animation_lasts_as_long_as_the_motion(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, log: Path, ending: str, codec: str
) -> None:
    film = tmp_path / f"film.{ending}"
    said = json.loads(call(capsys, "render", log, "-o", film, "--twin", "--no-opengl", "--json")[1])
    with av.open(film) as file:
        [track] = file.streams.video
        frames = [frame.to_ndarray(format="rgb24").astype(int) for frame in file.decode(track)]
        assert (track.codec_context.name, track.width, track.height) == (codec, 720, 360)
    assert len(frames) * 0.04 == pytest.approx(said["duration_s"], abs=0.05)
    assert (np.abs(frames[0] - frames[len(frames) // 2]).sum(axis=2) > 60).mean() > 0.01


def test_what_cannot_be_drawn_is_said_in_one_line(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, log: Path
) -> None:
    for words, told in (
        (("hop", "-o", tmp_path / "a.jpg"), "'a.jpg' does not end in .png, .gif or .mp4"),
        (("hop", "-o", tmp_path / "a.png", "--twin"), "--twin: is for a log"),
        (("hop", "-o", tmp_path / "a.png", "--truth", log), "--truth: is for a log"),
        ((log, "-o", tmp_path / "a.png", "--pole", "20cm"), "no log has a pole"),
        ((log, "-o", tmp_path / "a.png", "--truth", log), "no /truth/base messages"),
    ):
        code, out, err = call(capsys, "render", *words)
        assert (code, out, err.count("\n")) == (2, "", 1)
        assert told in err
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("library", "words"),
    [("av", "render none.mcap -o film.mp4"), ("arro3.io", "log export none.mcap -o run.parquet")],
)
def test_an_extra_that_is_missing_is_said_before_the_work(tmp_path: Path, library: str, words: str) -> None:
    code = f"import sys; sys.modules[{library!r}] = None; from robolamp.cli.entry import main; main()"
    done = subprocess.run(
        [sys.executable, "-c", code, *words.split()], cwd=tmp_path, capture_output=True, text=True, check=False
    )
    assert (done.returncode, done.stdout, done.stderr.count("\n")) == (2, "", 1)
    assert "needs the extra" in done.stderr  # and not that there is no such log
