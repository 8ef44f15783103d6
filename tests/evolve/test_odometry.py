"""Learning the odometer: slopes against differences, a law that is known, honest errors, and the command."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from robolamp.assets import Assets
from robolamp.calibration import load_calibration
from robolamp.cli.options import Setup
from robolamp.controller.controller_file import Controller
from robolamp.errors import RobolampError
from robolamp.evolve import odometry
from robolamp.evolve.odometry import StepTable
from robolamp.lamp import load_lamp
from robolamp.odometer import feature_names, load_odometer

ASSETS = Assets.of(None)
LAMP = load_lamp(ASSETS)
SETUP = Setup(ASSETS, LAMP, load_calibration(ASSETS, "nominal"))
FEATURES = len(feature_names(3))


def test_slopes_are_those_of_the_loss() -> None:
    rng = np.random.default_rng(1)
    network = odometry._blank(7, 3, rng)
    inputs, wanted = rng.standard_normal((11, 7)), rng.standard_normal(11)

    def loss(likelihood: bool) -> float:
        length, log_variance = network.run(inputs)
        if not likelihood:
            return float(np.mean((length - wanted) ** 2) / 2)
        variance = 0.1**2 + np.exp(log_variance)
        return float(np.mean((length - wanted) ** 2 / variance + np.log(variance)) / 2)

    for likelihood in (False, True):
        slopes = odometry._slopes(network, inputs, wanted, 0.1, likelihood=likelihood)
        for parameter, slope in zip(
            (network.weights, network.bias, network.outputs, network.offset), slopes, strict=True
        ):
            for place in np.ndindex(parameter.shape):
                kept, sides = parameter[place], []
                for step in (1e-5, -1e-5):
                    parameter[place] = kept + step
                    sides.append(loss(likelihood))
                parameter[place] = kept
                assert slope[place] == pytest.approx((sides[0] - sides[1]) / 2e-5, abs=1e-8)


def made_up(count: int, seed: int) -> StepTable:
    """Hops of 40 lamps that follow a law; the noise is tenfold where the last feature is high."""
    rng = np.random.default_rng(seed)
    features = rng.standard_normal((count, FEATURES))
    noise = np.where(features[:, -1] > 0, 0.01, 0.001)
    length = 0.06 + 0.02 * np.tanh(features[:, 0]) + 0.01 * features[:, 1] + noise * rng.standard_normal(count)
    run = np.arange(count) // 5
    return StepTable(features, length, run % 2, run % 40, run)


def controllers(*names: str) -> list[Controller]:
    return [SETUP.controller(name) for name in names]


def test_a_law_is_learnt_and_so_is_how_sure_it_is() -> None:
    learnt = odometry.fit(made_up(6000, 1), LAMP, controllers("hop-counting", "hop-sighted"), 8, 1)
    fresh = made_up(3000, 2)
    error, stderr = odometry.errors(learnt, fresh)
    noisy = fresh.features[:, -1] > 0
    assert np.sqrt(np.mean(error[noisy] ** 2)) == pytest.approx(0.01, rel=0.15)
    assert np.sqrt(np.mean(error[~noisy] ** 2)) < 0.003
    assert np.median(stderr[noisy]) > 3 * np.median(stderr[~noisy])
    facts = odometry.judge(learnt, fresh, controllers("hop-counting", "hop-sighted"))
    assert 0.8 < facts["step_standardised"] < 1.25
    assert 0.8 < facts["run_standardised"] < 1.25
    assert learnt.correlation < 0.1  # no lamp has an error of its own
    assert [row["controller"] for row in facts["by_controller"]] == ["hop-counting", "hop-sighted"]
    assert {"step_rms_when_left_out_m", "runs_within"} <= set(learnt.scores["by_controller"][0])


def test_errors_that_a_lamp_keeps_are_known_to_add_up() -> None:
    hops = made_up(6000, 1)
    own = 0.01 * np.random.default_rng(3).standard_normal(40)
    hops = replace(hops, length=hops.length + own[hops.lamp])
    learnt = odometry.fit(hops, LAMP, controllers("hop-counting", "hop-sighted"), 8, 1)
    assert learnt.correlation > 0.5
    again = odometry.fit(hops, LAMP, controllers("hop-counting", "hop-sighted"), 8, 1)
    assert np.array_equal(learnt.network.weights, again.network.weights)


def test_the_lamp_that_others_are_drawn_around_is_learnt_from_and_never_judged_by() -> None:
    rng = np.random.default_rng(1)
    groups = [odometry.drawn(LAMP, SETUP.calibration, ASSETS, "spread", scale, 2, rng) for scale in (1.0, 0.0)]
    steps = odometry.gather(LAMP, groups, controllers("hop-bending-sighted"), 1, rng)
    assert set(steps.lamp) == {0, 1, -1}
    hops = made_up(6000, 1)
    same = replace(hops, lamp=np.where(hops.lamp < 20, -1, hops.lamp))
    learnt = odometry.fit(same, LAMP, controllers("hop-counting", "hop-sighted"), 4, 1)
    assert learnt.scores["steps"] == 4 * 150  # of a fifth of the twenty that were drawn


def test_what_hardly_hops_teaches_nothing() -> None:
    rng = np.random.default_rng(1)
    group = odometry.drawn(LAMP, SETUP.calibration, ASSETS, "spread", 1.0, 1, rng)
    few = odometry.gather(LAMP, [group], controllers("hop-bending-sighted"), 1, rng)
    with pytest.raises(RobolampError, match=r"took \d+ steps in all; expected 200 or more"):
        odometry.fit(few, LAMP, controllers("hop-bending-sighted"), 4, 1)
    slow = replace(controllers("hop-counting")[0], control_period=0.04)
    with pytest.raises(RobolampError, match=r"different control periods \(hop-counting 0.02 s, hop-counting 0.04 s\)"):
        odometry.gather(LAMP, [group], [*controllers("hop-counting"), slow], 1, rng)


def test_the_command(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    from robolamp.cli.main import main  # noqa: PLC0415

    def told(*words: str) -> dict:
        with pytest.raises(SystemExit) as ended:
            main(["odometer", *words, "--json"])
        assert ended.value.code == 0
        return json.loads(capsys.readouterr().out)

    made = tmp_path / "odometer.toml"
    few = ["--lamps", "10", "--goals", "2", "--hidden", "4", "--workers"]
    words = ["hop-bending-sighted", "-o", str(made), *few]
    one = told("fit", *words, "1")
    text = made.read_text(encoding="utf-8")
    assert told("fit", *words, "2") == one
    assert made.read_text(encoding="utf-8") == text  # at any number of threads
    assert one["controllers"] == ["hop-bending-sighted"]
    learnt = load_odometer(made)
    assert learnt.provenance["learnt_from_steps"] == one["learnt_from_steps"] > 200
    assert math.isclose(learnt.scores["step_rms_m"], one["step_rms_m"])
    judged = told("score", "hop-bending-sighted", "--odometer", str(made), "--lamps", "10", "--goals", "1")
    assert judged["by_controller"][0]["steps"] == judged["steps"]
    assert 0 < judged["step_median_m"] < 0.03
