"""Single parts of the loop, for Diagrams of one's own and for any multirotor.

Each takes plain numbers; no scenario file is needed. `settings` are those of a scenario, by keyword, two underscores
for a dot: `make_estimator(estimator__delay="replay")`. How to wire the parts: docs/how_to/single_parts.md.
"""

from __future__ import annotations  # help() shows types by their names

from collections.abc import Iterable
from numbers import Real
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from pydrake.systems.framework import System

from ortilo_drake.diagrams.estimator import Estimator
from ortilo_drake.diagrams.wiring.onboard import servo_boxes
from ortilo_drake.diagrams.wiring.world import is_element, sensor_boxes
from ortilo_drake.loop.element import Box, constant, outside
from ortilo_drake.loop.shell import WiredSystem_
from ortilo_drake.loop.wiring import Wiring
from ortilo_drake.model.clock import check_tick
from ortilo_drake.model.equations import KINEMATICS
from ortilo_drake.model.parts import find_sensor, known_sensors
from ortilo_drake.model.room import Interior, Room
from ortilo_drake.model.signals import N_X, N_XBAR, REFERENCE_SIZE, SENSORS, VELOCITY_SIZE
from ortilo_drake.model.typed_yaml import InputError, nearest
from ortilo_drake.model.vehicle import M100, Vehicle
from ortilo_drake.scenario import Belief, Scenario, load_scenario
from ortilo_drake.sensors.described import described, port_of
from ortilo_drake.world.vehicle.body_state import BodyState_
from ortilo_drake.world.vehicle.quadrotor import QuadrotorPlant_

_WHOLE = 1e-9  # how far a rate may be from a whole number that is meant, as a share


def make_estimator(
    vehicle: Vehicle | None = None,
    room: Room | ArrayLike | None = None,
    sensors: tuple[str, ...] = ("uwb", "imu"),
    h: float = 1.0 / 30.0,
    x_0: ArrayLike | None = None,
    scenario: str = "imu_uwb",
    **settings: Any,
) -> Estimator:
    """Return the estimator as a Diagram: position fixes, the handler of what arrives, and the filter.

    It is the filter of a ready-made scenario: of imu_uwb one that estimates a lasting force, torque and biases besides,
    of nominal_imu_uwb the paper's filter in our tuning, of robust_imu_uwb or tight_imu_uwb another one.

    Ports:
        a port of each sensor, `uwb`, `detections` (of the camera), `imu` or a registered sensor's name: its messages,
            [arrived, stamp, payload ...]; where arrived is 0 the rest is ignored.
        control (4): u_k = [f_T, tau_x, tau_y, tau_z], which acts from this tick to the next.
        reference (9): r, r_dot, r_ddot in W; the integral of the position error reads r.
        estimate (15, output): xhat_{k|k-1} = [p_WB, rpy, v_WB, rpy rates] and that integral. It depends on no input
            of this tick, so that a servo which reads it makes no algebraic loop.
        covariance (225, output): P_k row by row.
        force (3, output): the force in W that lasts, as estimated [N]; only where estimator.force has it estimated.
        y (p), delta (s), V2 (q) (outputs): the measurement as the filter gets it in this tick.

    Args:
        vehicle: mass and inertia as they are believed; by default the DJI Matrice 100.
        room: the room, or only its anchors' places p_W (n, 3) [m]; by default the paper's room. Landmarks of a camera
            need a Room.
        sensors: which sensors' messages come.
        h: tick of all of it [s]; a slower sensor's usual rate gives way to the nearest that suits it.
        x_0: first estimate (12), by default zeros.
        scenario: whose settings of the filter it begins with.
        settings: changes of them, by keyword.

    Raises:
        InputError: if a setting is wrong, naming it.

    Example:
        >>> import ortilo_drake as od
        >>> small = od.Vehicle(mass=1.2, inertia=(0.011, 0.012, 0.02))
        >>> corners = [[0, 0, 0.2], [8, 0, 2.5], [8, 6, 0.2], [0, 6, 2.5]]
        >>> estimator = od.make_estimator(small, corners, h=0.02)
        >>> sorted(estimator.get_input_port(i).get_name() for i in range(4))
        ['control', 'imu', 'reference', 'uwb']
    """
    if isinstance(sensors, str):
        raise InputError(f"sensors: {sensors!r}: must be several, as ({sensors!r},)")
    changes = suiting_rates(scenario, h, sensors) | {"sensors": list(sensors), "camera__kind": "projected"} | settings
    xbar_0 = np.zeros(N_XBAR)
    xbar_0[:N_X] = _vector("x_0", x_0, N_X)
    return Estimator(_scenario(scenario, vehicle, h, changes), xbar_0, detects=False, room=_room(room))


