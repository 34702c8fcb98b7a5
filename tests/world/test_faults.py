"""Faults in the world against closed forms: what they change, and that they change nothing else."""

from typing import Any

import numpy as np
import pytest
from pydrake.systems.framework import Context
from scipy import stats

from ortilo_drake.diagrams.world import World, make_world
from ortilo_drake.flight.flight import fly
from ortilo_drake.model.signals import DETECTION_SIZE, PAYLOAD
from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.scenario import Scenario, load_scenario
from ortilo_drake.scenario.faults import LoadDropped, People, RotorWeak
from ortilo_drake.world.faults.table import cylinders_at, numbered, settings_of, table_of
from ortilo_drake.world.faults.vehicle_faults import wrench_matrix

P_WB = np.array([6.6, 2.2, 1.5])
START = 22.0
TICK = 663  # 22.1 s, at which all sensors send
HOVERS = ("planner={kind: hover, point: [9.0, 0.5, 1.5], duration: 3.0}", "settle=0.0")
Fault = dict[str, Any]


def scenario_with(*faults: Fault, name: str = "nominal_imu_uwb_yolo", settings: tuple[str, ...] = ()) -> Scenario:
    laid = [{"start": START} | fault for fault in faults]
    return load_scenario(name, ("camera.kind=projected", "camera.latency=0", *settings, ("faults", laid)))


def hovering(scenario: Scenario) -> tuple[World, Context]:
    world = make_world(scenario, r_0=P_WB)
    context = world.CreateDefaultContext()
    world.SetSeed(context, 3)
    return world, context


def message(port: str, *faults: Fault, tick: int = TICK, settings: tuple[str, ...] = ()) -> np.ndarray:
    scenario = scenario_with(*faults, settings=settings)
    world, context = hovering(scenario)
    context.SetTime(tick * scenario.h)
    said: np.ndarray = world.GetOutputPort(port).Eval(context)
    assert said[0] == 1.0
    return said.copy()


ANCHORS = Scenario().load_room().anchor_positions
N = len(ANCHORS)
RANGES, FLAGS = slice(PAYLOAD, PAYLOAD + N), slice(PAYLOAD + N, None)

ALL: list[tuple[Fault, tuple[str, ...]]] = [  # each with the messages that it changes
    ({"kind": "nlos_storm"}, ("uwb",)),
    ({"kind": "outlier_bursts"}, ("uwb",)),
    ({"kind": "stuck", "sensor": "uwb"}, ("uwb",)),
    ({"kind": "stuck", "sensor": "imu"}, ("imu",)),
    ({"kind": "stuck", "sensor": "camera"}, ("detections",)),
    ({"kind": "anchor_moved", "anchor": 3}, ("uwb",)),
    ({"kind": "anchors_dying", "anchors": [3, 4]}, ("uwb",)),
    ({"kind": "clock_jump"}, ("uwb",)),
    ({"kind": "yaw_jump"}, ("imu",)),
    ({"kind": "gyro_bias"}, ("imu",)),
    ({"kind": "camera_blinded"}, ("detections",)),
    ({"kind": "landmark_moved", "landmark": 1}, ("detections",)),
    ({"kind": "landmark_gone", "landmark": 1}, ("detections",)),
    ({"kind": "people", "walks": [[7.4, 2.2, 7.4, 2.2]]}, ("uwb", "detections")),
    ({"kind": "gust"}, ("imu",)),
    ({"kind": "load_dropped"}, ("imu",)),
    ({"kind": "rotor_weak"}, ("imu",)),
]
KINDS = [fault["kind"] for fault, _ in ALL]


@pytest.mark.long
@pytest.mark.parametrize(("fault", "ports"), ALL, ids=KINDS)
def test_a_fault_changes_what_it_concerns_and_no_other_noise(fault: Fault, ports: tuple[str, ...]) -> None:
    for port in ("uwb", "imu", "detections"):
        if port not in ports:
            np.testing.assert_array_equal(message(port, fault), message(port))


@pytest.mark.long
@pytest.mark.parametrize("fault", [fault for fault, _ in ALL], ids=KINDS)
def test_nothing_is_changed_before_the_start_and_after_the_end(fault: Fault) -> None:
    late, past = fault | {"start": START + 0.2}, fault | {"start": 1.0, "end": START}
    for port in ("uwb", "imu", "detections"):
        np.testing.assert_array_equal(message(port, late), message(port))
        if fault["kind"] != "load_dropped":
            np.testing.assert_array_equal(message(port, past), message(port))


