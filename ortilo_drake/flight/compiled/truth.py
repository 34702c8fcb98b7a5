"""How the world of one seed differs from what is believed, put into a compiled flight's constants.

The counterpart of world/truth.py, which sets the same numbers in a Context.
"""

import numpy as np

from ortilo_drake.flight.compiled.constants import FlightConstants
from ortilo_drake.flight.compiled.slow import NO_ERRORS, SlowConstants
from ortilo_drake.model.room import Room
from ortilo_drake.model.signals import IMU_SIZE, PAYLOAD
from ortilo_drake.scenario import Scenario, Truth
from ortilo_drake.scenario.truth import ForceTruth, VehicleTruth
from ortilo_drake.sensors.shares import share_of
from ortilo_drake.world.drawn_truth import AtStart, Drawn, draw_truth
from ortilo_drake.world.noise import stream_id
from ortilo_drake.world.sensors.sensor_errors import bias_of, errors_of, factor_of
from ortilo_drake.world.slow_error import SlowNoise, gauss_markov
from ortilo_drake.world.vehicle.wrench_error import wrench_matrix


def payloads_of(scenario: Scenario, room: Room) -> dict[str, int]:
    """Return the size of each payload, of the compiled sensors that fly, as draw_truth takes them."""
    sizes = {"uwb": 2 * len(room.anchors), "camera": 0, "imu": IMU_SIZE - PAYLOAD}
    sizes |= {name: share_of(name).payload for name in scenario.own_sensors}
    return {name: size for name, size in sizes.items() if name in scenario.sensors}


def slow_errors(noise: SlowNoise, bias: np.ndarray, factor: np.ndarray, name: str, draw: AtStart) -> SlowConstants:
    """Return errors that last, started as SlowError_ of that name starts them."""
    stream = f"slow error/{name}"
    first = draw(stream, len(bias))
    return SlowConstants(bias, noise.start * first, noise.a, noise.q, stream_id(stream), factor)


def of_sensor(scenario: Scenario, room: Room, sensor: str, drawn: Drawn, draw: AtStart) -> SlowConstants:
    """Return the errors of a sensor's messages that last."""
    payload = payloads_of(scenario, room).get(sensor)
    errors = None if payload is None else errors_of(scenario.truth, sensor, payload, scenario.h)
    if errors is None:
        return NO_ERRORS
    n = len(errors.noise.a)
    return slow_errors(
        errors.noise, bias_of(drawn, sensor, n), factor_of(drawn, sensor, n), f"{sensor}_slow_error", draw
    )


def constants_of_draw(believed: FlightConstants, scenario: Scenario, room: Room, draw: AtStart) -> FlightConstants:
    """Return the constants of a flight in whose world that was drawn at the start.

    Args:
        believed: those of a world that is as it is believed to be.
        scenario: the scenario.
        room: as it was surveyed.
        draw: what was drawn.
    """
    truth = scenario.truth
    if truth == Truth():
        return believed
    drawn = draw_truth(truth, draw, room, payloads_of(scenario, room))
    x_0 = believed.x_0.copy()
    x_0[0:3] += drawn["start.position"]
    x_0[5] += drawn["start.yaw"]
    wrench = believed.vehicle.wrench
    if truth.vehicle != VehicleTruth():
        wrench = wrench_matrix(float(drawn["vehicle.thrust_factor"]), drawn["vehicle.center_of_gravity"])
    vehicle = believed.vehicle._replace(
        mass=float(drawn["vehicle.mass_factor"] * scenario.vehicle.mass),
        inertia=np.array([float(drawn["vehicle.inertia_factor"] * moment) for moment in scenario.vehicle.inertia]),
        wrench=wrench,
    )
    force = NO_ERRORS
    if truth.force != ForceTruth():
        noise = gauss_markov(np.array([*[truth.force.gust_sd] * 3, 0.0, 0.0, 0.0]), truth.force.gust_time, scenario.h)
        bias = np.concatenate((drawn["force.mean"], np.zeros(3)))
        force = slow_errors(noise, bias, np.ones(6), "lasting_force", draw)
    imu_bias = np.array([*drawn["imu.level"], drawn["imu.yaw"], *drawn["imu.rates"], *drawn["imu.specific_force"]])
    camera = believed.camera
    if camera is not None:
        seen = camera.room._replace(positions=room.landmark_positions + drawn["survey.landmarks"])
        p_BC = np.array(room.camera.position) + drawn["camera.position"]
        lens = camera.camera._replace(p_BC=p_BC, f=camera.camera.f * float(drawn["camera.focal_factor"]))
        camera = camera._replace(room=seen, camera=lens, turned=drawn["camera.angles"], clock=_clock(drawn, "camera"))
    uwb = believed.uwb
    if "uwb" in scenario.sensors:
        anchors = room.anchor_positions + drawn["survey.anchors"]
        uwb = uwb._replace(anchors=anchors, bias=drawn["uwb.bias"], clock=_clock(drawn, "uwb"))
    others = [
        its._replace(errors=of_sensor(scenario, room, name, drawn, draw), clock=_clock(drawn, name))
        for name, its in zip(scenario.own_sensors, believed.others, strict=True)
    ]
    return believed._replace(
        x_0=x_0,
        vehicle=vehicle,
        force=force,
        imu=believed.imu._replace(bias=imu_bias),
        imu_errors=of_sensor(scenario, room, "imu", drawn, draw),
        uwb=uwb,
        uwb_errors=of_sensor(scenario, room, "uwb", drawn, draw),
        camera=camera,
        others=tuple(others),
    )


def normals_at_start(believed: FlightConstants, scenario: Scenario, room: Room) -> dict[str, int]:
    """Return how many normal numbers each stream gives to what is drawn at the start, by name; arguments as above."""
    asked: dict[str, int] = {}

    def ask(name: str, n: int) -> np.ndarray:
        asked[name] = n
        return np.zeros(n)

    constants_of_draw(believed, scenario, room, ask)
    return asked


def _clock(drawn: Drawn, sensor: str) -> np.ndarray:
    """Return offset [s] and drift [1] of a sensor's clock (2)."""
    return np.array([float(drawn[f"clock.offset.{sensor}"]), float(drawn[f"clock.drift.{sensor}"])])
