"""The norm, the search and the covariance under every fit, against what is known in closed form."""

from __future__ import annotations

import numpy as np
import pytest

from robolamp.calibrate.least_squares import Robust, correlation_length, posterior, search

RNG = np.random.default_rng(7)
SLOPES = RNG.normal(size=(60, 2))


@pytest.mark.parametrize("weights", [1.0, RNG.uniform(0.2, 2.0, (60, 1))])
def test_the_gradient_is_that_of_the_cost(weights: float | np.ndarray) -> None:
    norm, whole = Robust(2, 0.7, weights), np.vstack([SLOPES, np.eye(2)])
    residuals = np.concatenate([RNG.normal(size=60), [0.4, -1.2]])[:, None]
    gradient, hessian = norm.grad_hess(residuals, whole)
    for index, column in enumerate(whole.T):
        step = 1e-6 * column[:, None]
        change = float(norm.value(residuals + step) - norm.value(residuals - step)) / 2e-6
        assert gradient[index, 0] == pytest.approx(change, rel=1e-6)
    assert (np.linalg.eigvalsh(hessian) > 0).all()


def test_an_outlier_pulls_like_one_at_delta_and_no_more() -> None:
    norm = Robust(1, 2.0)
    pull = [float(norm.grad_hess(np.array([[error], [0.0]]), np.array([[1.0], [0.0]]))[0][0, 0]) for error in (1, 50)]
    assert pull == pytest.approx([1.0 / np.sqrt(1.25), 2.0], rel=1e-2)


def test_without_outliers_it_ends_where_the_normal_equations_do() -> None:
    target = np.array([0.3, -0.6])
    data = SLOPES @ target

    def residual(z: np.ndarray) -> np.ndarray:
        return np.vstack([SLOPES @ z - data[:, None], z])

    def jacobian(z: np.ndarray, r: np.ndarray) -> np.ndarray:
        return np.vstack([SLOPES, np.eye(2)])

    norm, free = Robust(2, 1e6), (np.full(2, -4.0), np.full(2, 4.0))
    found = search(np.zeros(2), residual, jacobian, norm, free, 30)
    spread = posterior(SLOPES, np.ones(60))
    assert found == pytest.approx(spread @ SLOPES.T @ data, abs=1e-6)
    assert spread == pytest.approx(np.linalg.inv(SLOPES.T @ SLOPES + np.eye(2)))
    held = search(np.zeros(2), residual, jacobian, norm, (np.full(2, -4.0), np.array([0.1, 4.0])), 30)
    assert held[0] == pytest.approx(0.1)


def test_what_no_sample_tells_is_known_as_well_as_before() -> None:
    assert posterior(np.empty((0, 3)), np.empty(0)) == pytest.approx(np.eye(3))


@pytest.mark.parametrize("rho", [0.0, 0.5, 0.9])
def test_samples_that_resemble_each_other_count_less(rho: float) -> None:
    noise = RNG.normal(size=200_000)
    errors = np.empty_like(noise)
    errors[0] = noise[0]
    for index in range(1, len(noise)):
        errors[index] = rho * errors[index - 1] + noise[index]
    assert correlation_length(errors) == pytest.approx((1 + rho) / (1 - rho), rel=0.1)  # of such a process, known


def test_errors_that_drift_all_along_say_as_much_as_a_few() -> None:
    assert 400 / correlation_length(np.linspace(-1.0, 1.0, 400)) < 4
    assert correlation_length(np.ones(400)) == 1.0
