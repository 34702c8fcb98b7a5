"""How a flight went, in a sentence."""

import json
import math

import numpy as np
import pytest
import xarray as xr

import ortilo_drake as od
from ortilo_drake.flight.verdict import lag_advice, rms_error, share_within, verdict


def made_up(n: int, sd: np.ndarray, lost: dict[str, object] | None = None) -> xr.Dataset:
    """Return n ticks of a flight at rest whose estimate errs by normal numbers of those sd (3)."""
    error = sd * np.random.default_rng(0).normal(size=(n, 3))
    return xr.Dataset(
        {
            "truth": (("tick", "state"), np.zeros((n, 12))),
            "estimate": (("tick", "xbar"), np.hstack([error, np.zeros((n, 12))])),
            "covariance": (("tick", "xbar", "xbar_column"), np.tile(np.diag([*sd**2, *np.ones(12)]), (n, 1, 1))),
        },
        coords={"time": ("tick", np.arange(n) / 30.0)},
        attrs={"lost": json.dumps(lost)},
    )


SD = np.array([0.01, 0.02, 0.02])


def test_a_consistent_estimate_is_within_three_sigma_as_often_as_a_gaussian() -> None:
    flight = made_up(20_000, SD)
    expected = 0.9973002**3
    assert share_within(flight) == pytest.approx(expected, abs=4.0 * np.sqrt(expected * (1.0 - expected) / 20_000))
    assert rms_error(flight) == pytest.approx(0.03, rel=0.02)


def test_an_estimate_that_claims_too_much_is_not() -> None:
    flight = made_up(2000, SD)
    flight["covariance"] = flight["covariance"] / 9.0
    assert share_within(flight) == pytest.approx(0.6827**3, abs=0.04)  # within one sigma of what it really is


@pytest.mark.parametrize(("first", "shares"), [(3, "46% and 100%"), (9, "100% and 46%")])
def test_angles_or_rates_that_are_claimed_far_too_well_are_told(first: int, shares: str) -> None:
    """Errors of 2.5 times their sd are within three of it with erf(1.2 / sqrt(2)), on three axes with its cube."""
    flight = made_up(20_000, SD)
    assert lag_advice(flight) is None
    flight["estimate"][:, first : first + 3] = np.random.default_rng(1).normal(size=(20_000, 3)) * 2.5
    assert share_within(flight, first) == pytest.approx(math.erf(1.2 / math.sqrt(2.0)) ** 3, abs=0.015)
    assert (lag_advice(flight) or "").startswith(f"within 3 sigma {shares} of the time")


def test_the_sentence() -> None:
    assert verdict(made_up(2231, SD)).startswith("reached its end in 74.3 s; the estimated position was 3 cm off")
    assert verdict(made_up(2231, SD)).endswith("cm off (RMS), within its 3 sigma 99% of the time")
    lost = verdict(made_up(300, SD, {"time": 9.97, "cause": "touched 'wall'"}))
    assert lost.startswith("lost at 10.0 s: touched 'wall'; until then the estimated position was")


def test_a_flight_without_a_state_at_its_end_has_one_too() -> None:
    flight = made_up(300, SD, {"time": 9.97, "cause": "tumbled"})
    flight["truth"][-1] = np.nan
    assert "nan" not in verdict(flight)


def test_a_shorter_flight_is_the_beginning_of_the_whole_one() -> None:
    """Bit for bit, and said so; a longer one than its path is refused."""
    whole = od.fly("nominal_imu_uwb", planner={"kind": "hover", "duration": 2.0}, seed=3)
    short = od.fly("nominal_imu_uwb", planner={"kind": "hover", "duration": 2.0}, seed=3, seconds=1.5)
    n = short.data.sizes["tick"]
    assert n == 1.5 * 30 + 1
    for name in ("truth", "estimate", "covariance", "control", "arrival"):
        np.testing.assert_array_equal(short.data[name], whole.data[name][:n])
    assert verdict(short.data).startswith("cut short as asked at 1.5 s; the estimated")
    assert "1.5 s, cut short as asked" in repr(short)
    with pytest.raises(od.InputError, match=r"seconds: 5: must be at most 4\.0, the length of the flight of nominal"):
        od.fly("nominal_imu_uwb", planner={"kind": "hover", "duration": 2.0}, seconds=5.0)


def test_errors_and_sigma_say_what_they_are() -> None:
    flight = od.fly("nominal_imu_uwb", planner={"kind": "hover", "duration": 0.5}, settle=0.0)
    for values, label in ((flight.errors, "error of the estimate"), (flight.sigma, "standard deviation")):
        assert values.attrs == {"long_name": label, "units": "m, rad, m/s, rad/s"}
        assert values.sel(state="psi").unit == "rad"
        assert list(values.sel(state=["z", "z_dot", "psi_dot"]).unit) == ["m", "m/s", "rad/s"]
