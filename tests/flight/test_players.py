"""Whoever flies a scenario, the same seed gives the same bits; and who flies is chosen and told."""

import runpy
from pathlib import Path

import numpy as np
import pytest
from command_line import run
from pydrake.systems.framework import System
from sameness import assert_same_bits

import ortilo_drake as od
from ortilo_drake.commands.options import PlayerName
from ortilo_drake.diagrams.onboard import Parts
from ortilo_drake.diagrams.wiring.whole import boxes_of
from ortilo_drake.flight.engine import Engine
from ortilo_drake.flight.players import CHOICES, choose, fly, player_of
from ortilo_drake.model.signals import PAYLOAD
from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.scenario import Belief, Scenario, load_scenario, scenario_names

PROJECTED = "camera.kind=projected"
HOVER = ("planner={kind: hover, point: [8, 1, 1.5], duration: 3}", "settle=0.0")
MOVING = ("planner={kind: waypoints, points: [[7.0, 1.0, 1.5], [8.2, 1.6, 1.5]]}", "settle=1.0")
RENDERED = "camera.kind: rendered: has no compiled form"
PNP = (PROJECTED, "landmark_fix.method=pnp")
OTHERS = ("drake", "drake-elements")
EXAMPLES = Path(__file__).parents[2] / "examples"


def check_players(scenario: Scenario, seeds: range) -> None:
    players = {name: player_of(scenario, name) for name in ("engine", *OTHERS)}
    for seed in seeds:
        flights = {name: player.fly(seed) for name, player in players.items()}
        assert {name: flight.attrs["player"] for name, flight in flights.items()} == {name: name for name in flights}
        for name in OTHERS:
            assert_same_bits(flights["engine"], flights[name])


FITTED = "uwb.fitted={white: 0.05, lasting: {time: 0.7, sd: 0.1}, field: {length: 1.0, sd: 0.05}, near_floor: 0.3, "
FITTED += "outliers: {share: 0.05, sd: 0.6, burst: 3.0}, constants_sd: 0.05, missing: 0.1}"
BURSTS = "loss={kind: bursts, loss: 0.4, mean_length: 0.5}"
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
REPLAYED = ("uwb.link.delay=2", "estimator.delay=replay")
CASES = (
    ("nominal_imu_uwb", (*REPLAYED, "uwb.link.random_delay=3")),
    ("nominal_imu_uwb", ("uwb.link.delay=2", "uwb.link.random_delay=3", "imu.link.loss=0.3")),
    ("nominal_imu_uwb", ("uwb.link.delay=2", "estimator.delay=drop", "imu.link.delay=1")),
    ("nominal_imu_uwb", (f"uwb.link.{BURSTS}", "estimator.gates={uwb: 0.9}")),
    (
        "nominal_imu_uwb",
        ("estimator.integrator=literal", "world.kinematics=rigid_body", "multilateration.method=nearest_three"),
    ),
    ("nominal_imu_uwb", ("estimator.force=thrust", "uwb.link.random_delay=2", "imu.link.rate=15")),
    ("nominal_imu_uwb", ("sensors=[imu]", "servo.form=paper", "world.kinematics=linear")),
    ("nominal_imu_uwb", ("control_rate=60", "uwb.link.rate=20", "sensors=[imu, uwb]")),
    ("nominal_imu_uwb", ("uwb.errors=fitted", FITTED, "sensors=[imu, uwb]")),
    (
        "nominal_imu_uwb",
        (
            *("estimator.delay=replay", "commands={filter: acted, servo: predicted}"),
            *("command_link={delay: 2, loss: 0.2}", "report_link={delay: 1, loss: 0.2}"),
        ),
    ),
    (
        "nominal_imu_uwb",
        ("commands={servo: predicted, delay: 0.06}", "command_link={delay: 2, loss: 0.1, when_lost: zero}", *ROTORS),
    ),
    (
        "nominal_imu_uwb",
        (
            *("estimator.delay=replay", "commands={filter: acted, servo: augmented, delay: 0.09}"),
            *("command_link.delay=3", "report_link.rate=15", *TRUTH),
        ),
    ),
    ("nominal_imu_uwb", ("estimator.delay=replay", "commands.servo=predicted", "estimator.force=measured")),
    ("nominal_imu_uwb_yolo", (*REPLAYED, "camera.link.delay=1", "camera.link.random_delay=4")),
    ("nominal_imu_uwb_yolo", (f"camera.link.{BURSTS}", "landmark_fix.method=known_tilt")),
    (
        "nominal_imu_uwb_yolo",
        ("landmark_fix={method: cosine_law, prior_sd: [0.3, 0.02]}", "camera.link.rate=10", "estimator.delay=drop"),
    ),
    ("imu_uwb", ("multilateration.noise_scale=null",)),
    ("imu_uwb", ("world.plant=continuous", "control_rate=50")),
    ("imu_uwb", (*TRUTH, "uwb.link.random_delay=2")),
    ("imu_uwb_yolo", (*TRUTH, *ROTORS)),
    ("robust_imu_uwb", ('faults=[{"kind": "anchor_moved", "start": 0.5, "anchor": 2}]',)),
    ("robust_imu_uwb", (*TRUTH, f"uwb.link.{BURSTS}", "estimator.robust={weight: {kind: student_t}, stuck: null}")),
    ("robust_imu_uwb_yolo", ("uwb.link.random_delay=3", "camera.link.delay=2", "estimator.delay=replay")),
    ("datasheet_imu_uwb", ()),
    (
        "tight_differences",
        (
            *("uwb.pairs=all", "uwb.link={rate: 10, delay: 2}", "estimator.horizon=0.1", "truth.uwb.factor=1.001"),
            *("uwb.errors=fitted", "uwb.file=util_2021", "truth.survey.anchors_sd=0.05", "truth.uwb.bias_sd=0.05"),
            *("estimator.ranges={bias_sd: 0.1, slow_sd: 0.1, clock_sd: 0.01}",),
            'faults=[{"kind": "stuck", "sensor": "uwb", "start": 0.7, "end": 1.0}]',
        ),
    ),
    ("nominal_imu_uwb", ("estimator.force=measured", "imu={link: {rate: 240}, ahrs: {time: 1.0}}", *ROTORS)),
    ("altimeter", ("imu.link={rate: 240, random_delay: 2}", "estimator.delay=replay", "altimeter.link.rate=60")),
    ("flow", ("altimeter.link.rate=60", "flow.link={rate: 90, loss: 0.2}", "imu.link.rate=120", *TRUTH)),
    (
        "flow",
        (
            *("flow.link={rate: 90, random_delay: 1}", "truth.sensors.flow.slow_sd=[0.01, 0.01, 0.01, 0.01, 0.01]"),
            'faults=[{"kind": "stuck", "sensor": "flow", "start": 0.5, "end": 0.8}]',
        ),
    ),
    ("tight_imu_uwb", ("sensors=[uwb, imu, altimeter]", "imu.link.rate=90", "altimeter.link.rate=60")),
    ("tight_imu_uwb", ("world.plant=continuous", "imu.link.rate=60")),
    ("tight_imu_uwb", ("sensors=[uwb, imu, altimeter, flow]", "altimeter.link={loss: 0.3, random_delay: 1}")),
    ("tight_imu_uwb", ("imu.link.rate=90", "estimator.ranges.differences=true", *ROTORS, *TRUTH)),
    ("tight_imu_uwb_yolo", ("uwb.link.delay=2", "camera.link.random_delay=3", "imu.link.loss=0.2", *TRUTH)),
)


