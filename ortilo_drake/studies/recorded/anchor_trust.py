"""The recorded filter's memory of each anchor: whether its ranges are refused, since when, and their innovations.

An anchor that was refused for a second by a large error is accepted again once its innovations are small on average:
an error that fades would pull the filter along as soon as it passed the gate. The memory also tells a lost filter.
"""

from typing import NamedTuple

import numpy as np
from numba.extending import register_jitable

from ortilo_drake.studies.recorded.reflected import share_after, weigh_range

ASTRAY = 3.0  # standard deviation of a position that ranges can no longer correct [m]
REFUSED, SHARE = 1.0, 1.0 / 3.0  # a filter is lost if two anchors, and this share, are refused for this time [s]
RECENT = 5.0  # an anchor counts as heard if its last range is at most this old [s]
PATIENCE = 3.0  # times REFUSED: how long the filter is believed if all refused ranges are too long
SETTLES = 0.5  # time constant of the mean of a refused anchor's innovations [s]
MOST = 8.0  # bound of an innovation in that mean [standard deviations]
FAR = 1.0  # a smaller innovation may be a bias that the filter does not know [m]
SETTLED = 1.0  # a refused anchor is accepted again when that mean is smaller [standard deviations]


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
