"""Sine, cosine, arctangent, exponential and logarithm for the onboard half, from sums, products and quotients only.

They give the same bits on every processor.

Mathematical libraries differ in the last bit, but the code flown here and the code exported to a vehicle (codegen/)
must give the same bits.

The argument is reduced by pi / 2 in three parts (Cody and Waite, "Software Manual for the Elementary Functions", 1980);
the polynomials come from Sun's fdlibm. Errors are below 1 ulp for |x| < LARGE. Beyond LARGE, whole turns are subtracted
with the rounding of x itself. Beyond SENSELESS, where neighbouring numbers are 0.1 rad apart, sine and cosine are NaN.
The exponential and the arctangent's polynomial are also from fdlibm, with errors below 1 ulp.
"""

from typing import Any, Final

import numpy as np
from numba.extending import overload, register_jitable

LARGE: Final = 8.0e5  # largest argument for which pi / 2 in three parts has enough digits [rad]
SENSELESS: Final = 1.0e15  # largest argument with a sine and a cosine [rad]
TURN: Final = 2.0 * np.pi
PER_QUARTER: Final = 6.36619772367581382433e-01  # 2 / pi
# pi / 2 in three parts of 33 bits, whose products with an integer of 20 bits are exact, and the remaining part.
Q_1, Q_2, Q_3 = 1.57079632673412561417e00, 6.07710050630396597660e-11, 2.02226624871116645580e-21
REST_3 = 8.47842766036889956997e-32
S_1, S_2, S_3 = -1.66666666666666324348e-01, 8.33333333332248946124e-03, -1.98412698298579493134e-04
S_4, S_5, S_6 = 2.75573137070700676789e-06, -2.50507602534068634195e-08, 1.58969099521155010221e-10
C_1, C_2, C_3 = 4.16666666666666019037e-02, -1.38888888888741095749e-03, 2.48015872894767294178e-05
C_4, C_5, C_6 = -2.75573143513906633035e-07, 2.08757232129817482790e-09, -1.13596475577881948265e-11
# atan(1/2), atan(1), a quarter turn and half a turn, in high and low parts; the arctangent's coefficients.
AT_1, AT_2, QUARTER = 4.63647609000806093515e-01, np.pi / 4.0, np.pi / 2.0
LO_1, LO_2, QUARTER_LOW = 2.26987774529616870924e-17, 3.06161699786838301793e-17, 6.12323399573676603587e-17
PI_LOW = 1.2246467991473531772e-16
A_0, A_1, A_2 = 3.33333333333329318027e-01, -1.99999999998764832476e-01, 1.42857142725034663711e-01
A_3, A_4, A_5 = -1.11111104054623557880e-01, 9.09088713343650656196e-02, -7.69187620504482999495e-02
A_6, A_7, A_8 = 6.66107313738753120669e-02, -5.83357013379057348645e-02, 4.97687799461593236017e-02
A_9, A_10 = -3.65315727442169155270e-02, 1.62858201153657823623e-02
FLAT = 2.0**-28  # a smaller angle equals its tangent to the last bit
SPLIT = 2.0**27 + 1.0  # factor that splits a number in two halves
HUGE, SCALE = 2.0**700, 2.0**200  # coordinates above HUGE or below 1 / HUGE are scaled
# ln 2 in two parts, the first with exact integer multiples; 1 / ln 2; the exponential's coefficients and range.
LN_2, LN_2_LOW, PER_LN_2 = 6.93147180369123816490e-01, 1.90821492927058770002e-10, 1.44269504088896338700e00
E_1, E_2, E_3 = 1.66666666666666019037e-01, -2.77777777770155933842e-03, 6.61375632143793436117e-05
E_4, E_5 = -1.65339022054652515390e-06, 4.13813679705723846039e-08
HIGHEST, LOWEST = 709.782712893383973096, -745.13321910194110842


@register_jitable
def reduced(x: float) -> tuple[int, float, float]:
    """Return the number of quarter turns in x [rad], and the rest in [-pi / 4, pi / 4] as a sum of two numbers."""
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
    """Return the sine of x [rad] plus `ahead` quarter turns."""
    quarters, high, low = reduced(x)
    quarter = (quarters + ahead) & 3
    value = sine_near_0(high, low) if quarter & 1 == 0 else cosine_near_0(high, low)
    return value if quarter < 2 else -value


@register_jitable
def sine_and_cosine(x: float) -> tuple[float, float]:
    """Return the sine and the cosine of x [rad], with one reduction for both."""
    quarters, high, low = reduced(x)
    s, c = sine_near_0(high, low), cosine_near_0(high, low)
    if quarters & 1 != 0:
        s, c = c, -s
    return (s, c) if quarters & 2 == 0 else (-s, -c)