def make_servo(
    vehicle: Vehicle | None = None, h: float = 1.0 / 30.0, takes_force: bool = False, **settings: Any
) -> System:
    """Return the paper's servo as a System: u = [m g, 0, 0, 0] - L (xbar - reference), L the gain of an LQ regulator.

    Ports:
        estimate (15): as the estimator says it, the integral of the position error last.
        reference (9): r, r_dot, r_ddot in W.
        force (3): the force in W that lasts, as estimated [N], which it opposes; only if takes_force.
        control (4, output): u_k = [f_T, tau_x, tau_y, tau_z], f_T absolute [N]. It depends on the inputs of this tick.

    Args:
        vehicle: mass and inertia as they are believed; by default the DJI Matrice 100.
        h: tick that the gain is made for [s].
        takes_force: whether it has the port `force`.
        settings: of a scenario, by keyword: `servo__weights__position=(...)`, `servo__yaw=0.5`.

    Raises:
        InputError: if a setting is wrong or there is no gain.
    """
    return make_lq_servo(_scenario("imu_uwb", vehicle, h, suiting_rates("imu_uwb", h) | settings), takes_force)


def make_lq_servo(scenario: Belief, takes_force: bool = False) -> System:
    """Return the servo of a scenario whose commands act at once; it is memoryless.

    Ports: those of make_servo, and
        velocity (8): velocity message; only where the scenario lends the servo the truth.

    Args:
        scenario: the scenario, of which the belief is all that is taken.
        takes_force: whether it is told the force.

    Raises:
        InputError: if there is no gain.
    """
    belief = scenario.belief
    inputs = [outside("estimate", N_XBAR), outside("reference", REFERENCE_SIZE)]
    inputs.append(outside("force", 3) if takes_force else constant("force", np.zeros(3)))
    inputs += [outside("velocity", VELOCITY_SIZE)] if belief.lends_velocities else []
    wiring = Wiring([*inputs, *servo_boxes(belief, "estimate", "force", {}, None, {})])
    return WiredSystem_[float]("lq_servo", wiring, {"control": ("servo",)}, belief.h)


def make_sensor(
    name: str, room: Room | ArrayLike | None = None, h: float = 1.0 / 30.0, seed: int = 0, **settings: Any
) -> System:
    """Return a sensor as a System, with its link: what it measures follows from the true state of any body.

    Ports:
        state (12): x = [p_WB, rpy, v_WB, rpy rates], of an IMU and others whose rows need it.
        acceleration (3): v_dot of B's origin in W [m/s^2]; only of the imu.
        chance (1): see loop/shell.py; need not be connected.
        the name of its messages (output): `uwb`, `detections` (of the camera), `imu` or a registered sensor's name:
            [arrived, stamp, payload ...], zeros in a tick in which no message lands.

    Where it is given a name in its Diagram, as in AddNamedSystem("left", make_sensor("uwb")), its noise is of that
    name.

    Args:
        name: 'uwb', 'camera' (projected: boxes, no pictures), 'imu', 'altimeter', 'flow' or a registered sensor's.
        room: as of make_estimator; of a uwb its anchors, of a camera its landmarks.
        h: tick [s]; the sensor sends at most one message a tick.
        seed: of its noise.
        settings: of the sensor's own group of a scenario, by keyword: `link__rate=20.0`, `link__loss=0.3`,
            `noise__sd=0.05`.

    Raises:
        InputError: if there is no such sensor, a setting is wrong, or the sensor is a System of one's own.

    Example:
        >>> import ortilo_drake as od
        >>> uwb = od.make_sensor("uwb", [[0, 0, 0.2], [8, 0, 2.5], [8, 6, 0.2], [0, 6, 2.5]], link__loss=0.3)
        >>> uwb.GetOutputPort("uwb").size()  # arrived, stamp, four ranges and whether each is there
        10
    """
    known = [*SENSORS, *(its for its in known_sensors() if its not in SENSORS)]
    if name not in SENSORS and find_sensor(name) is None:
        raise InputError(f"name: {name!r}: must be one of {', '.join(known)}{nearest(name, known)}")
    if not is_element(name):
        raise InputError(f"name: {name}: is a System that its make_world makes: add that System")
    changes = {"sensors": [name], "seed": seed, "camera__kind": "projected"}
    changes |= {f"{name}__{key}": value for key, value in settings.items()}
    try:
        scenario = _scenario(Scenario(name=name), None, h, changes)
    except InputError as error:
        if f"{name}.link.rate: " not in str(error) or {"link", "link__rate"} & settings.keys():
            raise
        usual = Scenario(name=name).link_of(name).rate
        raise InputError(
            f"link__rate: must be given with h = {h:g} s, which the usual {usual:g} Hz do not suit: 1 / h divided by a "
            "whole number, or None for a message every tick"
        ) from None
    if scenario.samples(name) > 1:
        raise InputError(f"{name}.link.rate: {scenario.link_of(name).rate:g}: must be at most 1 / h = {1.0 / h:g} Hz")
    made = [_of_state(box) for box in sensor_boxes(scenario, _room(room) or scenario.load_room(), name, True)]
    signals = {"state": N_X, "acceleration": 3} if described(name).needs_forces else {"state": N_X}
    wiring = Wiring([*(outside(signal, size) for signal, size in signals.items()), *made])
    system: System = WiredSystem_[float](name, wiring, {port_of(name): (made[-1].name,)}, h, seed)
    return system


