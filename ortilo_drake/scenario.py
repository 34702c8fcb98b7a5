"""The typed scenario: everything that decides a flight, and nothing else.

A scenario is a YAML file that holds the fields below; what it leaves out takes the default given here, and the
defaults together are a valid flight. Units are SI, angles in radians. A wrong file is refused before anything
runs, with one line that names the file, the field, the value and what is allowed (InputError).
"""

from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field, NonNegativeFloat, NonNegativeInt, PositiveFloat, PositiveInt, model_validator

from ortilo_drake.model.room import ORTILO_ROOM, Room, Vec3, load_room
from ortilo_drake.model.signals import SENSORS
from ortilo_drake.model.typed_yaml import Frozen, InputError, parse_yaml, read_text, validate
from ortilo_drake.model.vehicle import Vehicle

SCENARIO_FOLDER = Path(__file__).parent / "diagrams" / "scenarios"

Probability = Annotated[float, Field(ge=0.0, le=1.0)]
PositiveVec3 = tuple[PositiveFloat, PositiveFloat, PositiveFloat]
Seed = Annotated[int, Field(ge=0, lt=2**63)]


# --- the link -------------------------------------------------------------------------------------------------


class NoLoss(Frozen):
    """Every message arrives."""

    kind: Literal["none"] = "none"


class BernoulliLoss(Frozen):
    """Each message is lost with the same probability, independently."""

    kind: Literal["bernoulli"]
    probability: Probability


class GilbertElliottLoss(Frozen):
    """Bursts: a two-state Markov chain steps once a tick; messages are lost at the rate of its state.

    The chain starts in the good state.
    """

    kind: Literal["gilbert_elliott"]
    good_to_bad: Probability
    bad_to_good: Probability
    loss_good: Probability = 0.0
    loss_bad: Probability = 1.0


class PositionBlackout(Frozen):
    """No message while the vehicle's true coordinate on one axis lies in [start, end)."""

    kind: Literal["position"]
    axis: Literal["x", "y", "z"] = "x"
    start: float
    end: float


class TimeBlackout(Frozen):
    """No message while the time lies in [start, end) [s]."""

    kind: Literal["time"]
    start: NonNegativeFloat
    end: NonNegativeFloat


Loss = Annotated[NoLoss | BernoulliLoss | GilbertElliottLoss, Field(discriminator="kind")]
Blackout = Annotated[PositionBlackout | TimeBlackout, Field(discriminator="kind")]


class Link(Frozen):
    """How one sensor's messages reach the vehicle.

    Attributes:
        every: send on every n-th tick; at 30 ticks a second, 3 is 10 Hz.
        loss: what is lost at random.
        blackouts: where or when nothing arrives.
        delay: fixed delay [ticks].
        random_delay: largest additional delay [ticks], drawn uniformly for each message.
    """

    every: PositiveInt = 1
    loss: Loss = NoLoss()
    blackouts: tuple[Blackout, ...] = ()
    delay: NonNegativeInt = 0
    random_delay: NonNegativeInt = 0

    @model_validator(mode="after")
    def _blackouts_have_a_length(self) -> "Link":
        for blackout in self.blackouts:
            if blackout.start >= blackout.end:
                raise ValueError(f"blackout: start {blackout.start} must be below end {blackout.end}")
        return self


# --- the world ------------------------------------------------------------------------------------------------


class IdealRotors(Frozen):
    """The control acts on the body at once and without limit, as in the paper's model."""

    kind: Literal["ideal"] = "ideal"


class FirstOrderRotors(Frozen):
    """Mixing to four rotor speeds, limits of speed, and a first-order lag with the vehicle's time constants."""

    kind: Literal["first_order"]


class Disturbance(Frozen):
    """Force in W and torque in B, Gaussian, drawn anew every tick and held over it (sd per axis)."""

    force_sd: NonNegativeFloat = 0.27
    torque_sd: NonNegativeFloat = 0.005


class Imu(Frozen):
    """An IMU with its own attitude filter: white noise on each output (sd per axis)."""

    angle_sd: NonNegativeFloat = 0.01
    rate_sd: NonNegativeFloat = 0.01
    specific_force_sd: NonNegativeFloat = 0.05
    link: Link = Link()


class ProportionalNoise(Frozen):
    """Range noise whose standard deviation is this fraction of the distance."""

    kind: Literal["proportional"] = "proportional"
    fraction: NonNegativeFloat = 0.0075


class ConstantNoise(Frozen):
    """Range noise of one standard deviation [m]."""

    kind: Literal["constant"]
    sd: NonNegativeFloat


class WallsIgnored(Frozen):
    """Radio passes through walls unchanged."""

    kind: Literal["none"] = "none"


