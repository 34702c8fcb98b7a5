"""How the world of one seed differs from what is believed: what its boxes are given in place of their own."""

from typing import Any

import numpy as np

from ortilo_drake.loop.element import Given
from ortilo_drake.loop.wiring import Wiring
from ortilo_drake.model.room import Room
from ortilo_drake.model.signals import IMU_SIZE, PAYLOAD
from ortilo_drake.scenario import Scenario, Truth
from ortilo_drake.scenario.truth import ForceTruth, VehicleTruth
from ortilo_drake.world.drawn_truth import AtStart, Drawn, draw_truth, of_seed
from ortilo_drake.world.faults.fault_element import fault_out
from ortilo_drake.world.sensors.ahrs import STREAM as AHRS_STREAM
from ortilo_drake.world.sensors.range_paths import STREAM as PATHS_STREAM
from ortilo_drake.world.sensors.range_paths import paths_out
from ortilo_drake.world.sensors.sensor_errors import bias_of, errors_of, factor_of
from ortilo_drake.world.sensors.standstill import zero_at_rest
from ortilo_drake.world.slow_error import SlowNoise, gauss_markov
from ortilo_drake.world.vehicle.wrench_error import wrench_matrix


def drawn_of(wiring: Wiring, scenario: Scenario, room: Room, draw: AtStart) -> dict[str, Given]:
    """Return what boxes are given in the flight in whose world that was drawn at the start, by their names.

    Args:
        wiring: of the scenario, its world as it is believed to be.
        scenario: the scenario.
        room: as it was surveyed.
        draw: what was drawn.
    """
    if scenario.truth == Truth():
        return of_standstill(wiring, scenario, {}, draw) | of_paths(wiring, draw) | of_ahrs(wiring, scenario, draw)
    payloads = payloads_of(wiring, scenario, room)
    drawn = draw_truth(scenario.truth, draw, room, payloads)
    parts = [of_vehicle(wiring, scenario, drawn), of_force(scenario, drawn, draw)]
    parts += [of_sensor(wiring, scenario, room, sensor, n, drawn, draw) for sensor, n in payloads.items()]
    parts += [of_standstill(wiring, scenario, drawn, draw), of_paths(wiring, draw), of_ahrs(wiring, scenario, draw)]
    found: dict[str, Given] = {}
    for name, given in (item for part in parts for item in part.items()):
        if name in wiring.boxes:
            found[name] = found.get(name, Given()).with_(given)
    return found


def normals_at_start(wiring: Wiring, scenario: Scenario, room: Room) -> dict[str, int]:
    """Return how many normal numbers each stream gives to what is drawn at the start, by name; arguments as above."""
    asked: dict[str, int] = {}

    def ask(name: str, n: int) -> np.ndarray:
        asked[name] = n
        return np.zeros(n)

    drawn_of(wiring, scenario, room, ask)
    return asked


def payloads_of(wiring: Wiring, scenario: Scenario, room: Room) -> dict[str, int]:
    """Return the size of each payload, of the sensors that fly, as draw_truth takes them; 0 of the camera's."""
    sizes = {"uwb": 2 * len(room.anchors), "camera": 0, "imu": IMU_SIZE - PAYLOAD}
    flying = [name for name in scenario.measurement.sensors if name in scenario.sensors]
    flying.sort(key=lambda name: list(sizes).index(name) if name in sizes else len(sizes))
    return {name: sizes[name] if name in sizes else wiring.boxes[name].size - PAYLOAD for name in flying}


def of_vehicle(wiring: Wiring, scenario: Scenario, drawn: Drawn) -> dict[str, Given]:
    """Return where the vehicle starts, what it weighs, and what its rotors make of a command."""
    start = np.zeros(12)
    start[0:3], start[5] = drawn["start.position"], drawn["start.yaw"]
    found = of_body(wiring, scenario, drawn)
    name, state = ("vehicle", "body") if "vehicle" in wiring.boxes else ("plant", "x")
    if name in found:
        body = wiring.boxes[name].given.start[state].copy()
        body[:12] += start
        found[name] = found[name].with_(Given(start={state: body}))
    if scenario.truth.vehicle != VehicleTruth():
        wrench = wrench_matrix(float(drawn["vehicle.thrust_factor"]), drawn["vehicle.center_of_gravity"])
        tables = Given(tables={"wrench": wrench})
        found["wrench_error"] = found["rotors_felt"] = tables
        if name == "vehicle":
            found[name] = found[name].with_(tables)
    return found


def of_body(wiring: Wiring, scenario: Scenario, drawn: Drawn) -> dict[str, Given]:
    """Return what the vehicle weighs, and the mean force on it, of boxes that are told."""
    vehicle, boxes = scenario.vehicle, wiring.boxes
    mass = float(drawn["vehicle.mass_factor"] * vehicle.mass)
    inertia = np.array([float(drawn["vehicle.inertia_factor"] * moment) for moment in vehicle.inertia])
    numbers = {"mass": mass, "inertia": inertia}
    found = {}
    for name in ("vehicle", "plant", "acceleration"):
        told = {number for number in numbers if name in boxes and number in boxes[name].given.numbers}
        if told:
            found[name] = Given({number: numbers[number] for number in told})
    if "lasting_force" in boxes:
        found["lasting_force"] = Given(tables={"bias": np.concatenate((drawn["force.mean"], np.zeros(3)))})
    return found


