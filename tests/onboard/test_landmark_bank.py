"""What is learned of the landmarks' survey, against dense Gaussians and drawn surveys."""

import numpy as np
import pytest
from plain_box import PlainBox
from scipy.linalg import null_space
from scipy.stats import multivariate_normal
from seen_landmarks import EXACT, ROOM, SHOWN, covariance, shown_centers, shown_message, state

from ortilo_drake.diagrams.wiring.intermittent import filtering_of, learned_coefficients
from ortilo_drake.model.signals import ARRIVED, DETECTION_SIZE, DETECTIONS_SIZE, PAYLOAD
from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.onboard.estimator.lasting_element import told_layout, vary
from ortilo_drake.onboard.landmarks.box_fix import BoxBelief, box_belief, boxes_to_solve
from ortilo_drake.onboard.landmarks.fix_element import camera_fix_box
from ortilo_drake.onboard.landmarks.known_attitude import FREE_SD
from ortilo_drake.onboard.landmarks.landmark_bank import (
    PER_LANDMARK,
    REPEATS,
    Solved,
    learn,
    put_information,
    put_lasting,
)
from ortilo_drake.onboard.ranging.bank_element import NOTHING_YET
from ortilo_drake.onboard.ranging.lasting_error import KEPT, KEY, N_LASTING, NEW_KEY, SHARE, keep
from ortilo_drake.onboard.ranging.survey_bank import learned_first
from ortilo_drake.scenario import LandmarkFix as Settings
from ortilo_drake.scenario import load_scenario

N, M, SD, PIXELS = len(ROOM.landmark_positions), len(SHOWN), 0.05, 0.6
BANK = (0.0, 0.4, 1.0)
SETTINGS = Settings(method="pose", center_sd=PIXELS, survey_sd=SD, survey_bank=BANK)
BELIEVED: BoxBelief = box_belief(SETTINGS, ROOM, 320)
FIX_SIZE = PAYLOAD + 42


