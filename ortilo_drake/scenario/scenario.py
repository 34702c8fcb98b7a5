"""The scenario: everything that decides a flight, and nothing else."""

import json
import math
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any, Literal, Self

from pydantic import AfterValidator, Field, model_validator

from ortilo_drake.model.measurement import Measurement
from ortilo_drake.model.parts import find_sensor, measurement_of
from ortilo_drake.model.room import ORTILO_ROOM, Room, load_room
from ortilo_drake.model.signals import SENSORS
from ortilo_drake.model.typed_yaml import FileName, Frozen, InputError
from ortilo_drake.model.vehicle import Vehicle
from ortilo_drake.scenario.failsafe import Failsafe
from ortilo_drake.scenario.link import CommandLink, Link
from ortilo_drake.scenario.loss_chain import loss_parameters
from ortilo_drake.scenario.onboard import (
    Detector,
    IntermittentFilter,
    LandmarkFix,
    LqServo,
    Multilateration,
)
from ortilo_drake.scenario.own_parts import model_for
from ortilo_drake.scenario.planner import GcsPlanner, Planner
from ortilo_drake.scenario.sensors import Camera, Imu, Uwb
from ortilo_drake.scenario.world import World

Seed = Annotated[int, Field(ge=0, lt=2**63)]


def _as_file_name(name: str) -> str:
    if not name.isprintable() or set(name) & set("/\\") or not 0 < len(name.encode()) <= 100 or name[0] == ".":
        raise ValueError(
            f"{name!r}: must be 1 to 100 bytes of printable text without / and \\, and not begin with a point"
        )
    return name


Name = Annotated[str, AfterValidator(_as_file_name)]  # a folder of flights is called so


