"""A range that may have come by a reflection, and is then too long: what it says, as one row of a Kalman filter.

With u = H dx + white noise of variance S, a priori N(0, S), an innovation e is

    direct, share 1 - pi        e = u
    reflected, share pi         e = u + b,  b >= 0, of density 1 / LENGTH whatever it is
    wild                        density WILD, whatever u is

Of a reflected one u is N(0, S) cut off above e: one that is far too long tells nothing, however often it is repeated.
All that the state learns of e is mean and variance of u: the update that keeps both (moment matching, as in
probabilistic data association) is that of a row with

    S' = S / (1 - Var[u] / S),   e' = E[u] S' / S

S' is negative where e leaves u less certain than it was: the covariance then grows.

A hard gate takes e in full once the state is so uncertain that it passes: one reflected range after a gap, or those of
an anchor that was refused for long while the height it told grew uncertain, then move a filter by all of e, and it
believes them. Reflections last: an anchor's share pi is the probability that its last range was reflected, and goes
back to the usual share within LASTS.

Source: Y. Bar-Shalom, X. R. Li, T. Kirubarajan, "Estimation with Applications to Tracking and Navigation", 2001, 8.
"""

from math import erfc

import numpy as np
from numba.extending import register_jitable

LENGTH = 1.5  # of what a reflection adds, whose density is one over it [m]
WILD = 1e-3  # density of a range that says nothing [1/m]: as likely as a direct one some 4 standard deviations off
LASTS = 3.0  # time constant by which a reflection is forgotten [s]
LEAST = 1e-9  # share of S by which a row changes the variance at least, so that S' is finite
DEEPEST = -8.0  # standard deviations below which nothing of u's distribution is left under e


@register_jitable
def share_after(share: float, usual: float, passed: float) -> float:
    """Return an anchor's share of reflected ranges, `passed` after its last one [s]; at least the usual one."""
    return usual + max(0.0, share - usual) * np.exp(-passed / LASTS)


@register_jitable
def weigh_range(e: float, S: float, share: float) -> tuple[float, float, float]:
    """Return e' and S' [m, m²] of a range, and the probability that it is reflected.

    Args:
        e: innovation [m].
        S: its variance if the range is direct [m²].
        share: probability a priori that it is reflected.
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
