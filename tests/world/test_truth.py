"""A world whose Context says what it is like is the world that was built so."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from pydrake.systems.analysis import Simulator

from ortilo_drake.diagrams.wiring.world import world_boxes
from ortilo_drake.diagrams.world import make_world
from ortilo_drake.flight.flight import fix_steps
from ortilo_drake.loop.element import Values
from ortilo_drake.model.room import ORTILO_ROOM
from ortilo_drake.model.signals import N_X
from ortilo_drake.model.vehicle import M100, Vehicle
from ortilo_drake.scenario import Scenario, load_scenario

LIGHT = ("sensors=[uwb, imu, camera]", "camera.kind=projected", "uwb.link={rate: null}", "camera.link={rate: null}")
HEAVY = Vehicle(mass=3.1, inertia=(0.2, 0.18, 0.3), arm_length=0.2, rotor_lift=2.1e-5, rotor_time_constant=(0.02, 0.03))
START = np.array([8.0, 1.0, 1.5])
NOTHING: dict[str, Values] = {}


def flown(scenario: Scenario, given: dict[str, Values] = NOTHING) -> list[Any]:
    """Return all that a world shows in ten ticks under a control that turns it, and the state that it comes to."""
    world = make_world(scenario, r_0=START)
    simulator = Simulator(world)
    fix_steps(simulator, scenario)
    context = simulator.get_mutable_context()
    world.Give(context, given)
    world.GetInputPort("control").FixValue(context, [28.0, 0.01, -0.02, 0.005])
    found = []
    for k in range(1, 11):
        simulator.AdvanceTo(k * scenario.h)
        found += [world.GetOutputPort(name).Eval(context).tobytes() for name in ("state", "uwb", "imu", "detections")]
    return found


def world_of(*settings: str, vehicle: Vehicle = M100) -> Scenario:
    return load_scenario("nominal_imu_uwb_yolo", (*LIGHT, *settings)).model_copy(update={"vehicle": vehicle})


def built_as(scenario: Scenario) -> dict[str, Values]:
    """Return the constants of a scenario's vehicle, and its state at the start, which has its rotors' speeds."""
    boxes, _ = world_boxes(scenario, scenario.load_room(), START, whole_imu=True)
    of_vehicle = [box for box in boxes if box.name in ("plant", "vehicle", "rotors_felt", "felt", "acceleration")]
    return {box.name: box.given for box in of_vehicle}


@pytest.mark.family
@pytest.mark.parametrize(
    "settings", [(), ("world.plant=continuous", "world.rotors={kind: first_order}"), ("world.plant=continuous",)]
)
def test_a_vehicle_that_is_set_flies_as_the_one_built(settings: tuple[str, ...]) -> None:
    built = flown(world_of(*settings, vehicle=HEAVY))
    assert flown(world_of(*settings), built_as(world_of(*settings, vehicle=HEAVY))) == built
    assert flown(world_of(*settings)) != built


@pytest.mark.parametrize("settings", [(), ("world.plant=continuous",)])
def test_a_body_that_is_changed_flies_as_the_one_built(settings: tuple[str, ...]) -> None:
    heavier = M100.model_copy(update={"mass": 1.25 * M100.mass})
    flights = []
    for vehicle, more in ((heavier, 0.0), (M100, 0.25)):
        world = make_world(world_of(*settings, vehicle=vehicle), r_0=START)
        simulator = Simulator(world)
        context = simulator.get_mutable_context()
        world.ChangeBody(context, more, np.zeros(3))
        world.GetInputPort("control").FixValue(context, [28.0, 0.01, -0.02, 0.005])
        simulator.AdvanceTo(0.5)
        flights.append(world.GetOutputPort("state").Eval(context).copy())
    np.testing.assert_array_equal(*flights)


def room_file(tmp_path: Path, change: Callable[[dict[str, Any]], None]) -> str:
    data = yaml.safe_load(ORTILO_ROOM.read_text())
    change(data)
    (tmp_path / "room.yaml").write_text(yaml.safe_dump(data))
    return f"room={tmp_path / 'room.yaml'}"


def shifted(room: np.ndarray) -> np.ndarray:
    return room + np.random.default_rng(1).uniform(-0.2, 0.2, room.shape)


def test_anchors_that_are_set_range_as_those_built_and_their_biases_add(tmp_path: Path) -> None:
    scenario = world_of()
    anchors = shifted(scenario.load_room().anchor_positions)
    built = flown(world_of(room_file(tmp_path, lambda data: data.update(anchors=anchors.tolist()))))
    moved = Values(tables={"receiver_anchors": anchors})
    assert flown(scenario, {"uwb": moved}) == built
    bias = np.linspace(0.1, 0.5, len(anchors))
    biased = flown(scenario, {"uwb": moved.updated(Values(tables={"receiver_bias": bias}))})
    assert [a == b for a, b in zip(biased, built, strict=True)] == [True, False, True, True] * 10
    one, other = (np.frombuffer(found[1])[2:] for found in (biased, built))
    there = other[len(anchors) :] > 0.0
    assert there.any()
    np.testing.assert_allclose((one - other)[: len(anchors)][there], bias[there], rtol=0.0, atol=1e-12)


def test_an_imus_bias_adds_to_what_it_says() -> None:
    bias = np.linspace(-0.04, 0.04, 9)
    plain = flown(world_of())
    biased = flown(world_of(), {"imu": Values(tables={"bias": bias})})
    assert [a == b for a, b in zip(biased, plain, strict=True)] == [True, True, False, True] * 10
    difference = np.frombuffer(biased[2])[2:] - np.frombuffer(plain[2])[2:]
    np.testing.assert_allclose(difference, bias, rtol=0.0, atol=1e-12)


def with_landmarks(positions: np.ndarray) -> Callable[[dict[str, Any]], None]:
    def change(data: dict[str, Any]) -> None:
        for landmark, position in zip(data["landmarks"], positions.tolist(), strict=True):
            landmark["position"] = position

    return change


def test_landmarks_and_a_camera_that_are_set_are_seen_as_those_built(tmp_path: Path) -> None:
    scenario, p_BC = world_of(), np.array([0.2, 0.05, -0.1])
    landmarks = shifted(scenario.load_room().landmark_positions)

    def build(data: dict[str, Any]) -> None:
        with_landmarks(landmarks)(data)
        data["camera"]["position"] = p_BC.tolist()

    moved = {"camera": Values(tables={"camera_p_BC": p_BC, "room_positions": landmarks})}
    assert flown(scenario, moved) == flown(world_of(room_file(tmp_path, build))) != flown(scenario)


def pictures(*settings: str) -> np.ndarray:
    """Return what a world draws at one place: the landmark at each pixel, and its colours."""
    rendered = ("camera.kind=rendered", "camera.width=160")
    world = make_world(load_scenario("nominal_imu_uwb_yolo", (*rendered, *settings)))
    context = world.CreateDefaultContext()
    world.SetSeed(context, 0)
    world.Give(context, {"plant": Values(start={"x": np.concatenate((START, np.zeros(N_X - 3)))})})
    ports = [world.GetOutputPort(name) for name in ("label_image", "image")]
    return np.concatenate([port.Eval(context).data.astype(float) for port in ports], axis=2)


@pytest.mark.long
@pytest.mark.egl
def test_landmarks_and_a_camera_that_are_set_are_drawn_as_those_built(tmp_path: Path) -> None:
    room, by = load_scenario("nominal_imu_uwb_yolo").load_room(), [0.15, -0.1, 0.0]

    def build(data: dict[str, Any]) -> None:
        with_landmarks(room.landmark_positions + by)(data)
        data["camera"]["position"] = (np.array(room.camera.position) + [0.0, 0.1, 0.2]).tolist()

    moved = pictures(f"truth.survey.landmarks={by}", "truth.camera.position=[0.0, 0.1, 0.2]")
    built, plain = pictures(room_file(tmp_path, build)), pictures()
    np.testing.assert_array_equal(moved[..., 0], built[..., 0])
    assert np.mean(moved[..., 0] == plain[..., 0]) < 0.97
