"""Persistence of errors and misses from picture to picture."""

from typing import Any

import numpy as np

from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.training.calibration.estimates import fit_slow, latent_correlation
from ortilo_drake.training.calibration.sightings import Sightings
from ortilo_drake.world.sensors.landmark_view import LANDMARK

LAGS = np.array([1, 2, 3, 5, 8, 12, 20, 30, 50])  # pictures
UNSURE = 0.02, 0.98  # range of rates in which misses count; beyond it the error of the rate itself decides


def pairs_at_lag(s: Sightings, lag: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the indices of pairs of sightings of the same landmark that are lag pictures apart."""
    landmarks = int(s.view[:, LANDMARK].max()) + 1
    key = s.picture * landmarks + s.view[:, LANDMARK].astype(int)
    later = np.searchsorted(key, key + lag * landmarks)  # views are in the map's order, so keys rise
    there = np.minimum(later, len(key) - 1)
    same = (key[there] == key + lag * landmarks) & (s.flight[there] == s.flight)
    return np.flatnonzero(same), there[same]


def persistence(s: Sightings, rate: np.ndarray, scores: np.ndarray, interval: float) -> dict[str, Any]:
    """Return the fields slow_errors and slow_misses.

    Args:
        s: the sightings.
        rate: the expected probability of finding each (n).
        scores: normal scores of the errors, NaN where none is known (n, 4).
        interval: time between pictures [s].

    Raises:
        InputError: if no landmark was found in enough pictures one after another.
    """
    errors, misses, weights = [], [], []
    telling, lags = (rate > UNSURE[0]) & (rate < UNSURE[1]), []
    for lag in LAGS:
        a, b = pairs_at_lag(s, int(lag))
        product = scores[a] * scores[b]
        if np.isfinite(product).sum() < 100:
            continue
        lags.append(float(lag))
        errors.append(np.nanmean(product) / np.nanmean(scores**2))
        a, b = a[telling[a] & telling[b]], b[telling[a] & telling[b]]
        misses.append(latent_correlation(rate[a], rate[b], int(np.sum(s.found[a] & s.found[b]))))
        weights.append(1.0 / lag)  # the lags are spaced about evenly in their logarithm
    if not lags:
        raise InputError("seeds: too few landmarks found one picture after another: fly more")
    slow = {}
    for name, correlation in (("slow_errors", errors), ("slow_misses", misses)):
        share, spacing = fit_slow(np.array(lags), np.array(correlation), np.array(weights))
        slow[name] = {"share": share, "period": spacing * interval}
    return slow