def of_force(scenario: Scenario, drawn: Drawn, draw: AtStart) -> dict[str, Given]:
    """Return the force that lasts."""
    truth = scenario.truth.force
    if truth == ForceTruth():
        return {}
    noise = gauss_markov(np.array([*[truth.gust_sd] * 3, 0.0, 0.0, 0.0]), truth.gust_time, scenario.h)
    bias = np.concatenate((drawn["force.mean"], np.zeros(3)))
    return {"lasting_force": lasting("lasting_force", noise, bias, draw)}


def lasting(name: str, noise: SlowNoise, bias: np.ndarray, draw: AtStart) -> Given:
    """Return an error that lasts, with the noise that has its name."""
    return Given(start={"x": noise.start * draw(f"slow error/{name}", len(bias))}, tables={"bias": bias})


def of_sensor(
    wiring: Wiring, scenario: Scenario, room: Room, sensor: str, payload: int, drawn: Drawn, draw: AtStart
) -> dict[str, Given]:
    """Return a sensor's clock, where it and what it sees stand, and the errors of its messages; arguments as above."""
    clock = Given({"offset": float(drawn[f"clock.offset.{sensor}"]), "drift": float(drawn[f"clock.drift.{sensor}"])})
    found = {f"{sensor}_clock": clock}
    errors = errors_of(scenario.truth, sensor, payload, scenario.h)
    if errors is not None:
        n = len(errors.noise.a)
        lasts = lasting(f"{sensor}_slow_error", errors.noise, bias_of(drawn, sensor, n), draw)
        found[f"{sensor}_error"] = lasts.with_(Given(tables={"factor": factor_of(drawn, sensor, n)}))
    if sensor == "imu":
        found["imu"] = Given(tables={"bias": imu_bias(drawn)})
    if sensor == "uwb":
        anchors = Given(tables={"anchors": room.anchor_positions + drawn["survey.anchors"]})
        found["uwb"] = anchors.with_(Given(tables={"bias": drawn["uwb.bias"]}))
        found |= {name: anchors for name, box in wiring.boxes.items() if box.element.out in (fault_out, paths_out)}
    if sensor == "camera" and not scenario.is_rendered:
        f = wiring.boxes["camera"].given.numbers["camera_f"] * float(drawn["camera.focal_factor"])
        tables = {
            "camera_p_BC": np.array(room.camera.position) + drawn["camera.position"],
            "room_positions": room.landmark_positions + drawn["survey.landmarks"],
        }
        found["camera"] = Given({"camera_f": f, "turned": drawn["camera.angles"]}, tables=tables)
    return found


def of_paths(wiring: Wiring, draw: AtStart) -> dict[str, Given]:
    """Return the first of what walls lengthen ranges by."""
    if "uwb_paths" not in wiring.boxes:
        return {}
    size = len(wiring.boxes["uwb_paths"].given.start["x"])
    return {"uwb_paths": Given(start={"x": draw(PATHS_STREAM, size)})}


def of_ahrs(wiring: Wiring, scenario: Scenario, draw: AtStart) -> dict[str, Given]:
    """Return how the yaw of the imu's attitude filter drifts."""
    if "imu_ahrs" not in wiring.boxes or scenario.imu.ahrs is None:
        return {}
    return {"imu_ahrs": Given({"drift": scenario.imu.ahrs.drift_sd * float(draw(AHRS_STREAM, 1)[0])})}


def imu_bias(drawn: Drawn) -> np.ndarray:
    """Return what is added to the imu's angles, rates and specific force (9)."""
    return np.array([*drawn["imu.level"], drawn["imu.yaw"], *drawn["imu.rates"], *drawn["imu.specific_force"]])


def of_standstill(wiring: Wiring, scenario: Scenario, drawn: Drawn, draw: AtStart) -> dict[str, Given]:
    """Return the imu as it is after it was zeroed at rest: what is taken off its messages is taken off its biases."""
    if scenario.samples_at_rest == 0 or "imu" not in wiring.boxes:
        return {}
    bias, factor = imu_errors(drawn)
    bias[3:] -= zero_at_rest(scenario, bias, factor, draw) / factor[3:]
    return {"imu": Given(tables={"bias": bias})}


def imu_errors(drawn: Drawn) -> tuple[np.ndarray, np.ndarray]:
    """Return the biases and the factors of the imu's angles, rates and specific force (9 each); of {} none."""
    return (imu_bias(drawn), factor_of(drawn, "imu", 9)) if drawn else (np.zeros(9), np.ones(9))


def standstill_of(scenario: Scenario, room: Room) -> dict[str, Any]:
    """Return how the vehicle of a scenario and its seed stood still: for how long, and what was measured; {} if not."""
    if scenario.samples_at_rest == 0:
        return {}
    draw = of_seed(scenario.seed)
    drawn = draw_truth(scenario.truth, draw, room, {"imu": IMU_SIZE - PAYLOAD}) if scenario.truth != Truth() else {}
    zero = zero_at_rest(scenario, *imu_errors(drawn), draw).tolist()
    how = {"seconds": scenario.imu.standstill, "samples": scenario.samples_at_rest}
    return how | {"rates": zero[:3], "specific_force": zero[3:]}