class Scenario(Frozen):
    """One flight.

    Attributes:
        name: what tables and files call it.
        seed: the seed of all noise; the same seed gives the same flight bit for bit.
        control_rate: ticks a second, 1 / h [Hz].
        settle: time flown after the path's end [s].
        room: 'ortilo' or the path of a room file, relative to the scenario's own folder.
        vehicle: mass, inertia and rotors; a scenario file may name a file of them instead, found as a room's is.
        world: the simulated physics apart from the sensors.
        sensors: which of uwb, camera and imu fly; the others never arrive.
        imu: attitude, body rates and specific force.
        uwb: ranges to the room's anchors.
        camera: boxes of landmarks.
        command_link: delivery of the control packets; perfect by default.
        detector: the network that looks at a rendered camera's pictures.
        multilateration: position from ranges.
        landmark_fix: position from boxes.
        estimator: what makes a state of the fixes and the imu's angles.
        servo: what makes a control of state and reference.
        planner: the path to fly.
        failsafe: what flies while no command comes; only in real time (`ortilo hil world`).
    """

    name: Name = "default"
    seed: Seed = 0
    control_rate: Annotated[float, Field(ge=5.0, le=1000.0)] = 30.0
    settle: Annotated[float, Field(ge=0.0, le=3600.0)] = 2.0
    room: FileName = "ortilo"
    vehicle: Vehicle = Vehicle()
    world: World = World()
    sensors: tuple[Literal["uwb", "camera", "imu"], ...] = SENSORS
    imu: Imu = Imu()
    uwb: Uwb = Uwb()
    camera: Camera = Camera()
    command_link: CommandLink = CommandLink()
    detector: Detector = Detector()
    multilateration: Multilateration = Multilateration()
    landmark_fix: LandmarkFix = LandmarkFix()
    estimator: IntermittentFilter = IntermittentFilter()
    servo: LqServo = LqServo()
    planner: Planner = GcsPlanner()
    failsafe: Failsafe = Failsafe()

    @property
    def h(self) -> float:
        """The control period, the tick of every discrete system [s]."""
        return 1.0 / self.control_rate

    @property
    def yaw(self) -> float:
        """The heading that is held [rad]; 0 with a servo of one's own that has no such setting."""
        return float(getattr(self.servo, "yaw", 0.0))

    @property
    def lends_velocities(self) -> bool:
        """Whether the servo is given the true velocities."""
        return getattr(self.servo, "velocities", "estimate") == "truth"

    @property
    def is_rendered(self) -> bool:
        """Whether there is a camera and it renders."""
        return self.camera.kind == "rendered" and "camera" in self.sensors

    @property
    def image_width(self) -> int:
        """Width of the image that the camera's boxes are in [px]."""
        return self.camera.width

    def projected(self) -> "Scenario":
        """Return the same scenario with a camera that draws no pictures."""
        return self.model_copy(update={"camera": self.camera.model_copy(update={"kind": "projected"})})

    def link_of(self, sensor: str) -> Link:
        """Return the link of a sensor."""
        link: Link = self.group_of(sensor).link
        return link

    def group_of(self, sensor: str) -> Any:
        """Return the settings of a sensor, built-in or registered."""
        return getattr(self, sensor) if sensor in SENSORS else self.settings_of(sensor)

    def every(self, sensor: str) -> int:
        """Return how many ticks lie from one message of a sensor to the next."""
        return self.link_of(sensor).every(self.h)

    @model_validator(mode="after")
    def _rates_divide_control_rate(self) -> "Scenario":
        for sensor in self.sensors:
            rate, most = self.link_of(sensor).rate, self.control_rate
            ticks = 1.0 if rate is None else most / rate
            if abs(ticks - max(1, round(ticks))) <= 1e-9 * ticks:
                continue
            wrong = f"{sensor}.link.rate: {rate}: must divide control_rate, {most:g} Hz"
            if ticks < 1.0:
                raise ValueError(f"{wrong}, or be null: a sensor faster than the tick is not flown yet")
            below, above = most / math.ceil(ticks), most / math.floor(ticks)
            raise ValueError(f"{wrong}; the nearest that do are {below:.12g} and {above:.12g}")
        return self

    @model_validator(mode="after")
    def _losses_exist(self) -> "Scenario":
        links = {f"{sensor}.link": self.link_of(sensor) for sensor in {*SENSORS, *self.sensors}} | {
            "command_link": self.command_link
        }
        for name, link in links.items():
            try:
                loss_parameters(link.loss, self.h)
            except InputError as error:
                raise ValueError(f"{name}.loss.{error}") from None
        return self

    @model_validator(mode="after")
    def _gated_sensors_fly(self) -> "Scenario":
        for sensor in dict(getattr(self.estimator, "gates", ())):
            if sensor not in self.sensors:
                raise ValueError(f"estimator.gates.{sensor}: does not fly, of sensors {list(self.sensors)}")
        return self

    @model_validator(mode="after")
    def _force_is_measured(self) -> "Scenario":
        if getattr(self.estimator, "force", "none") == "measured" and "imu" not in self.sensors:
            raise ValueError(
                f"estimator.force: measured: must be none or thrust, no imu in sensors {list(self.sensors)}"
            )
        return self

    def settings_of(self, sensor: str) -> Any:
        """Return the settings of a registered sensor, its defaults where the scenario has none."""
        found = find_sensor(sensor)
        if found is None:
            raise ValueError(f"sensors: {sensor!r}: is not registered")
        return getattr(self, sensor, None) or found.settings()

    @property
    def own_sensors(self) -> tuple[str, ...]:
        """Those that fly and are not built in."""
        return tuple(sensor for sensor in self.sensors if sensor not in SENSORS)

    @property
    def measurement(self) -> Measurement:
        """The layout of what the filter gets: the paper's three sensors, and those of one's own that fly."""
        return measurement_of(self.sensors)

    @classmethod
    def model_for(cls, data: Any) -> type["Scenario"]:
        """Return the model of data that may name registered parts."""
        model: Any = model_for(cls, data)
        return model

    @classmethod
    def model_validate_json(cls, json_data: str | bytes | bytearray, **options: Any) -> Self:
        """Return a scenario from JSON, which may name registered parts."""
        try:
            model: Any = cls.model_for(json.loads(json_data))
        except ValueError:  # no JSON, which pydantic says better
            model = cls
        scenario: Any = super(Scenario, model).model_validate_json(json_data, **options)
        return scenario

    def __reduce__(self) -> tuple[Callable[[str], "Scenario"], tuple[str]]:
        """Pickle as JSON: a model with registered parts has no name to be found by."""
        return Scenario.model_validate_json, (self.model_dump_json(),)

    @model_validator(mode="after")
    def _sensors_differ(self) -> "Scenario":
        if len(set(self.sensors)) != len(self.sensors):
            raise ValueError(f"sensors: {list(self.sensors)} names one twice")
        return self

    def load_room(self) -> Room:
        """Return the room this scenario flies in; InputError if its file is wrong."""
        return load_room(ORTILO_ROOM if self.room == "ortilo" else Path(self.room))
