"""The lever from the imu to the antenna by the ranges' innovations alone, where neither map nor truth tells it.

The imu feels the acceleration of its own place; the ranges measure the antenna's place. Where the body turns, a wrong
lever makes the innovations e of variance S larger. Gauss-Newton steps minimise, over the first TRIAL seconds,

    sum e(lever)² / S + |lever|² / PRIOR²

with derivatives by differences between runs of the filter. The other errors (biases and lasting errors of the ranges,
the imu's biases) are states of the filter, so S includes them.

In these runs no range counts as possibly reflected. The weight of such a range, and with it all that follows, depends
so steeply on its innovation that the derivatives would hold over millimetres only.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ortilo_drake.interop.recorded.map_file import FilterSettings
from ortilo_drake.interop.recorded.recording import Imu, Ranges, between
from ortilo_drake.studies.recorded.filter_types import FilterSetup, noise_of
from ortilo_drake.studies.recorded.filtered import TRIAL, Begin, estimate
from ortilo_drake.studies.recorded.reacquired import Innovations, innovation_score

PRIOR = 0.1  # standard deviation of each component a priori [m]
TOLD = 0.05  # a component with a larger standard deviation stays 0, as where the body does not turn [m]
STEP = 0.001  # difference of the lever between the runs of a derivative [m]
SMOOTH = 1.0  # a larger derivative is a jump: the gate took the range in one run and not in the other
ROUNDS = 2  # Gauss-Newton steps


class Lever(NamedTuple):
    """The lever in body axes (3), and each component's standard deviation (3) [m]."""

    arm: np.ndarray
    sd: np.ndarray


def fit_lever(ranges: Ranges, imu: Imu, known: FilterSetup, settings: FilterSettings) -> Lever | None:
    """Return the likeliest lever by the first TRIAL seconds; None if no lever is likelier than 0.

    Raises:
        InputError: as in `estimate`.
    """
    first = -np.inf if known.rest is None else known.rest.end
    ranges = ranges.only(np.flatnonzero(ranges.t >= first))
    ranges = ranges.only(np.flatnonzero(ranges.t <= ranges.t[:1] + TRIAL))
    imu = between(imu, -np.inf, np.append(ranges.t, -np.inf).max())
    settings = settings.model_copy(update={"reflected": 0.0})
    begin: Begin | None = None
    gate = noise_of(settings, True).gate

    def innovations(arm: np.ndarray) -> Innovations:
        nonlocal begin
        found = estimate(ranges, imu, known._replace(lever=arm), settings, np.zeros(0), begin=begin)
        begin = found.begin
        return found.run

    def likelihood(found: Innovations, arm: np.ndarray) -> float:
        return innovation_score(found, gate) - 0.5 * float(arm @ arm) / PRIOR**2

    arm, sd = np.zeros(3), np.full(3, PRIOR)
    now = innovations(arm)
    before = likelihood(now, arm)
    for _ in range(ROUNDS):
        arm, sd = _stepped(arm, now, [innovations(arm + step) for step in STEP * np.eye(3)])
        now = innovations(arm)
    arm = np.where(sd < TOLD, arm, 0.0)
    return Lever(arm, sd) if arm.any() and likelihood(innovations(arm), arm) > before else None


def _stepped(arm: np.ndarray, now: Innovations, beside: Sequence[Innovations]) -> tuple[np.ndarray, np.ndarray]:
    """Return the lever (3) after a Gauss-Newton step, and its deviations (3); `beside`: innovations one STEP away."""
    J = np.column_stack([(one.innovation - now.innovation) / STEP for one in beside])
    taken = now.taken & (np.abs(J) < SMOOTH).all(axis=1)
    S = np.sqrt(now.variance[taken])
    e, J = now.innovation[taken] / S, J[taken] / S[:, None]
    information = J.T @ J + np.eye(3) / PRIOR**2
    step = np.linalg.solve(information, J.T @ e + arm / PRIOR**2)
    return arm - step, np.sqrt(np.diag(np.linalg.inv(information)))
