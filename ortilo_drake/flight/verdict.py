"""The verdict on a flight, in a sentence."""

import json

import numpy as np
import xarray as xr

WITHIN = 3.0  # standard deviations
DOUBTFUL = 0.8  # a smaller share of angles or rates within 3 sigma is reported; the ready-made `rotors` has 0.91


def share_within(flight: xr.Dataset, first: int = 0) -> float:
    """Return the share of ticks in which each of three estimated states is within 3 sigma of the truth [1].

    The states are those from index `first` on, by default the position. The first tick is left out: its estimate is
    given. A Gaussian error has the share 0.992.
    """
    states = slice(first, first + 3)
    error = np.abs(flight["estimate"].values[1:, states] - flight["truth"].values[1:, states])
    P = flight["covariance"].values[1:, states, states]
    there = np.isfinite(error).all(axis=1)
    sd = np.sqrt(np.maximum(np.diagonal(P, axis1=1, axis2=2), 0.0))
    return float(np.mean((error <= WITHIN * sd)[there].all(axis=1))) if there.any() else float("nan")


def lag_advice(flight: xr.Dataset) -> str | None:
    """Return the shares of angles and rates within 3 sigma and what to read, for lagging rotors; None if not small."""
    angles, rates = share_within(flight, 3), share_within(flight, 9)
    if not min(angles, rates) < DOUBTFUL:
        return None
    return (
        f"within 3 sigma {angles:.0%} and {rates:.0%} of the time, since rotors lag: `ortilo scenario check` names "
        "the noise to assume, see docs/how_to/own_vehicle.md"
    )


def rms_error(flight: xr.Dataset) -> float:
    """Return the root mean square distance between the estimated and the true position [m]."""
    error = flight["estimate"].values[:, :3] - flight["truth"].values[:, :3]
    return float(np.sqrt(np.nanmean(np.sum(error**2, axis=1))))


def ending(flight: xr.Dataset) -> str:
    """Return how a flight ended: lost, at its end, or cut short by the scenario's `seconds`."""
    if lost := json.loads(flight.attrs["lost"]):
        return f"lost at {lost['time']:.1f} s: {lost['cause']}"
    seconds = json.loads(flight.attrs.get("scenario", "{}")).get("seconds")
    return "reached its end" if seconds is None else "cut short as asked"


def verdict(flight: xr.Dataset) -> str:
    """Return a verdict on a flight, in a sentence for a reader who knows nothing of the flight yet."""
    end, error, share = ending(flight), 100.0 * rms_error(flight), share_within(flight)
    seconds = float(flight["time"].values[-1])
    at = "in" if end.startswith("reached") else "at"
    begin = "; until then the" if end.startswith("lost") else f" {at} {seconds:.1f} s; the"
    return f"{end}{begin} estimated position was {error:.2g} cm off (RMS), within its 3 sigma {share:.0%} of the time"
