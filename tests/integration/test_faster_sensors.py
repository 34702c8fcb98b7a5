"""A sensor faster than the tick: its samples, their mean in the filter, and the ways that they take."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray as xr
from scipy import stats
from scipy.integrate import solve_ivp

from ortilo_drake.diagrams.world import World
from ortilo_drake.flight.flight import fly
from ortilo_drake.flight.stepped_halves import WorldHalf
from ortilo_drake.hil.wire.handshake import flight_of
from ortilo_drake.hil.wire.packets import encode_vector
from ortilo_drake.hil.wire.unpack import BadPacket, decode
from ortilo_drake.interop.log.logged_flight import fly_logged
from ortilo_drake.interop.log.mcap_records import read_logged
from ortilo_drake.interop.log.reader import log_file, read_messages
from ortilo_drake.interop.ros.ros_types import from_cdr
from ortilo_drake.model.equations import DYNAMICS
from ortilo_drake.model.signals import IMU_SIZE, PAYLOAD, STAMP, samples_in
from ortilo_drake.model.vehicle import M100
from ortilo_drake.scenario import Scenario, load_scenario
from ortilo_drake.sensors.described import information_of
from ortilo_drake.sensors.information_rows import information
from ortilo_drake.world.noise import normals, stream_id

H, N = 1.0 / 30.0, 8
AGE = (N - 1) * H / (2 * N)
EXACT = "imu={link: {rate: 240}, angle_density: 0, rate_density: 0, specific_force_density: 0}"
DENSITIES = dict(zip(("angle", "rate", "specific_force"), np.sqrt(H / N) * np.array([0.01, 0.001, 0.05]), strict=True))
FAST = (
    f"imu={{link: {{rate: 240}}, {', '.join(f'{name}_density: {its}' for name, its in DENSITIES.items())}}}",
    "estimator.V.imu=[1.25e-5, 1.25e-5, 1.25e-5]",
)
TURNING = np.array([1.05 * M100.hover_thrust, 0.3, -0.2, 0.1])
CALM = "world.disturbance={force_density: 0, torque_density: 0}"
SHORT = ("settle=0", "planner={kind: hover, duration: 1.0}")


def messages_of(sensor: str, scenario: Scenario, ticks: int, u: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return x (ticks, 12) and a sensor's samples (ticks, n, 2 + p) of a world that flies under one control."""
    world, states, samples = WorldHalf(scenario), [], []
    for _ in range(ticks):
        states.append(world.state)
        samples.append(samples_in(world.sample()[sensor], scenario.samples(sensor)))
        world.advance(u)
    return np.array(states), np.array(samples)


def states_after(x: np.ndarray, n: int) -> np.ndarray:
    """Return the states (n, 12) at t + H / n, ..., t + H under TURNING, given x (12) at t, as SciPy integrates them."""
    inertia, f = np.array(M100.inertia), DYNAMICS["small_angle"].py_func
    at = H * np.arange(1, n + 1) / n
    found: np.ndarray = solve_ivp(
        lambda t, x: f(x, TURNING, np.zeros(6), M100.mass, inertia),
        (0.0, H),
        x,
        "DOP853",
        t_eval=at,
        rtol=1e-13,
        atol=1e-15,
    ).y.T
    return found


@pytest.mark.family
@pytest.mark.parametrize("rate", [240, 300])
def test_samples_are_the_state_between_the_ticks_as_scipy_integrates_it(rate: int) -> None:
    n = rate // 30
    scenario = load_scenario("nominal_imu_uwb", (CALM, EXACT, f"imu.link.rate={rate}"))
    states, samples = messages_of("imu", scenario, 6, TURNING)
    for k in range(2, 6):
        within = states_after(states[k - 1], n)
        np.testing.assert_allclose(samples[k, :, 2:5], within[:, 3:6], rtol=0.0, atol=1e-11)
        np.testing.assert_array_equal(samples[k, -1, 2:5], states[k, 3:6])
        np.testing.assert_allclose(samples[k, :, STAMP], k * H - H + H * np.arange(1, n + 1) / n, rtol=0.0, atol=1e-14)
        assert samples[k, -1, STAMP] == k * scenario.h
        np.testing.assert_allclose(samples[k, :, 10], TURNING[0] / M100.mass, rtol=1e-15)  # the thrust that acts


