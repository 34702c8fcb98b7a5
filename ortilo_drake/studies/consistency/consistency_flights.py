"""The consistency of a scenario's filter over its flights: NEES, NIS and whiteness, in and out of the blackouts."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
import xarray as xr

from ortilo_drake.flight.blackouts import in_blackout
from ortilo_drake.flight.flight import AXES, scenario_of
from ortilo_drake.flight.metrics import innovations, loss_of
from ortilo_drake.model.signals import N_X
from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.scenario import Scenario
from ortilo_drake.theory.consistency.consistency import Average, normalized_square, time_average
from ortilo_drake.theory.consistency.whiteness import WhitenessReport, normalized_innovations, whiteness_report

START = 3.0  # first seconds of a flight, reported apart: it starts with less error than P_0 says [s]
AFTER = 3.0  # length of the region after a blackout [s]
LAGS = 15
REGIONS: Final = ("all", "start", "blackout", "after", "clear", "outside")

Averages = dict[str, Average | None]  # by region; None where there is nothing, such as no blackout


@dataclass(frozen=True)
class ConsistencyReport:
    """The consistency of the filter on flights of one scenario; lost flights count up to their loss.

    The NEES is of position, x, y, z and state, see nees_series; NIS and whiteness are by sensor that arrived.
    """

    scenario: str
    flights: int
    lost: int
    nees: dict[str, Averages]
    nis: dict[str, Averages]
    whiteness: dict[str, WhitenessReport | None]


def region_masks(flight: xr.Dataset) -> dict[str, np.ndarray]:
    """Return the masks over ticks (n) of each region of a flight, by name.

    'start' is the first START seconds. Of the rest, 'blackout' is in a blackout, 'after' is within AFTER seconds of
    the end of one, and 'clear' is neither. 'outside' is all but 'blackout', the start included.
    """
    scenario = scenario_of(flight)
    black = in_blackout(flight["truth"].values, scenario)
    after, n = np.zeros_like(black), round(AFTER / scenario.h)
    for end in np.flatnonzero(black[:-1] & ~black[1:]) + 1:
        after[end : end + n] = True
    start = np.arange(len(black)) < round(START / scenario.h)
    after &= ~black
    return {
        "all": np.ones_like(black),
        "start": start,
        "blackout": black & ~start,
        "after": after & ~start,
        "clear": ~(black | after | start),
        "outside": ~black,
    }


def finite_part(flight: xr.Dataset) -> xr.Dataset:
    """Return the flight up to its last finite tick; a flight that diverged ends in NaN or inf."""
    finite = np.isfinite(flight["truth"].values).all(axis=1) & np.isfinite(flight["estimate"].values).all(axis=1)
    return flight.isel(tick=finite & np.isfinite(flight["covariance"].values).all(axis=(1, 2)))


def nees_series(error: np.ndarray, P: np.ndarray) -> dict[str, np.ndarray]:
    """Return the NEES over ticks of position, of x, y and z alone and of all 12 states, by name.

    The errors xhat - x (n, 12) have the covariance P (n, 12, 12).
    """
    series = {"position": normalized_square(error[:, :3], P[:, :3, :3])}
    series |= {axis: normalized_square(error[:, i : i + 1], P[:, i : i + 1, i : i + 1]) for i, axis in enumerate(AXES)}
    return series | {"state": normalized_square(error, P)}


def check_same_scenario(flights: Sequence[xr.Dataset], names: Sequence[str] | None = None) -> Scenario:
    """Return the scenario that all flights share, their seeds aside.

    InputError if there is no flight, or two are of different scenarios; names say which files they are from.
    """
    if not flights:
        raise InputError("flights: none given")
    first = scenario_of(flights[0])
    for k, flight in enumerate(flights):
        other = scenario_of(flight)
        if other.model_dump(exclude={"seed"}) != first.model_dump(exclude={"seed"}):
            which = f"{names[0]} and {names[k]}" if names else f"seeds {first.seed} and {other.seed}"
            raise InputError(
                f"{which}: fly different scenarios ('{first.name}' and '{other.name}'); give one's flights"
            )
    return first


DOF: Final = {"position": 3, "x": 1, "y": 1, "z": 1, "state": N_X}


def consistency_report(flights: Sequence[xr.Dataset]) -> ConsistencyReport:
    """Return the filter's consistency on flights of one scenario.

    InputError if there is no flight or they are not of one scenario.
    """
    scenario = check_same_scenario(flights)
    whole = [finite_part(flight) for flight in flights]
    masks = [region_masks(flight) for flight in whole]
    series = [
        nees_series(f["estimate"].values[:, :N_X] - f["truth"].values, f["covariance"].values[:, :N_X, :N_X])
        for f in whole
    ]

    def over_regions(values: list[np.ndarray], dof: int) -> Averages:
        return {region: time_average(values, [m[region] for m in masks], dof) for region in REGIONS}

    nis, whiteness = dict[str, Averages](), dict[str, WhitenessReport | None]()
    for sensor in scenario.measurement.sensors:
        found = [innovations(flight, sensor) for flight in whole]
        if not any(np.isfinite(e).any() for e, _ in found):
            continue
        nis[sensor] = over_regions([normalized_square(e, S) for e, S in found], found[0][0].shape[1])
        whiteness[sensor] = whiteness_report([normalized_innovations(e, S) for e, S in found], LAGS)
    return ConsistencyReport(
        scenario=scenario.name,
        flights=len(flights),
        lost=sum(loss_of(flight) is not None for flight in flights),
        nees={name: over_regions([s[name] for s in series], dof) for name, dof in DOF.items()},
        nis=nis,
        whiteness=whiteness,
    )