@pytest.mark.long
def test_a_moved_anchor_shifts_its_range_by_what_geometry_says() -> None:
    by = np.array([0.3, -0.1, 0.2])
    said, plain = message("uwb", {"kind": "anchor_moved", "anchor": 3, "by": by.tolist()}), message("uwb")
    shift = np.linalg.norm(P_WB - ANCHORS[3] - by) - np.linalg.norm(P_WB - ANCHORS[3])
    assert said[PAYLOAD + 3] - plain[PAYLOAD + 3] == pytest.approx(shift, abs=1e-12)
    np.testing.assert_array_equal(np.delete(said, PAYLOAD + 3), np.delete(plain, PAYLOAD + 3))


@pytest.mark.long
def test_a_moved_anchor_moves_from_where_it_truly_stands() -> None:
    settings = ("truth.survey.anchors=[0.5, 0.0, 0.0]",)
    moved = message("uwb", {"kind": "anchor_moved", "anchor": 3}, settings=settings)
    true = ANCHORS[3] + [0.5, 0.0, 0.0]
    shift = np.linalg.norm(P_WB - true - [0.3, 0.0, 0.0]) - np.linalg.norm(P_WB - true)
    assert (moved - message("uwb", settings=settings))[PAYLOAD + 3] == pytest.approx(shift, abs=1e-12)


@pytest.mark.long
def test_a_clock_jump_adds_the_same_to_every_range_that_is_there() -> None:
    said, plain = message("uwb", {"kind": "clock_jump", "by": 0.4}), message("uwb")
    there = plain[FLAGS] > 0.0
    np.testing.assert_allclose((said - plain)[RANGES], 0.4 * there, atol=1e-12)
    np.testing.assert_array_equal(said[FLAGS], plain[FLAGS])


@pytest.mark.long
def test_a_storm_adds_an_exponential_length_to_a_share_of_the_ranges() -> None:
    storm = {"kind": "nlos_storm", "share": 0.3, "mean": 0.7}
    added = []
    world, context = hovering(scenario_with(storm))
    calm, its = hovering(scenario_with())
    for tick in range(TICK, TICK + 3000, 3):
        for c in (context, its):
            c.SetTime(tick / 30.0)
        said, plain = world.GetOutputPort("uwb").Eval(context), calm.GetOutputPort("uwb").Eval(its)
        added.append((said - plain)[RANGES][plain[FLAGS] > 0.0])
    lengths = np.concatenate(added)
    assert lengths.min() >= 0.0
    hit = lengths[lengths > 0.0]
    assert len(hit) / len(lengths) == pytest.approx(0.3, abs=0.03)
    assert np.mean(hit) == pytest.approx(0.7, abs=0.06)
    assert np.mean(hit > 0.7) == pytest.approx(np.exp(-1.0), abs=0.05)


@pytest.mark.long
def test_bursts_come_and_go() -> None:
    bursts = {"kind": "outlier_bursts", "every": 1.0, "length": 0.4, "sd": 2.0}
    hit = [not np.array_equal(message("uwb", bursts, tick=t), message("uwb", tick=t)) for t in range(660, 720, 3)]
    assert hit == 2 * ([True] * 4 + [False] * 6)


@pytest.mark.long
def test_anchors_die_one_by_one() -> None:
    dying = {"kind": "anchors_dying", "anchors": [3, 4, 5], "every": 1.0, "end": START + 5.0}
    for tick, dead in ((660, [3]), (687, [3]), (690, [3, 4]), (720, [3, 4, 5]), (804, [3, 4, 5]), (810, [])):
        gone = np.flatnonzero(message("uwb", tick=tick)[FLAGS] != message("uwb", dying, tick=tick)[FLAGS])
        assert gone.tolist() == dead


@pytest.mark.long
def test_yaw_and_rates_are_shifted_and_nothing_else() -> None:
    plain = message("imu")
    for fault, columns, by in (
        ({"kind": "yaw_jump", "by": 0.2}, [PAYLOAD + 2], [0.2]),
        (
            {"kind": "gyro_bias", "by": [0.01, -0.02, 0.03]},
            [PAYLOAD + 3, PAYLOAD + 4, PAYLOAD + 5],
            [0.01, -0.02, 0.03],
        ),
    ):
        shifted = plain.copy()
        shifted[columns] += by
        np.testing.assert_array_equal(message("imu", fault), shifted)


def boxes(said: np.ndarray) -> np.ndarray:
    rows = said[PAYLOAD:].reshape(-1, DETECTION_SIZE)
    return np.asarray(rows[rows[:, 0] >= 0.0])


