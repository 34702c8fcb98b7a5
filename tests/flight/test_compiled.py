"""The compiled engine: batches, figures, lost flights, refusals; test_players.py holds its flights to Drake's."""

from collections.abc import Callable

import numpy as np
import pytest
import xarray as xr
from hypothesis import given
from hypothesis import strategies as st
from sameness import assert_same_bits
from test_players import TRUTH

from ortilo_drake.diagrams.wiring.whole import why_not
from ortilo_drake.flight.engine import Engine
from ortilo_drake.flight.figures import TRACE_SIZE, TRUE, squared_path_distances
from ortilo_drake.flight.metrics import nis, summary
from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.scenario import load_scenario, scenario_names

COMPILED = {name for name in scenario_names() if why_not(load_scenario(name, ("camera.kind=projected",))) is None}
BURSTS = "uwb.link.loss={kind: bursts, loss: 0.4, mean_length: 0.5}"
SHORT = "planner={kind: waypoints, points: [[0, 0, 1.5], [1.2, 0.6, 1.5]]}"
Flown = Callable[..., xr.Dataset]


@pytest.mark.long
def test_what_is_drawn_in_a_world_belongs_to_its_seed() -> None:
    engine = Engine(load_scenario("imu_uwb", (SHORT, *TRUTH)))
    together = engine.figures(range(9), threads=2)
    assert np.array_equal(together[5], engine.figures([5])[0])
    ticks = np.full((1, engine.ticks), 5)
    branched = ticks.copy()
    branched[0, engine.ticks // 2 :] = 6
    one, other = engine.distances(ticks)[0], engine.distances(branched)[0]
    assert np.array_equal(one[: engine.ticks // 2], other[: engine.ticks // 2])
    assert not np.array_equal(one, other)


def test_the_ready_made_scenarios_of_the_papers_sensors_are_compiled() -> None:
    presets = ("paper_", "printed_", "nominal_", "", "unbiased_", "robust_", "tight_")
    every = {"altimeter", "flow", "realistic_altimeter", "realistic_flow"}
    every |= {f"{preset}imu_uwb{camera}" for preset in presets for camera in ("", "_yolo")}
    assert {*every, "outage", "bursty_link", "uwb_walls", "rotors", "realistic", "realistic_tight"} <= COMPILED


@pytest.mark.long
def test_a_lost_flight_ends_where_drakes_does(flown: Flown) -> None:
    changes = (SHORT, "world.disturbance.force_density=2.19", "settle=20")
    engine = Engine(load_scenario("nominal_imu_uwb", changes))
    flight = engine.fly(2)
    assert flight.attrs["lost"] != "null"
    assert_same_bits(flown("nominal_imu_uwb", changes, 2), flight)
    ticks, cause = engine.figures([2])[0, :2]
    assert ticks == flight.sizes["tick"] - 1
    assert cause >= 0


def test_a_flight_is_the_same_alone_and_in_any_batch() -> None:
    engine = Engine(load_scenario("nominal_imu_uwb", (SHORT, BURSTS)))
    seeds = range(9)
    together = engine.figures(seeds, threads=2)
    alone = np.vstack([engine.figures([seed]) for seed in seeds])
    assert np.array_equal(together, alone, equal_nan=True)
    assert np.array_equal(engine.figures(seeds[::-1])[::-1], alone, equal_nan=True)
    assert len(np.unique(alone[:, 2])) == len(seeds)


@pytest.mark.family("nominal_imu_uwb")
@pytest.mark.parametrize("name", ["nominal_imu_uwb", pytest.param("paper_imu_uwb", marks=pytest.mark.long)])
def test_figures_are_those_of_the_summary(name: str, flown: Flown) -> None:
    engine = Engine(load_scenario(name))
    found = dict(zip(engine.columns, engine.figures([1])[0], strict=True))
    flight = flown(name, (), 1)
    expected = summary(flight)
    assert found["ticks"] == flight.sizes["tick"] - 1
    for name in ("path_mse", "path_distance_mse", "max_path_distance", "max_reference_distance", "nees"):
        assert found[name] == pytest.approx(getattr(expected, name), rel=1e-9)
    for axis in "xyz":
        assert found[f"mse_{axis}"] == pytest.approx(expected.mse[axis], rel=1e-9)
    assert found["arrived_uwb"] / found["due_uwb"] == pytest.approx(expected.arrivals["uwb"])
    assert found["arrived_imu"] == len(nis(flight, "imu"))


@given(st.integers(0, 2**32 - 1), st.integers(1, 300), st.floats(0.0, 3.0), st.floats(0.0, 2.0))
def test_no_point_of_a_path_is_nearer_than_the_one_found(seed: int, points: int, aside: float, speed: float) -> None:
    """Against all points, of paths that wait and cross themselves, along them, aside of them and after a leap."""
    random = np.random.default_rng(seed)
    path = np.cumsum(random.normal(size=(points, 3)) * random.choice([0.0, 1.0], points)[:, None], axis=0)
    along = np.clip(np.cumsum(random.normal(speed, 1.0, size=80)), 0, points - 1).astype(int)
    trace = np.zeros((80, TRACE_SIZE))
    trace[:, TRUE] = path[along] + aside * np.cumsum(random.normal(size=(80, 3)), axis=0) / 9.0
    trace[40:, TRUE] += random.normal(size=3) * random.choice([0.0, 20.0])
    longest = max(np.linalg.norm(np.diff(path, axis=0), axis=1).max(initial=0.0), 1e-12)
    expected = np.min(np.sum((trace[:, None, TRUE] - path) ** 2, axis=2), axis=1)
    np.testing.assert_allclose(squared_path_distances(trace, path, longest), expected, rtol=1e-12, atol=1e-24)


@pytest.mark.parametrize(
    ("changes", "field"),
    [
        (("sensors=[uwb, camera, imu]", "camera.kind=rendered"), "camera.kind"),
        (("sensors=[uwb, camera, imu]", "camera.kind=projected", "landmark_fix.method=pnp"), "landmark_fix.method"),
    ],
)
def test_what_is_not_compiled_is_told_in_a_line(changes: tuple[str, ...], field: str) -> None:
    scenario = load_scenario("nominal_imu_uwb", changes)
    reason = why_not(scenario)
    assert reason is not None
    assert reason.startswith(field)
    with pytest.raises(InputError, match="Drake flies it"):
        Engine(scenario)
