"""The error of the landmarks' survey, learned from the residuals of their boxes.

A survey error lambda_i of a landmark moves its box by A_i lambda_i, A_i = -d z_i / d p_WB. With J the Jacobian of all
boxes with respect to the pose and W the weights of the boxes' own errors alone, the residuals e of a fix have this
information on the landmarks, whatever the pose:

    M = W - W J (J^T W J)^-1 J^T W,   Lambda_i = sum_k A_i^T M_ii A_i,   eta_i = sum_k A_i^T (M e)_i

Each landmark is judged by all other landmarks (a composite likelihood: Varin, Reid and Firth, "An overview of composite
likelihood methods", Statistica Sinica 21, 2011). So the memory grows with the number of landmarks and not with its
square. The likelihood of a share c_j of the survey's sd s in the settings (landmark_fix.survey_sd) is

    log L_j = sum_i -1/2 log det(I + c_j^2 s^2 Lambda_i) + 1/2 c_j^2 s^2 eta_i^T (I + c_j^2 s^2 Lambda_i)^-1 eta_i

The estimated share follows as in ranging/survey_bank.py. The errors of boxes are correlated over time: 0.44 of their
variance lasts for a second (world/sensors/camera_calibration.yaml), so an image counts as 1 / REPEATS of an image.

If the scale of the boxes' noise is learned too (landmark_fix.noise_scale), nu and q of ranging/bank_element.py come
from the difference of each box from its prediction by all others, M_ii^-1 (M e)_i, with the covariance M_ii^-1:

    nu = sum_k 2 k_k / REPEATS,   q = sum_k sum_i (M e)_i^T M_ii^-1 (M e)_i / REPEATS

A fix has the error sum_i G_i A_i lambda_i, G = N^-1 J^T R^-1 with R of boxes and survey. The lasting error of its
position follows as in ranging/lasting_error.py, with g the rows of all G_i A_i.
"""

from typing import Final, NamedTuple

import numpy as np
from numba.extending import register_jitable

from ortilo_drake.model.cholesky import scaled_inverse
from ortilo_drake.model.equations import rotation_matrix
from ortilo_drake.model.pinhole import box_and_jacobian, sines
from ortilo_drake.model.placing import fill
from ortilo_drake.model.products import product, times
from ortilo_drake.onboard.landmarks.box_fix import BoxBelief
from ortilo_drake.onboard.landmarks.known_attitude import FREE_SD
from ortilo_drake.onboard.landmarks.landmark_association import center_sd, with_survey
from ortilo_drake.onboard.ranging.bank_element import RESIDUALS, SQUARES, weigh_scales
from ortilo_drake.onboard.ranging.lasting_error import KEY, SHARE, put_kept
from ortilo_drake.onboard.ranging.survey_bank import weigh

LEAST = 4  # smallest number of boxes that leaves residuals after six unknowns
REPEATS: Final = 5.0
REGULAR = 1e-6  # smallest scaled determinant of M_ii; below it the other boxes alone do not determine the pose
PER_LANDMARK = 12  # size of [Lambda_i, eta_i] (3 x 4); a landmark has 9 sensitivities


class Solved(NamedTuple):
    """A fix and its boxes."""

    centers: np.ndarray
    """centres of the boxes [px] (k, 2)."""
    chosen: np.ndarray
    """indices of the boxes' landmarks (k)."""
    pose: np.ndarray
    """solved pose [p_WB, rpy] (6)."""


