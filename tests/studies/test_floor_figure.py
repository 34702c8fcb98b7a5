"""The figure of the Cramer-Rao floor: roots of sums on the left, the ratio by axis on the right."""

from collections.abc import Callable

import numpy as np
import pytest
import xarray as xr

from ortilo_drake.flight.efficiency import floor_at_ticks
from ortilo_drake.studies.consistency.consistency_figures import draw_floor

SHORT = "planner={kind: waypoints, points: [[0, 0, 1.5], [2.2, 0.9, 1.5]]}"


@pytest.mark.long
def test_errors_sd_and_floor_are_those_of_the_flights(flown: Callable[..., xr.Dataset]) -> None:
    flights = [flown("nominal_imu_uwb", (SHORT,), seed) for seed in range(2)]
    floors = [floor_at_ticks(flight) for flight in flights]
    assert floors[0] is not None
    left, right = draw_floor({"imu_uwb": flights}, {"imu_uwb": [f for f in floors if f is not None]}).axes
    n = min(flight.sizes["tick"] for flight in flights)
    error, floor, sd = left.get_lines()
    squares = [(f["estimate"].values[:n, :3] - f["truth"].values[:n, :3]) ** 2 for f in flights]
    np.testing.assert_allclose(error.get_ydata(), np.sqrt(np.mean(squares, axis=0).sum(axis=1)))
    least = np.mean([f[:n] for f in floors if f is not None], axis=0)
    np.testing.assert_allclose(floor.get_ydata(), np.sqrt(least.sum(axis=1)))
    P = np.mean([f["covariance"].values[:n] for f in flights], axis=0)
    np.testing.assert_allclose(sd.get_ydata(), np.sqrt(P[:, 0, 0] + P[:, 1, 1] + P[:, 2, 2]))
    assert floor.get_linewidth() > 2 * sd.get_linewidth()  # so that both are seen where they coincide
    late = flights[0]["time"].values[:n] > 2.0
    for i, line in enumerate(right.get_lines()[:3]):
        np.testing.assert_allclose(line.get_ydata(), np.sqrt(P[late, i, i] / least[late, i]))
    assert right.get_legend_handles_labels()[1] == ["x", "y", "z"]
    assert (left.get_ylabel(), right.get_ylabel()) == ("position [m]", "filter's own sd / floor [-]")
    assert left.get_xlabel() == right.get_xlabel() == "time [s]"