class WallsBias(Frozen):
    """Each wall in the line of sight makes a range this much longer [m]; not the wall that holds the anchor."""

    kind: Literal["bias"]
    per_wall: NonNegativeFloat = 0.3


class WallsBlock(Frozen):
    """A wall in the line of sight blocks a range; not the wall that holds the anchor."""

    kind: Literal["block"]


RangeNoise = Annotated[ProportionalNoise | ConstantNoise, Field(discriminator="kind")]
WallEffect = Annotated[WallsIgnored | WallsBias | WallsBlock, Field(discriminator="kind")]


class Uwb(Frozen):
    """UWB ranging to the room's anchors; by default the authors' simulator: 10 Hz, sd 0.0075 d, no walls."""

    noise: RangeNoise = ProportionalNoise()
    walls: WallEffect = WallsIgnored()
    max_distance: PositiveFloat = 100.0
    link: Link = Link(every=3)


class ProjectedCamera(Frozen):
    """A landmark camera that returns boxes without rendering an image.

    Attributes:
        width: image width [px]; the room's camera is scaled to it.
        edge_sd: noise of each edge of a box [px].
        miss_base: miss rate at distance 0.
        miss_per_metre: growth of the miss rate with distance [1/m].
        max_distance: farther landmarks are never found [m].
        min_size: smaller boxes, in either direction, are never found [px].
        min_visible: a landmark is found if at least this share of it is not hidden by walls and stands.
        false_boxes: mean number of false boxes an image (Poisson).
        link: rate and delivery; 10 Hz by default.
    """

    width: Annotated[int, Field(ge=16, le=8192)] = 320
    edge_sd: NonNegativeFloat = 1.3
    miss_base: Probability = 0.02
    miss_per_metre: NonNegativeFloat = 0.02
    max_distance: PositiveFloat = 12.0
    min_size: NonNegativeFloat = 6.0
    min_visible: Probability = 0.6
    false_boxes: Annotated[float, Field(ge=0.0, le=5.0)] = 0.1
    link: Link = Link(every=3)


class World(Frozen):
    """The simulated physics apart from the sensors.

    Attributes:
        kinematics: 'small_angle' is the paper's nonlinear model, 'rigid_body' has proper Euler-rate kinematics,
            'linear' is the paper's linearisation at hover.
        rotors: between the control and the body.
        disturbance: what pushes the vehicle about.
    """

    kinematics: Literal["linear", "small_angle", "rigid_body"] = "small_angle"
    rotors: Annotated[IdealRotors | FirstOrderRotors, Field(discriminator="kind")] = IdealRotors()
    disturbance: Disturbance = Disturbance()


# --- onboard --------------------------------------------------------------------------------------------------


class Multilateration(Frozen):
    """Position from ranges.

    'nearest_three' intersects the spheres of the three nearest anchors, as the authors do; 'least_squares' is
    weighted nonlinear least squares over all ranges. noise is what the solver believes of the ranges.
    """

    method: Literal["nearest_three", "least_squares"] = "least_squares"
    noise: RangeNoise = ProportionalNoise()


class LandmarkFix(Frozen):
    """Position from landmark boxes.

    Attributes:
        method: 'known_attitude' (two landmarks or more, attitude from the filter), 'cosine_law' (three or more,
            the paper's) or 'pnp' (four or more, OpenCV's SQPNP in RANSAC).
        center_sd: what the solver believes of a box centre's error [px]; more than the boxes' own, because the
            filter's attitude error is common to successive fixes.
        gate: an association is refused beyond this probability of the predicted projection's error.
        max_residual: 'known_attitude' drops boxes that disagree with the rest by more than this many sd.
        prior_sd: error of the estimate's position [m] and angles [rad] to associate by; null takes them from the
            filter's covariance.
    """

    method: Literal["known_attitude", "cosine_law", "pnp"] = "known_attitude"
    center_sd: PositiveFloat = 2.0
    gate: Annotated[float, Field(gt=0.0, lt=1.0)] = 0.999
    max_residual: PositiveFloat = 4.0
    prior_sd: tuple[PositiveFloat, PositiveFloat] | None = None


class Noise(Frozen):
    """What the filter believes of the measurements, V (variances per axis [m^2], [rad^2]).

    A position sensor set to null takes its covariance from each fix: geometry and sensor noise.
    """

    uwb: PositiveVec3 | None = None
    camera: PositiveVec3 | None = None
    imu: PositiveVec3 = (1.0e-4, 1.0e-4, 1.0e-4)


