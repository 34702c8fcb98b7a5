"""A flight whose ranges err more than its filter believes is warned of, and only such a one."""

import pytest

from ortilo_drake.scenario import load_scenario, scenario_names
from ortilo_drake.sensors.uwb_theory import believed_noise

NOISY = "uwb.noise.fraction=0.05"  # 0.25 m at 5 m, believed to be 0.0075 * 5 = 0.0375 m


@pytest.mark.parametrize("name", scenario_names())
def test_the_ready_made_filters_know_their_ranges(name: str) -> None:
    assert believed_noise(load_scenario(name)) == []


@pytest.mark.parametrize(
    ("name", "key"),
    [
        ("nominal_imu_uwb", "multilateration.noise the same, or let --set multilateration.noise_scale=10 learn it"),
        ("robust_imu_uwb", "multilateration.noise the same"),
        ("tight_imu_uwb", "estimator.ranges.noise the same"),
    ],
)
def test_noise_that_the_filter_does_not_know_is_told_with_the_key(name: str, key: str) -> None:
    (line,) = believed_noise(load_scenario(name, NOISY))
    assert line == f"uwb.noise: 0.25 m at 5 m, but the filter assumes 0.0375 m; give {key}"


@pytest.mark.parametrize("mend", ["multilateration.noise.fraction=0.05", "multilateration.noise_scale=10"])
def test_what_the_line_says_mends_it(mend: str) -> None:
    assert believed_noise(load_scenario("nominal_imu_uwb", (NOISY, mend))) == []


def test_the_default_filter_learns_it_and_is_not_warned_of() -> None:
    assert believed_noise(load_scenario("imu_uwb", (NOISY,))) == []
    assert believed_noise(load_scenario("imu_uwb", (NOISY, "multilateration.noise_scale=null"))) != []
