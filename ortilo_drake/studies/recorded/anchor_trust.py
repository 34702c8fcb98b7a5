"""The recorded filter's memory of each anchor: whether it is refused, since when, and its errors then.

An anchor that was left out for a second, by far, comes back when its innovations are small on average: an error that
fades would pull the filter along as soon as it passed the gate. The same memory says whether the filter is lost.
"""

from typing import NamedTuple

import numpy as np
from numba.extending import register_jitable

from ortilo_drake.studies.recorded.reflected import share_after, weigh_range

ASTRAY = 3.0  # deviation of a position at which ranges no longer correct it [m]
REFUSED, SHARE = 1.0, 1.0 / 3.0  # so long [s], and of so many of the anchors, and of two
RECENT = 5.0  # an anchor counts among those heard if its last range is not older [s]
PATIENCE = 3.0  # so many times longer the filter is believed where all that it refuses is too long
SETTLES = 0.5  # innovations of an anchor that was refused for long are averaged over this time [s]
MOST = 8.0  # of these innovations, in standard deviations
FAR = 1.0  # what is refused by less may be a bias that the filter does not know of [m]
SETTLED = 1.0  # and it is heard again when their mean is below so many standard deviations


class Trust(NamedTuple):
    """The record of each anchor (n).

    Since when it is refused [s], inf if it is not; when it was last heard [s], -inf if never; the mean of its
    innovations [standard deviations]; whether it was refused by far; and the probability that its last range was
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
    """Return whether the filter is lost: the refused ranges show that it is wrong, and not they.

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
        trust: changed.
        i: the anchor.
        t: stamp [s].
        e: innovation [m].
        S: its variance [m²].
        passes: whether the gate lets it pass.
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
    """Return innovation and variance of the row that a range to anchor i is taken as; update the anchor's record.

    Arguments as accept_range, which is called afterwards; usual is the share of reflected ranges.
    """
    share = share_after(trust.reflected[i], usual, t - trust.heard_at[i])
    weighed_e, weighed_S, trust.reflected[i] = weigh_range(e, S, share)
    return weighed_e, weighed_S
