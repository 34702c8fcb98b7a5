"""The element that learns from fixes the share of the survey's error and the scale of the ranges' noise.

The scale c of the noise of ranges or boxes is learned together with the share of the survey's error that lasts. The
noise is c times the noise in the settings. Before the first fix c^2 ~ IG(nu_0 / 2, nu_0 / 2) (inverse gamma), so the
settings count as nu_0 residuals. Beside Lambda and eta (survey_bank.py) fixes give the number of their residuals and
the residuals' weighted sum of squares, with the weights of the settings:

    nu = sum_k nu_k,   q = sum_k e_k^T M_k e_k

A lasting error with sd sigma, in units of the noise, is conjugate to this prior (Gelman et al., "Bayesian Data
Analysis", 2013, chapter 14): with

    Q = q - sigma^2 eta^T (I + sigma^2 Lambda)^-1 eta

the likelihood of a model is a Student's t, and the distribution of c^2 is an inverse gamma again:

    log L = -1/2 log det(I + sigma^2 Lambda) - 1/2 (nu_0 + nu) log(nu_0 + Q)
    c^2 ~ IG((nu_0 + nu) / 2, (nu_0 + Q) / 2)

Each model stands for a survey's sd in metres: sigma_j = c_j s_2 / c with the scale c of the fix before. White errors
change c, lasting errors change the share of s_2. The estimate of c^2 is the mean of 1 / E[c^-2] over the models.

The squares of one fix count at most as LIMIT times their expected value c^2 nu_k + s^2 tr M_k, because a range that a
wall lengthens is not noise. A larger true scale is still found, after a few more fixes.
"""

from typing import Any, Final

import numpy as np
from numba.extending import register_jitable

from ortilo_drake.loop.element import Box, Element, Values
from ortilo_drake.model.elementary import log
from ortilo_drake.model.placing import fill
from ortilo_drake.model.scalars import values_of
from ortilo_drake.model.signals import ARRIVED, FIX_SIZE, PAYLOAD
from ortilo_drake.onboard.ranging.lasting_error import N_LASTING, SHARE, keep
from ortilo_drake.onboard.ranging.multilateration import believed_noise
from ortilo_drake.onboard.ranging.survey_bank import gather, kept_from, learned_first, log_likelihood, share_of, weigh
from ortilo_drake.scenario import Multilateration as MultilaterationSettings

SQUARES, RESIDUALS, SCALE = 0, 1, 2  # indices in `scale` of q, nu and c^2
NOTHING_YET: Final = (0.0, 0.0, 1.0)
LIMIT: Final = 4.0


@register_jitable
def weigh_scales(
    gathered: np.ndarray,
    scale: np.ndarray,
    bank: np.ndarray,
    s_2: float,
    worth: float,
    weights: np.ndarray,
    Q: np.ndarray,
    S: np.ndarray,
    e: np.ndarray,
) -> float:
    """Return the estimated share of the setting s_2 [m]; write the models' weights (m), and c^2 to `scale`.

    `gathered` has [Lambda, eta] (k n, n + 1) of each of the k groups with independent errors, and the lower half of
    Lambda; `scale` has q, nu and c^2, `bank` c_j (m), `worth` is nu_0. Q (m), S (n, n) and e (n) are work memory.
    """
    c, n = np.sqrt(scale[SCALE]), e.size
    nu = worth + scale[RESIDUALS]
    for j in range(bank.size):
        weights[j], Q[j], sigma = 0.0, scale[SQUARES], bank[j] * s_2 / c
        for i in range(0, gathered.shape[0] if sigma > 0.0 else 0, n):
            weights[j] += log_likelihood(gathered[i : i + n], sigma, S, e)
            gain = 0.0
            for row in range(n):
                gain += e[row] * e[row]
            weights[j] -= 0.5 * gain
            Q[j] -= gain
        Q[j] = worth + max(Q[j], 0.0)
        weights[j] -= 0.5 * nu * log(Q[j])
    share = share_of(weights, bank)
    scale[SCALE] = 0.0
    for j in range(bank.size):
        scale[SCALE] += weights[j] * Q[j] / nu
    return share


