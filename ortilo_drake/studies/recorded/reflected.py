"""A range that may be reflected, and then too long, as one row of a Kalman filter.

With u = H dx + white noise, a priori N(0, S), an innovation e is

    direct, share 1 - pi        e = u
    reflected, share pi         e = u + b,  b >= 0, of constant density 1 / LENGTH
    wild                        density WILD, whatever u is

Given a reflection, u is N(0, S) cut off above e: a range that is far too long tells nothing, however often it repeats.
The state learns only the mean and variance of u from e. The update that keeps both (moment matching, as in
probabilistic data association) is the update of a row with

    S' = S / (1 - Var[u] / S),   e' = E[u] S' / S

S' is negative where e leaves u less certain than before: the covariance then grows.

A hard gate takes e in full once the state is uncertain enough for e to pass. One reflected range after a gap then moves
the filter by all of e, and so do the ranges of an anchor that was refused for long, while the height grew uncertain.
Reflections last: an anchor's share pi is the probability that its last range was reflected, and it decays to the usual
share with time constant LASTS.

Source: Y. Bar-Shalom, X. R. Li, T. Kirubarajan, "Estimation with Applications to Tracking and Navigation", 2001, 8.
"""

from math import erfc

import numpy as np
from numba.extending import register_jitable

LENGTH = 1.5  # one over the density of a reflection's extra length [m]
WILD = 1e-3  # density of a range that tells nothing [1/m]: as likely as a direct one some 4 standard deviations off
LASTS = 3.0  # time constant with which a reflection is forgotten [s]
LEAST = 1e-9  # least share of S by which a row changes the variance, so that S' is finite
DEEPEST = -8.0  # for e below so many standard deviations, nothing of u's distribution is left under e


@register_jitable
def share_after(share: float, usual: float, passed: float) -> float:
    """Return an anchor's share of reflected ranges, `passed` [s] after its last range; at least the usual share."""
    return usual + max(0.0, share - usual) * np.exp(-passed / LASTS)


@register_jitable
def weigh_range(e: float, S: float, share: float) -> tuple[float, float, float]:
    """Return e' [m] and S' [m²] of a range, and the probability that the range is reflected.

    Args:
        e: innovation [m].
        S: variance of the innovation if the range is direct [m²].
        share: probability a priori that the range is reflected.
    """
    sd = np.sqrt(S)
    at = e / sd
    normal = np.exp(-0.5 * at * at) / np.sqrt(2.0 * np.pi)
    direct = (1.0 - share) * normal / sd
    reflected = mean = variance = 0.0
    if at > DEEPEST:
        below = 0.5 * erfc(-at / np.sqrt(2.0))
        edge = normal / below
        reflected = share * below / LENGTH
        mean, variance = -sd * edge, S * (1.0 - at * edge - edge * edge)
    total = direct + reflected + WILD
    direct, reflected, wild = direct / total, reflected / total, WILD / total
    u = direct * e + reflected * mean
    spread = direct * (e - u) ** 2 + reflected * (variance + (mean - u) ** 2) + wild * (S + u * u)
    tells = 1.0 - spread / S
    if abs(tells) < LEAST:
        tells = LEAST
    return u / tells, S / tells, reflected + wild * share
