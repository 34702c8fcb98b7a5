"""Maps of the tube's margin, and the mixture that its flights are drawn from."""

from functools import lru_cache

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from ortilo_drake.flight.lost import find_loss
from ortilo_drake.model.room import Room, load_room
from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.model.vehicle import Vehicle
from ortilo_drake.scenario import NoLoss, Scenario, load_scenario
from ortilo_drake.scenario.loss_chain import loss_parameters
from ortilo_drake.studies.tube.corridor import Corridor, corridor, margin
from ortilo_drake.studies.tube.disc_radius import THREE_SIGMA
from ortilo_drake.studies.tube.tube import NominalFlight, Tube, nominal_flight, predict_tube
from ortilo_drake.studies.tube.tube_map import (
    Mixture,
    burst_map,
    bursts,
    chance_map,
    chance_outside,
    guided_ticks,
    map_sensors,
    mixture,
    mixture_radius,
    rate_cases,
    tube_map,
    with_losses,
    with_rates,
    without_blackouts,
)
from ortilo_drake.studies.tube.tube_report import why_no_tube
from ortilo_drake.world.noise import stream_id
from ortilo_drake.world.radio.link import chain_after

PATH = "planner={kind: waypoints, points: [[0.0, 0.0, 1.5], [0.8, 0.5, 1.5]]}"


@lru_cache(maxsize=1)
def short() -> tuple[Scenario, NominalFlight]:
    scenario = without_blackouts(load_scenario("nominal_imu_uwb_yolo", ("settle=0.5", PATH)))
    return scenario, nominal_flight(scenario)


def test_bursts_are_those_of_the_links_own_chain() -> None:
    h, rate, burst = 1.0 / 30.0, 0.6, 0.5
    settings = bursts(rate, burst, h)
    assert settings is not None
    loss, stream = loss_parameters(settings, h), stream_id("link/uwb")
    states = np.zeros(60_000, dtype=bool)
    for k in range(len(states) - 1):
        states[k + 1] = chain_after(k, bool(states[k]), loss, 1, stream)
    starts = np.count_nonzero(states[1:] & ~states[:-1])
    # The share's standard error is about 1 %: 60,000 ticks are 1,600 bursts.
    assert 1.0 - states.mean() == pytest.approx(rate, abs=0.04)
    assert states.sum() * h / starts == pytest.approx(burst, rel=0.1)


@pytest.mark.long
def test_there_are_no_bursts_shorter_than_the_chain_can_make() -> None:
    assert bursts(0.1, 1.0 / 30.0, 1.0 / 30.0) is None
    scenario, _ = short()
    margins = burst_map(scenario, np.array([0.1, 0.9]), np.array([1.0 / 30.0, 0.5]))
    np.testing.assert_array_equal(np.isnan(margins.whole), [[True, False], [False, False]])


@pytest.mark.long
def test_more_arrivals_leave_more_room() -> None:
    scenario, _ = short()
    rates = tube_map(scenario, np.array([0.02, 0.2, 1.0]), np.array([0.02, 1.0])).whole
    assert np.all(np.diff(rates, axis=0) > 0.0)
    assert np.all(np.diff(rates, axis=1) > 0.0)


@pytest.mark.long
def test_margins_of_a_map_are_those_of_each_tube() -> None:
    # Every radius at every tick, where the map finds only those that may be the least.
    scenario, nominal = short()
    rates = np.array([0.02, 0.3])
    found = tube_map(scenario, rates, rates)
    about, n = corridor(scenario.load_room(), scenario.vehicle, nominal.r), guided_ticks(nominal)
    for i, uwb in enumerate(rates):
        for j, camera in enumerate(rates):
            tube = predict_tube(with_rates(scenario, uwb, camera), nominal)
            least = np.minimum(about.radius - tube.radius, about.height - tube.height)
            assert found.whole[i, j] == pytest.approx(least.min(), rel=1e-9)
            assert found.guided[i, j] == pytest.approx(least[:n].min(), rel=1e-9)


@pytest.mark.long
def test_longer_bursts_widen_the_tube() -> None:
    # Standing still for 50 s, for the chain starts good: on a short flight long bursts are few.
    scenario, nominal = short()
    n, last = 1500, len(nominal.time) - 1
    there = np.zeros((n, 3), dtype=bool)
    there[::3, 0] = there[1::3, 1] = there[:, 2] = True
    still = NominalFlight(
        np.arange(n) * scenario.h,
        np.repeat(nominal.r[last:], n, axis=0),
        np.repeat(nominal.x_ref[last:], n, axis=0),
        np.repeat(nominal.u_ff[last:], n, axis=0),
        np.tile(np.array([0.01, 0.01, 1e-4])[:, None, None] * np.eye(3), (n, 1, 1, 1)),
        there,
    )  # fmt: skip
    ends = []
    for burst in (0.2, 1.0, 5.0):
        loss = bursts(0.5, burst, scenario.h)
        assert loss is not None
        ends.append(predict_tube(with_losses(scenario, loss, loss), still).radius[-1])
    assert ends[0] < ends[1] < ends[2]


