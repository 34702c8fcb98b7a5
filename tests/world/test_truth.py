"""A world whose Context says what it is like is the world that was built so."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from ortilo_drake.world.truth import set_anchors, set_camera, set_landmarks, set_vehicle
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import Context, Diagram

from ortilo_drake.diagrams.world import make_world
from ortilo_drake.flight.simulator import fix_steps
from ortilo_drake.model.room import ORTILO_ROOM
from ortilo_drake.model.vehicle import M100, Vehicle
from ortilo_drake.scenario import Scenario, load_scenario

LIGHT = ("sensors=[uwb, imu, camera]", "camera.kind=projected", "uwb.link={rate: null}", "camera.link={rate: null}")
HEAVY = Vehicle(mass=3.1, inertia=(0.2, 0.18, 0.3), arm_length=0.2, rotor_lift=2.1e-5, rotor_time_constant=(0.02, 0.03))


def flown(scenario: Scenario, change: Callable[[Diagram, Context], None] = lambda world, context: None) -> list[Any]:
    """Return all that a world shows in ten ticks under a control that turns it, and the state that it comes to."""
    world = make_world(scenario)
    simulator = Simulator(world)
    fix_steps(simulator, scenario)
    context = simulator.get_mutable_context()
    world.SetHovering(context, np.array([8.0, 1.0, 1.5]), 0.0)
    if world.HasSubsystemNamed("rotors"):
        world.GetSubsystemByName("rotors").GetMyMutableContextFromRoot(context).SetContinuousState([600.0] * 4)
    change(world, context)
    world.GetInputPort("control").FixValue(context, [28.0, 0.01, -0.02, 0.005])
    found = []
    for k in range(1, 11):
        simulator.AdvanceTo(k * scenario.h)
        found += [world.GetOutputPort(name).Eval(context).tobytes() for name in ("state", "uwb", "imu", "detections")]
    return found


def world_of(*settings: str, vehicle: Vehicle = M100) -> Scenario:
    return load_scenario("nominal_imu_uwb_yolo", (*LIGHT, *settings)).model_copy(update={"vehicle": vehicle})


@pytest.mark.parametrize(
    "settings", [(), ("world.plant=continuous", "world.rotors={kind: first_order}"), ("world.plant=continuous",)]
)
def test_a_vehicle_that_is_set_flies_as_the_one_built(settings: tuple[str, ...]) -> None:
    built = flown(world_of(*settings, vehicle=HEAVY))
    assert flown(world_of(*settings), lambda world, context: set_vehicle(world, context, HEAVY)) == built
    assert flown(world_of(*settings)) != built


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
    zero = np.zeros(len(anchors))
    built = flown(world_of(room_file(tmp_path, lambda data: data.update(anchors=anchors.tolist()))))
    assert flown(scenario, lambda world, context: set_anchors(world, context, anchors, zero)) == built
    bias = np.linspace(0.1, 0.5, len(anchors))
    biased = flown(scenario, lambda world, context: set_anchors(world, context, anchors, bias))
    assert [a == b for a, b in zip(biased, built, strict=True)] == [True, False, True, True] * 10
    one, other = (np.frombuffer(found[1])[2:] for found in (biased, built))
    there = other[len(anchors) :] > 0.0
    assert there.any()
    np.testing.assert_allclose((one - other)[: len(anchors)][there], bias[there], rtol=0.0, atol=1e-12)


def test_an_imus_bias_adds_to_what_it_says() -> None:
    bias = np.linspace(-0.04, 0.04, 9)
    plain = flown(world_of())
    biased = flown(world_of(), lambda world, context: set_vehicle(world, context, M100, bias))
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

    def change(world: Diagram, context: Context) -> None:
        set_landmarks(world, context, landmarks)
        set_camera(world, context, p_BC)

    assert flown(scenario, change) == flown(world_of(room_file(tmp_path, build))) != flown(scenario)


def pictures(scenario: Scenario, change: Callable[[Diagram, Context], None] | None = None) -> np.ndarray:
    """Return what a world draws at one place: the landmark at each pixel, and its colours."""
    world = make_world(scenario)
    context = world.CreateDefaultContext()
    plant = world.GetSubsystemByName("quadrotor")
    plant.SetState(plant.GetMyMutableContextFromRoot(context), [8.0, 1.0, 1.5, *[0.0] * 9])
    if change is not None:
        change(world, context)
    ports = [world.GetOutputPort(name) for name in ("label_image", "image")]
    return np.concatenate([port.Eval(context).data.astype(float) for port in ports], axis=2)


@pytest.mark.long
@pytest.mark.egl
def test_landmarks_and_a_camera_that_are_set_are_drawn_as_those_built(tmp_path: Path) -> None:
    scenario = load_scenario("nominal_imu_uwb_yolo", ("camera.kind=rendered", "camera.width=160"))
    room = scenario.load_room()
    p_BC = np.array(room.camera.position) + [0.0, 0.1, 0.2]
    landmarks = room.landmark_positions + [0.15, -0.1, 0.0]

    def change(world: Diagram, context: Context) -> None:
        set_landmarks(world, context, landmarks)
        set_camera(world, context, p_BC)

    def build(data: dict[str, Any]) -> None:
        with_landmarks(landmarks)(data)
        data["camera"]["position"] = p_BC.tolist()

    moved, plain = pictures(scenario, change), pictures(scenario)
    size = "camera.kind=rendered", "camera.width=160"
    built = pictures(load_scenario("nominal_imu_uwb_yolo", (*size, room_file(tmp_path, build))))
    np.testing.assert_array_equal(moved[..., 0], built[..., 0])
    assert np.mean(moved[..., 0] == plain[..., 0]) < 0.97
