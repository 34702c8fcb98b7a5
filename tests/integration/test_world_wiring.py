"""The world played by its wiring says and does what Drake's world does, bit for bit."""

import numpy as np
import pytest

from ortilo_drake.diagrams.wiring.truth import drawn_values
from ortilo_drake.diagrams.wiring.world import world_boxes
from ortilo_drake.flight.stepped_halves import WorldHalf
from ortilo_drake.loop.element import Array, Box, Element, Values, constant
from ortilo_drake.loop.player import Player
from ortilo_drake.loop.wiring import Wiring
from ortilo_drake.model.placing import put
from ortilo_drake.model.signals import N_U
from ortilo_drake.onboard.planner.planned import path_of, start_of
from ortilo_drake.scenario import Scenario, load_scenario
from ortilo_drake.world.drawn_truth import of_seed

TICKS = 40
PORTS = {"detections": "camera"}  # of Drake's world, where it has another name than its sensor
TRUTH = (
    "truth={vehicle: {mass_factor: 1.03, inertia_factor: 1.05, thrust_factor: 0.98, center_of_gravity_sd: 0.005},"
    "force: {mean: [0.06, 0.08, 0.0], gust_sd: 0.05}, imu: {level: [0.01, -0.01], yaw_walk: 0.01, rates_sd: 0.01,"
    "specific_force_factor_sd: 0.01}, uwb: {bias_sd: 0.1, slow_sd: 0.1}, survey: {anchors_sd: 0.1},"
    "clock: {offset: 0.005, drift_sd: 1.0e-4}, start: {position: [0.2, -0.2, 0.1], yaw: 0.1},"
    "sensors: {altimeter: {bias_sd: [0.1], slow_sd: [0.1], factor_sd: [0.1]}}}"
)
FAULTS = (
    "faults=[{kind: stuck, sensor: imu, start: 0.41, end: 0.77}, {kind: yaw_jump, start: 0.6, by: 0.1},"
    "{kind: gyro_bias, start: 0.33, by: [0.1, 0.0, 0.2]}, {kind: stuck, sensor: uwb, start: 0.7, end: 0.95},"
    "{kind: nlos_storm, start: 0.2, end: 0.6}, {kind: anchor_moved, start: 0.1, anchor: 1},"
    "{kind: anchors_dying, start: 0.5, anchors: [0, 2], every: 0.2}, {kind: gust, start: 0.3, force: [1.0, 0.0, 0.5]},"
    "{kind: load_dropped, start: 0.65, mass_factor: 0.9}, {kind: rotor_weak, start: 0.81, rotor: 2, factor: 0.9}]"
)
ROTORS = "world={kinematics: rigid_body, plant: continuous, rotors: {kind: first_order}}"
LINKS = (
    "uwb.link={loss: {kind: bursts, loss: 0.3, mean_length: 3}, random_delay: 2}",
    "imu.link={loss: 0.3, delay: 1}",
)
FAST = ("imu.link={rate: 240, loss: 0.3}", "estimator.kind=tight")
LATE = "command_link={delay: 2, loss: 0.4}"


def commands(ticks: int) -> np.ndarray:
    """Commands about hover (ticks, 4)."""
    k = np.arange(ticks)
    return np.column_stack([26.5 + np.sin(k), 0.01 * np.sin(0.3 * k), 0.01 * np.cos(0.2 * k), 1e-3 * np.sin(k)])


def tell(k: int, path: np.ndarray, out: np.ndarray) -> None:
    put(path[k], out)


TOLD = Element("told", out=tell, tables=(Array("path", 2),))


def played(scenario: Scenario) -> dict[str, np.ndarray]:
    """State and messages of each tick under these commands."""
    room = scenario.load_room()
    world, messages = world_boxes(scenario, room, start_of(path_of(scenario)), whole_imu=True)
    servo = Box("servo", TOLD, N_U, Values(tables={"path": commands(TICKS)}))
    wiring = Wiring([*world, servo, constant("end", [-1.0])])
    said = {"state": "plant", **{name: box.name for name, box in messages.items()}}
    if scenario.commands.are_reported:
        said["acted"] = "acted_delivered"
    player = Player(wiring, tuple(said.values()), "end")
    rows = np.zeros((TICKS, player.width))
    drawn = drawn_values(wiring, scenario, room, of_seed(scenario.seed))
    player.fly(np.full(TICKS, scenario.seed, np.int64), rows, drawn)
    edges = np.cumsum([wiring.boxes[name].size for name in said.values()])[:-1]
    return dict(zip(said, np.split(rows, edges, axis=1), strict=True))


def flown(scenario: Scenario) -> list[dict[str, np.ndarray]]:
    """State and messages of each tick by Drake; a message that is not there is left out."""
    world, found = WorldHalf(scenario), []
    for u in commands(TICKS):
        messages = {PORTS.get(name, name): value for name, value in world.sample().items()}
        found.append({"state": world.state} | messages)
        world.advance(u)
    return found


@pytest.mark.long
@pytest.mark.parametrize(
    "settings",
    [
        (),
        LINKS,
        (FAULTS, *LINKS),
        (TRUTH,),
        (TRUTH, FAULTS, *LINKS),
        (ROTORS,),
        (ROTORS, TRUTH, FAULTS),
        FAST,
        (*FAST, ROTORS, TRUTH, FAULTS),
        (LATE,),
        (LATE, ROTORS, "commands.servo=predicted"),
        (LATE, TRUTH, FAULTS, "commands.servo=predicted", "report_link={delay: 1, loss: 0.3}"),
        ("commands.servo=predicted", "report_link.rate=15"),
    ],
    ids=range(13),
)
def test_the_world_of_a_wiring_is_drakes(settings: tuple[str, ...]) -> None:
    sensors = "[uwb, imu]" if "estimator.kind=tight" in settings else "[uwb, imu, altimeter]"
    changes = (f"sensors={sensors}", "estimator.force=measured", "seed=5") if "altimeter" in sensors else ("seed=5",)
    scenario = load_scenario("nominal_imu_uwb", (*changes, *settings))
    mine, drakes = played(scenario), flown(scenario)
    for k, theirs in enumerate(drakes):
        for name, rows in mine.items():
            np.testing.assert_array_equal(rows[k], theirs.get(name, np.zeros(rows.shape[1])), f"{name} at tick {k}")