@pytest.mark.long
@pytest.mark.parametrize(("name", "changes"), CASES)
def test_all_players_fly_the_same_bits(name: str, changes: tuple[str, ...]) -> None:
    check_players(load_scenario(name, (*MOVING, PROJECTED, *changes)), range(2))


@pytest.mark.long
@pytest.mark.parametrize("changes", [HOVER, MOVING], ids=["hover", "moving"])
@pytest.mark.parametrize("name", scenario_names())
def test_all_players_fly_the_same_bits_of_every_ready_made_scenario(name: str, changes: tuple[str, ...]) -> None:
    check_players(load_scenario(name, (PROJECTED, *changes)), range(5))


@pytest.mark.long
def test_the_tight_filter_reads_the_mean_of_a_registered_sensor_s_samples(own_register: None) -> None:
    runpy.run_path(str(EXAMPLES / "barometer.py"))
    changes = (*MOVING, "sensors=[uwb, imu, barometer]", "barometer={link: {rate: 60}, sd: 0.2, drift: 0}")
    scenario = load_scenario("tight_imu_uwb", changes)
    fix = next(box for box in boxes_of(scenario, 1) if box.name == "barometer_fix")
    assert fix.size == PAYLOAD + 1 + 1
    np.testing.assert_allclose(fix.given.tables["V"], [0.2**2 / 2.0], rtol=1e-15)
    check_players(scenario, range(1))


def test_flights_of_different_seeds_are_told_apart() -> None:
    """So that the tests above cannot hold of flights that say nothing."""
    engine = Engine(load_scenario("nominal_imu_uwb", HOVER))
    with pytest.raises(AssertionError):
        assert_same_bits(engine.fly(0), engine.fly(1))


def test_the_fastest_is_the_engine_where_it_can() -> None:
    scenario = load_scenario("nominal_imu_uwb_yolo", (PROJECTED,))
    assert [choose(scenario, player) for player in CHOICES] == ["engine", "engine", *OTHERS]
    assert {str(name) for name in PlayerName} == set(CHOICES)
    rendered = load_scenario("nominal_imu_uwb_yolo")
    assert choose(rendered) == "drake"
    assert isinstance(player_of(load_scenario("nominal_imu_uwb", HOVER)), Engine)