def test_guided_part_ends_with_the_last_fix() -> None:
    _, nominal = short()
    there = nominal.there.copy()
    there[40:, 1] = False
    last = np.flatnonzero(there[:, 1])[-1]
    assert guided_ticks(nominal._replace(there=there)) == last + 1
    there[:, 1] = False
    assert guided_ticks(nominal._replace(there=there)) == len(nominal.time)


def test_maps_are_over_the_sensors_that_fly() -> None:
    ready_made = {
        name: load_scenario(name) for name in ("nominal_imu_uwb_yolo", "altimeter", "flow", "nominal_imu_uwb")
    }
    assert map_sensors(ready_made["nominal_imu_uwb_yolo"]) == ("uwb", "camera")
    assert map_sensors(ready_made["altimeter"]) == ("uwb", "altimeter")
    assert map_sensors(ready_made["flow"]) == ("uwb", "flow")
    with pytest.raises(InputError, match="must be two beside the imu"):
        map_sensors(ready_made["nominal_imu_uwb"])
    assert why_no_tube(ready_made["nominal_imu_uwb"]) is not None
    assert why_no_tube(ready_made["altimeter"]) is None


@pytest.mark.long
def test_a_sensor_that_never_arrives_is_one_that_does_not_fly() -> None:
    with_it, without = (
        without_blackouts(load_scenario(n, ("settle=0.5", PATH))) for n in ("altimeter", "nominal_imu_uwb")
    )
    never, lost = predict_tube(with_rates(with_it, 1.0, 0.0)), predict_tube(with_losses(with_it, NoLoss(), NoLoss()))
    plain = predict_tube(without)
    np.testing.assert_allclose(never.radius, plain.radius, rtol=1e-9)
    np.testing.assert_allclose(never.height, plain.height, rtol=1e-9)
    assert np.all(lost.radius <= (1.0 + 1e-9) * plain.radius)  # to what is known anyway a height adds
    assert lost.height[-1] < 0.9 * plain.height[-1]


@pytest.mark.parametrize("rates", [(-0.1, 0.5), (0.5, 1.2), (float("nan"), 0.5)])
def test_rates_outside_zero_and_one_are_refused(rates: tuple[float, float]) -> None:
    with pytest.raises(InputError, match=r"must be in \[0, 1\]"):
        with_rates(Scenario(), *rates)


@pytest.mark.parametrize(("rate", "burst"), [(0.0, 1.0), (1.1, 1.0), (0.5, 0.0), (0.5, float("nan"))])
def test_impossible_bursts_are_refused(rate: float, burst: float) -> None:
    with pytest.raises(InputError):
        bursts(rate, burst, 1.0 / 30.0)


@pytest.mark.long
def test_without_losses_the_mixture_is_the_tube() -> None:
    scenario, nominal = short()
    tube = predict_tube(scenario, nominal)
    of = mixture(scenario, nominal, [1, 2])
    np.testing.assert_allclose(of.covariances[0], tube.covariance[:, :2, :2], rtol=1e-12, atol=1e-15)
    np.testing.assert_allclose(chance_outside(tube.radius, of), THREE_SIGMA, rtol=1e-6)
    np.testing.assert_allclose(mixture_radius(of, 0.7 * tube.radius), tube.radius, rtol=1e-3)


@pytest.mark.long
def test_a_filter_that_knows_its_arrivals_errs_less_on_average() -> None:
    # The tube's gains do not know the arrivals' history, the filter's do: its error's covariance is smaller on average.
    scenario, nominal = short()
    lossy = with_rates(scenario, 0.1, 0.1)
    tube = predict_tube(lossy, nominal)
    of = mixture(lossy, nominal, range(40))
    trace = np.trace(of.covariances, axis1=2, axis2=3)[:, -1]
    error = 4.0 * trace.std() / np.sqrt(len(trace))
    assert trace.mean() < np.trace(tube.covariance[-1, :2, :2]) + error


