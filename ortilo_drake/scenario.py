"""The typed scenario: everything that decides a flight, and nothing else.

A scenario is a YAML file that holds the fields of Scenario; what it leaves out takes the default given there, and the
defaults together are a valid flight. Units are SI, angles in radians. A wrong file is refused before anything
runs, with one line that names the file, the field, the value and what is allowed (InputError).

The groups of settings are in ortilo_drake/settings and can be imported from here.
"""

import os
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, Field, model_validator

from ortilo_drake.model.input_files import read_text
from ortilo_drake.model.room import ORTILO_ROOM, Room, load_room
from ortilo_drake.model.signals import SENSORS
from ortilo_drake.model.typed_yaml import DEEPEST, FileName, Frozen, InputError, nearest, parse_yaml, validate
from ortilo_drake.model.vehicle import Vehicle
from ortilo_drake.settings.failsafe import Failsafe
from ortilo_drake.settings.link import (
    BernoulliLoss,
    Blackout,
    CommandLink,
    GilbertElliottLoss,
    Link,
    Loss,
    NoLoss,
    PositionBlackout,
    TimeBlackout,
)
from ortilo_drake.settings.onboard import (
    Detector,
    DiagonalW,
    DisturbanceW,
    KalmanFilter,
    LandmarkFix,
    LqServo,
    MeasurementHandler,
    Multilateration,
    Noise,
    ServoWeights,
)
from ortilo_drake.settings.planner import GcsPlanner, HoverPlanner, Planner, WaypointPlanner, read_waypoints
from ortilo_drake.settings.sensors import (
    ConstantNoise,
    Imu,
    ProjectedCamera,
    ProportionalNoise,
    RangeNoise,
    RenderedCamera,
    Uwb,
    WallEffect,
    WallsBias,
    WallsBlock,
    WallsIgnored,
)
from ortilo_drake.settings.world import Disturbance, FirstOrderRotors, IdealRotors, World

__all__ = [
    "SCENARIO_FOLDER",
    "BernoulliLoss",
    "Blackout",
    "CommandLink",
    "ConstantNoise",
    "Detector",
    "DiagonalW",
    "Disturbance",
    "DisturbanceW",
    "Failsafe",
    "FirstOrderRotors",
    "GcsPlanner",
    "GilbertElliottLoss",
    "HoverPlanner",
    "IdealRotors",
    "Imu",
    "InputError",
    "KalmanFilter",
    "LandmarkFix",
    "Link",
    "Loss",
    "LqServo",
    "MeasurementHandler",
    "Multilateration",
    "NoLoss",
    "Noise",
    "Planner",
    "PositionBlackout",
    "ProjectedCamera",
    "ProportionalNoise",
    "RangeNoise",
    "RenderedCamera",
    "Scenario",
    "ServoWeights",
    "TimeBlackout",
    "Uwb",
    "Vehicle",
    "WallEffect",
    "WallsBias",
    "WallsBlock",
    "WallsIgnored",
    "WaypointPlanner",
    "World",
    "load_scenario",
    "read_waypoints",
    "scenario_names",
    "with_seed",
]

SCENARIO_FOLDER = Path(__file__).parent / "diagrams" / "scenarios"

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
        sensors: which of uwb, camera and imu fly; the others never arrive.
        camera: how the camera is simulated: 'rendered' draws pictures for a detector to look at, 'projected' draws the
            boxes that a detector would have found from what was measured of it, eighty times as fast.
        camera_link: rate and delivery of either camera's pictures or boxes; 10 Hz by default.
        command_link: delivery of the control packets; perfect by default.
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
    camera: Literal["projected", "rendered"] = "projected"
    camera_link: Link = Link(every=3)
    command_link: CommandLink = CommandLink()
    projected_camera: ProjectedCamera = ProjectedCamera()
    rendered_camera: RenderedCamera = RenderedCamera()
    detector: Detector = Detector()
    multilateration: Multilateration = Multilateration()
    landmark_fix: LandmarkFix = LandmarkFix()
    handler: MeasurementHandler = MeasurementHandler()
    filter: KalmanFilter = KalmanFilter()
    servo: LqServo = LqServo()
    planner: Planner = GcsPlanner()
    failsafe: Failsafe = Failsafe()

    @property
    def h(self) -> float:
        """The control period, the tick of every discrete system [s]."""
        return 1.0 / self.control_rate

    @property
    def is_rendered(self) -> bool:
        """Whether there is a camera and it renders."""
        return self.camera == "rendered" and "camera" in self.sensors

    @property
    def image_width(self) -> int:
        """Width of the image that the camera's boxes are in [px]."""
        return (self.rendered_camera if self.camera == "rendered" else self.projected_camera).width

    def link_of(self, sensor: str) -> Link:
        """Return the link of 'uwb', 'camera' or 'imu'."""
        return {"uwb": self.uwb.link, "camera": self.camera_link, "imu": self.imu.link}[sensor]

    @model_validator(mode="after")
    def _sensors_differ(self) -> "Scenario":
        if len(set(self.sensors)) != len(self.sensors):
            raise ValueError(f"sensors: {list(self.sensors)} names one twice")
        return self

    def load_room(self) -> Room:
        """Return the room this scenario flies in; InputError if its file is wrong."""
        return load_room(ORTILO_ROOM if self.room == "ortilo" else Path(self.room))


