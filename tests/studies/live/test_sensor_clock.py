"""What the sensors' clock says now: a delay that comes and goes is seen, a drift of the clocks is not."""

import numpy as np
import pytest

from ortilo_drake.studies.live.live_bridge import SensorClock


def test_what_is_heard_late_is_seen_to_be_old() -> None:
    wall = iter([100.00, 100.11, 100.20, 101.80, 101.90])
    clock = SensorClock(lambda: next(wall))
    ages = [clock.now(stamp) - stamp for stamp in (5.0, 5.1, 5.2, 5.3, 6.9)]
    np.testing.assert_allclose(ages, [0.0, 0.01, 0.0, 1.5, 0.0], atol=1e-9)


def test_clocks_may_drift() -> None:
    """Fifty parts in a million over an hour are 0.18 s, and no delay."""
    times = np.arange(0.0, 3600.0, 0.5)
    wall = iter(times * (1.0 + 50e-6))
    clock = SensorClock(lambda: next(wall))
    assert max(clock.now(t) - t for t in times) < 0.005


def test_a_bag_that_is_played_faster_is_never_old() -> None:
    wall = iter(np.linspace(0.0, 1.0, 200))
    clock = SensorClock(lambda: next(wall))
    for stamp in np.linspace(0.0, 40.0, 200):
        assert clock.now(stamp) == pytest.approx(stamp)
