"""Measured detection rates by class, distance, share inside the image and visible share."""

from typing import Any

import numpy as np

from ortilo_drake.training.calibration.estimates import PRIOR, SHARES, fit_table, knot_shares
from ortilo_drake.training.calibration.sightings import Sightings, is_whole
from ortilo_drake.world.sensors.camera_calibration import OTHER
from ortilo_drake.world.sensors.landmark_view import DISTANCE, INSIDE, VISIBLE

DISTANCES = np.array([1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 9.0, 10.0, 12.0, 14.0, 17.0])  # [m]


def detection_rates(s: Sightings, classes: tuple[str, ...]) -> tuple[dict[str, Any], np.ndarray]:
    """Return the fields of Found, and the probability they give each sighting (n).

    The prior of a class's rates are the rates of all classes, and their prior is a line from 1 at 4 m to 0 at 24 m. The
    factors of the shares are fitted to what the rates of landmarks in clear view leave unexplained; their prior is the
    share itself.
    """
    distance, inside, visible = s.view[:, DISTANCE], s.view[:, INSIDE], s.view[:, VISIBLE]
    near = distance <= DISTANCES[-1]  # beyond the last knot the rate is 0
    found, clear = s.found.astype(float), (visible >= 0.95) & is_whole(s.view) & near

    def rates(chosen: np.ndarray, prior: np.ndarray) -> np.ndarray:
        return np.clip(fit_table(DISTANCES, distance[chosen], found[chosen], prior, PRIOR), 0.0, 1.0)

    falling = np.clip(1.2 - DISTANCES / 20.0, 0.0, 1.0)
    table = {OTHER: rates(clear, falling)}
    rate = np.zeros(len(found))
    for c, name in enumerate(classes):
        table[name] = rates(clear & (s.label == c), table[OTHER])
        mine = s.label == c
        rate[mine] = np.where(near[mine], knot_shares(DISTANCES, distance[mine]) @ table[name], 0.0)
    factors = []
    for at, chosen in ((visible, is_whole(s.view) & near), (inside, ~is_whole(s.view) & near)):
        factor = np.clip(fit_table(SHARES, at[chosen], found[chosen], SHARES, PRIOR, rate[chosen]), 0.0, 1.0)
        factor[-1] = 1.0
        factors.append(factor)
        rate = rate * (knot_shares(SHARES, at) @ factor)
    return {
        "distance": DISTANCES,
        "rate": table,
        "inside": SHARES,
        "inside_factor": factors[1],
        "visible": SHARES,
        "visible_factor": factors[0],
    }, rate
