"""Whoever flies a scenario, the same seed gives the same bits; and who flies is chosen and told."""

import runpy
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from command_line import run
from pydrake.systems.framework import System

import ortilo_drake as od
from ortilo_drake.commands.options import PlayerName
from ortilo_drake.diagrams.onboard import Parts
from ortilo_drake.flight.engine import Engine
from ortilo_drake.flight.players import CHOICES, choose, fly, player_of
from ortilo_drake.model import parts
from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.scenario import Belief, Scenario, load_scenario, scenario_names

PROJECTED = "camera.kind=projected"
HOVER = ("planner={kind: hover, point: [8, 1, 1.5], duration: 3}", "settle=0.0")
MOVING = ("planner={kind: waypoints, points: [[7.0, 1.0, 1.5], [8.2, 1.6, 1.5]]}", "settle=1.0")
RENDERED = "camera.kind: rendered: has no compiled form"
OTHERS = ("drake", "drake-elements")
EXAMPLES = Path(__file__).parents[2] / "examples"


def assert_same_bits(one: xr.Dataset, other: xr.Dataset) -> None:
    assert one.attrs["lost"] == other.attrs["lost"]
    assert set(one.variables) == set(other.variables)
    for name in one.variables:
        np.testing.assert_array_equal(one[name].values, other[name].values, err_msg=str(name))


def check_players(scenario: Scenario, seeds: range) -> None:
    players = {name: player_of(scenario, name) for name in ("engine", *OTHERS)}
    for seed in seeds:
        flights = {name: player.fly(seed) for name, player in players.items()}
        assert {name: flight.attrs["player"] for name, flight in flights.items()} == {name: name for name in flights}
        for name in OTHERS:
            assert_same_bits(flights["engine"], flights[name])


CHANGES = {
    "nominal_imu_uwb": (*MOVING, "uwb.link.delay=2", "uwb.link.random_delay=3", "estimator.delay=replay"),
    "imu_uwb": (*HOVER, "multilateration.noise_scale=null"),
    "imu_uwb_yolo": (*HOVER, "truth.vehicle.mass_factor_sd=0.05", "truth.start={position: [0.2, -0.1, 0.0]}"),
    "robust_imu_uwb": (*MOVING, 'faults=[{"kind": "anchor_moved", "start": 0.5, "anchor": 2}]'),
    "datasheet_imu_uwb": HOVER,
    "tight_differences": (
        *(*MOVING, "uwb.pairs=all", "uwb.link={rate: 10, delay: 2}", "estimator.horizon=0.1", "truth.uwb.factor=1.001"),
        *("uwb.errors=fitted", "uwb.file=util_2021", "truth.survey.anchors_sd=0.05", "truth.uwb.bias_sd=0.05"),
        *("estimator.ranges={bias_sd: 0.1, slow_sd: 0.1, clock_sd: 0.01}",),
        'faults=[{"kind": "stuck", "sensor": "uwb", "start": 0.7, "end": 1.0}]',
    ),
    "tight_imu_uwb": (*HOVER, "world.plant=continuous", "imu.link.rate=60"),
}


@pytest.mark.long
@pytest.mark.parametrize("name", CHANGES)
def test_all_players_fly_the_same_bits(name: str) -> None:
    check_players(load_scenario(name, (PROJECTED, *CHANGES[name])), range(2))


@pytest.mark.long
@pytest.mark.parametrize("changes", [HOVER, MOVING], ids=["hover", "moving"])
@pytest.mark.parametrize("name", scenario_names())
def test_all_players_fly_the_same_bits_of_every_ready_made_scenario(name: str, changes: tuple[str, ...]) -> None:
    check_players(load_scenario(name, (PROJECTED, *changes)), range(5))


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
        ("nominal_imu_uwb", ("imu.link.rate=60",), "engine", "imu.link.rate: is faster than the tick"),
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
    assert run(*words, "--set", "imu.link.rate=60") == 0
    assert "flown by            drake (imu.link.rate: is faster than the tick)\n" in capsys.readouterr().out
    assert run(*words, "--set", "imu.link.rate=60", "--player", "engine") == 2
    assert "imu.link.rate: is faster than the tick: Drake flies it" in capsys.readouterr().err
    assert run(*words, "--player", "engine", "--log", "never") == 2
    assert "--player: engine: does not take --log" in capsys.readouterr().err


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
@pytest.mark.parametrize(
    "part",
    [pytest.param(part, marks=[pytest.mark.long] * (part not in ("estimator", "sensor"))) for part in OF_ONES_OWN],
)
def test_all_players_fly_the_same_bits_of_a_part_of_ones_own(part: str, monkeypatch: pytest.MonkeyPatch) -> None:
    for register in ("_SENSORS", "_PARTS"):
        monkeypatch.setattr(parts, register, dict(getattr(parts, register)))
    file, name, changes = OF_ONES_OWN[part]
    runpy.run_path(str(EXAMPLES / f"{file}.py"))
    check_players(load_scenario(name, changes), range(1))