@pytest.mark.long
def test_a_blinded_camera_sends_a_message_without_a_box() -> None:
    assert len(boxes(message("detections"))) > 0
    assert len(boxes(message("detections", {"kind": "camera_blinded"}))) == 0


@pytest.mark.long
def test_landmarks_that_are_gone_or_hidden_take_their_own_boxes_alone() -> None:
    plain = boxes(message("detections", tick=660))
    count = len(Scenario().load_room().landmarks)
    without = [boxes(message("detections", {"kind": "landmark_gone", "landmark": i}, tick=660)) for i in range(count)]
    missing = [len(plain) - len(rows) for rows in without]
    assert set(missing) == {0, 1}
    assert sum(missing) <= len(plain)  # false boxes are nobody's
    for rows in without:
        assert {tuple(row) for row in rows} <= {tuple(row) for row in plain}
    wall = [[7.1, y, 7.1, y] for y in np.arange(0.0, 4.6, 0.2)]
    people = boxes(message("detections", {"kind": "people", "walks": wall, "height": 3.0}, tick=660))
    assert len(people) == len(plain) - sum(missing)


@pytest.mark.long
def test_people_hide_the_anchors_behind_them() -> None:
    middle = (0.5 * (P_WB + ANCHORS[3])).tolist()
    stands = {"kind": "people", "walks": [[*middle[:2], *middle[:2]]], "height": 3.0}
    said, plain = message("uwb", stands), message("uwb")
    assert plain[PAYLOAD + N + 3] == 1.0
    assert said[PAYLOAD + 3] == said[PAYLOAD + N + 3] == 0.0
    assert np.array_equal(message("uwb", stands | {"height": 1.0}), plain)


@pytest.mark.long
def test_people_lengthen_the_ranges_through_them() -> None:
    """By an exponential length, new in every message."""
    middle = (0.5 * (P_WB + ANCHORS[3])).tolist()
    stands = {"kind": "people", "walks": [[*middle[:2], *middle[:2]]], "height": 3.0, "excess": 0.5}
    worlds, h = [hovering(scenario_with(*faults)) for faults in ((stands,), ())], 1.0 / 30.0

    def said(world: World, context: Context, tick: int) -> np.ndarray:
        context.SetTime(tick * h)
        found: np.ndarray = world.GetOutputPort("uwb").Eval(context)
        return found.copy()

    longer = np.array([said(*worlds[0], tick) - said(*worlds[1], tick) for tick in range(TICK, TICK + 1200, 3)])
    through = np.flatnonzero(longer.any(axis=0))
    assert PAYLOAD + 3 in through
    assert through.max() < PAYLOAD + N  # all ranges are there
    assert stats.kstest(longer[:, PAYLOAD + 3], "expon", args=(0.0, 0.5)).pvalue > 1e-3


def test_people_walk_to_and_fro() -> None:
    people = People(kind="people", start=1.0, walks=((0.0, 0.0, 3.0, 4.0),), speed=2.0)
    values = settings_of(table_of([*numbered((people,))]), 0)
    for t, way in ((1.0, 0.0), (2.0, 2.0), (3.5, 5.0), (4.5, 3.0), (6.0, 0.0)):
        np.testing.assert_allclose(cylinders_at(values, t - 1.0), [[0.6 * way, 0.8 * way, 0.25, 1.75]], atol=1e-12)


@pytest.mark.long
def test_a_stuck_sensor_says_what_it_said_last() -> None:
    stuck = {"kind": "stuck", "sensor": "imu", "start": 1.0, "end": 1.5}
    plain, flown = (fly(scenario_with(*faults, settings=HOVERS)) for faults in ((), (stuck,)))
    y, y_0 = (flight["measurement"].sel(output=["phi_imu", "theta_imu", "psi_imu"]).values for flight in (flown, plain))
    np.testing.assert_array_equal(y[:30], y_0[:30])
    np.testing.assert_array_equal(y[30:45], np.tile(y[29], (15, 1)))
    assert np.all(y[46] != y[29])


