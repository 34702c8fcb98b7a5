"""The compiled engine's flights are those of the Drake diagram."""

from collections.abc import Callable

import numpy as np
import pytest
import xarray as xr
from hypothesis import given
from hypothesis import strategies as st
from sameness import apart

from ortilo_drake.diagrams.wiring.whole import why_not
from ortilo_drake.flight.engine import Engine
from ortilo_drake.flight.figures import TRACE_SIZE, TRUE, squared_path_distances
from ortilo_drake.flight.metrics import nis, summary
from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.scenario import load_scenario, scenario_names

COMPILED = {name for name in scenario_names() if why_not(load_scenario(name, ("camera.kind=projected",))) is None}
FITTED = "uwb.fitted={white: 0.05, lasting: {time: 0.7, sd: 0.1}, field: {length: 1.0, sd: 0.05}, near_floor: 0.3, "
FITTED += "outliers: {share: 0.05, sd: 0.6, burst: 3.0}, constants_sd: 0.05, missing: 0.1}"
BURSTS = "uwb.link.loss={kind: bursts, loss: 0.4, mean_length: 0.5}"
SHORT = "planner={kind: waypoints, points: [[0, 0, 1.5], [1.2, 0.6, 1.5]]}"
VARIANTS = (
    ("uwb.link.delay=2", "uwb.link.random_delay=3", "imu.link.loss=0.3"),
    ("uwb.link.delay=2", "estimator.delay=drop", "imu.link.delay=1"),
    (BURSTS, "estimator.gates={uwb: 0.9}"),
    ("estimator.integrator=literal", "world.kinematics=rigid_body", "multilateration.method=nearest_three"),
    ("estimator.force=thrust", "uwb.link.random_delay=2", "imu.link.rate=15"),
    ("sensors=[imu]", "servo.form=paper", "world.kinematics=linear"),
    ("control_rate=60", "uwb.link.rate=20", "sensors=[imu, uwb]"),
    ("uwb.errors=fitted", FITTED, "sensors=[imu, uwb]"),
)

Flown = Callable[..., xr.Dataset]


@pytest.mark.long
@pytest.mark.parametrize("changes", VARIANTS)
def test_flights_of_other_settings_are_drakes(changes: tuple[str, ...], flown: Flown) -> None:
    engine = Engine(load_scenario("nominal_imu_uwb", (SHORT, *changes)))
    found = apart(flown("nominal_imu_uwb", (SHORT, *changes), 5), engine.fly(5))
    assert found.same, found


CAMERA_VARIANTS = (
    ("camera.link.delay=1", "camera.link.random_delay=4", "estimator.delay=replay", "uwb.link.delay=2"),
    ("camera.link.loss={kind: bursts, loss: 0.4, mean_length: 0.5}", "landmark_fix.method=known_tilt"),
    ("landmark_fix={method: cosine_law, prior_sd: [0.3, 0.02]}", "camera.link.rate=10", "estimator.delay=drop"),
)


@pytest.mark.long
@pytest.mark.parametrize("changes", CAMERA_VARIANTS)
def test_flights_of_other_cameras_are_drakes(changes: tuple[str, ...], flown: Flown) -> None:
    changes = (SHORT, "camera.kind=projected", *changes)
    engine = Engine(load_scenario("nominal_imu_uwb_yolo", changes))
    found = apart(flown("nominal_imu_uwb_yolo", changes, 4), engine.fly(4))
    assert found.same, found


TRUTH = (
    "truth.vehicle={mass_factor_sd: 0.05, inertia_factor: 1.1, thrust_factor: 0.97, center_of_gravity: [0.004, 0.0]}",
    "truth.force={mean: [0.1, -0.05, 0.0], gust_sd: 0.1}",
    "truth.uwb={bias: 0.05, factor_sd: 0.005, slow_sd: 0.04}",
    "truth.imu={level_sd: 0.005, yaw_walk: 0.001, rates_factor: 1.01, specific_force_walk: 0.01}",
    "truth.survey={anchors_sd: 0.03, landmarks_sd: 0.02}",
    "truth.camera={position_sd: 0.01, angles_sd: 0.004, focal_factor: 1.003}",
    "truth.clock={offset: 0.004, offset_sd: 0.002, drift: 1.0e-5}",
    "truth.start={position: [0.2, -0.1, 0.0], yaw: 0.05}",
)
ROTORS = ("world.plant=continuous", "world.rotors={kind: first_order}")
WORLDS = (
    ("imu_uwb", ("world.plant=continuous", "control_rate=50")),
    ("imu_uwb", (*TRUTH, "uwb.link.random_delay=2")),
    ("imu_uwb_yolo", (*TRUTH, *ROTORS)),
    ("robust_imu_uwb", (*TRUTH, BURSTS, "estimator.robust={weight: {kind: student_t}, stuck: null}")),
    ("robust_imu_uwb_yolo", ("uwb.link.random_delay=3", "camera.link.delay=2", "estimator.delay=replay")),
    ("tight_imu_uwb_yolo", ("uwb.link.delay=2", "camera.link.random_delay=3", "imu.link.loss=0.2", *TRUTH)),
    ("tight_imu_uwb", ("sensors=[uwb, imu, altimeter, flow]", "altimeter.link={loss: 0.3, random_delay: 1}")),
    (
        "tight_imu_uwb",
        (
            "imu.link.rate=90",
            "estimator.ranges.differences=true",
            "world.plant=continuous",
            "world.rotors={kind: first_order}",
        ),
    ),
)


@pytest.mark.long
@pytest.mark.parametrize(("name", "changes"), WORLDS)
def test_flights_in_other_worlds_are_drakes(name: str, changes: tuple[str, ...], flown: Flown) -> None:
    changes = (SHORT, "camera.kind=projected", *changes)
    engine = Engine(load_scenario(name, changes))
    found = apart(flown(name, changes, 3), engine.fly(3))
    assert found.same, found


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
    found = apart(flown("nominal_imu_uwb", changes, 2), flight)
    assert found.same, found
    ticks, cause = engine.figures([2])[0, :2]
    assert ticks == flight.sizes["tick"] - 1
    assert cause >= 0


def test_other_flights_are_told_apart() -> None:
    engine = Engine(load_scenario("nominal_imu_uwb", (SHORT,)))
    one, other = engine.fly(1), engine.fly(2)
    assert apart(one, one).same
    assert not apart(one, other).same
    assert not apart(one, one.isel(tick=slice(0, -1))).same
    nearly = one.copy(deep=True)
    nearly["estimate"].values[7, 1] += 1e-8
    assert not apart(one, nearly).same
    late = one.copy(deep=True)
    late["arrival"].values[7, 0] = not late["arrival"].values[7, 0]
    assert not apart(one, late).arrivals


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
        (("imu.link.rate=60",), "imu.link.rate"),
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