def information_of(errors: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return what boxes that err (m, 2) [px] tell of each landmark (n, 3, 4), and the sensitivities (3, n, 3)."""
    told, here = np.zeros(PER_LANDMARK * N), np.zeros(9 * N)
    put_information(told, here, Solved(shown_centers()[0] + errors, SHOWN, np.array(EXACT)), BELIEVED)
    return told.reshape(N, 3, 4), here.reshape(3, N, 3)


def test_the_likelihood_is_the_product_of_each_landmarks_dense_gaussian() -> None:
    errors = np.random.default_rng(1).normal(0.0, 2.0, (M, 2))
    J = shown_centers()[1].reshape(2 * M, 6)
    rest = null_space(J.T)  # what residuals say whatever the pose
    learned, gathered = learned_first(np.array(BANK), 9 * N), np.zeros((3 * N, 4))
    told, room = information_of(errors)[0].ravel(), (np.zeros(3), np.zeros((3, 3)), np.zeros(3))
    learn(learned, gathered, np.array(NOTHING_YET), told, np.zeros(2), 1.0, 0.0, np.array(BANK), SD, *room)
    logs = np.zeros(len(BANK))
    for i in range(M):
        A = np.zeros((2 * M, 3))
        A[2 * i : 2 * i + 2] = -J[2 * i : 2 * i + 2, :3]
        P = rest.T @ np.eye(2 * M) @ rest * PIXELS**2 * REPEATS  # an image counts as 1 / REPEATS of one
        said = A.T @ rest @ np.linalg.solve(P, rest.T @ errors.ravel())
        Lambda = A.T @ rest @ np.linalg.solve(P, rest.T @ A)
        for j, share in enumerate(BANK):  # A lambda + noise, and what of it lies along A: eta ~ N(0, Lambda + ...)
            V = Lambda + (share * SD) ** 2 * Lambda @ Lambda
            logs[j] += multivariate_normal(cov=V, allow_singular=True).logpdf(said)
    weights = np.exp(logs - logs.max())
    np.testing.assert_allclose(learned[-3:], weights / weights.sum(), rtol=1e-6)
    assert learned[SHARE] == pytest.approx(np.sqrt(learned[-3:] @ np.square(BANK)))


def test_an_error_of_the_pose_itself_says_nothing() -> None:
    J = shown_centers()[1]
    told = information_of(J @ np.array([0.05, -0.04, 0.03, 0.01, -0.02, 0.01]))[0]
    size = np.abs(information_of(np.full((M, 2), 1.0) * [[(-1.0) ** i] for i in range(M)])[0][..., 3]).max()
    assert np.abs(told[..., 3]).max() < 1e-6 * size
    unseen = np.setdiff1d(np.arange(N), SHOWN)
    assert not told[unseen].any()


def test_the_sensitivities_are_what_moved_landmarks_make_of_a_fit() -> None:
    drawn = np.random.default_rng(2).normal(0.0, 0.01, (M, 3))
    z, J = shown_centers()
    sds = np.sqrt(PIXELS**2 + SD**2 * np.sum(J[..., :3] ** 2, axis=2)).ravel()
    rows = np.vstack((J.reshape(-1, 6) / sds[:, None], np.eye(6)[3:] / FREE_SD))
    z_moved = shown_centers(drawn)[0]
    values = np.concatenate((((z_moved - z).ravel() / sds), np.zeros(3)))
    fitted = np.linalg.lstsq(rows, values, rcond=None)[0][:3]
    here = information_of(np.zeros((M, 2)))[1]
    np.testing.assert_allclose(np.einsum("and,nd->a", here[:, SHOWN], drawn), fitted, atol=3e-4)
    assert np.abs(fitted).max() > 3e-3


def test_what_lasts_is_what_drawn_surveys_make_of_it() -> None:
    generator = np.random.default_rng(3)
    one, other = generator.normal(size=(3, 3 * N)), generator.normal(size=(3, 3 * N))
    other = 0.9 * one + 0.4 * other
    errors = generator.normal(0.0, SD, (40_000, 3 * N))
    drawn = errors @ one.T, errors @ other.T
    learned, said = learned_first(np.array(BANK), 9 * N), np.zeros(N_LASTING)
    put_lasting(said, SD, one.ravel(), learned)
    np.testing.assert_allclose(said[:3], drawn[0].std(axis=0), rtol=0.02)
    np.testing.assert_array_equal(said[3:], 1.0)
    keep(learned, said, one.ravel())
    np.testing.assert_array_equal(learned[KEY : KEY + 9 * N], one.ravel())
    put_lasting(said, SD, other.ravel(), learned)
    together = [np.corrcoef(drawn[0][:, axis], drawn[1][:, axis])[0, 1] for axis in range(3)]
    assert min(together) > NEW_KEY
    np.testing.assert_allclose(said[3:], together, atol=0.02)
    keep(learned, said, other.ravel())
    np.testing.assert_allclose(learned[KEPT : KEPT + 3], together, atol=0.02)
    np.testing.assert_array_equal(learned[KEY : KEY + 9 * N], one.ravel())


@pytest.mark.long
@pytest.mark.parametrize(("sd", "right", "wrong"), [(0.0, 0, 2), (0.05, 2, 0)])
def test_within_three_seconds_it_tells_five_centimetres_from_none(sd: float, right: int, wrong: int) -> None:
    for seed in range(6):
        generator = np.random.default_rng(seed)
        its, moved = PlainBox(camera_fix_box(SETTINGS, ROOM, 320, 0.1)), generator.normal(0.0, 1.0, (M, 3)) * sd
        for k in range(30):
            pose = (EXACT[0], EXACT[1] + 0.002 * k, *EXACT[2:])
            belief = np.concatenate((state(), covariance(0.1)))
            said = shown_message(pose, moved, generator.normal(0.0, PIXELS, (M, 2)))
            its.say(message=said, belief=belief)
            its.step(message=said, belief=belief)
        weights = its.state["learned"][-3:]
        assert weights.sum() == pytest.approx(1.0)
        assert weights[wrong] < 0.02 < weights[right], (seed, weights)


def test_an_image_without_a_fix_keeps_all_that_lasts() -> None:
    its, belief = PlainBox(camera_fix_box(SETTINGS, ROOM, 320)), np.concatenate((state(), covariance(0.1)))
    said = shown_message(EXACT)
    fix = its.say(message=said, belief=belief)
    assert fix[ARRIVED] == 1.0
    its.step(message=said, belief=belief)
    nothing = its.say(message=np.zeros(DETECTIONS_SIZE), belief=belief)
    assert not nothing[:FIX_SIZE].any()
    np.testing.assert_array_equal(nothing[FIX_SIZE : FIX_SIZE + 3], fix[FIX_SIZE : FIX_SIZE + 3])
    np.testing.assert_array_equal(nothing[FIX_SIZE + 3 : FIX_SIZE + 6], 1.0)


def test_a_box_that_the_fix_refuses_tells_nothing() -> None:
    """Its message is that of a picture without the box."""
    errors, belief = np.zeros((M, 2)), np.concatenate((state(), covariance(0.1)))
    errors[1, 0] = 8.0
    said = shown_message(EXACT, errors=errors)
    fewer = said.copy()
    rows = fewer[PAYLOAD:].reshape(-1, DETECTION_SIZE)
    rows[1:-1] = rows[2:]
    chosen = boxes_to_solve(said, *np.split(belief, [15]), BELIEVED, 1.0)[4]
    assert SHOWN[1] in chosen  # so it is the solver that drops it
    shares = list[float]()
    for its_message in (said, fewer):
        its = PlainBox(camera_fix_box(SETTINGS, ROOM, 320, 0.1))
        found = its.say(message=its_message, belief=belief)
        its.step(message=its_message, belief=belief)
        told = found[FIX_SIZE + N_LASTING :][: PER_LANDMARK * N].reshape(N, 3, 4)
        assert told[SHOWN[2]].any()
        assert not told[SHOWN[1]].any()
        shares.append(its.state["learned"][SHARE])
    assert shares[0] == pytest.approx(shares[1], rel=1e-6)


def test_a_surveys_part_and_the_boxes_own_are_one_state() -> None:
    belief_of = load_scenario("imu_uwb_yolo").belief
    its = filtering_of(belief_of)
    told, n, c = learned_coefficients(belief_of, its), its.n, np.array(belief_of.estimator.biases.camera_sd)
    lasting = np.array([0.03, 0.05, 0.09, 1.0, 1.0, 1.0, 0.03, 0.02, 0.0, 0.9, 1.0, 1.0])
    weights = np.zeros(its.seen.layout.weights.shape)
    layout = told_layout(its.seen.layout, told, lasting, weights)
    rho = [layout.weights[row, column] for row, column in zip(told.row, told.column, strict=True)]
    np.testing.assert_allclose(rho, [1.0, 1.0, 1.0, *(np.hypot(lasting[6:9], c) / c)])

    P = np.diag(np.arange(1.0, n + 1.0))
    belief = np.concatenate((np.ones(n), P.ravel()))
    vary(belief, n, told, lasting)
    decays = np.exp(-belief_of.h / belief_of.estimator.biases.camera_time)
    survey = lasting[6:9] ** 2 / (lasting[6:9] ** 2 + c**2)
    r = survey * lasting[9:] + (1.0 - survey) * decays
    np.testing.assert_allclose(belief[told.state], [1.0, 1.0, 1.0, *r])
    found = belief[n:].reshape(n, n)[told.state, told.state][3:]
    np.testing.assert_allclose(found, r**2 * P[told.state, told.state][3:] + (1.0 - r**2) * c**2)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ("landmark_fix.survey_sd=0", r"survey_bank: must be null without survey_sd"),
        ("landmark_fix.method=known_tilt", r"survey_bank: must be null without survey_sd"),
        ("estimator.robust={}", r"landmark_fix\.survey_bank: .* must be null with estimator\.robust"),
    ],
)
def test_a_bank_has_something_to_share_and_a_filter_that_takes_it(change: str, message: str) -> None:
    with pytest.raises(InputError, match=message):
        load_scenario("imu_uwb_yolo", (change,))