def make_plant(
    vehicle: Vehicle | None = None, kinematics: str = "rigid_body", time_step: float = 0.0, x_0: ArrayLike | None = None
) -> System:
    """Return the vehicle as a System: a rigid body under its total thrust and three torques.

    Ports:
        control (4): u = [f_T, tau_x, tau_y, tau_z], f_T absolute [N], torques about B's axes [N m].
        disturbance (6): force in W [N], torque in B [N m]; zero where not connected.
        state (12, output): x = [p_WB, rpy, v_WB, rpy rates]; does not depend on the inputs.
        acceleration (3, output): v_dot of B's origin in W [m/s^2], under the inputs of that instant.

    Args:
        vehicle: its true mass and inertia; by default the DJI Matrice 100.
        kinematics: 'rigid_body', 'small_angle' (the paper's) or 'linear' (the model at hover).
        time_step: 0 where the simulator integrates it, else its step under held inputs [s], as of a MultibodyPlant.
        x_0: its default state (12), by default zeros.

    Raises:
        InputError: if an argument is wrong.
    """
    if kinematics not in KINEMATICS:
        raise InputError(f"kinematics: {kinematics!r}: must be one of {', '.join(KINEMATICS)}")
    if not isinstance(time_step, Real) or not 0.0 <= time_step < float("inf"):
        raise InputError(f"time_step: {time_step!r}: must be 0 or positive")
    plant: System = QuadrotorPlant_[float](_vehicle(vehicle), kinematics, time_step, _vector("x_0", x_0, N_X))
    return plant


def make_body_state(body: int) -> System:
    """Make a System that gives sensors the state (12) and acceleration (3) of a body of a MultibodyPlant.

    Ports: as of world/vehicle/body_state.py, `body_poses`, `body_spatial_velocities`, `body_spatial_accelerations` from
    the plant's outputs of these names; `state` (12) and `acceleration` (3) out.

    Args:
        body: the body's index, `body.index()`.
    """
    system: System = BodyState_[float](body)
    return system


def _scenario(base: str | Scenario, vehicle: Vehicle | None, h: float, settings: dict[str, Any]) -> Scenario:
    """Return a scenario for a vehicle and a tick, with settings laid over it."""
    return load_scenario(base, {"control_rate": _rate(h), "vehicle": _vehicle(vehicle)}, **settings)


def _rate(h: float) -> float:
    check_tick(h)
    return float(round(1.0 / h)) if abs(round(1.0 / h) * h - 1.0) < _WHOLE else 1.0 / h


def _vehicle(given: Vehicle | None) -> Vehicle:
    if not isinstance(given, Vehicle | None):
        raise InputError(f"vehicle: {given!r}: must be a Vehicle, as Vehicle(mass=1.2, inertia=(0.012, 0.013, 0.022))")
    return given or M100


def suiting_rates(scenario: str, h: float, sensors: Iterable[str] = ()) -> dict[str, float]:
    """Return the settings with which slower sensors suit any tick: of the rates that do, the one nearest to the usual.

    The rate counts: what is learned of ranges and boxes fades from message to message (onboard/ranging/survey_bank.py).

    Args:
        scenario: whose rates are the usual ones.
        h: tick [s].
        sensors: beside those that fly in it; one that is unknown is left to be refused.
    """
    its, ticks = load_scenario(scenario), _rate(h)
    known = [name for name in known_sensors() if name in {*its.sensors, *sensors}]
    rates = {name: its.link_of(name).rate or ticks for name in known}
    return {f"{name}__link__rate": ticks / round(ticks / rate) for name, rate in rates.items() if rate < ticks}


def _array(name: str, given: ArrayLike) -> np.ndarray:
    try:
        return np.array(given, dtype=float)
    except (TypeError, ValueError):
        raise InputError(f"{name}: must be numbers, in rows of one length") from None


def _room(given: Room | ArrayLike | None) -> Room | None:
    """Return a room, one around anchors where only those are given."""
    if given is None or isinstance(given, Room):
        return given
    anchors = _array("room", given)
    if anchors.ndim != 2 or anchors.shape[1] != 3 or len(anchors) < 3 or not np.all(np.isfinite(anchors)):
        raise InputError(f"room: has the shape {anchors.shape}, must be a Room or at least 3 anchors (n, 3) [m]")
    low, high = anchors.min(axis=0) - 1.0, anchors.max(axis=0) + 1.0
    around = Interior(min=tuple(low.tolist()), max=tuple(high.tolist()))
    return Room(interior=around, anchors=tuple(tuple(p) for p in anchors.tolist()))


def _vector(name: str, given: ArrayLike | None, size: int) -> np.ndarray:
    values = np.zeros(size) if given is None else _array(name, given)
    if values.shape != (size,) or not np.all(np.isfinite(values)):
        raise InputError(f"{name}: must be {size} finite numbers")
    return values


def _of_state(box: Box) -> Box:
    """Return a box of the world that reads the port `state` in place of the vehicle."""
    return box.with_inputs(**{port: "state" for port, said in box.reads.items() if said == "plant"})