@register_jitable
def left_of_quotient(above: float, below: float, quotient: float) -> float:
    """Return the rounding error of quotient = above / below, from the exact product in halves (Dekker, 1971)."""
    q, b = SPLIT * quotient, SPLIT * below
    q_high, b_high = q - (q - quotient), b - (b - below)
    q_low, b_low = quotient - q_high, below - b_high
    return (((above - q_high * b_high) - q_high * b_low - q_low * b_high) - q_low * b_low) / below


@register_jitable
def angle_of(y: float, x: float) -> float:
    """Return the angle of the point (x, y) [rad]; two infinite coordinates count as equal.

    The angle is quarter turns +- atan(c) +- atan(u), with u = (small - c large) / (large + c small) and |u| < 7 / 16.
    """
    if not (x == x and y == y):
        return np.nan
    a, b = abs(x), abs(y)
    if a == np.inf and b == np.inf:
        a, b = 1.0, 1.0
    small, large = (a, b) if b > a else (b, a)
    if large > HUGE:
        small, large = small / SCALE, large / SCALE
    elif large < 1.0 / HUGE:
        small, large = small * SCALE, large * SCALE
    u, lost, at, at_low = small / large if large > 0.0 else 0.0, 0.0, 0.0, 0.0
    if u > 0.71875:
        u, at, at_low = (small - large) / (large + small), AT_2, LO_2
    elif u > 0.4375:
        u, at, at_low = (small - 0.5 * large) / (large + 0.5 * small), AT_1, LO_1
    elif u > FLAT:
        lost = left_of_quotient(small, large, u)
    z = u * u
    w = z * z
    even = z * (A_0 + w * (A_2 + w * (A_4 + w * (A_6 + w * (A_8 + w * A_10)))))
    odd = w * (A_1 + w * (A_3 + w * (A_5 + w * (A_7 + w * A_9))))
    bent = u * (even + odd) - lost * (1.0 - z)
    turned = np.copysign(1.0, x) < 0.0
    turn, turn_low = (QUARTER, QUARTER_LOW) if b > a else (np.pi, PI_LOW) if turned else (0.0, 0.0)
    if (b > a) != turned:
        u, bent, at, at_low = -u, -bent, -at, -at_low
    whole = turn + at
    low = ((turn - whole) + at) + (turn_low + at_low)
    return np.copysign(whole + (u - (bent - low)), y)


@register_jitable
def power_of_two(n: int) -> float:
    """Return 2^n."""
    value, factor = 1.0, 2.0 if n > 0 else 0.5
    for _ in range(abs(n)):
        value *= factor
    return value


@register_jitable
def exponential(x: float) -> float:
    """Return e^x."""
    if not LOWEST <= x <= HIGHEST:
        return np.inf if x > HIGHEST else 0.0 if x < LOWEST else np.nan
    k = int(PER_LN_2 * x + (0.5 if x >= 0.0 else -0.5))
    high, low = x - float(k) * LN_2, float(k) * LN_2_LOW
    r = high - low
    t = r * r
    c = r - t * (E_1 + t * (E_2 + t * (E_3 + t * (E_4 + t * E_5))))
    y = 1.0 - ((low - (r * c) / (2.0 - c)) - high)
    half = k // 2
    return y * power_of_two(half) * power_of_two(k - half)


def sin(x: Any) -> Any:
    """Return the sine of a number [rad]; AutoDiffXd and Expression use their own sine."""
    return sine(float(x), 0) if isinstance(x, float) else np.sin(x)


def cos(x: Any) -> Any:
    """Return the cosine of a number [rad]; AutoDiffXd and Expression use their own cosine."""
    return sine(float(x), 1) if isinstance(x, float) else np.cos(x)


def sin_cos(x: Any) -> tuple[Any, Any]:
    """Return the sine and the cosine of a number [rad]; AutoDiffXd and Expression use their own functions."""
    return sine_and_cosine(float(x)) if isinstance(x, float) else (np.sin(x), np.cos(x))


def arctan2(y: Any, x: Any) -> Any:
    """Return the angle of the point (x, y) [rad]; AutoDiffXd and Expression use their own arctan2."""
    return angle_of(float(y), float(x)) if isinstance(x, float) and isinstance(y, float) else np.arctan2(y, x)


def exp(x: Any) -> Any:
    """Return e^x of a number; AutoDiffXd and Expression use their own exponential."""
    return exponential(float(x)) if isinstance(x, float) else np.exp(x)


# In compiled functions, which know only floats; strict compares annotations, which a lambda does not have.
overload(sin, strict=False)(lambda x: lambda x: sine(x, 0))
overload(cos, strict=False)(lambda x: lambda x: sine(x, 1))
overload(sin_cos, strict=False)(lambda x: lambda x: sine_and_cosine(x))
overload(arctan2, strict=False)(lambda y, x: lambda y, x: angle_of(y, x))
overload(exp, strict=False)(lambda x: lambda x: exponential(x))


@register_jitable
def log(x: float) -> float:
    """Return the natural logarithm of a finite x > 0, with an error of about 1e-15; NaN for any other x."""
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
    return (2.0 * total + float(halvings) * LN_2_LOW) + float(halvings) * LN_2
