"""The recorded filter's memory of each anchor: whether its ranges are refused, since when, and their innovations.

An anchor that was refused for a second by a large error is accepted again once its innovations are small on average:
an error that fades would pull the filter along as soon as it passed the gate. The memory also tells a lost filter.

weigh_range takes a range that may be reflected, and then too long, as one row of a Kalman filter.

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
from typing import NamedTuple

import numpy as np
from numba.extending import register_jitable

ASTRAY = 3.0  # standard deviation of a position that ranges can no longer correct [m]
REFUSED, SHARE = 1.0, 1.0 / 3.0  # a filter is lost if two anchors, and this share, are refused for this time [s]
RECENT = 5.0  # an anchor counts as heard if its last range is at most this old [s]
PATIENCE = 3.0  # times REFUSED: how long the filter is believed if all refused ranges are too long
SETTLES = 0.5  # time constant of the mean of a refused anchor's innovations [s]
MOST = 8.0  # bound of an innovation in that mean [standard deviations]
FAR = 1.0  # a smaller innovation may be a bias that the filter does not know [m]
SETTLED = 1.0  # a refused anchor is accepted again when that mean is smaller [standard deviations]

LENGTH = 1.5  # one over the density of a reflection's extra length [m]
WILD = 1e-3  # density of a range that tells nothing [1/m]: as likely as a direct one some 4 standard deviations off
LASTS = 3.0  # time constant with which a reflection is forgotten [s]
LEAST = 1e-9  # least share of S by which a row changes the variance, so that S' is finite
DEEPEST = -8.0  # for e below so many standard deviations, nothing of u's distribution is left under e


class Trust(NamedTuple):
    """The record of each anchor (n).

    Since when the anchor is refused [s], inf if it is not; when it was last heard [s], -inf if never; the mean of its
    innovations [standard deviations]; whether one of them exceeded FAR; and the probability that its last range was
    reflected.
    """

    refused_from: np.ndarray
    heard_at: np.ndarray
    mean: np.ndarray
    far: np.ndarray
    reflected: np.ndarray


@register_jitable
def new_trust(n: int) -> Trust:
    """Return the record of n anchors before their first range."""
    return Trust(np.full(n, np.inf), np.full(n, -np.inf), np.zeros(n), np.zeros(n, np.bool_), np.zeros(n))


@register_jitable
def is_lost(t: float, trust: Trust) -> bool:
    """Return whether the filter is lost: the refused ranges are right, and the filter is wrong.

    A single range that is too long says little: it may be a reflection. Three anchors that agree support the filter.
    """
    heard = refused = long_since = 0
    short = off = False
    for i in range(len(trust.heard_at)):
        if trust.heard_at[i] >= t - RECENT:
            heard += 1
            if trust.refused_from[i] <= t - REFUSED:
                refused += 1
                short |= trust.mean[i] < 0.0
                off |= trust.far[i]
            if trust.refused_from[i] <= t - PATIENCE * REFUSED:
                long_since += 1
    if refused < 2 or not off:
        return False
    if short:
        return heard - refused < 3 or refused > SHARE * heard
    return long_since >= 2 and heard - long_since < 3


@register_jitable
def accept_range(trust: Trust, i: int, t: float, e: float, S: float, passes: bool, low: bool) -> bool:
    """Return whether a range to anchor i is accepted; update the anchor's record.

    Args:
        trust: the record; changed.
        i: the anchor's index.
        t: stamp of the range [s].
        e: innovation [m].
        S: variance of the innovation [m²].
        passes: whether the range passes the outlier gate.
        low: whether the antenna is so near to the floor that no refusal counts.
    """
    z = e / np.sqrt(S)
    since = trust.refused_from[i]
    share = 1.0 if since == np.inf else 1.0 - np.exp((trust.heard_at[i] - t) / SETTLES)
    trust.mean[i] += share * (min(max(z, -MOST), MOST) - trust.mean[i])
    trust.heard_at[i] = t
    trust.far[i] = (trust.far[i] and since < np.inf) or abs(e) > FAR
    fades = trust.far[i] and t - since >= REFUSED and abs(trust.mean[i]) > SETTLED
    taken = passes and not fades
    if taken:
        trust.refused_from[i] = np.inf
    elif since == np.inf and not low:
        trust.refused_from[i] = t
    return taken


@register_jitable
def weigh_by(trust: Trust, i: int, t: float, e: float, S: float, usual: float) -> tuple[float, float]:
    """Return the innovation [m] and variance [m²] with which a range to anchor i is taken; update the anchor's record.

    Arguments as in `accept_range`, which is called afterwards; usual: the share of reflected ranges.
    """
    share = share_after(trust.reflected[i], usual, t - trust.heard_at[i])
    weighed_e, weighed_S, trust.reflected[i] = weigh_range(e, S, share)
    return weighed_e, weighed_S


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
