"""The critical arrival probability of two unstable modes that an output confuses: degenerate second-order systems.

Let |s_1| = |s_2| = |s| and let C see one combination of the two at a time. Ticks a multiple of d apart show the same
combination, where d is the least whole number with (s_1 / s_2)^d = 1. The rest of the error grows as long as all
arrivals lie in one of the d classes of ticks: by |s|^(2 d) every d ticks, for which d - 1 packets must be lost. So

    l_c = 1 - |s|^(-2 d / (d - 1)),

which is 1 - |s|^-4 for s_2 = -s_1. It falls to 1 - |s|^-2 as d grows, and is that where no power of s_1 / s_2 is 1 and
for a Jordan block, of which no two arrivals show the same combination. In a channel with memory the same holds with the
chance of d - 1 losses of each d ticks, which growth_in_bursts gives.

Y. Mo, B. Sinopoli, "Towards finding the critical value for Kalman filtering with intermittent observations" (2010); K.
You, M. Fu, L. Xie, "Mean square stability for Kalman filtering with Markovian packet losses", Automatica 47(12), 2011.
"""

from fractions import Fraction

import numpy as np

from ortilo_drake.model.typed_yaml import InputError

LONGEST = 1000  # ticks after which modes may look alike again; l_c is then less than 0.002 ln|s| above its limit
SAME = 1e-6  # eigenvalues closer than this, relative, are one
SAME_ANGLE = 1e-9  # of a turn


def ticks_to_repeat(s_1: complex, s_2: complex) -> int | None:
    """Return the least d with (s_1 / s_2)^d = 1, or None: none up to LONGEST, or the two are one (a Jordan block)."""
    if abs(s_1 - s_2) <= SAME * abs(s_1):
        return None
    turns = float(np.angle(s_1 / s_2)) / (2.0 * np.pi)
    nearest = Fraction(turns).limit_denominator(LONGEST)
    return nearest.denominator if abs(turns - float(nearest)) <= SAME_ANGLE else None


def second_order_rate(modulus: float, d: int | None) -> float:
    """Return l_c of two modes of that modulus that look alike to C every d ticks, never if None."""
    return 1.0 - modulus ** (-2.0 if d is None else -2.0 * d / (d - 1.0))


def growth_in_bursts(modulus: float, d: int | None, failure: float, recovery: float) -> float:
    """Return the growth factor of E[P_k] a tick through a Gilbert-Elliott channel; E[P_k] is bounded if it is below 1.

    Packets of good ticks arrive, those of bad ones are lost. Of d ticks the first may be either and d - 1 are bad: the
    chance of that, from one first tick to the next, is the radius of a matrix of rank 1, p q (1 - q)^(d-2) + (1 - q)^d
    (You, Fu and Xie, 2011). With p = 1 - l and q = l the losses are independent.

    Args:
        modulus: of both modes, above 1.
        d: as ticks_to_repeat returns it.
        failure: p, the chance that a bad tick follows a good one.
        recovery: q, the chance that a good tick follows a bad one.

    Raises:
        InputError: if p or q lies outside [0, 1].
    """
    for name, chance in (("failure", failure), ("recovery", recovery)):
        if not 0.0 <= chance <= 1.0:
            raise InputError(f"{name}: {chance}: must lie in [0, 1]")
    stays = 1.0 - recovery
    if d is None:
        return modulus**2 * stays
    return modulus**2 * (failure * recovery * stays ** (d - 2) + stays**d) ** (1.0 / d)
