"""What is learned of the boxes' noise, against dense Gaussians and drawn boxes."""

import numpy as np
import pytest
from plain_box import PlainBox
from scipy.stats import multivariate_t
from seen_landmarks import EXACT, ROOM, SHOWN, covariance, shown_centers, shown_message, state

from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.onboard.landmarks.box_fix import BoxBelief, box_belief
from ortilo_drake.onboard.landmarks.fix_element import camera_fix_box
from ortilo_drake.onboard.landmarks.landmark_bank import (
    PER_LANDMARK,
    REPEATS,
    Solved,
    learn,
    put_information,
)
from ortilo_drake.onboard.ranging.bank_element import NOTHING_YET, RESIDUALS, SCALE, SQUARES
from ortilo_drake.onboard.ranging.survey_bank import learned_first
from ortilo_drake.scenario import LandmarkFix as Settings
from ortilo_drake.scenario import load_scenario

N, M, SD, PIXELS, WORTH = len(ROOM.landmark_positions), len(SHOWN), 0.05, 0.6, 10.0
BANK = (0.0, 0.4, 1.0)
SETTINGS = Settings(method="pose", center_sd=PIXELS, survey_sd=SD, survey_bank=BANK, noise_scale=WORTH)
BELIEVED: BoxBelief = box_belief(SETTINGS, ROOM, 320)


def left_out(J: np.ndarray, errors: np.ndarray, i: int) -> tuple[np.ndarray, np.ndarray]:
    """Return how far box i is from where all others have it (2), and the covariance of that by noise of PIXELS."""
    own, others = J[2 * i : 2 * i + 2], np.delete(J, [2 * i, 2 * i + 1], axis=0)
    step = np.linalg.lstsq(others, np.delete(errors, [2 * i, 2 * i + 1]), rcond=None)[0]
    return errors[2 * i : 2 * i + 2] - own @ step, PIXELS**2 * (
        np.eye(2) + own @ np.linalg.inv(others.T @ others) @ own.T
    )


def told_of(errors: np.ndarray) -> tuple[np.ndarray, tuple[float, float]]:
    told, here = np.zeros(PER_LANDMARK * N), np.zeros(9 * N)
    left = put_information(
        told, here, Solved(shown_centers()[0] + errors.reshape(M, 2), SHOWN, np.array(EXACT)), BELIEVED
    )
    return told, left


def test_residuals_are_what_boxes_are_off_from_where_the_others_have_them() -> None:
    errors, J = np.random.default_rng(1).normal(0.0, 2.0, 2 * M), shown_centers()[1].reshape(2 * M, 6)
    off = [left_out(J, errors, i) for i in range(M)]
    residuals, squares = told_of(errors)[1]
    assert residuals == 2 * M
    assert squares == pytest.approx(sum(t @ np.linalg.solve(V, t) for t, V in off), rel=1e-6)


@pytest.mark.parametrize("white", [0.5, 3.0])
def test_models_are_weighed_as_students_t_of_each_box(white: float) -> None:
    """Of one landmark, in pictures that count in whole; the others' part is a product of its kind."""
    errors, J = np.random.default_rng(2).normal(0.0, white, 2 * M), shown_centers()[1].reshape(2 * M, 6)
    told, _ = told_of(errors)
    t, V = left_out(J, errors, 0)
    only = np.zeros_like(told)
    only[PER_LANDMARK * SHOWN[0] : PER_LANDMARK * (SHOWN[0] + 1)] = told[PER_LANDMARK * SHOWN[0] :][:PER_LANDMARK]
    left = np.array([2.0, t @ np.linalg.solve(V, t)])
    learned, gathered, scale = learned_first(np.array(BANK), 9 * N), np.zeros((3 * N, 4)), np.array(NOTHING_YET)
    room = np.zeros(len(BANK)), np.zeros((3, 3)), np.zeros(3)
    learn(learned, gathered, scale, REPEATS * only, REPEATS * left, 1.0, WORTH, np.array(BANK), SD, *room)
    A = -J[:2, :3]
    shapes = [V + (share * SD) ** 2 * A @ A.T for share in BANK]
    likely = np.array([multivariate_t(shape=shape, df=WORTH).pdf(t) for shape in shapes])
    np.testing.assert_allclose(learned[-3:], likely / likely.sum(), rtol=1e-6)
    squares = np.array([t @ np.linalg.solve(shape, t) for shape in shapes])
    assert scale[SCALE] == pytest.approx(learned[-3:] @ (WORTH + squares) / (WORTH + 2.0), rel=1e-6)
    np.testing.assert_allclose(scale[[RESIDUALS, SQUARES]], left[[0, 1]])


@pytest.mark.long
@pytest.mark.parametrize(("c", "sd"), [(0.5, 0.0), (2.0, 0.0), (1.0, 0.05)])
def test_within_four_seconds_it_tells_the_scale_whatever_lasts(c: float, sd: float) -> None:
    for seed in range(2):
        generator = np.random.default_rng(seed)
        its, moved = PlainBox(camera_fix_box(SETTINGS, ROOM, 320, 0.1)), generator.normal(0.0, 1.0, (M, 3)) * sd
        for k in range(40):
            pose = (EXACT[0], EXACT[1] + 0.002 * k, *EXACT[2:])
            belief = np.concatenate((state(), covariance(0.1)))
            said = shown_message(pose, moved, generator.normal(0.0, c * PIXELS, (M, 2)))
            its.say(message=said, belief=belief)
            its.step(message=said, belief=belief)
        assert np.sqrt(its.state["scale"][SCALE]) == pytest.approx(c, rel=0.25)
        weights = its.state["learned"][-3:]
        assert weights.sum() == pytest.approx(1.0)
        right, wrong = (0, 2) if sd == 0.0 else (2, 0)
        assert weights[wrong] < 0.1 < weights[right], (seed, weights)


def test_a_scale_needs_the_pose() -> None:
    with pytest.raises(InputError, match=r"noise_scale: must be null with method 'known_tilt'"):
        load_scenario(
            "imu_uwb_yolo",
            ("landmark_fix.method=known_tilt", "landmark_fix.survey_bank=null", "landmark_fix.noise_scale=10"),
        )


def test_the_robust_form_learns_no_scale() -> None:
    with pytest.raises(InputError, match=r"landmark_fix\.noise_scale: 10\.0: must be null with estimator\.robust"):
        load_scenario("robust_imu_uwb_yolo", ("landmark_fix.noise_scale=10",))