def test_chance_outside_by_sampling() -> None:
    rng = np.random.default_rng(1)
    C = np.array([np.diag([1.0, 0.3]), np.diag([9.0, 4.0])])
    of = Mixture(np.array([[[0.2, 0.0]], [[0.0, -0.5]]]), C[:, None])
    z = np.concatenate([rng.multivariate_normal(of.means[i, 0], C[i], 200_000) for i in range(2)])
    sampled = np.mean(np.hypot(*z.T) > 4.0)
    assert chance_outside(np.array([4.0]), of)[0] == pytest.approx(sampled, abs=4.0 * np.sqrt(sampled / 400_000))


@pytest.mark.long
def test_chance_map_is_the_chance_of_leaving_the_corridor() -> None:
    scenario, nominal = short()
    cases = rate_cases(scenario, np.array([0.01, 1.0]), np.array([0.0]))
    chance = chance_map(scenario, cases, [1, 2, 3])
    room = corridor(scenario.load_room(), scenario.vehicle, nominal.r).radius
    for of_case, (case,) in zip(chance, cases, strict=True):  # at every tick
        assert case is not None
        expected = chance_outside(room, mixture(case, nominal, [1, 2, 3])).max()
        np.testing.assert_allclose(of_case, expected, rtol=1e-12)
    assert chance.shape == (2, 1)
    assert chance[0, 0] > chance[1, 0]
    assert chance[1, 0] < 1e-6


ROOM, VEHICLE = load_room(), Vehicle()


def is_lost(p_WB: np.ndarray) -> bool:
    states = np.zeros((1, 12))
    states[0, :3] = p_WB
    return find_loss(states, 0.1, ROOM, VEHICLE) is not None


@pytest.mark.long
@given(st.floats(-0.5, 22.0), st.floats(-4.0, 3.0), st.floats(0.0, 2.0 * np.pi), st.floats(0.0, 0.999))
def test_nothing_within_the_corridor_is_lost(x: float, y: float, direction: float, share: float) -> None:
    p = np.array([x, y, 1.5])
    about = corridor(ROOM, VEHICLE, p[None])
    assume(about.radius[0] > 0.0)
    away = share * about.radius[0] * np.array([np.cos(direction), np.sin(direction), 0.0])
    assert not is_lost(p + away)


@pytest.mark.long
@given(st.floats(0.0, 21.0), st.floats(-3.5, 2.5))
def test_a_step_beyond_the_corridor_is_lost_in_some_direction(x: float, y: float) -> None:
    p = np.array([x, y, 1.5])
    about = corridor(ROOM, VEHICLE, p[None])
    assume(about.radius[0] > 0.0)
    angles = np.linspace(0.0, 2.0 * np.pi, 721)
    reach = about.radius[0] * 1.01 + 1e-3
    ring = p + reach * np.column_stack([np.cos(angles), np.sin(angles), np.zeros_like(angles)])
    assert any(is_lost(point) for point in ring)


def test_height_reaches_floor_and_ceiling() -> None:
    path = np.array([[0.0, 0.0, 1.0], [0.0, 0.0, 2.8]])
    low, high = ROOM.interior.min[2], ROOM.interior.max[2]
    np.testing.assert_allclose(
        corridor(ROOM, VEHICLE, path).height, [min(1.0 - low, high - 1.0), min(2.8 - low, high - 2.8)]
    )


def test_a_wall_beside_the_path_is_named() -> None:
    x, y, _ = ROOM.walls[9]
    alone = Room.model_validate(ROOM.model_dump() | {"walls": ((x, y, 0.0),)})
    half_y = ROOM.wall_size[1] / 2
    path = np.array([[x, y + half_y + VEHICLE.radius + 0.4, 1.5]])
    about = corridor(alone, VEHICLE, path)
    np.testing.assert_allclose(about.radius, 0.4, atol=1e-12)
    assert about.nearest[0] == 0


def test_margin_is_the_least_over_the_path() -> None:
    n = 4
    about = Corridor(np.array([1.0, 0.6, 2.0, 1.0]), np.full(n, 1.5), np.array([3, 7, -1, 2]))
    r = np.arange(3.0 * n).reshape(n, 3)
    tube = Tube(
        np.arange(n), r, np.zeros((n, 3)), np.zeros((n, 3, 3)), np.zeros((n, 3, 3)), np.full(n, 0.5), np.full(n, 1.6)
    )
    found = margin(tube, about)
    assert (found.tick, found.nearest) == (1, 7)
    np.testing.assert_allclose([found.horizontal, found.vertical, found.least], [0.1, -0.1, -0.1])
    np.testing.assert_array_equal(found.place, r[1])