@pytest.mark.family
@pytest.mark.parametrize("imu_rate", [30, 120])
def test_samples_of_a_registered_sensor_are_of_the_states_between_the_ticks_too(imu_rate: int) -> None:
    """Also where another sensor is sampled at other instants; a clock behind by 4 ms shows the states before."""
    changes = (CALM, "altimeter={link: {rate: 90}, sd: 1.0e-12, fraction: 0}", f"imu.link.rate={imu_rate}")
    for offset in (0.0, 0.004):
        scenario = load_scenario("altimeter", (*changes, f"truth.clock.offset={offset}"))
        floor = scenario.load_room().interior.min[2]
        states, samples = messages_of("altimeter", scenario, 6, TURNING)
        assert np.ptp(states[2:, 2]) > 0.005
        for k in range(2, 6):
            x = states_after(states[k - 1], 3)
            x[:, :6] -= offset * x[:, 6:]
            range_ = (x[:, 2] - floor) / (np.cos(x[:, 3]) * np.cos(x[:, 4]))
            # Each of three steps of third order errs by (H / 3)^4 / 24 = 6e-10 s^4 times z'''', below 1 m/s^4.
            np.testing.assert_allclose(samples[k, :, PAYLOAD], range_, rtol=0.0, atol=2e-9)
            np.testing.assert_allclose(samples[k, :, STAMP], k * H - H + H * np.arange(1, 4) / 3, rtol=0.0, atol=1e-14)


def test_it_is_sampled_without_an_imu_too_where_commands_come_in_real_time() -> None:
    scenario = load_scenario("altimeter", ("sensors=[uwb, altimeter]", "altimeter.link.rate=60"))
    world = World(scenario, command_period=scenario.h / 4.0)
    context = world.CreateDefaultContext()
    ((_, stamp, r),) = samples_in(world.GetOutputPort("altimeter").Eval(context), 2)[1:]  # at t_0 the newest alone
    floor = scenario.load_room().interior.min[2]
    sd = np.hypot(scenario.altimeter.sd, scenario.altimeter.fraction * floor)
    assert stamp == 0.0
    assert abs(r - (0.0 - floor)) < 5.0 * sd


def test_a_stuck_sensor_repeats_its_last_sample_before_the_fault() -> None:
    stuck = 'faults=[{"kind": "stuck", "sensor": "altimeter", "start": 0.1, "end": 0.16}]'
    changes = ("altimeter.link.rate=90",)
    (_, plain), (_, flown) = (
        messages_of("altimeter", load_scenario("altimeter", (*changes, *more)), 6, TURNING) for more in ((), (stuck,))
    )
    there, ranges = flown[..., STAMP], flown[..., PAYLOAD]
    active = (there > 0.1 - 1e-9) & (there < 0.16)
    assert active.sum() == 6  # 0.1 s, the newest sample of tick 3, to 0.1556 s
    np.testing.assert_array_equal(ranges[active], plain[3, 1, PAYLOAD])  # the sample before it, of 0.0889 s
    np.testing.assert_array_equal(ranges[~active], plain[..., PAYLOAD][~active])


def test_each_sample_has_the_noise_of_its_number_and_the_first_tick_has_one() -> None:
    changes = (CALM,)
    u = np.array([M100.hover_thrust, 0.0, 0.0, 0.0])
    _, samples = messages_of("imu", load_scenario("nominal_imu_uwb", (*changes, *FAST)), 4, u)
    _, exact = messages_of("imu", load_scenario("nominal_imu_uwb", (*changes, EXACT)), 4, u)
    assert not samples[0, :-1].any()
    sd, seed = np.repeat([0.01, 0.001, 0.05], 3), load_scenario("nominal_imu_uwb").seed
    for k in range(4):
        for i in range(N) if k else (N - 1,):
            v = normals(seed, stream_id("imu"), N * (k - 1) + i + 1, 9)
            np.testing.assert_allclose(samples[k, i, PAYLOAD:] - exact[k, i, PAYLOAD:], sd * v, rtol=0.0, atol=1e-13)


@pytest.fixture(scope="module")
def flight() -> xr.Dataset:
    return fly(load_scenario("nominal_imu_uwb", (*FAST, "seed=3")))


@pytest.mark.long
def test_the_filter_gets_the_mean_of_a_tick_with_an_eighth_of_the_variance(flight: xr.Dataset) -> None:
    x = flight["truth"].values[1:]
    y = flight["measurement"].sel(output=["phi_imu", "theta_imu", "psi_imu"]).values
    assert np.isnan(y[0]).all()
    assert np.isfinite(y[1:]).all()
    noise = (y[1:] - (x[:, 3:6] - AGE * x[:, 9:12])) / (0.01 / np.sqrt(N))
    n = noise.size
    low, high = stats.chi2.ppf([0.0005, 0.9995], n)
    assert low < np.sum(noise**2) < high
    assert abs(noise.mean()) < 3.5 / np.sqrt(n)
    V = flight["measurement_covariance"].sel(sensor="imu").values[1:]
    np.testing.assert_allclose(V, np.broadcast_to(1e-4 / N * np.eye(3), V.shape), rtol=1e-15)
    # Taken as if it were of the tick's end, it would err by the rates times its age.
    late = (y[1:] - x[:, 3:6]) / (0.01 / np.sqrt(N))
    assert np.sum(late**2) > np.sum(noise**2)