@pytest.mark.long
def test_after_the_load_is_dropped_it_hovers_on_less_thrust() -> None:
    dropped = {"kind": "load_dropped", "start": 5.0, "mass_factor": 0.9}
    long = ("planner={kind: hover, point: [9.0, 0.5, 1.5], duration: 40.0}", "settle=0.0")
    scenario = scenario_with(dropped, name="imu_uwb", settings=long)
    flight = fly(scenario)
    thrust, h = flight["control"].values[:, 0], scenario.h
    hover = scenario.vehicle.hover_thrust
    assert np.mean(thrust[: round(5.0 / h)]) == pytest.approx(hover, rel=0.01)
    assert np.mean(thrust[round(25.0 / h) :]) == pytest.approx(0.9 * hover, rel=0.01)
    plain = fly(scenario_with(name="imu_uwb", settings=long))
    tick = round(5.0 / h)
    np.testing.assert_array_equal(flight["truth"].values[: tick + 1], plain["truth"].values[: tick + 1])
    # Of the same thrust and force 1 / 0.9 times the acceleration: dv = (v_z' + g h) (1 / 0.9 - 1).
    dv = flight["truth"].values[tick + 1, 8] - plain["truth"].values[tick + 1, 8]
    push = plain["truth"].values[tick + 1, 8] - plain["truth"].values[tick, 8] + 9.81 * h
    assert dv == pytest.approx(push * (1.0 / 0.9 - 1.0), rel=1e-2)


@pytest.mark.long
def test_a_gust_pushes_by_its_force_over_the_mass() -> None:
    gust = {"kind": "gust", "start": 1.0, "end": 2.0, "force": [0.0, 2.0, 0.0]}
    plain, flown = (fly(scenario_with(*faults, settings=HOVERS)) for faults in ((), (gust,)))
    dv = (flown["truth"].values - plain["truth"].values)[:, 6:9]
    mass, h = scenario_with().vehicle.mass, scenario_with().h
    assert not dv[:31].any()
    np.testing.assert_allclose(dv[31], [0.0, 2.0 / mass * h, 0.0], atol=1e-9)


def test_the_wrench_of_a_weak_rotor_and_of_a_lighter_body() -> None:
    vehicle = Scenario().vehicle
    weak = wrench_matrix(RotorWeak(kind="rotor_weak", start=0.0, rotor=1, factor=0.8), vehicle)
    u = weak @ np.array([vehicle.hover_thrust, 0.0, 0.0, 0.0])
    assert u[0] == pytest.approx((1.0 - 0.2 / vehicle.rotor_count) * vehicle.hover_thrust)
    assert np.abs(u[1:]).min() > 0.0
    lighter = wrench_matrix(LoadDropped(kind="load_dropped", start=0.0, mass_factor=0.8), vehicle)
    np.testing.assert_allclose(lighter @ [8.0, 1.0, 2.0, 3.0], [10.0, 1.0, 2.0, 3.0])


def test_the_onboard_half_knows_of_no_fault() -> None:
    with_fault, without = scenario_with({"kind": "clock_jump"}), scenario_with()
    assert with_fault != without
    assert with_fault.belief == without.belief
    assert "faults" not in with_fault.belief.model_dump()


@pytest.mark.parametrize(
    ("fault", "settings", "said"),
    [
        ({"kind": "clock_jumps"}, (), "faults.0"),
        ({"kind": "gust", "end": 3.0}, (), "must be after the start, 22.0, or null"),
        ({"kind": "stuck", "sensor": "flow"}, (), "must be in sensors"),
        ({"kind": "stuck", "sensor": "uwb", "start": 0.0}, (), "start"),
        ({"kind": "nlos_storm", "share": 1.5}, (), "share"),
        ({"kind": "load_dropped", "end": 30.0}, (), "end"),
        ({"kind": "yaw_jump", "by": 4.0}, (), "by"),
        ({"kind": "camera_blinded"}, ("sensors=[imu, uwb]",), "faults.0: camera_blinded: concerns camera"),
        (
            {"kind": "camera_blinded"},
            ("camera.kind=rendered", "camera.latency=3"),
            "a fault of the camera: camera.kind must be projected",
        ),
    ],
)
def test_wrong_faults_are_refused_in_one_line(fault: Fault, settings: tuple[str, ...], said: str) -> None:
    with pytest.raises(InputError) as error:
        scenario_with(fault, settings=settings)
    assert said in str(error.value)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("fault", "said"),
    [
        ({"kind": "anchor_moved", "anchor": 12}, "faults.0: anchor_moved: anchor 12: must be below 12"),
        ({"kind": "anchors_dying", "anchors": [0, 40]}, "anchor 40"),
        ({"kind": "landmark_gone", "landmark": 29}, "landmark 29: must be below 29"),
        ({"kind": "rotor_weak", "rotor": 4}, "rotor 4: must be below 4"),
    ],
)
def test_what_is_not_there_has_no_fault(fault: Fault, said: str) -> None:
    with pytest.raises(InputError, match=said):
        make_world(scenario_with(fault))
