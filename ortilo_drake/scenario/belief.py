"""The belief: the part of a scenario that the onboard half may know.

A scenario decides a whole flight. Its Belief is the part that a team knows before the flight: the surveyed room, the
weighed vehicle, the rates of the sensors, and the settings of everything onboard. A Belief holds neither the seed, nor
the errors of the belief (scenario/truth.py), nor the world's random parts: disturbance, noise, losses, delays.
"""

import json
import sys
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Annotated, Any, Literal, Self

import numpy as np
from pydantic import AfterValidator, Field

from ortilo_drake.model.measurement import CAMERA, PAPER, Measurement, Row, make_measurement, seen_earlier
from ortilo_drake.model.parts import find_part, find_sensor
from ortilo_drake.model.room import ORTILO_ROOM, Room, load_room
from ortilo_drake.model.signals import SENSORS
from ortilo_drake.model.typed_yaml import FileName, Frozen
from ortilo_drake.model.vehicle import Vehicle
from ortilo_drake.scenario.camera import CameraSetup
from ortilo_drake.scenario.estimator import IntermittentFilter
from ortilo_drake.scenario.onboard import Detector, LandmarkFix, LqServo, Multilateration
from ortilo_drake.scenario.own_parts import model_for, model_of_all
from ortilo_drake.scenario.planner import GcsPlanner, Planner
from ortilo_drake.scenario.sensors import ImuSetup, UwbSetup
from ortilo_drake.scenario.world import Commands


def _as_file_name(name: str) -> str:
    if not name.isprintable() or set(name) & set("/\\") or not 0 < len(name.encode()) <= 100 or name[0] == ".":
        raise ValueError(
            f"{name!r}: must be 1 to 100 bytes of printable text without / and \\, and not begin with a point"
        )
    return name


Name = Annotated[str, AfterValidator(_as_file_name)]  # a folder of flights has this name


def measurement_of(
    sensors: Iterable[str], camera: tuple[Row, ...] = CAMERA, ages: Mapping[str, float] | None = None, yaw: float = 0.0
) -> Measurement:
    """Return the measurement of the paper's three sensors and of the registered sensors among `sensors`.

    A landmark fix fills the rows `camera`. `ages` gives the mean age of the values of each sensor that is faster than
    the tick [s]; `yaw` is the heading that the servo holds [rad].
    """
    own = ((name, find_sensor(name)) for name in sensors if name not in SENSORS)
    paper = ((name, camera if rows is CAMERA else rows) for name, rows in PAPER)
    rows = (*paper, *((name, sensor.rows) for name, sensor in own if sensor is not None))
    old = ages or {}
    return make_measurement(
        tuple((name, tuple(seen_earlier(r, old[name], yaw) for r in its) if name in old else its) for name, its in rows)
    )


