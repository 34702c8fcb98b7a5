"""Sine, cosine, exp and log of the onboard half, of sums and products alone: the same bits on every processor.

Mathematical libraries differ in the last bit. What flies here and what is exported to a vehicle (codegen/) must not.
The argument is reduced by pi / 2 in three parts (Cody and Waite, "Software Manual for the Elementary Functions", 1980);
the polynomials are those of Sun's fdlibm. Errors are below 1 ulp for |x| < LARGE. Beyond, whole turns are taken off
with the rounding of x itself, and beyond SENSELESS, where two neighbouring numbers are 0.1 rad apart, both are NaN.
"""

from collections.abc import Callable
from typing import Any, Final

import numpy as np
from numba.extending import overload, register_jitable

LARGE: Final = 8.0e5  # where pi / 2 in three parts no longer has enough digits [rad]
SENSELESS: Final = 1.0e15  # [rad]
TURN: Final = 2.0 * np.pi
PER_QUARTER: Final = 6.36619772367581382433e-01  # 2 / pi
# pi / 2: three parts of 33 bits, whose products with a whole number of 20 bits are exact, and the rest.
Q_1, Q_2, Q_3 = 1.57079632673412561417e00, 6.07710050630396597660e-11, 2.02226624871116645580e-21
REST_3 = 8.47842766036889956997e-32
S_1, S_2, S_3 = -1.66666666666666324348e-01, 8.33333333332248946124e-03, -1.98412698298579493134e-04
S_4, S_5, S_6 = 2.75573137070700676789e-06, -2.50507602534068634195e-08, 1.58969099521155010221e-10
C_1, C_2, C_3 = 4.16666666666666019037e-02, -1.38888888888741095749e-03, 2.48015872894767294178e-05
C_4, C_5, C_6 = -2.75573143513906633035e-07, 2.08757232129817482790e-09, -1.13596475577881948265e-11
LN_2: Final = 6.93147180559945286227e-01
TOO_SMALL: Final = -700.0  # exp of less counts as 0


@register_jitable
def exp(x: float) -> float:
    """Return e to the power of x <= 0, to about 1e-15 relative; 0 below TOO_SMALL, NaN of NaN."""
    if not x >= TOO_SMALL:
        return 0.0 if x < TOO_SMALL else np.nan
    halvings = int(0.5 - x / LN_2)
    r, term, total = x + float(halvings) * LN_2, 1.0, 1.0
    for i in range(1, 15):
        term *= r / float(i)
        total += term
    for _ in range(halvings):
        total *= 0.5
    return total


@register_jitable
def log(x: float) -> float:
    """Return the natural logarithm of a finite x > 0, to about 1e-15; NaN of any other."""
    if not 0.0 < x < np.inf:
        return np.nan
    halvings = 0
    while x > 1.5:
        x, halvings = 0.5 * x, halvings + 1
    while x < 0.75:
        x, halvings = 2.0 * x, halvings - 1
    f = (x - 1.0) / (x + 1.0)
    square, term, total = f * f, f, f
    for i in range(3, 26, 2):
        term *= square
        total += term / float(i)
    return 2.0 * total + float(halvings) * LN_2


@register_jitable
def reduced(x: float) -> tuple[int, float, float]:
    """Return how many quarters of a turn x is beyond [-pi / 4, pi / 4], and the rest as a sum of two numbers [rad]."""
    if not abs(x) <= LARGE:
        if not abs(x) <= SENSELESS:
            return 0, np.nan, np.nan
        x -= TURN * float(int(x / TURN))
    quarters = int(x * PER_QUARTER + (0.5 if x >= 0.0 else -0.5))
    n = float(quarters)
    r_1 = x - n * Q_1  # exact
    r_2 = r_1 - n * Q_2
    r_3 = r_2 - n * Q_3
    lost = n * REST_3 - ((r_2 - r_3) - n * Q_3) - ((r_1 - r_2) - n * Q_2)
    high = r_3 - lost
    return quarters, high, (r_3 - high) - lost


@register_jitable
def sine_near_0(x: float, rest: float) -> float:
    """Return sin(x + rest) for |x| <= pi / 4."""
    z = x * x
    v = z * x
    r = S_2 + z * (S_3 + z * (S_4 + z * (S_5 + z * S_6)))
    return x - ((z * (0.5 * rest - v * r) - rest) - v * S_1)


@register_jitable
def cosine_near_0(x: float, rest: float) -> float:
    """Return cos(x + rest) for |x| <= pi / 4."""
    z = x * x
    r = z * (C_1 + z * (C_2 + z * (C_3 + z * (C_4 + z * (C_5 + z * C_6)))))
    half = 0.5 * z
    w = 1.0 - half
    return w + (((1.0 - w) - half) + (z * r - x * rest))


@register_jitable
def sine(x: float, ahead: int) -> float:
    """Return the sine of x and some quarters of a turn."""
    quarters, high, low = reduced(x)
    quarter = (quarters + ahead) & 3
    value = sine_near_0(high, low) if quarter & 1 == 0 else cosine_near_0(high, low)
    return value if quarter < 2 else -value


def sin(x: Any) -> Any:
    """Return the sine of a number [rad]; of AutoDiffXd and Expression their own."""
    return sine(float(x), 0) if isinstance(x, float) else np.sin(x)


def cos(x: Any) -> Any:
    """Return the cosine of a number [rad]; of AutoDiffXd and Expression their own."""
    return sine(float(x), 1) if isinstance(x, float) else np.cos(x)


@overload(sin, strict=False)
def _compiled_sin(x: Any) -> Callable[[Any], Any]:
    return lambda x: sine(x, 0)


@overload(cos, strict=False)
def _compiled_cos(x: Any) -> Callable[[Any], Any]:
    return lambda x: sine(x, 1)
