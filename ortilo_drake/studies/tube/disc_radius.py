"""The disc that a plane Gaussian leaves with a given probability.

For z ~ N(m, C) in the plane, turned into C's principal axes (s_1 >= s_2), the probability of |z| > R is

    Q(R) = P(|z_1| > R) + integral_{-R}^{R} f_1(x) P(|z_2| > sqrt(R^2 - x^2)) dx,

where f_1 is the density of z_1. This is the tail of a generalised chi-square (J. P. Imhof, "Computing the distribution
of quadratic forms in normal variables", Biometrika, 1961) as one integral of smooth functions. It is computed by
Gauss-Legendre quadrature with x = R sin t. At 0.27 % the radius is 3 sigma for s_2 = 0, and 3.44 sigma for a round C.
"""

import math

import numpy as np

from ortilo_drake.compiled.cached import cached_njit

THREE_SIGMA = math.erfc(3.0 / math.sqrt(2.0))  # 0.27 %, the probability outside 3 sigma in one dimension
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(64)
_REACH = 9.0  # standard deviations beyond which a density counts as 0
_LEAST = 1e-300  # least Q, so that Q has a logarithm


@cached_njit
def outside_interval(low: float, high: float, m: float, s: float) -> float:
    """Return P(z < low or z > high) of z ~ N(m, s^2)."""
    if s == 0.0:
        return 0.0 if low <= m <= high else 1.0
    scale = s * math.sqrt(2.0)
    return 0.5 * math.erfc((m - low) / scale) + 0.5 * math.erfc((high - m) / scale)


@cached_njit
def outside_disc(R: float, m: np.ndarray, s: np.ndarray) -> float:
    """Return Q(R) for mean m (2) and standard deviations s (2) along the principal axes, s_1 >= s_2, s_1 > 0."""
    total = outside_interval(-R, R, m[0], s[0])
    low, high = max(-R, m[0] - _REACH * s[0]), min(R, m[0] + _REACH * s[0])
    if low >= high:
        return max(total, _LEAST)
    start, end = math.asin(low / R), math.asin(high / R)
    for node, weight in zip(_NODES, _WEIGHTS):  # noqa: B905 - numba's zip knows no strict
        t = 0.5 * (start + end) + 0.5 * (end - start) * node
        x, y = R * math.sin(t), R * math.cos(t)
        density = math.exp(-0.5 * ((x - m[0]) / s[0]) ** 2) / (s[0] * math.sqrt(2.0 * math.pi))
        total += 0.5 * (end - start) * weight * y * density * outside_interval(-y, y, m[1], s[1])
    return max(total, _LEAST)


@cached_njit
def _radius(m: np.ndarray, s: np.ndarray, outside: float) -> float:
    """Return R with Q(R) = outside.

    The logarithm of Q is nearly linear in R^2. So the method is false position in R^2, with Illinois' halving of the
    end that stays (M. Dowell and P. Jarratt, BIT, 1971), until R^2 changes by less than a part in 1e10.
    """
    if s[0] == 0.0:
        return float(np.sqrt(m[0] ** 2 + m[1] ** 2))
    b = (np.sqrt(m[0] ** 2 + m[1] ** 2) + 3.5 * s[0]) ** 2
    f_b = math.log(outside_disc(math.sqrt(b), m, s) / outside)
    while f_b > 0.0:
        b *= 2.0
        f_b = math.log(outside_disc(math.sqrt(b), m, s) / outside)
    a, f_a = 0.0, -math.log(outside)
    for _ in range(100):
        c = (a * f_b - b * f_a) / (f_b - f_a)
        f_c = math.log(outside_disc(math.sqrt(c), m, s) / outside)
        close = abs(c - b) < 1e-10 * c
        if f_b * f_c < 0.0:
            a, f_a = b, f_b
        else:
            f_a *= 0.5
        b, f_b = c, f_c
        if close or f_c == 0.0:
            break
    return float(math.sqrt(b))


@cached_njit
def principal(m: np.ndarray, C: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return a mean (2) in the principal axes of C (2 x 2), and the standard deviations along them, s_1 >= s_2 (2)."""
    a, b, c = C[0, 0], C[0, 1], C[1, 1]
    angle = 0.5 * math.atan2(2.0 * b, a - c)
    cos, sin = math.cos(angle), math.sin(angle)
    half = math.hypot(0.5 * (a - c), b)
    s = np.array([math.sqrt(max(0.5 * (a + c) + half, 0.0)), math.sqrt(max(0.5 * (a + c) - half, 0.0))])
    return np.array([cos * m[0] + sin * m[1], cos * m[1] - sin * m[0]]), s


@cached_njit
def disc_radii(means: np.ndarray, covariances: np.ndarray, outside: float) -> np.ndarray:
    """Return the radius R_k (n) of the disc about 0 that N(m_k, C_k) leaves with the probability `outside`, in (0, 1).

    means: m_k (n, 2); covariances: C_k (n, 2, 2), symmetric and positive semidefinite.
    """
    radii = np.empty(means.shape[0])
    for k in range(means.shape[0]):
        m, s = principal(means[k], covariances[k])
        radii[k] = _radius(m, s, outside)
    return radii


@cached_njit(nogil=True)
def least_margin(corridor: np.ndarray, means: np.ndarray, covariances: np.ndarray, outside: float) -> float:
    """Return the least of corridor_k - R_k, with R_k of disc_radii, computing R_k only where the margin may be least.

    |z - m| > x has a probability of at most exp(-x^2 / (2 s_1^2)), so R <= |m| + s_1 sqrt(-2 ln outside). The margin at
    k is no less than b, the least margin so far, if Q(corridor_k - b) <= outside.

    Arguments as in `disc_radii`, and the corridor's radius (n).
    """
    n, reach = corridor.shape[0], math.sqrt(-2.0 * math.log(outside))
    m, s, at_least = np.empty((n, 2)), np.empty((n, 2)), np.empty(n)
    for k in range(n):
        m[k], s[k] = principal(means[k], covariances[k])
        at_least[k] = corridor[k] - math.hypot(m[k, 0], m[k, 1]) - reach * s[k, 0]
    least = np.inf
    for k in np.argsort(at_least):
        if at_least[k] > least:
            break
        left = corridor[k] - least
        if left <= 0.0 or s[k, 0] == 0.0 or outside_disc(left, m[k], s[k]) > outside:
            least = min(least, corridor[k] - _radius(m[k], s[k], outside))
    return least


@cached_njit(nogil=True)
def outside_discs(radii: np.ndarray, means: np.ndarray, covariances: np.ndarray) -> np.ndarray:
    """Return the probability (n) that N(m_k, C_k) leaves the disc of radius R_k > 0 about 0; see disc_radii."""
    outside = np.empty(radii.shape[0])
    for k in range(radii.shape[0]):
        m, s = principal(means[k], covariances[k])
        if s[0] == 0.0:
            outside[k] = 1.0 if m[0] ** 2 + m[1] ** 2 > radii[k] ** 2 else 0.0
        else:
            outside[k] = outside_disc(radii[k], m, s)
    return outside