@pytest.mark.parametrize(
    ("name", "changes", "player", "said"),
    [
        ("nominal_imu_uwb_yolo", (), "engine", RENDERED),
        ("nominal_imu_uwb_yolo", PNP, "engine", "landmark_fix.method: pnp: has no compiled form"),
        ("nominal_imu_uwb", (), "quickest", "'quickest': must be one of fastest, engine, drake, drake-elements"),
    ],
)
def test_what_a_player_cannot_fly_is_refused_in_a_line(
    name: str, changes: tuple[str, ...], player: str, said: str, tmp_path: Path
) -> None:
    scenario = load_scenario(name, (*HOVER, *changes))
    with pytest.raises(InputError, match=r"^player: ") as refused:
        fly(scenario, player=player)
    assert said in str(refused.value)
    assert "\n" not in str(refused.value)
    with pytest.raises(InputError, match=r"^player: "):
        od.fly_many(scenario, [0, 1], out=tmp_path, player=player)


def never(belief: Belief) -> System:
    raise AssertionError


def test_a_part_that_is_a_system_is_flown_by_drake() -> None:
    scenario, parts = load_scenario("nominal_imu_uwb", HOVER), Parts(servo=never)
    assert choose(scenario, parts=parts) == "drake"
    with pytest.raises(InputError, match="servo: is given as a System"):
        choose(scenario, "engine", parts)


@pytest.mark.long
@pytest.mark.parametrize("player", CHOICES)
def test_flights_say_who_flew_them(player: str, tmp_path: Path) -> None:
    expected = "engine" if player == "fastest" else player
    flight = od.fly("nominal_imu_uwb", HOVER, seed=3, player=player)
    assert flight.player == flight.summary()["player"] == expected
    (summary,) = od.fly_many("nominal_imu_uwb", [3], HOVER, out=tmp_path, player=player).summaries
    assert summary["player"] == expected
    assert od.Flight.load(flight.to_netcdf(tmp_path / "flight.nc")).player == expected
    assert list(od.compare("nominal_imu_uwb", seeds=[3], settings=HOVER, player=player)["player"]) == [expected]


@pytest.mark.long
def test_the_command_says_who_flew_and_why_not_the_engine(capsys: pytest.CaptureFixture[str]) -> None:
    words = ("fly", "nominal_imu_uwb", *(word for change in HOVER for word in ("--set", change)))
    for player, said in (("fastest", "engine"), ("drake", "drake")):
        assert run(*words, "--player", player) == 0
        assert f"flown by            {said}\n" in capsys.readouterr().out
    words_pnp = ("fly", "nominal_imu_uwb_yolo", *(word for change in (*HOVER, *PNP) for word in ("--set", change)))
    assert run(*words_pnp) == 0
    assert "flown by            drake (landmark_fix.method: pnp: has no compiled form)\n" in capsys.readouterr().out
    assert run(*words_pnp, "--player", "engine") == 2
    assert "landmark_fix.method: pnp: has no compiled form: Drake flies it" in capsys.readouterr().err
    assert run(*words, "--player", "engine", "--log", "never") == 2
    assert "--player: engine: must be drake or fastest with --log" in capsys.readouterr().err


def test_the_engine_tells_its_progress_and_its_speed() -> None:
    player, told = Engine(load_scenario("nominal_imu_uwb", HOVER)), list[int]()
    flight = player.fly(0, told.append)
    assert told == [flight.sizes["tick"] - 1]
    assert 0.0 < flight.attrs["real_time_factor"] < np.inf


OF_ONES_OWN = {
    "estimator": ("range_follower", "imu_uwb", (*HOVER, "estimator={kind: range_follower}")),
    "servo": ("cascade_servo", "imu_uwb", (*HOVER, "servo={kind: cascade}")),
    "planner": ("circle_planner", "imu_uwb", ("planner={kind: circle, duration: 3}", "settle=0.0")),
    "fault": ("longer_ranges", "imu_uwb", (*HOVER, "faults=[{kind: longer_ranges, sensor: uwb, start: 1.0}]")),
    "sensor": ("magnetometer", "imu_uwb", (*HOVER, "sensors=[uwb, imu, magnetometer]")),
    "sensor of the tight filter": ("magnetometer", "tight_imu_uwb", (*HOVER, "sensors=[uwb, imu, magnetometer]")),
}


@pytest.mark.long
@pytest.mark.parametrize("part", OF_ONES_OWN)
@pytest.mark.usefixtures("own_register")
def test_all_players_fly_the_same_bits_of_a_part_of_ones_own(part: str) -> None:
    file, name, changes = OF_ONES_OWN[part]
    runpy.run_path(str(EXAMPLES / f"{file}.py"))
    check_players(load_scenario(name, changes), range(1))