def scenario_names() -> list[str]:
    """Return the names of the ready-made scenarios."""
    return sorted(path.stem for path in SCENARIO_FOLDER.glob("*.yaml"))


def _resolve(name_or_file: str | Path) -> Path:
    path = Path(name_or_file)
    if path.suffix in (".yaml", ".yml"):
        return path
    if str(name_or_file) in scenario_names():
        return SCENARIO_FOLDER / f"{name_or_file}.yaml"
    name, known = str(name_or_file), scenario_names()
    shown = repr(name) if len(name) <= 100 else f"{name[:100]!r}..."
    raise InputError(
        f"scenario: {shown} is unknown{nearest(name[:100], known)}: give a .yaml file or one of {', '.join(known)}"
    )


def _set_field(data: dict[str, Any], setting: str) -> None:
    key, equals, text = setting.partition("=")
    shown = repr(setting) if len(setting) <= 100 else f"{setting[:100]!r}..."
    if not equals or not all(key.split(".")) or key.count(".") > DEEPEST:
        raise InputError(f"--set {shown}: must read key.key=value")
    *parents, last = key.split(".")
    for parent in parents:
        child = data.get(parent)
        if child is None:
            child = data[parent] = {}
        if not isinstance(child, dict):
            raise InputError(f"--set {shown}: '{parent}' is not a group of settings")
        data = child
    value = parse_yaml(text, f"--set {shown}")
    if last == "kind" and data.get("kind") != value:
        data.clear()  # another kind has other settings
    data[last] = value


def load_scenario(name_or_file: str | Path, settings: tuple[str, ...] = (), seed: int | None = None) -> Scenario:
    """Return a scenario by name or from a file, with settings 'key.key=value' laid over it.

    Args:
        name_or_file: a ready-made scenario's name, or the path of a .yaml file.
        settings: changes, each value in YAML; a changed 'kind' drops what belonged to the former one.
        seed: the seed, if not the scenario's own.

    Raises:
        InputError: naming file, field, value and what is allowed.
    """
    path = _resolve(name_or_file)
    source = str(path) if path != SCENARIO_FOLDER / path.name else path.stem
    data = parse_yaml(read_text(path), source)
    if data is None:
        data = {}
    if not isinstance(data, dict):
        raise InputError(f"{source}: must hold settings by name, not {type(data).__name__}")
    data.setdefault("name", path.stem)
    scenario = validate(Scenario, data, source)
    if settings or seed is not None:
        data = scenario.model_dump(mode="json")  # so that a setting finds the defaults of its neighbours
        for setting in settings:
            _set_field(data, setting)
        if seed is not None:
            data["seed"] = seed
        scenario = validate(Scenario, data, source)
    # The ready-made scenarios name no files: what is laid over them is meant from where the user stands.
    scenario = _relative_to(Path.cwd() if path.parent == SCENARIO_FOLDER else path.parent, scenario)
    scenario.load_room()
    return scenario


def _relative_to(folder: Path, scenario: Scenario) -> Scenario:
    """Return the scenario with the paths in it made absolute and its waypoints read, so that it stands alone."""
    changes: dict[str, Any] = {}

    def absolute(name: str) -> str:
        return os.path.realpath(folder / name)

    if scenario.room != "ortilo":
        changes["room"] = absolute(scenario.room)
    if isinstance(scenario.planner, WaypointPlanner) and scenario.planner.file is not None:
        points = read_waypoints(Path(absolute(scenario.planner.file)))
        rows = tuple(tuple(row) for row in points.tolist())
        changes["planner"] = scenario.planner.model_copy(update={"file": None, "points": rows})
    files = {key: path for key in ("cfg", "weights", "names") if (path := getattr(scenario.detector, key)) is not None}
    if files:
        files = {key: absolute(path) for key, path in files.items()}
        changes["detector"] = scenario.detector.model_copy(update=files)
    errors = scenario.projected_camera.errors
    if errors.kind == "measured" and errors.file != "rendered":
        errors = errors.model_copy(update={"file": absolute(errors.file)})
        changes["projected_camera"] = scenario.projected_camera.model_copy(update={"errors": errors})
    return scenario.model_copy(update=changes) if changes else scenario


def with_seed(scenario: Scenario, seed: int) -> Scenario:
    """Return the same scenario with another seed."""
    return validate(Scenario, scenario.model_dump(mode="json") | {"seed": seed}, scenario.name)
