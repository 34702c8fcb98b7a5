"""The lasting part of a fix's error, which comes from the errors of the anchors' survey and from the geometry.

A fix has the error G A a, with a the errors of the anchors' positions, sd s each (3 n), A = -diag(u_i^T) their
projection on the ranges, and G = N^-1 J^T R^-1 of range_equations.py. Along one axis, the sd of this error and its
correlation with the error of a fix at another place are

    sigma = s |g|,   rho = g . g' / (|g| |g'|),   g . g' = sum_i G_i G'_i u_i . u'_i

g is the fix's sensitivity. From fix to fix the share r of the error is kept. r is this fix's rho with a stored place,
divided by the rho of the fix before with this place. So the product of r over a row of fixes gives the correlation of
the first with the last, however short the steps.
"""

from typing import Final

import numpy as np
from numba.extending import register_jitable

from ortilo_drake.model.placing import fill, put
from ortilo_drake.onboard.ranging.range_equations import MIN_SD, inverse, product

SHARE, LASTING, KEPT, KEY = 0, 1, 4, 7  # first index of each part of `learned`, see survey_bank.learned_first
N_LASTING, N_KEPT = 6, 3  # size of a fix's lasting error: sds (3), then from index N_KEPT the kept shares r (3)
NEW_KEY: Final = 0.7  # a new place is stored when an axis' correlation with the stored one falls below this


@register_jitable
def put_sensitivities(
    out: np.ndarray, p: np.ndarray, there: np.ndarray, anchors: np.ndarray, noise: np.ndarray
) -> None:
    """Write u_i and the columns of G at the estimated p_WB to out (6 n); zeros for a missing range.

    `there` (n), the anchors a_i in W (n, 3) and the noise s_0 [m], s_1, s_2 [m] are as in range_equations.py. The
    predicted distances replace the ranges, so that the result does not depend on the ranges' noise.
    """
    n = anchors.shape[0]
    fill(out, 0.0)
    xx = xy = xz = yy = yz = zz = 0.0
    for i in range(n):
        if there[i] != 0.0:
            x, y, z = p[0] - anchors[i, 0], p[1] - anchors[i, 1], p[2] - anchors[i, 2]
            d = np.sqrt(x * x + y * y + z * z) + 1e-30
            w = 1.0 / (max(noise[0] + noise[1] * d, MIN_SD) ** 2 + noise[2] ** 2)
            x, y, z = x / d, y / d, z / d
            put((x, y, z, w * x, w * y, w * z), out, 6 * i)
            xx, xy, xz = xx + w * x * x, xy + w * x * y, xz + w * x * z
            yy, yz, zz = yy + w * y * y, yz + w * y * z, zz + w * z * z
    definite, C = inverse((xx, xy, xz, yy, yz, zz))
    for i in range(n):
        x, y, z = product(C, out[6 * i + 3 : 6 * i + 6]) if definite else (0.0, 0.0, 0.0)
        put((x, y, z), out, 6 * i + 3)


@register_jitable
def products(one: np.ndarray, other: np.ndarray, axis: int) -> tuple[float, float, float]:
    """Return g . g, g . g' and g' . g' along an axis, given the sensitivities of two fixes (6 n each)."""
    own = both = others = 0.0
    for i in range(0, one.size, 6):
        g, g_other = one[i + 3 + axis], other[i + 3 + axis]
        own += g * g
        others += g_other * g_other
        both += g * g_other * (one[i] * other[i] + one[i + 1] * other[i + 1] + one[i + 2] * other[i + 2])
    return own, both, others


@register_jitable
def put_lasting(
    out: np.ndarray,
    p: np.ndarray,
    there: np.ndarray,
    anchors: np.ndarray,
    noise: np.ndarray,
    learned: np.ndarray,
    here: np.ndarray,
) -> None:
    """Write a fix's lasting error to out (6): the sds [m] (3) and the shares r kept of the error of the fix before (3).

    p is the estimated position (3); `learned` comes from bank_element.bank_box; the fix's sensitivities go to `here` (6
    n). Other arguments as in range_equations.py.
    """
    put_sensitivities(here, p, there, anchors, noise)
    key = learned[KEY : KEY + here.size]
    for axis in range(3):
        put_kept(out, axis, noise[2], products(here, key, axis), learned)


@register_jitable
def put_kept(
    out: np.ndarray, axis: int, s: float, its_products: tuple[float, float, float], learned: np.ndarray
) -> None:
    """Write the sd [m] of a fix's lasting error along an axis and the share r kept of the error of the fix before.

    s is the estimated sd of the survey [m]; its_products are g . g, g . g' and g' . g', with g' at the stored place.
    Other arguments as in put_lasting.
    """
    now, both, before = its_products
    out[axis], out[N_KEPT + axis] = s * np.sqrt(now), 1.0
    if before > 0.0 and now > 0.0:
        kept = max(both / np.sqrt(before * now), 0.0)
        out[N_KEPT + axis] = min(kept / learned[KEPT + axis], 1.0)


@register_jitable
def keep(learned: np.ndarray, lasting: np.ndarray, here: np.ndarray) -> None:
    """Store a fix's lasting error (6), and its sensitivities `here` if it is far from the stored place."""
    put(lasting[:N_KEPT], learned, LASTING)
    least, is_first = 1.0, True
    for axis in range(3):
        learned[KEPT + axis] *= lasting[N_KEPT + axis]
        least = min(least, learned[KEPT + axis])
    for i in range(here.size):
        is_first = is_first and learned[KEY + i] == 0.0
    if least < NEW_KEY or is_first:
        put(here, learned, KEY)
        for axis in range(3):
            learned[KEPT + axis] = 1.0