@register_jitable
def put_information(
    out: np.ndarray, sensitivities: np.ndarray, solved: Solved, believed: BoxBelief
) -> tuple[float, float]:
    """Write the information of a fix's boxes on each landmark, and the fix's sensitivities; zeros for unseen landmarks.

    Returns the number of residuals of the boxes from their predictions by all others, and their sum of squares sum_i (M
    e)_i^T M_ii^-1 (M e)_i. `out` gets [Lambda_i, eta_i] with the lower half of Lambda_i (12 n), `sensitivities` the
    rows of G_i A_i, x of all landmarks first, then y and z (9 n). `believed` has the present survey sd.
    """
    fill(out, 0.0)
    fill(sensitivities, 0.0)
    k, n = solved.chosen.size, believed.positions.shape[0]
    p_WB, rpy = solved.pose[:3], solved.pose[3:]
    R_WB, of_rpy, box = rotation_matrix(rpy), sines(rpy), np.empty(4)
    J, e, W, R = np.empty((k, 2, 6)), np.empty((k, 2)), np.empty((k, 2)), np.empty((k, 2))
    for i in range(k):
        its = solved.chosen[i]
        place, outline = believed.positions[its], believed.outlines[its]
        if not box_and_jacobian(place, outline, p_WB, of_rpy, R_WB, believed.camera, box, J[i]):
            return 0.0, 0.0
        for axis in range(2):
            own = center_sd(box[2 + axis] - box[axis], believed.sd, believed.growth)
            e[i, axis] = solved.centers[i, axis] - 0.5 * (box[axis] + box[2 + axis])
            W[i, axis] = 1.0 / own**2
            R[i, axis] = 1.0 / with_survey(own, J[i, axis], believed.survey_sd) ** 2
    regular, C = scaled_inverse(normal(J, R, 1.0 / FREE_SD**2))
    if regular:
        for i in range(k):
            for axis in range(2):
                G = times(C, J[i, axis])
                for a in range(3):
                    for b in range(3):
                        at = 3 * (n * a + solved.chosen[i]) + b
                        sensitivities[at] -= R[i, axis] * G[a] * J[i, axis, b]
    regular, C = scaled_inverse(normal(J, W, 0.0))
    if k < LEAST or not regular:
        return 0.0, 0.0
    residuals, squares = 0.0, 0.0
    g, M_ii, Me = np.zeros(6), np.empty((2, 2)), np.empty(2)
    for i in range(k):
        for axis in range(2):
            for a in range(6):
                g[a] += W[i, axis] * e[i, axis] * J[i, axis, a]
    step = times(C, g)
    for i in range(k):
        its = out[PER_LANDMARK * solved.chosen[i] : PER_LANDMARK * (solved.chosen[i] + 1)].reshape((3, 4))
        hat = product(product(J[i], C), J[i].T)
        for v in range(2):
            rest = e[i, v]
            for a in range(6):
                rest -= J[i, v, a] * step[a]
            Me[v] = W[i, v] * rest
            for a in range(3):
                its[a, 3] -= W[i, v] * rest * J[i, v, a]
                for w in range(2):
                    M = W[i, v] * ((1.0 if v == w else 0.0) - hat[v, w] * W[i, w])
                    M_ii[v, w] = M
                    for b in range(a + 1):
                        its[a, b] += J[i, v, a] * M * J[i, w, b]
        uu, uv, vv = M_ii[0, 0], M_ii[0, 1], M_ii[1, 1]
        determinant = uu * vv - uv * uv
        if determinant > REGULAR * W[i, 0] * W[i, 1]:
            residuals += 2.0
            squares += (vv * Me[0] ** 2 - 2.0 * uv * Me[0] * Me[1] + uu * Me[1] ** 2) / determinant
    return residuals, squares


@register_jitable
def normal(J: np.ndarray, W: np.ndarray, free: float) -> np.ndarray:
    """Return J^T W J (6 x 6) of J (k, 2, 6) and weights W (k, 2); `free` [1/rad^2] is added on the angles' diagonal."""
    N = np.zeros((6, 6))
    for i in range(W.shape[0]):
        for axis in range(2):
            for a in range(6):
                for b in range(6):
                    N[a, b] += W[i, axis] * J[i, axis, a] * J[i, axis, b]
    for a in range(3, 6):
        N[a, a] += free
    return N


@register_jitable
def dot(one: np.ndarray, other: np.ndarray) -> float:
    """Return the scalar product of two vectors, summed in a fixed order."""
    total = 0.0
    for i in range(one.size):
        total += one[i] * other[i]
    return total


@register_jitable
def put_lasting(out: np.ndarray, s: float, here: np.ndarray, learned: np.ndarray) -> None:
    """Write a fix's lasting error to out (6): the sds [m] (3) and the shares kept of the error of the fix before (3).

    s is the estimated sd of the landmarks' survey [m]; `here` has the fix's sensitivities (9 n); `learned` has those of
    the stored place (survey_bank.learned_first).
    """
    m = here.size // 3
    for axis in range(3):
        g, key = here[m * axis : m * (axis + 1)], learned[KEY + m * axis : KEY + m * (axis + 1)]
        put_kept(out, axis, s, (dot(g, g), dot(g, key), dot(key, key)), learned)


@register_jitable
def learn(
    learned: np.ndarray,
    gathered: np.ndarray,
    scale: np.ndarray,
    told: np.ndarray,
    left: np.ndarray,
    keeps: float,
    worth: float,
    bank: np.ndarray,
    survey_sd: float,
    Q: np.ndarray,
    S: np.ndarray,
    e: np.ndarray,
) -> None:
    """Add a fix's information to `gathered`, and write the share and the models' weights to `learned`.

    `learned` is as in survey_bank.learned_first, with 9 n sensitivities; `gathered` is [Lambda_i, eta_i] with the lower
    half of Lambda_i (3 n, 4). `told` (12 n) and `left` (2) are what put_information wrote and returned; `keeps` is the
    share of older information that is kept. `scale` has q, nu and c^2 of the boxes' noise (3); it changes only if
    `worth`, nu_0, is not 0. `bank` is c_j (m), survey_sd is s [m]. Q (m), S (3, 3) and e (3) are work memory.
    """
    for i in range(gathered.shape[0]):
        for j in range(4):
            gathered[i, j] = keeps * gathered[i, j] + told[4 * i + j] / REPEATS
    weights = learned[learned.size - bank.size :]
    if worth == 0.0:
        learned[SHARE] = weigh(weights, gathered, bank, survey_sd, S, e)
        return
    scale[RESIDUALS] = keeps * scale[RESIDUALS] + left[0] / REPEATS
    scale[SQUARES] = keeps * scale[SQUARES] + left[1] / REPEATS
    learned[SHARE] = weigh_scales(gathered, scale, bank, survey_sd, worth, weights, Q, S, e)