@register_jitable
def counted(squares: float, expected: float) -> float:
    """Return the factor on a fix's residuals that limits their squares e^T M e to LIMIT times the expected value."""
    if squares <= LIMIT * expected:
        return 1.0
    return float(np.sqrt(LIMIT * expected / squares))


N_NOISE = 3  # number of noise settings s_0, s_1, s_2 of range_equations.py


def bank_step(
    n: Any,
    message: np.ndarray,
    fix: np.ndarray,
    anchors: np.ndarray,
    bank: np.ndarray,
    learned: np.ndarray,
    gathered: np.ndarray,
    scale: np.ndarray,
    S: np.ndarray,
    e: np.ndarray,
    rows: np.ndarray,
    told: np.ndarray,
    Q: np.ndarray,
) -> None:
    """Update the learned numbers with the residuals of this tick's fix, if there is one."""
    its, uwb, scales = values_of(fix), values_of(message), n.worth > 0.0
    if its[ARRIVED] == 0.0:
        return
    survey, noise = learned[: learned.size - N_NOISE], learned[learned.size - N_NOISE :]
    weights = survey[survey.size - bank.size :]
    for i in range(e.size):
        fill(told[i], 0.0)
        for j in range(e.size + 1):
            gathered[i, j] *= n.keeps
    p = its[PAYLOAD : PAYLOAD + 3]
    residuals, squares = gather(told if scales else gathered, p, uwb, anchors, n.noise, rows)
    if scales:
        expected = scale[SCALE] * residuals
        for i in range(e.size):
            expected += noise[2] ** 2 * told[i, i]
        part = counted(squares, expected)
        for i in range(e.size):
            for j in range(e.size):
                gathered[i, j] += told[i, j]
            gathered[i, e.size] += part * told[i, e.size]
        scale[SQUARES] = n.keeps * scale[SQUARES] + part**2 * squares
        scale[RESIDUALS] = n.keeps * scale[RESIDUALS] + residuals
        survey[SHARE] = weigh_scales(gathered, scale, bank, n.noise[2], n.worth, weights, Q, S, e)
    else:
        survey[SHARE] = weigh(weights, gathered, bank, n.noise[2], S, e)
    c = np.sqrt(scale[SCALE])
    noise[0], noise[1], noise[2] = c * n.noise[0], c * n.noise[1], survey[SHARE] * n.noise[2]
    if its.size > FIX_SIZE:
        sensitivities = its.size - 6 * e.size
        keep(survey, its[sensitivities - N_LASTING : sensitivities], its[sensitivities:])


BANK = Element("survey_bank", step=bank_step, shows="learned")


def bank_box(settings: MultilaterationSettings, anchors: np.ndarray, period: float) -> Box:
    """Return the box that learns from the arrived uwb message, one every `period` [s], and from the fix made of it.

    The box outputs what it has `learned` of the survey of the anchors (n, 3), see learned_first with 6 n sensitivities,
    and then the estimated `noise` of the ranges (3). The settings have a bias_bank, a noise_scale, or both.
    """
    bank, n, noise = np.array(settings.bias_bank or (1.0,)), len(anchors), believed_noise(settings)
    survey = learned_first(bank, 6 * n)
    learned = np.concatenate((survey, noise * [1.0, 1.0, survey[SHARE]]))
    numbers = {"noise": noise, "keeps": kept_from(period), "worth": settings.noise_scale or 0.0}
    start = {"learned": learned, "gathered": np.zeros((n, n + 1)), "scale": np.array(NOTHING_YET)}
    work = {"S": (n, n), "e": (n,), "rows": (n, 3), "told": (n, n + 1), "Q": (len(bank),)}
    parts = {"learned": (0, survey.size), "noise": (survey.size, N_NOISE)}
    given = Values(numbers, start, {"anchors": anchors, "bank": bank})
    return Box("uwb_bank", BANK, learned.size, given, work, parts=parts)
