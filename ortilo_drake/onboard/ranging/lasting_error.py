"""The part of a fix's error that lasts, as the geometry makes it of errors of the anchors.

A fix errs by G A a, with a the errors of the anchors' positions of sd s each (3 n), A = -diag(u_i^T) what of them lies
along the ranges, and G = N^-1 J^T R^-1 as range_equations.py has it. Of an axis the sd here, and the correlation with
the error of a fix elsewhere, are

    sigma = s |g|,   rho = g . g' / (|g| |g'|),   g . g' = sum_i G_i G'_i u_i . u'_i

g is the fix's sensitivity. From fix to fix the error is kept by r, rho with a place that was kept over that of the fix
before: a row of fixes so has the correlation of its ends, however short the steps.
"""

from typing import Final

import numpy as np
from numba.extending import register_jitable

from ortilo_drake.model.placing import fill, put
from ortilo_drake.onboard.ranging.range_equations import MIN_SD, inverse, product

SHARE, LASTING, KEPT, KEY = 0, 1, 4, 7  # of what is learned, where each begins, see survey_bank.learned_first
N_LASTING, N_KEPT = 6, 3  # of what a fix tells; where in it stands what is kept
NEW_KEY: Final = 0.7  # a place is kept until less than this of an axis' error is


@register_jitable
def put_sensitivities(
    out: np.ndarray, p: np.ndarray, there: np.ndarray, anchors: np.ndarray, noise: np.ndarray
) -> None:
    """Write u_i and the columns of G at the believed p_WB to out (6 n), zeros of a range that is not there.

    Which are there (n), the anchors a_i in W (n, 3) and the noise s_0 [m], s_1, s_2 [m] are as in range_equations.py.
    The distances stand for the ranges, so that nothing depends on noise.
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
    """Return g . g, g . g' and g' . g' of an axis of two fixes, of their sensitivities (6 n)."""
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
    """Write the sds of what lasts of a fix's error [m] and how it is correlated with that of the fix before to out (6).

    The vehicle is believed to be at p; what is learned is that of bank_element.bank_box; the fix's sensitivities go to
    `here` (6 n). Other arguments as range_equations.py.
    """
    put_sensitivities(here, p, there, anchors, noise)
    key = learned[KEY : KEY + here.size]
    for axis in range(3):
        put_kept(out, axis, noise[2], products(here, key, axis), learned)


@register_jitable
def put_kept(
    out: np.ndarray, axis: int, s: float, its_products: tuple[float, float, float], learned: np.ndarray
) -> None:
    """Write the sd of what lasts of a fix's error along an axis [m] and how it is correlated with the fix before's.

    Arguments as put_lasting, with the survey's sd s as it is believed [m], and g . g, g . g' and g' . g' with g' of the
    place that is kept.
    """
    now, both, before = its_products
    out[axis], out[N_KEPT + axis] = s * np.sqrt(now), 1.0
    if before > 0.0 and now > 0.0:
        kept = max(both / np.sqrt(before * now), 0.0)
        out[N_KEPT + axis] = min(kept / learned[KEPT + axis], 1.0)


@register_jitable
def keep(learned: np.ndarray, lasting: np.ndarray, here: np.ndarray) -> None:
    """Keep what a fix says lasts (6), and its sensitivities, here, if it is far from where it was compared with."""
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