class MeasurementHandler(Frozen):
    """What of the arrived fixes the filter gets.

    A fix is ignored if its squared Mahalanobis distance from the filter's prediction exceeds the chi-square
    quantile of the sensor's gate; null switches the gate off.
    """

    uwb_gate: Annotated[float, Field(gt=0.0, lt=1.0)] | None = None
    camera_gate: Annotated[float, Field(gt=0.0, lt=1.0)] | None = None


class DisturbanceW(Frozen):
    """W = Gamma_d diag(force_sd^2, torque_sd^2) Gamma_d^T of a disturbance held over each tick."""

    kind: Literal["disturbance"] = "disturbance"
    force_sd: PositiveFloat = 0.27
    torque_sd: PositiveFloat = 0.005


class DiagonalW(Frozen):
    """W diagonal: one variance each for position, angles, velocity and Euler rates."""

    kind: Literal["diagonal"]
    position: NonNegativeFloat
    angle: NonNegativeFloat
    velocity: NonNegativeFloat
    rate: NonNegativeFloat


class KalmanFilter(Frozen):
    """The intermittent Kalman filter.

    Attributes:
        W: process noise covariance.
        V: measurement noise.
        initial_sd: standard deviation of the initial error in position [m], angles, velocity, Euler rates.
    """

    W: Annotated[DisturbanceW | DiagonalW, Field(discriminator="kind")] = DisturbanceW()
    V: Noise = Noise()
    initial_sd: tuple[PositiveFloat, PositiveFloat, PositiveFloat, PositiveFloat] = (0.05, 0.02, 0.05, 0.05)


class ServoWeights(Frozen):
    """Diagonals of the servo's Q (by group of states) and R."""

    position: PositiveVec3 = (6.0, 6.0, 6.0)
    angle: tuple[NonNegativeFloat, NonNegativeFloat, PositiveFloat] = (1.0, 1.0, 1.0)
    velocity: tuple[NonNegativeFloat, NonNegativeFloat, NonNegativeFloat] = (1.0, 1.0, 1.0)
    rate: tuple[NonNegativeFloat, NonNegativeFloat, NonNegativeFloat] = (0.1, 0.1, 0.1)
    integral: PositiveVec3 = (3.0e-4, 3.0e-4, 3.0e-4)
    control: tuple[PositiveFloat, PositiveFloat, PositiveFloat, PositiveFloat] = (0.02, 1.0, 1.0, 1.0)


class LqServo(Frozen):
    """The LQ servo.

    Attributes:
        form: 'paper' is u = -L [xhat; i]; 'error' is u = -L [xhat - x_ref; i] with the planner's acceleration fed
            forward, as in the authors' code.
        integrator: 'literal' and 'hold' integrate r less the measured position, as printed, and are part of the
            filter's model; where no fix arrived 'literal' integrates r itself, 'hold' keeps still. 'estimate'
            integrates r - xhat, as in the authors' code.
        velocities: 'truth' lends the servo the true velocities and Euler rates, as the authors did.
        yaw: psi_r [rad].
        weights: Q and R.
    """

    form: Literal["paper", "error"] = "error"
    integrator: Literal["literal", "hold", "estimate"] = "estimate"
    velocities: Literal["estimate", "truth"] = "estimate"
    yaw: Annotated[float, Field(ge=-0.5, le=0.5)] = 0.0
    weights: ServoWeights = ServoWeights()


class GcsPlanner(Frozen):
    """A smooth collision-free path at constant altitude through convex free cells.

    Attributes:
        kind: 'gcs'.
        start: start of the path, x and y [m]; the flight starts hovering there.
        goal: goal, x and y [m].
        height: flying height [m].
        speed: path speed [m/s].
        acceleration: largest acceleration [m/s^2].
        clearance: horizontal distance kept between the vehicle's outline and every obstacle where there is room
            for it [m]; less in a narrow place.
        vertical_clearance: obstacles that end lower than this below the flying height are flown over [m].
    """

    kind: Literal["gcs"] = "gcs"
    start: tuple[float, float] = (0.0, 0.0)
    goal: tuple[float, float] = (21.0, -3.2)
    height: PositiveFloat = 1.5
    speed: PositiveFloat = 0.35
    acceleration: PositiveFloat = 0.2
    clearance: NonNegativeFloat = 1.6
    vertical_clearance: NonNegativeFloat = 0.6


class WaypointPlanner(Frozen):
    """A smooth path through given points, from the scenario or from a file with one 'x y z' [m] a line."""

    kind: Literal["waypoints"]
    points: tuple[Vec3, ...] = ()
    file: str | None = None
    speed: PositiveFloat = 0.35
    acceleration: PositiveFloat = 0.2

    @model_validator(mode="after")
    def _has_points(self) -> "WaypointPlanner":
        if self.file is not None and self.points:
            raise ValueError("give points or file, not both")
        if self.file is None and not self.points:
            raise ValueError("points: none given and no file either")
        return self


