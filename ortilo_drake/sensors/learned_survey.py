"""The settings that a filter with banks learns at one position.

A filter with banks (onboard/ranging/survey_bank.py, onboard/landmarks/landmark_bank.py) has a bias state s with a
coefficient rho, the sd given by a fix over the sd in the settings. At hover this filter equals a filter without a bank
whose bias state is rho s, with the sd given by the fix for the learned sd of the survey.

The learned sd follows from the mean log likelihoods. If errors beta ~ N(0, s_w^2 I) last, the information Lambda of the
remembered fixes, with eigenvalues l, has E[eta eta^T] = s_w^2 Lambda^2 + Lambda, so that

    E log L(s) = 1/2 sum_l s^2 (s_w^2 l^2 + l) / (1 + s^2 l) - log(1 + s^2 l)

If the scale of the noise is learned (onboard/ranging/bank_element.py), the filter's noise gets this scale.
"""

import numpy as np

from ortilo_drake.onboard.estimator.filter_model import filter_of
from ortilo_drake.onboard.ranging.survey_bank import share_of
from ortilo_drake.scenario import Scenario


def share_learned(bank: np.ndarray, sd: float, information: np.ndarray, world_sd: float) -> float:
    """Return the share of `sd` [m] that a bank with shares c_j learns.

    `information` holds the eigenvalues l of the remembered information [1/m^2]; world_sd is s_w [m].
    """
    return float(share_of(mean_log_likelihood(bank * sd, information, world_sd), bank))


def mean_log_likelihood(s: np.ndarray, information: np.ndarray, world_sd: float) -> np.ndarray:
    """Return E log L (m) of sds s (m) [m]; information and world_sd as in share_learned."""
    q = s[:, np.newaxis] ** 2 * information
    return np.asarray(0.5 * np.sum(q * (world_sd**2 * information + 1.0) / (1.0 + q) - np.log1p(q), axis=1))


def residual_information(J: np.ndarray, variances: np.ndarray) -> np.ndarray:
    """Return M = W - W J (J^T W J)^-1 J^T W, the residuals' information on errors, for rows J (l, m), variances (l)."""
    W = np.diag(1.0 / variances)
    return np.asarray(W - W @ J @ np.linalg.solve(J.T @ W @ J, J.T @ W))


def scale_learned(J: np.ndarray, told: np.ndarray, variances: np.ndarray) -> float:
    """Return the scale c of the noise learned from residuals, c^2 = tr(M V) / (l - n); 1 without residuals.

    J has rows (l, n). M uses the variances in the settings, `told` (l); V has the true `variances` (l) on its diagonal.
    """
    residuals = len(J) - J.shape[1]
    if residuals <= 0:
        return 1.0
    return float(np.sqrt(np.diag(residual_information(J, told)) @ variances / residuals))


def with_biases(scenario: Scenario, **settings: object) -> Scenario:
    """Return the scenario with changed settings of the biases of fixes (estimator.biases)."""
    its = filter_of(scenario)
    biases = its.biases.model_copy(update=settings)
    return scenario.model_copy(update={"estimator": its.model_copy(update={"biases": biases})})
