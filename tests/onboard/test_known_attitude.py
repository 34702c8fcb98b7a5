"""The covariance of boxes' residuals, and the 3 x 3 inverse, against dense algebra."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from seen_landmarks import CAMERA, EXACT, POINTS, centers, state

from ortilo_drake.onboard.landmarks.known_attitude import inverse_3x3
from ortilo_drake.onboard.landmarks.landmark_fix import METHODS

known_attitude = METHODS["known_attitude"]

DOTS = np.zeros((len(POINTS), 1, 3))  # an outline of one point has no kinks: the projection is smooth
SD = 1e-4  # of a box centre [px], so small that the projection is linear in the errors


def sds(n: int) -> np.ndarray:
    return np.full((n, 2), SD)


def dense_jacobian(n: int) -> tuple[np.ndarray, np.ndarray]:
    """d centres / d p_WB and / d rpy (2 n, 3) by central differences of OpenCV's projection."""
    ahead, back = ([centers(EXACT + d, POINTS[:n], DOTS[:n]).ravel() for d in s * np.eye(6)] for s in (1e-5, -1e-5))
    J = (np.array(ahead) - np.array(back)).T / 2e-5
    return J[:, :3], J[:, 3:]


@pytest.mark.parametrize("n", [2, 3, len(POINTS)])
@pytest.mark.parametrize("seed", range(8))
def test_the_box_that_disagrees_most_is_dropped_from_its_own_residual_covariance_on(n: int, seed: int) -> None:
    """A limit just above the greatest r_i^T S_i^-1 r_i keeps every box, one just below it drops one.

    The residuals are r = M (v + A e), M = I - J J^+, of the boxes' errors v and the attitude's e, so their covariance
    is M (sd^2 I + A P_a A^T) M^T.
    """
    rng = np.random.default_rng(seed)
    J, A = dense_jacobian(n)
    M = np.eye(2 * n) - J @ np.linalg.pinv(J)
    root = rng.normal(size=(3, 3)) * 2.0 * SD / CAMERA.f  # its part of the residuals is about as large as the boxes'
    P_a = root @ root.T
    S = M @ (SD**2 * np.eye(2 * n) + A @ P_a @ A.T) @ M.T
    errors = 3.0 * SD * rng.normal(size=2 * n)
    r = M @ errors
    greatest = max(
        r[i : i + 2] @ np.linalg.solve(S[i : i + 2, i : i + 2] + 1e-6 * SD**2 * np.eye(2), r[i : i + 2])
        for i in range(0, 2 * n, 2)
    )
    P = np.zeros((15, 15))
    P[:3, :3], P[3:6, 3:6] = np.eye(3), P_a
    z = centers(EXACT, POINTS[:n], DOTS[:n]) + errors.reshape(n, 2)
    everything = np.array(EXACT[:3]) + np.linalg.pinv(J) @ errors
    kept = []
    for limit in (0.997, 1.003):
        found, p_WB, cov = known_attitude(
            z, POINTS[:n], DOTS[:n], state(), P.ravel(), CAMERA, sds(n), limit * np.sqrt(greatest)
        )
        kept.append(found and np.linalg.norm(p_WB - everything) < 1e-3 * np.linalg.norm(everything - EXACT[:3]))
    assert kept == [False, True]
    G = np.linalg.pinv(J) @ A
    np.testing.assert_allclose(cov, SD**2 * np.linalg.inv(J.T @ J) + G @ P_a @ G.T, rtol=1e-4, atol=1e-4 * cov.max())


@given(st.integers(0, 10**6), st.floats(-12.0, 12.0), st.floats(0.01, 1.0))
def test_the_inverse_of_a_symmetric_matrix_is_numpys(seed: int, exponent: float, least: float) -> None:
    turn = np.linalg.qr(np.random.default_rng(seed).normal(size=(3, 3)))[0]
    N = 10.0**exponent * (turn * np.array([1.0, 0.3, least])) @ turn.T
    regular, inverse = inverse_3x3(N)
    assert regular
    np.testing.assert_allclose(inverse, np.linalg.inv(N), rtol=1e-9, atol=1e-9 * np.abs(inverse).max())


@given(st.integers(0, 10**6), st.floats(-12.0, 12.0), st.integers(1, 2))
def test_a_singular_matrix_has_no_inverse(seed: int, exponent: float, rank: int) -> None:
    turn = np.linalg.qr(np.random.default_rng(seed).normal(size=(3, 3)))[0]
    diagonal = np.array([1.0, 1.0, 1e-13])
    diagonal[rank:] = 1e-13
    N = 10.0**exponent * (turn * diagonal) @ turn.T
    regular, nothing = inverse_3x3(N)
    assert not regular
    np.testing.assert_array_equal(nothing, np.zeros((3, 3)))


def test_one_box_is_no_fix_and_leaves_the_estimates_position_without_a_covariance() -> None:
    xhat = state()
    xhat[:3] += 0.1
    seen = centers(EXACT, POINTS[:1], DOTS[:1])
    found, p_WB, cov = known_attitude(seen, POINTS[:1], DOTS[:1], xhat, np.eye(15).ravel(), CAMERA, sds(1), 4.0)
    assert not found
    np.testing.assert_array_equal(p_WB, xhat[:3])
    np.testing.assert_array_equal(cov, np.zeros((3, 3)))


@pytest.mark.parametrize("n", [4, len(POINTS)])
def test_of_two_boxes_that_are_wrong_the_worse_goes_first(n: int) -> None:
    """With the worse gone the other is found out as well; the rest, free of errors, gives the position."""
    z, errors = centers(EXACT, POINTS[:n], DOTS[:n]), {2: [30.0, 0.0], 3: [0.0, 500.0]}
    for box, error in errors.items():
        z[box] += SD * np.array(error)
    P = 1e-20 * np.eye(15).ravel()
    found, p_WB, cov = known_attitude(z, POINTS[:n], DOTS[:n], state(), P, CAMERA, sds(n), 4.0)
    assert found
    np.testing.assert_allclose(p_WB, EXACT[:3], atol=1e-9)
    J = np.delete(dense_jacobian(n)[0].reshape(-1, 2, 3), list(errors), axis=0).reshape(-1, 3)
    np.testing.assert_allclose(cov, SD**2 * np.linalg.inv(J.T @ J), rtol=1e-3, atol=1e-3 * cov.max())