class HoverPlanner(Frozen):
    """Stay at one point."""

    kind: Literal["hover"]
    point: Vec3 = (0.0, 0.0, 1.5)
    duration: PositiveFloat = 10.0


Planner = Annotated[GcsPlanner | WaypointPlanner | HoverPlanner, Field(discriminator="kind")]


# --- the whole ------------------------------------------------------------------------------------------------


class Scenario(Frozen):
    """One flight.

    Attributes:
        name: what tables and files call it.
        seed: the seed of all noise; the same seed gives the same flight bit for bit.
        control_rate: ticks a second, 1 / h [Hz].
        settle: time flown after the path's end [s].
        room: 'ortilo' or the path of a room file, relative to the scenario's own folder.
        sensors: which of uwb, camera and imu fly; the others never arrive.
        camera: how the camera is simulated.
    """

    name: str = "default"
    seed: Seed = 0
    control_rate: Annotated[float, Field(ge=5.0, le=1000.0)] = 30.0
    settle: NonNegativeFloat = 2.0
    room: str = "ortilo"
    vehicle: Vehicle = Vehicle()
    world: World = World()
    sensors: tuple[Literal["uwb", "camera", "imu"], ...] = SENSORS
    imu: Imu = Imu()
    uwb: Uwb = Uwb()
    camera: Literal["projected"] = "projected"
    projected_camera: ProjectedCamera = ProjectedCamera()
    multilateration: Multilateration = Multilateration()
    landmark_fix: LandmarkFix = LandmarkFix()
    handler: MeasurementHandler = MeasurementHandler()
    filter: KalmanFilter = KalmanFilter()
    servo: LqServo = LqServo()
    planner: Planner = GcsPlanner()

    @property
    def h(self) -> float:
        """The control period, the tick of every discrete system [s]."""
        return 1.0 / self.control_rate

    def link_of(self, sensor: str) -> Link:
        """Return the link of 'uwb', 'camera' or 'imu'."""
        return {"uwb": self.uwb.link, "camera": self.projected_camera.link, "imu": self.imu.link}[sensor]

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
    raise InputError(
        f"scenario: {str(name_or_file)!r} is unknown: give a .yaml file or one of {', '.join(scenario_names())}"
    )


def _set_field(data: dict[str, Any], setting: str) -> None:
    key, equals, text = setting.partition("=")
    if not equals or not all(key.split(".")):
        raise InputError(f"--set {setting!r}: must read key.key=value")
    *parents, last = key.split(".")
    for parent in parents:
        child = data.get(parent)
        if child is None:
            child = data[parent] = {}
        if not isinstance(child, dict):
            raise InputError(f"--set {setting!r}: '{parent}' is not a group of settings")
        data = child
    data[last] = parse_yaml(text, f"--set {setting!r}")


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
    # Where a file says nothing of a group, a setting inside it changes the default of the typed model.
    for setting in settings:
        _set_field(data, setting)
    if seed is not None:
        data["seed"] = seed
    scenario = validate(Scenario, data, source)
    scenario = _relative_to(path.parent, scenario)
    scenario.load_room()
    return scenario


def _relative_to(folder: Path, scenario: Scenario) -> Scenario:
    """Return the scenario with the files it names made absolute."""
    changes: dict[str, Any] = {}
    if scenario.room != "ortilo":
        changes["room"] = str((folder / scenario.room).resolve())
    if isinstance(scenario.planner, WaypointPlanner) and scenario.planner.file is not None:
        file = str((folder / scenario.planner.file).resolve())
        changes["planner"] = scenario.planner.model_copy(update={"file": file})
    return scenario.model_copy(update=changes) if changes else scenario


def with_seed(scenario: Scenario, seed: int) -> Scenario:
    """Return the same scenario with another seed."""
    return validate(Scenario, scenario.model_dump(mode="json") | {"seed": seed}, scenario.name)


def read_waypoints(path: Path) -> np.ndarray:
    """Return the waypoints p_W (n, 3) of a text file with one 'x y z' a line; '#' starts a comment.

    Raises:
        InputError: naming file and line.
    """
    points = []
    for number, line in enumerate(read_text(path).splitlines(), start=1):
        words = line.partition("#")[0].replace(",", " ").split()
        if not words:
            continue
        try:
            point = [float(word) for word in words]
        except ValueError:
            raise InputError(f"{path}: line {number}: {line.strip()!r} is not three numbers") from None
        if len(point) != 3 or not np.all(np.isfinite(point)):
            raise InputError(f"{path}: line {number}: {line.strip()!r} is not three finite numbers")
        points.append(point)
    return np.array(points).reshape(-1, 3)
