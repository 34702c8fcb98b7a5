"""The error of the anchors' survey, learned from the residuals of the ranges to them.

Twelve ranges for three unknowns leave nine residuals. With the unit vectors u_i as the rows of J and the weights
W = diag(1 / v_i^2) of the ranges' noise alone, the residuals e_i = r_i - |p - a_i| of a fix p have information on the
lasting error beta (n) of the ranges, whatever the position:

    M = W - W J (J^T W J)^-1 J^T W,   Lambda = sum_k M_k,   eta = sum_k M_k e_k

M J = 0, so that an error of p itself does not count. Each model j of the bank has the sd c_j s_2 of the lasting error,
with c_j a share of the setting s_2 (multilateration.bias_sd). For beta ~ N(0, (c_j s_2)^2 I) the likelihood, divided by
the likelihood of beta = 0, is

    log L_j = -1/2 log det(I + s^2 Lambda) + 1/2 s^2 eta^T (I + s^2 Lambda)^-1 eta,   s = c_j s_2

The models are equally likely before the first fix. The estimated share is the root of the mean of c_j^2 over the
models. As the vehicle moves, other components of the survey's error lie along the ranges, so old fixes fade with
MEMORY.
"""

from typing import Final

import numpy as np
from numba.extending import register_jitable

from ortilo_drake.model.cholesky import squared_norm_in_place
from ortilo_drake.model.elementary import exp, log
from ortilo_drake.model.placing import fill
from ortilo_drake.model.signals import PAYLOAD
from ortilo_drake.onboard.ranging.range_equations import MIN_SD, inverse, normal_equations, product

MEMORY: Final = 10.0  # time constant with which old fixes fade [s]


@register_jitable
def gather(
    gathered: np.ndarray, p: np.ndarray, uwb: np.ndarray, anchors: np.ndarray, noise: np.ndarray, rows: np.ndarray
) -> tuple[float, float]:
    """Add a fix's M and M e to [Lambda, eta] (n, n + 1); return the number of residuals that it leaves, and e^T M e.

    If the ranges do not determine a position, nothing is added and zeros are returned. Only the lower half of Lambda is
    written. p is the fix (3), the message uwb has 2 + 2 n numbers, anchors and noise are as in range_equations.py;
    `rows` (n, 3) is work memory for W J.
    """
    n = anchors.shape[0]
    ranges, there = uwb[PAYLOAD : PAYLOAD + n], uwb[PAYLOAD + n :]
    cost, N, g = normal_equations(p, ranges, there, anchors, noise[:2])
    definite, C = inverse(N)
    if not definite:
        return 0.0, 0.0
    residuals = -3.0
    for i in range(n):
        if there[i] == 0.0:
            fill(rows[i], 0.0)
            continue
        residuals += 1.0
        x, y, z = p[0] - anchors[i, 0], p[1] - anchors[i, 1], p[2] - anchors[i, 2]
        d = np.sqrt(x * x + y * y + z * z) + 1e-30
        w = 1.0 / max(noise[0] + noise[1] * ranges[i], MIN_SD) ** 2
        rows[i, 0], rows[i, 1], rows[i, 2] = w * x / d, w * y / d, w * z / d
        x, y, z = product(C, rows[i])
        gathered[i, n] += w * (ranges[i] - d) - (x * g[0] + y * g[1] + z * g[2])
        gathered[i, i] += w
        for j in range(i + 1):
            gathered[i, j] -= x * rows[j, 0] + y * rows[j, 1] + z * rows[j, 2]
    x, y, z = product(C, g)
    return residuals, max(cost - (x * g[0] + y * g[1] + z * g[2]), 0.0)


@register_jitable
def log_likelihood(gathered: np.ndarray, s: float, S: np.ndarray, e: np.ndarray) -> float:
    """Return log L of the sd s [m], given [Lambda, eta] (n, n + 1); S (n, n) and e (n) are work memory."""
    n = e.size
    for i in range(n):
        for j in range(i + 1):
            S[i, j] = s * s * gathered[i, j]
        S[i, i] += 1.0
        e[i] = s * gathered[i, n]
    found = 0.5 * squared_norm_in_place(S, e)
    for i in range(n):
        found -= log(S[i, i])
    return found


@register_jitable
def is_told(gathered: np.ndarray, n: int) -> bool:
    """Return whether any fix has given information on a group's errors (n)."""
    told = False
    for i in range(n):
        told = told or gathered[i, i] != 0.0
    return told


@register_jitable
def weigh(
    weights: np.ndarray, gathered: np.ndarray, bank: np.ndarray, s_2: float, S: np.ndarray, e: np.ndarray
) -> float:
    """Return the estimated share of s_2 [m]; write the models' weights (m).

    Each n rows of [Lambda, eta] (k n, n + 1) belong to a group with its own independent errors; S and e as in
    log_likelihood.
    """
    n = e.size
    for j in range(bank.size):
        weights[j] = 0.0
        for i in range(0, gathered.shape[0], n):
            if bank[j] > 0.0 and is_told(gathered[i : i + n], n):  # otherwise log L is 0
                weights[j] += log_likelihood(gathered[i : i + n], bank[j] * s_2, S, e)
    return share_of(weights, bank)


@register_jitable
def share_of(weights: np.ndarray, bank: np.ndarray) -> float:
    """Return the estimated share; replace the models' log likelihoods in `weights` (m) by the models' weights."""
    best, total, mean = -np.inf, 0.0, 0.0
    for j in range(bank.size):
        best = max(best, weights[j])
    for j in range(bank.size):
        weights[j] = exp(weights[j] - best)
        total += weights[j]
    for j in range(bank.size):
        weights[j] /= total
        mean += weights[j] * bank[j] ** 2
    return np.sqrt(mean)


def learned_first(bank: np.ndarray, sensitivities: int) -> np.ndarray:
    """Return the learned numbers before the first fix.

    They are [share, sds of the last fix's lasting error (3) [m], correlation of this error with the one at the place
    that lasting_error.py has stored (3), the sensitivities at this place, weights of the models].
    """
    weights = np.full(bank.size, 1.0 / bank.size)
    return np.concatenate(([np.sqrt(weights @ bank**2)], np.zeros(3), np.ones(3), np.zeros(sensitivities), weights))


def kept_from(period: float) -> float:
    """Return the factor (0 to 1) by which information from old fixes fades in a period [s]."""
    return float(np.exp(-period / MEMORY))
