"""The result, at a place, of a filter that learns the survey's errors.

A filter with banks (onboard/ranging/survey_bank.py, onboard/landmarks/landmark_bank.py) sees its bias state s by a
coefficient rho, the sd that a fix says over the one of the settings. Hovering, that is the filter whose state is rho s,
of the sd that the fix says, with the survey's sd as it was learned and no bank.

What is learned is what the mean log likelihoods say. Where errors beta ~ N(0, s_w^2 I) last, the information Lambda of
the fixes that are remembered, of eigenvalues l, has E[eta eta^T] = s_w^2 Lambda^2 + Lambda, so that

    E log L(s) = 1/2 sum_l s^2 (s_w^2 l^2 + l) / (1 + s^2 l) - log(1 + s^2 l)

Where the scale of the noise is learned (onboard/ranging/bank_element.py), the filter is told noise of that scale.
"""

import numpy as np

from ortilo_drake.onboard.estimator.filter_model import filter_of
from ortilo_drake.onboard.ranging.survey_bank import share_of
from ortilo_drake.scenario import Scenario


def share_learned(bank: np.ndarray, sd: float, information: np.ndarray, world_sd: float) -> float:
    """Return the share of an sd [m] that a bank of shares c_j of it settles on.

    The information has the eigenvalues l of what is remembered [1/m^2]; world_sd is s_w [m].
    """
    return float(share_of(mean_log_likelihood(bank * sd, information, world_sd), bank))


def mean_log_likelihood(s: np.ndarray, information: np.ndarray, world_sd: float) -> np.ndarray:
    """Return E log L of sds s (m) [m]; information and world_sd as share_learned."""
    q = s[:, np.newaxis] ** 2 * information
    return np.asarray(0.5 * np.sum(q * (world_sd**2 * information + 1.0) / (1.0 + q) - np.log1p(q), axis=1))


def residual_information(J: np.ndarray, variances: np.ndarray) -> np.ndarray:
    """Return M = W - W J (J^T W J)^-1 J^T W of rows J (l, m) and their variances (l): what residuals tell of errors."""
    W = np.diag(1.0 / variances)
    return np.asarray(W - W @ J @ np.linalg.solve(J.T @ W @ J, J.T @ W))


def scale_learned(J: np.ndarray, told: np.ndarray, variances: np.ndarray) -> float:
    """Return the scale c of the noise that residuals show, c^2 = tr(M V) / (l - n) with M of what is told; 1 of none.

    J has rows (l, n); told and true variances, the diagonal of V, are (l).
    """
    residuals = len(J) - J.shape[1]
    if residuals <= 0:
        return 1.0
    return float(np.sqrt(np.diag(residual_information(J, told)) @ variances / residuals))


def with_biases(scenario: Scenario, **settings: object) -> Scenario:
    """Return a scenario whose filter believes in other biases of its fixes (estimator.biases)."""
    its = filter_of(scenario)
    biases = its.biases.model_copy(update=settings)
    return scenario.model_copy(update={"estimator": its.model_copy(update={"biases": biases})})