class Belief(Frozen):
    """The part of a scenario that the onboard half knows."""

    name: Name = "default"
    """name of the scenario in tables and files."""
    control_rate: Annotated[float, Field(ge=5.0, le=1000.0)] = 30.0
    """ticks per second, 1 / h [Hz]."""
    room: FileName = "ortilo"
    """the surveyed map: 'ortilo' or the path of a room file, relative to the scenario's own folder."""
    vehicle: Vehicle = Vehicle()
    """believed mass, inertia and rotors; a scenario file may name a vehicle file instead, by a path as in `room`."""
    sensors: tuple[Literal["uwb", "camera", "imu"], ...] = SENSORS
    """the sensors that fly, of uwb, camera and imu; messages of the others never arrive."""
    imu: ImuSetup = ImuSetup()
    """the IMU: attitude, body rates and specific force."""
    uwb: UwbSetup = UwbSetup()
    """ranges to the room's anchors."""
    camera: CameraSetup = CameraSetup()
    """the camera: boxes of landmarks."""
    detector: Detector = Detector()
    """the network that finds landmarks in a rendered camera's pictures."""
    multilateration: Multilateration = Multilateration()
    """position from ranges."""
    landmark_fix: LandmarkFix = LandmarkFix()
    """position from boxes."""
    estimator: IntermittentFilter = IntermittentFilter()
    """the filter."""
    servo: LqServo = LqServo()
    """the controller, from state and reference to control."""
    planner: Planner = GcsPlanner()
    """the path to fly."""
    commands: Commands = Commands()
    """the treatment of late commands."""

    @property
    def belief(self) -> "Belief":
        """The part that the onboard half may know; a Belief returns itself."""
        return self

    @property
    def h(self) -> float:
        """The control period, the tick of every discrete system [s]."""
        return 1.0 / self.control_rate

    @property
    def yaw(self) -> float:
        """The heading that the servo holds [rad]; 0 for a registered servo without a setting `yaw`."""
        return float(getattr(self.servo, "yaw", 0.0))

    @property
    def lends_velocities(self) -> bool:
        """True if the servo is given the true velocities."""
        return getattr(self.servo, "velocities", "estimate") == "truth"

    @property
    def linear_filter(self) -> IntermittentFilter | None:
        """The linear filter that the estimator equals near hover, built in or declared at registration; else None."""
        if isinstance(self.estimator, IntermittentFilter):
            return self.estimator
        part = find_part("estimator", self.estimator.kind)
        return None if part is None or part.linear is None else part.linear(self.belief)

    @property
    def is_rendered(self) -> bool:
        """True if the camera flies and renders pictures."""
        return self.camera.kind == "rendered" and "camera" in self.sensors

    @property
    def image_width(self) -> int:
        """Width of the image in which the camera's boxes are given [px]."""
        return self.camera.width

    def group_of(self, sensor: str) -> Any:
        """Return the settings of a sensor, built-in or registered."""
        return getattr(self, sensor) if sensor in SENSORS else self.settings_of(sensor)

    def every(self, sensor: str) -> int:
        """Return the period of a sensor's messages [ticks]."""
        ticks: int = self.group_of(sensor).link.every(self.h)
        return ticks

    def samples(self, sensor: str) -> int:
        """Return the number of samples in a message: more than one for a sensor faster than the tick."""
        n: int = self.group_of(sensor).link.samples(self.h) if sensor in self.sensors else 1
        return n

    @property
    def imu_samples(self) -> int:
        """The number of samples in a message of the imu."""
        return self.samples("imu")

    @property
    def measures_ranges(self) -> bool:
        """True if ranges to the room's anchors are measured."""
        return "uwb" in self.sensors

    @property
    def sees_landmarks(self) -> bool:
        """True if a camera looks for the room's landmarks."""
        return "camera" in self.sensors

    def is_picture(self, sensor: str) -> bool:
        """Return whether a sensor sends pictures; its message is then the one of the shutter."""
        return sensor == "camera" and self.is_rendered

    @property
    def imu_period(self) -> float:
        """The interval between IMU samples, which sets their noise [s]: a tick, or less if the IMU is faster."""
        return self.h / self.samples("imu")

    @property
    def samples_at_rest(self) -> int:
        """The number of IMU samples while the vehicle rests before take-off, at least one message; 0 without rest."""
        if "imu" not in self.sensors or self.imu.standstill == 0.0:
            return 0
        messages = int(self.imu.standstill / (self.every("imu") * self.h) + 1e-9)
        return max(messages, 1) * self.samples("imu")

    @property
    def faster_sensors(self) -> tuple[str, ...]:
        """The sensors that fly and are faster than the tick."""
        return tuple(sensor for sensor in self.sensors if self.samples(sensor) > 1)

    @property
    def instants(self) -> np.ndarray:
        """The instants inside a tick, as shares of the tick, at which sensors faster than the tick are sampled."""
        counts = [self.samples(sensor) for sensor in self.faster_sensors]
        return np.unique([i / n for n in counts for i in range(1, n)])

    def sampled_for(self, sensor: str) -> Self:
        """Return the scenario with the samples of a sensor as ticks, if the sensor is faster than the tick."""
        n = self.samples(sensor)
        return self if n == 1 else self.model_copy(update={"control_rate": n * self.control_rate})

    def settings_of(self, sensor: str) -> Any:
        """Return the settings of a registered sensor; its defaults if the scenario has none."""
        found = find_sensor(sensor)
        if found is None:
            raise ValueError(f"sensors: {sensor!r}: is not registered")
        return getattr(self, sensor, None) or found.settings()

    @property
    def flown_rows(self) -> tuple[str, ...]:
        """The names of the rows of y that belong to sensors that fly."""
        return tuple(row.name for sensor, rows in self.measurement.rows if sensor in self.sensors for row in rows)

    @property
    def measurement(self) -> Measurement:
        """The layout of the filter's measurement: the paper's three sensors, and the registered sensors that fly.

        From a sensor faster than the tick, the filter gets the mean of a tick's n samples; it is (n - 1) h / (2 n) old.
        """
        faster = {sensor: self.samples(sensor) for sensor in self.faster_sensors}
        ages = {sensor: 0.5 * (n - 1) / n * self.h for sensor, n in faster.items()}
        return measurement_of(self.sensors, self.landmark_fix.rows, ages, self.yaw)

    def load_room(self) -> Room:
        """Return the surveyed room, with the calibrated camera if there is one; InputError if the file is wrong."""
        room, calibration = (
            load_room(ORTILO_ROOM if self.room == "ortilo" else Path(self.room)),
            self.camera.calibration,
        )
        return room if calibration is None else room.model_copy(update={"camera": calibration.on(room.camera)})

    @classmethod
    def model_for(cls, data: Any) -> type[Self]:
        """Return the model for these data, which may name registered parts."""
        model: Any = model_for(cls, data)
        return model

    @classmethod
    def model_of_all(cls) -> type[Self]:
        """Return the model that holds the settings of every registered part."""
        model: Any = model_of_all(cls)
        return model

    @classmethod
    def model_validate_json(cls, json_data: str | bytes | bytearray, **options: Any) -> Self:
        """Return a Scenario or a Belief from JSON, which may name registered parts."""
        try:
            model: Any = cls.model_for(json.loads(json_data))
        except ValueError:  # no JSON: pydantic's message is better
            model = cls
        found: Any = super(Belief, model).model_validate_json(json_data, **options)
        return found

    def __reduce__(self) -> tuple[Callable[[str], Any], tuple[str]]:
        """Pickle as JSON of Belief or Scenario: pickle cannot find a model with registered parts by name."""
        known = getattr(sys.modules[type(self).__module__], type(self).__name__)
        return known.model_validate_json, (self.model_dump_json(),)
