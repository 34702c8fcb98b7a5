"""An anchor elsewhere, told without a truth by the constant-velocity filter over the whole recording.

The cheap fit of short times (lone_fit.py) takes most of a misplaced anchor up as another place of the body, and what it
leaves looks small. A filter's path is one: with the anchor's right place, and a constant for each anchor in both, all
its innovations shrink. In real rooms errors that depend on the place shrink too, by some 4 %, so less is not told.
"""

import numpy as np

from ortilo_drake.interop.recorded.map_file import Map
from ortilo_drake.interop.recorded.recording import Recording
from ortilo_drake.studies.recorded.doubts import NIS
from ortilo_drake.studies.recorded.filtered import FilterSetup, estimate, noise_of
from ortilo_drake.studies.recorded.freed import Move, moves_of
from ortilo_drake.studies.recorded.plain_fit import left_of
from ortilo_drake.studies.recorded.readings import Guess, Trial
from ortilo_drake.studies.recorded.setups import given_level

SHRINKS = 0.92  # to this share, in the squares
BEST = 2  # moves tried, those that gain most
SETTLED = 3.0  # the start tells nothing [s]


def moved_by_filter(recording: Recording, trial: Trial, map_: Map) -> Guess | None:
    """Return the anchor's place by which the constant-velocity filter predicts all ranges clearly better.

    Args:
        recording: without a truth.
        trial: what the cheap fits go by.
        map_: what it says.
    """
    tried = [(one.key, *_innovations(recording, map_, one)) for one in moves_of(trial, map_, BEST)]
    good = [(key, left) for key, after, left in tried[1:] if after <= min(SHRINKS * tried[0][1], NIS)]
    if not good:
        return None
    key = " or ".join(key.removeprefix("anchors: ").removesuffix(",") for key, _ in good)
    return Guess(f"anchors: {key},", tried[0][2], good[0][1], "the constant-velocity filter's range")


def _innovations(recording: Recording, map_: Map, by: Move) -> tuple[float, float]:
    """Return mean NIS, no range above the gate's, and the RMS [m] of the innovations."""
    ranges, settings = recording.ranges, map_.filter
    known = FilterSetup(by.anchors, by.biases, np.zeros(3), None, given_level(map_), tags=recording.tags)
    found = estimate(ranges, None, known, settings, ranges.t[-1:])
    settled = found.range_stamps > ranges.t[0] + SETTLED
    e, variance = found.run.innovation[settled], found.run.variance[settled]
    if not len(e):
        return float("inf"), float("inf")
    return float(np.mean(np.minimum(e**2 / variance, noise_of(settings, False).gate ** 2))), left_of(e)
