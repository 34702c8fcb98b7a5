"""Standing still finds the biases that the world drew, and leaves what least squares says it leaves."""

import json

import numpy as np
import pytest
from scipy.stats import chi2

from ortilo_drake.diagrams.wiring.truth import drawn_values
from ortilo_drake.diagrams.wiring.whole import boxes_of
from ortilo_drake.flight.players import player_of
from ortilo_drake.loop.wiring import Wiring
from ortilo_drake.model.vehicle import GRAVITY
from ortilo_drake.scenario import Scenario, load_scenario
from ortilo_drake.world.drawn_truth import draw_truth, of_seed

HOVER = ("planner={kind: hover, point: [8, 1, 1.5], duration: 0.5}", "settle=0.0")
DRAWN = (
    "truth.imu={level: [0.01, -0.02], level_sd: 0.01, rates_sd: 0.01, specific_force: [0.3, 0.0, -0.2],"
    "specific_force_sd: 0.2}",
)
NOISELESS = ("imu.angle_density=0", "imu.rate_density=0", "imu.specific_force_density=0")


def biases_left(scenario: Scenario, seeds: range) -> np.ndarray:
    """What the imu's rates and specific force err by in flight, beside their noise (seeds, 6)."""
    room, wiring = scenario.load_room(), Wiring(boxes_of(scenario, 1))
    given = [drawn_values(wiring, scenario, room, of_seed(seed)) for seed in seeds]
    return np.array([its["imu"].tables["bias"][3:] for its in given])


def test_without_noise_the_drawn_biases_are_found_up_to_the_imus_own_level() -> None:
    scenario, seeds = load_scenario("imu_uwb", (*HOVER, *DRAWN, *NOISELESS)), range(5)
    left = biases_left(scenario, seeds)
    np.testing.assert_allclose(left[:, :3], 0.0, atol=1e-12)
    for seed in seeds:  # the accelerometer believes to have stood as the imu's roll and pitch say
        phi, theta = draw_truth(scenario.truth, seed, scenario.load_room(), {"imu": 9})["imu.level"]
        g_B = GRAVITY * np.array([-np.sin(theta), np.cos(theta) * np.sin(phi), np.cos(theta) * np.cos(phi)])
        np.testing.assert_allclose(left[seed, 3:], g_B - [0.0, 0.0, GRAVITY], atol=1e-12)


def test_a_factor_at_one_g_is_found_too() -> None:
    factor = "truth.imu={specific_force_factor: 1.02, specific_force: [0.1, 0.2, 0.3]}"
    scenario = load_scenario("imu_uwb", (*HOVER, factor, *NOISELESS))
    said = 1.02 * (np.array([0.0, 0.0, GRAVITY]) + biases_left(scenario, range(1))[0, 3:])
    np.testing.assert_allclose(said, [0.0, 0.0, GRAVITY], atol=1e-12)


@pytest.mark.parametrize("rate", [30, 240])
def test_what_is_left_spreads_as_least_squares_has_it(rate: int) -> None:
    """The mean of 2 s of white noise of density D has the variance D^2 / 2 s, of however many samples."""
    scenario, n = load_scenario("imu_uwb", (*HOVER, "imu.standstill=2", f"imu.link.rate={rate}")), 400
    left, imu = biases_left(scenario, range(n)), scenario.imu
    assert scenario.samples_at_rest == 2 * rate
    tilt = np.array([GRAVITY, GRAVITY, 0.0]) * imu.angle_density
    variance = np.array([*[imu.rate_density**2] * 3, *(imu.specific_force_density**2 + tilt**2)]) / 2.0
    low, high = chi2.ppf([1e-5, 1.0 - 1e-5], n) / n
    ratios = np.mean(left**2, axis=0) / variance
    assert np.all((low < ratios) & (ratios < high)), ratios
    correlation = np.corrcoef(left.T)[~np.eye(6, dtype=bool)]
    assert np.abs(correlation).max() < 5.0 / np.sqrt(n)


@pytest.mark.long
@pytest.mark.parametrize("settings", [(), DRAWN], ids=["nothing differs", "biases are drawn"])
def test_every_player_stands_still_alike_and_the_log_says_how(settings: tuple[str, ...]) -> None:
    scenario = load_scenario("imu_uwb", (*HOVER, *settings))
    flights = [player_of(scenario, name).fly(3) for name in ("engine", "drake", "drake-elements")]
    for flight in flights[1:]:
        for name in flight.variables:
            np.testing.assert_array_equal(flight[name].values, flights[0][name].values, err_msg=str(name))
    said = [json.loads(flight.attrs["standstill"]) for flight in flights]
    assert said[0] == said[1] == said[2]
    assert (said[0]["seconds"], said[0]["samples"]) == (30.0, 900)
    if settings:
        drawn = draw_truth(scenario.truth, 3, scenario.load_room(), {"imu": 9})
        np.testing.assert_allclose(said[0]["rates"], drawn["imu.rates"], atol=5 * 0.001 / 30)
        level = GRAVITY * np.array([drawn["imu.level"][1], -drawn["imu.level"][0], 0.0])
        expected = drawn["imu.specific_force"] + level  # of small angles
        np.testing.assert_allclose(said[0]["specific_force"], expected, atol=0.03)
    still = player_of(load_scenario("nominal_imu_uwb", HOVER), "engine").fly(3)
    assert "standstill" not in still.attrs
