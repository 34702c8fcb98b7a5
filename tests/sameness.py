"""Proof that the engine's flights are those of the Drake diagram: on the same noise, number by number."""

from dataclasses import dataclass

import numpy as np
import xarray as xr


@dataclass(frozen=True)
class Apart:
    """How far two flights of one scenario and seed are apart.

    Attributes:
        position: largest difference of the true and the estimated position [m].
        others: largest difference of any other number of the logs, in its own unit.
        arrivals: whether both lasted as long, ended alike, and the same measurements arrived in the same ticks.
    """

    position: float
    others: float
    arrivals: bool

    @property
    def same(self) -> bool:
        """Whether they are the same flight, to the last bit."""
        return self.arrivals and self.position == 0.0 and self.others == 0.0


def apart(one: xr.Dataset, other: xr.Dataset) -> Apart:
    """Return how far two flights are apart."""
    if one.sizes["tick"] != other.sizes["tick"] or one.attrs["lost"] != other.attrs["lost"]:
        return Apart(np.inf, np.inf, False)
    position, others = 0.0, 0.0
    for name in map(str, one.data_vars):
        a, b = one[name].values.astype(float), other[name].values.astype(float)
        if not np.array_equal(np.isfinite(a), np.isfinite(b)):
            return Apart(np.inf, np.inf, False)
        difference = np.abs(np.where(np.isfinite(a), a - b, 0.0))
        if name in ("truth", "estimate"):
            position = max(position, float(difference[:, :3].max()))
        others = max(others, float(difference.max()))
    return Apart(position, others, bool(np.array_equal(one["arrival"].values, other["arrival"].values)))
