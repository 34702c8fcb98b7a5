"""What a compiled flight is made of: plain numbers and arrays, prepared from a scenario."""

from typing import Any, NamedTuple

import numpy as np

from ortilo_drake.flight.compiled.constants_onboard import (
    FilterConstants,
    OwnConstants,
    ServoConstants,
    TightConstants,
)
from ortilo_drake.flight.compiled.faults import VehicleFaults
from ortilo_drake.flight.compiled.slow import SlowConstants
from ortilo_drake.flight.lost import Bounds
from ortilo_drake.model.pinhole import Camera
from ortilo_drake.onboard.landmarks.box_fix import BoxBelief
from ortilo_drake.world.faults.table import FaultTable
from ortilo_drake.world.sensors.camera_tables import Tables
from ortilo_drake.world.sensors.landmark_view import Surroundings


class LinkConstants(NamedTuple):
    """How a sensor's messages are delivered, see world/radio/link.py.

    Attributes:
        every: ticks from one message to the next; 0 of a sensor that does not fly.
        loss: probabilities of the chain (4).
        has_chain: whether the chain ever steps.
        blackouts: rows (n, 3).
        delays: fixed delay and greatest additional delay [ticks].
        stream: number of the link's noise.
    """

    every: int
    loss: np.ndarray
    has_chain: bool
    blackouts: np.ndarray
    delays: tuple[int, int]
    stream: np.uint64


class VehicleConstants(NamedTuple):
    """The plant, what makes its wrench and what pushes it about.

    Attributes:
        mass: m [kg].
        inertia: I_x, I_y, I_z [kg m^2].
        kinematics: index in model.equations.KINEMATICS.
        hover_thrust: m g of the vehicle as it is believed to be [N].
        longest_step: of the integration of a continuous plant [s]; None of a sampled one.
        wrench: T of world/vehicle/wrench_error.py (4, 4).
        hover_speeds: of the rotors at the start [rad/s] (n); none where they are ideal.
        mixing: M of their squared speeds (4, n).
        unmixing: M^+ (n, 4).
        max_speed: their largest [rad/s].
        time_constant: of one speeding up and slowing down [s] (2).
        force_sd: of the disturbance force per axis [N].
        torque_sd: of its torque per axis [N m].
        stream: number of the disturbance's noise.
        faults: None where the whole flight has none.
    """

    mass: float
    inertia: np.ndarray
    kinematics: int
    hover_thrust: float
    longest_step: float | None
    wrench: np.ndarray
    hover_speeds: np.ndarray
    mixing: np.ndarray
    unmixing: np.ndarray
    max_speed: float
    time_constant: np.ndarray
    force_sd: float
    torque_sd: float
    stream: np.uint64
    faults: VehicleFaults | None


class ImuConstants(NamedTuple):
    """The imu, see world/sensors/imu.py.

    Attributes:
        whole: whether more than its angles is read.
        samples: in a message.
        bias: of its nine values.
        sd: of angles, rates and specific force (3).
        stream: number of its noise.
        link: how its messages are delivered.
        faults: of its messages; None where the whole flight has none.
    """

    whole: bool
    samples: int
    bias: np.ndarray
    sd: np.ndarray
    stream: np.uint64
    link: LinkConstants
    faults: FaultTable | None


class UwbConstants(NamedTuple):
    """Ranging, see world/sensors/uwb.py, and what the multilateration believes of it.

    Attributes:
        anchors: p_WA_i as they stand (n, 3).
        bias: of each anchor's ranges [m] (n).
        walls: those that act on a range (m, 7).
        settings: see uwb_message (5).
        stream: number of its noise.
        clock: its offset [s] and drift [1], see world/sensors/sensor_clock.py (2).
        link: how its messages are delivered.
        surveyed: p_WA_i as they are believed to stand (n, 3).
        noise: believed of the ranges (3).
        three: whether the nearest three are met.
        faults: of its messages; None where the whole flight has none.
    """

    anchors: np.ndarray
    bias: np.ndarray
    walls: np.ndarray
    settings: np.ndarray
    stream: np.uint64
    clock: np.ndarray
    link: LinkConstants
    surveyed: np.ndarray
    noise: np.ndarray
    three: bool
    faults: FaultTable | None


class CameraConstants(NamedTuple):
    """The projected camera, see world/sensors/projected_camera.py, and the landmark fix of its boxes.

    Attributes:
        room: landmarks and what may hide them.
        labels: the landmarks' classes (n).
        camera: the camera.
        tables: of rates and errors.
        streams: numbers of each landmark's noise (n, 4).
        false_stream: number of the noise of false boxes.
        turned: roll, pitch and yaw by which it is turned from looking ahead [rad] (3).
        clock: its offset [s] and drift [1] (2).
        link: how its messages are delivered, its latency among the delays.
        believed: of the boxes.
        by_cosines: True where cosine_law solves the boxes; else None, and numba does not compile it.
        rows: of a fix: 3 of known_attitude and cosine_law, 4 of known_tilt, 6 of pose.
        prior: what stands in for P row by row (225); empty where P itself is taken.
        joint: whether refused images are counted.
        faults: of its messages; None where the whole flight has none.
        scene: those of what it looks at; None where the whole flight has none.
    """

    room: Surroundings
    labels: np.ndarray
    camera: Camera
    tables: Tables
    streams: np.ndarray
    false_stream: np.uint64
    turned: np.ndarray
    clock: np.ndarray
    link: LinkConstants
    believed: BoxBelief
    by_cosines: bool | None
    rows: int
    prior: np.ndarray
    joint: bool
    faults: FaultTable | None
    scene: FaultTable | None


class OtherConstants(NamedTuple):
    """A sensor beside uwb, camera and imu, see others.py.

    Attributes:
        numbers: what its functions take.
        payload: numbers in its message.
        noises: standard normal numbers that a message takes.
        first: where its fix begins in the vector that the handler takes.
        number: of it among the sensors.
        about: whether it is solved about a belief.
        stream: number of its noise.
        clock: its offset [s] and drift [1] (2).
        errors: of its messages that last.
        link: how its messages are delivered.
        faults: of its messages; None where the whole flight has none.
    """

    numbers: Any
    payload: int
    noises: int
    first: int
    number: int
    about: bool
    stream: np.uint64
    clock: np.ndarray
    errors: SlowConstants
    link: LinkConstants
    faults: FaultTable | None


class FlightConstants(NamedTuple):
    """All that decides a flight beside its seed.

    Attributes:
        h: tick [s].
        reference: r, r_dot, r_ddot at every tick (ticks + 1, 9).
        x_0: true state at the start (12).
        vehicle: the plant.
        force: that lasts.
        imu: the imu.
        imu_errors: of its messages that last.
        uwb: ranging.
        uwb_errors: of its messages that last.
        camera: the camera and its fix; None where there is none.
        others: the other sensors that fly.
        filter: the estimator.
        servo: the servo.
        bounds: within what the flight is not lost.
    """

    h: float
    reference: np.ndarray
    x_0: np.ndarray
    vehicle: VehicleConstants
    force: SlowConstants
    imu: ImuConstants
    imu_errors: SlowConstants
    uwb: UwbConstants
    uwb_errors: SlowConstants
    camera: CameraConstants | None
    others: tuple[OtherConstants, ...]
    filter: FilterConstants | TightConstants | OwnConstants
    servo: ServoConstants
    bounds: Bounds
