"""What fixes tell of the anchors' survey and of the scale of the ranges' noise, as an element of the loop."""

from typing import Any

import numpy as np

from ortilo_drake.loop.element import Box, Element, Values
from ortilo_drake.model.placing import fill
from ortilo_drake.model.scalars import values_of
from ortilo_drake.model.signals import ARRIVED, FIX_SIZE, PAYLOAD
from ortilo_drake.onboard.ranging.lasting_error import N_LASTING, SHARE, keep
from ortilo_drake.onboard.ranging.multilateration import believed_noise
from ortilo_drake.onboard.ranging.noise_scale import (
    NOTHING_YET,
    RESIDUALS,
    SCALE,
    SQUARES,
    counted,
    put_noise,
    weigh_scales,
)
from ortilo_drake.onboard.ranging.survey_bank import gather, kept_from, learned_first, weigh
from ortilo_drake.scenario import Multilateration as MultilaterationSettings

N_NOISE = 3  # s_0, s_1 and s_2 of range_equations.py


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
    """Learn from the residuals of a fix that was made in this tick."""
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
    put_noise(noise, n.noise, scale, survey[SHARE])
    if its.size > FIX_SIZE:
        sensitivities = its.size - 6 * e.size
        keep(survey, its[sensitivities - N_LASTING : sensitivities], its[sensitivities:])


BANK = Element("survey_bank", step=bank_step, shows="learned")


def bank_box(settings: MultilaterationSettings, anchors: np.ndarray, period: float) -> Box:
    """Return the box that learns from the uwb message as it lands, every so often [s], and the fix made of it.

    It says what is `learned` of the survey of the anchors (n, 3), see learned_first with 6 n sensitivities, and after
    it the ranges' `noise` as it is believed (3). The settings have a bias_bank, a noise_scale, or both.
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
