"""A scenario whose filter is given the survey's error that it would learn at a place.

A filter with banks (onboard/ranging/survey_bank.py, onboard/landmarks/landmark_bank.py) sees its bias state s by a
coefficient rho, the sd that a fix says over the one of the settings. Hovering, that is the filter whose state is rho s,
of the sd that the fix says, with the survey's sd as it was learned and no bank.

What is learned is what the mean log likelihoods say. Where errors beta ~ N(0, s_w^2 I) last, the information Lambda of
the fixes that are remembered, of eigenvalues l, has E[eta eta^T] = s_w^2 Lambda^2 + Lambda, so that

    E log L(s) = 1/2 sum_l s^2 (s_w^2 l^2 + l) / (1 + s^2 l) - log(1 + s^2 l)
"""

import numpy as np

from ortilo_drake.model.room import Room
from ortilo_drake.onboard.landmarks.landmark_bank import REPEATS
from ortilo_drake.onboard.ranging.survey_bank import MEMORY, share_of
from ortilo_drake.scenario import Scenario
from ortilo_drake.sensors.information_rows import GRADIENT, SOURCE, VARIANCE
from ortilo_drake.sensors.unknown_error import moved
from ortilo_drake.sensors.uwb import unknown_fitted
from ortilo_drake.studies.loop.fix_errors import of_boxes, of_ranges


def share_learned(bank: np.ndarray, sd: float, information: np.ndarray, world_sd: float) -> float:
    """Return the share of an sd that a bank settles on.

    Args:
        bank: shares c_j.
        sd: that c_j is the share of [m].
        information: eigenvalues l of what is remembered [1/m^2].
        world_sd: s_w [m].
    """
    return float(share_of(mean_log_likelihood(bank * sd, information, world_sd), bank))


def mean_log_likelihood(s: np.ndarray, information: np.ndarray, world_sd: float) -> np.ndarray:
    """Return E log L of sds s (m) [m]; information and world_sd as share_learned."""
    q = s[:, np.newaxis] ** 2 * information
    return np.asarray(0.5 * np.sum(q * (world_sd**2 * information + 1.0) / (1.0 + q) - np.log1p(q), axis=1))


def residual_information(J: np.ndarray, variances: np.ndarray) -> np.ndarray:
    """Return M = W - W J (J^T W J)^-1 J^T W, the residuals' information on errors, of rows J (l, m), variances (l)."""
    W = np.diag(1.0 / variances)
    return np.asarray(W - W @ J @ np.linalg.solve(J.T @ W @ J, J.T @ W))


def as_learned(scenario: Scenario, x: np.ndarray) -> Scenario:
    """Return the scenario with its filter set to what its banks learn hovering at x (12); the same without banks."""
    room = scenario.load_room()
    if "uwb" in scenario.sensors and scenario.multilateration.bias_bank is not None:
        scenario = _anchors_learned(scenario, room, x)
    if "camera" in scenario.sensors and scenario.landmark_fix.survey_bank is not None:
        scenario = _landmarks_learned(scenario, room, x)
    return scenario


def _anchors_learned(scenario: Scenario, room: Room, x: np.ndarray) -> Scenario:
    settings, uwb, survey = scenario.multilateration, scenario.truth.uwb, scenario.truth.survey
    _, rows = of_ranges(scenario, room, x)
    M = residual_information(rows[:, GRADIENT][:, :3], rows[:, VARIANCE])
    fixes = MEMORY / (scenario.every("uwb") * scenario.h)
    fitted = [error.sd[0] for error in unknown_fitted(scenario, len(room.anchors))]
    lasts = (uwb.bias, uwb.bias_sd, uwb.slow_sd, survey.anchors_sd, *fitted)
    s = settings.bias_sd
    s *= share_learned(np.array(settings.bias_bank), s, fixes * np.linalg.eigvalsh(M), float(np.linalg.norm(lasts)))
    settings = settings.model_copy(update={"bias_bank": None, "bias_sd": s})
    scenario = scenario.model_copy(update={"multilateration": settings})
    D, rows = of_ranges(scenario, room, x)
    return _with_biases(scenario, uwb_sd=tuple(s * np.linalg.norm(D, axis=1)))


def _landmarks_learned(scenario: Scenario, room: Room, x: np.ndarray) -> Scenario:
    settings, biases, h = scenario.landmark_fix, scenario.estimator.biases, scenario.h
    made = of_boxes(scenario, room, x)
    if made is None:
        return scenario
    rows, n = made[1], len(room.landmark_positions)
    M = residual_information(rows[:, GRADIENT][:, :6], rows[:, VARIANCE])
    A = moved(-1.0, n, 2)(rows)
    seen = sorted({int(source) // 2 for source in rows[:, SOURCE]})
    # each landmark is told of by itself
    told = [A[:, 3 * i : 3 * i + 3].T @ np.where(_of(rows, i), M, 0.0) @ A[:, 3 * i : 3 * i + 3] for i in seen]
    fixes = MEMORY / (scenario.every("camera") * h) / REPEATS
    information = fixes * np.concatenate([np.linalg.eigvalsh(each) for each in told])
    s = settings.survey_sd
    s *= share_learned(np.array(settings.survey_bank), s, information, scenario.truth.survey.landmarks_sd)
    settings = settings.model_copy(update={"survey_bank": None, "survey_sd": s})
    scenario = scenario.model_copy(update={"landmark_fix": settings})
    made = of_boxes(scenario, room, x)
    assert made is not None
    sigma = s * np.linalg.norm(made[0][:3] @ A, axis=1)
    own = np.array(biases.camera_sd)
    if not own.any():
        return scenario
    lasts, decays = sigma @ sigma, own @ own
    r = (lasts + np.exp(-h / biases.camera_time) * decays) / (lasts + decays)
    return _with_biases(scenario, camera_sd=tuple(np.hypot(sigma, own)), camera_time=float(-h / np.log(r)))


def _of(rows: np.ndarray, landmark: int) -> np.ndarray:
    own = rows[:, SOURCE].astype(int) // 2 == landmark
    return np.logical_and.outer(own, own)


def _with_biases(scenario: Scenario, **settings: object) -> Scenario:
    biases = scenario.estimator.biases.model_copy(update=settings)
    return scenario.model_copy(update={"estimator": scenario.estimator.model_copy(update={"biases": biases})})