@pytest.mark.long
def test_the_innovations_of_the_means_are_as_large_as_the_filter_says(flight: xr.Dataset) -> None:
    rows = ["phi_imu", "theta_imu", "psi_imu"]
    nu = flight["innovation"].sel(output=rows).values[30:]
    C = load_scenario("nominal_imu_uwb", (*FAST,)).measurement.C_of("imu")
    S = C @ flight["covariance"].values[30:, :12, :12] @ C.T + 1e-4 / N * np.eye(3)
    nis = np.einsum("ki,kij,kj->k", nu, np.linalg.inv(S), nu)
    # White innovations: the sum is of chi-square. With V whole it would be 0.14 a degree of freedom.
    low, high = stats.chi2.ppf([0.0005, 0.9995], nu.size) / nu.size
    assert low < nis.mean() / 3.0 < high


@pytest.mark.long
def test_the_filter_is_consistent_and_knows_the_attitude_better(flight: xr.Dataset) -> None:
    slow = fly(load_scenario("nominal_imu_uwb", ("seed=3",)))
    spread = {}
    for name, data in {"fast": flight, "slow": slow}.items():
        e = data["estimate"].values[300:, 3:6] - data["truth"].values[300:, 3:6]
        P = data["covariance"].values[300:, 3:6, 3:6]
        nees = np.einsum("ki,kij,kj->k", e, np.linalg.inv(P), e)
        assert 0.7 < nees.mean() / 3.0 < 1.3, name  # neighbouring ticks are correlated: wide
        spread[name] = np.sqrt(np.mean(e**2, axis=0))
    assert (spread["fast"] < 0.7 * spread["slow"]).all()
    assert flight.attrs["lost"] == "null"


def test_the_floor_counts_every_sample_at_its_age() -> None:
    scenario = load_scenario("nominal_imu_uwb", (*FAST,))
    rows = information_of("imu", scenario, scenario.load_room(), np.zeros((1, 12)), np.ones(1, bool)).rows["imu"]
    assert len(rows) == 3 * N
    J = information(rows)
    ages = H * np.arange(N) / N
    for angle, rate in ((3, 9), (4, 10), (5, 11)):
        block = J[np.ix_([angle, rate], [angle, rate])]
        expected = np.array([[N, -ages.sum()], [-ages.sum(), ages @ ages]]) / 0.01**2
        np.testing.assert_allclose(block, expected, rtol=1e-12)


def test_a_log_has_every_sample_as_an_imu_message_with_its_stamp(tmp_path: Path) -> None:
    scenario = load_scenario("nominal_imu_uwb", ("settle=0", "planner={kind: hover, duration: 0.1}", *FAST))
    fly_logged(scenario, tmp_path / "log")
    logged = read_logged(log_file(tmp_path / "log"), lambda topic: topic == "/imu/data")
    stamps = [from_cdr("sensor_msgs/msg/Imu", message.data).header.stamp for message in logged]
    np.testing.assert_allclose([s.sec + 1e-9 * s.nanosec for s in stamps], np.arange(3 * N + 1) / 240, atol=1e-9)
    sizes = {messages["imu"].size for _, messages, _ in read_messages(tmp_path / "log")}
    assert sizes == {PAYLOAD + N * IMU_SIZE}


def test_packets_hold_samples_of_this_tick_in_their_order() -> None:
    scenario = load_scenario("nominal_imu_uwb", (*FAST,))
    flight, tick = flight_of(scenario, 77), 300
    samples = np.zeros((N, IMU_SIZE))
    samples[:, 0], samples[:, STAMP] = 1.0, (tick - 1 + np.arange(1, N + 1) / N) * H

    def verdict(changed: dict[tuple[int, int], float], **head: Any) -> str:
        its = samples.copy()
        for at, value in changed.items():
            its[at] = value
        message = np.concatenate(([head.get("arrived", 1.0), head.get("stamp", tick * H)], its.ravel()))
        try:
            decode("imu", encode_vector(77, tick, message), flight)
        except BadPacket as problem:
            return problem.reason
        return "accepted"

    assert verdict({}) == "accepted"
    assert verdict({(0, 0): 0.0}) == "accepted"  # one is missing
    assert verdict({(3, 0): 0.5}) == "value"
    assert verdict({(3, 4): 1e9}) == "value"
    assert verdict({(3, STAMP): samples[2, STAMP]}) == "stamp"
    assert verdict({(0, STAMP): (tick - 1.1) * H}) == "stamp"
    assert verdict({(N - 1, STAMP): (tick + 0.1) * H}) == "stamp"
    assert verdict({}, stamp=(tick - 0.5) * H) == "stamp"
