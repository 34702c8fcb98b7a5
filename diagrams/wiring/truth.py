"""The world of one seed: the values that its boxes are given in place of the believed ones."""

import numpy as np

from ortilo_drake.loop.element import Values
from ortilo_drake.loop.wiring import Wiring
from ortilo_drake.model.room import Room
from ortilo_drake.model.signals import PAYLOAD
from ortilo_drake.model.vehicle import Vehicle
from ortilo_drake.scenario import Scenario, Truth
from ortilo_drake.scenario.truth import ForceTruth, VehicleTruth
from ortilo_drake.sensors.described import described
from ortilo_drake.sensors.imu import ahrs_drawn, zeroed
from ortilo_drake.sensors.messages import message_size
from ortilo_drake.sensors.uwb import errors_drawn, paths_drawn
from ortilo_drake.world.drawn_truth import AtStart, Drawn, draw_truth
from ortilo_drake.world.sensors.sensor_errors import bias_of, errors_of, factor_of
from ortilo_drake.world.vehicle.rotors import wrench_matrix


def drawn_values(wiring: Wiring, scenario: Scenario, room: Room, draw: AtStart) -> dict[str, Values]:
    """Return the values given to each box in a flight whose world has these draws, by the boxes' names.

    The wiring is that of the scenario, its world as it is believed to be, and the room as it was surveyed.
    """
    boxes, drawn, parts = wiring.boxes, dict[str, np.ndarray](), list[dict[str, Values]]()
    if scenario.truth != Truth():
        payloads = payloads_of(wiring, scenario, room)
        drawn = draw_truth(scenario.truth, draw, room, payloads)
        parts = [of_vehicle(wiring, scenario, drawn), of_gusts(scenario, draw)]
        parts += [of_sensor(wiring, scenario, room, sensor, n, drawn, draw) for sensor, n in payloads.items()]
    # Every world has these, even one as believed: the imu's zero and drift, ranges' detours and errors.
    parts += [zeroed(scenario, drawn, draw), paths_drawn(boxes, draw), ahrs_drawn(scenario, draw)]
    parts.append(errors_drawn(scenario, room, draw))
    found: dict[str, Values] = {}
    for name, given in (item for part in parts for item in part.items()):
        if name in boxes:
            found[name] = found.get(name, Values()).updated(given)
    return found


def normals_at_start(wiring: Wiring, scenario: Scenario, room: Room) -> dict[str, int]:
    """Return the number of normal numbers that each stream draws at the start, by name; arguments as above."""
    asked: dict[str, int] = {}

    def ask(name: str, n: int) -> np.ndarray:
        asked[name] = n
        return np.zeros(n)

    drawn_values(wiring, scenario, room, ask)
    return asked


def payloads_of(wiring: Wiring, scenario: Scenario, room: Room) -> dict[str, int]:
    """Return the size of each payload, of the sensors that fly, as draw_truth takes them."""
    sizes = dict[str, int]()
    for name in (name for name in scenario.measurement.sensors if name in scenario.sensors):
        sensor = described(name)
        is_asked = sensor.payload is None and sensor.compiled is None
        size = wiring.boxes[name].size if is_asked else message_size(sensor, scenario, room)
        sizes[name] = size - PAYLOAD
    return sizes


def body_of(wiring: Wiring) -> tuple[str, str]:
    """Return the box of the vehicle's own state, and which of its states begins with x."""
    return ("vehicle", "body") if "vehicle" in wiring.boxes else ("plant", "x")


def true_start(drawn: Drawn) -> np.ndarray:
    """Return x at the true start less that at the believed one (12)."""
    start = np.zeros(12)
    start[0:3], start[5] = drawn["start.position"], drawn["start.yaw"]
    return start


def of_vehicle(wiring: Wiring, scenario: Scenario, drawn: Drawn) -> dict[str, Values]:
    """Return the vehicle's true start, mass and inertia, and the wrench of its rotors."""
    found = of_body(wiring, scenario, drawn)
    name, state = body_of(wiring)
    if name in found:
        body = wiring.boxes[name].given.start[state].copy()
        body[:12] += true_start(drawn)
        found[name] = found[name].updated(Values(start={state: body}))
    if scenario.truth.vehicle != VehicleTruth():
        wrench = wrench_matrix(float(drawn["vehicle.thrust_factor"]), drawn["vehicle.center_of_gravity"])
        tables = Values(tables={"wrench": wrench})
        found["wrench_error"] = found["rotors_felt"] = tables
        if "vehicle" in found:  # not where Drake integrates the plant: a box of that name then only passes samples on
            found["vehicle"] = found["vehicle"].updated(tables)
    return found


def true_vehicle(vehicle: Vehicle, drawn: Drawn) -> Vehicle:
    """Return a vehicle with its true mass and inertia."""
    inertia = tuple(float(drawn["vehicle.inertia_factor"] * moment) for moment in vehicle.inertia)
    return vehicle.model_copy(update={"mass": float(drawn["vehicle.mass_factor"] * vehicle.mass), "inertia": inertia})


def of_body(wiring: Wiring, scenario: Scenario, drawn: Drawn) -> dict[str, Values]:
    """Return the true mass and inertia, and the mean force, for the boxes that take them."""
    vehicle, boxes = true_vehicle(scenario.vehicle, drawn), wiring.boxes
    numbers = {"mass": vehicle.mass, "inertia": np.array(vehicle.inertia)}
    found = {}
    for name in ("vehicle", "plant", "acceleration"):
        told = {number for number in numbers if name in boxes and number in boxes[name].given.numbers}
        if told:
            found[name] = Values({number: numbers[number] for number in told})
    if "lasting_force" in boxes:
        found["lasting_force"] = Values(tables={"bias": np.concatenate((drawn["force.mean"], np.zeros(3)))})
    return found


def of_gusts(scenario: Scenario, draw: AtStart) -> dict[str, Values]:
    """Return the first gust of the force that lasts, whose mean of_body gives."""
    truth = scenario.truth.force
    start = np.array([*[truth.gust_sd] * 3, 0.0, 0.0, 0.0])
    return {} if truth == ForceTruth() else {"lasting_force": first_slow("lasting_force", start, draw)}


def first_slow(name: str, sd: np.ndarray, draw: AtStart) -> Values:
    """Return the first numbers of noise that changes slowly, of these standard deviations."""
    return Values(start={"x": sd * draw(f"slow error/{name}", len(sd))})


def of_sensor(
    wiring: Wiring, scenario: Scenario, room: Room, sensor: str, payload: int, drawn: Drawn, draw: AtStart
) -> dict[str, Values]:
    """Return a sensor's clock, where it and what it sees stand, and the errors of its messages; arguments as above."""
    clock = Values({"offset": float(drawn[f"clock.offset.{sensor}"]), "drift": float(drawn[f"clock.drift.{sensor}"])})
    found = {f"{sensor}_clock": clock, f"{sensor}_clock_inside": clock}
    errors = errors_of(scenario, sensor, payload)
    if errors is not None:
        n = len(errors.noise.a)
        tables = {"bias": bias_of(drawn, sensor, n), "factor": factor_of(drawn, sensor, n)}
        start = first_slow(f"{sensor}_slow_error", errors.noise.start, draw)
        found[f"{sensor}_error"] = start.updated(Values(tables=tables))
    own = described(sensor).drawn
    return found if own is None else found | own(scenario, room, drawn, wiring.boxes)
