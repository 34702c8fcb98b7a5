"""Wald's sequential probability ratio test of a share of lost flights: it ends as soon as the flights decide.

A. Wald, Sequential tests of statistical hypotheses, Annals of Mathematical Statistics 16 (1945), 117-186. With n
flights of which l are lost, and the two shares p_0 < p_1 between which no decision is asked for,

    L = l ln(p_1 / p_0) + (n - l) ln((1 - p_1) / (1 - p_0)),

the share is decided to be the larger where L >= ln((1 - e) / e) and the smaller where L <= -ln((1 - e) / e). Each
decision is wrong with a chance of at most e / (1 - e): of p_1 or more, and of p_0 or less.
"""

from math import log
from typing import Final

ERROR: Final = 0.05  # e
APART: Final = 2.5  # p_0 = share / APART
ABOVE: Final = 2.0  # p_1 = share ABOVE


def loses_more(flights: int, lost: int, share: float) -> bool | None:
    """Return whether more than a share of all flights is lost; None if these do not decide.

    Args:
        flights: how many were flown.
        lost: how many of them were lost.
        share: about which the test decides: above it by ABOVE or below it by APART.
    """
    p_0, p_1 = share / APART, share * ABOVE
    ratio = lost * log(p_1 / p_0) + (flights - lost) * log((1.0 - p_1) / (1.0 - p_0))
    bound = log((1.0 - ERROR) / ERROR)
    return True if ratio >= bound else False if ratio <= -bound else None
