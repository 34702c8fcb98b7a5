"""The register of sensors, estimators, servos, planners, detectors and faults that a scenario may name.

A part comes from a package with an entry point in the group ``ortilo_drake.plugins``, whose module registers the part
when imported; from a file given by ``--plugin FILE.py``; or from a call of register_* before the scenario is loaded. A
scenario file never runs code by itself.
"""

import importlib.util
import inspect
import sys
from collections.abc import Callable, Hashable
from dataclasses import dataclass, field
from functools import cache
from importlib.metadata import entry_points
from pathlib import Path
from typing import Any, Final, Literal, get_args, get_origin
from zlib import crc32

import numpy as np

from ortilo_drake.model.input_error import InputError
from ortilo_drake.model.measurement import Row
from ortilo_drake.model.signals import SENSORS
from ortilo_drake.model.typed_yaml import Frozen

KINDS: Final = ("estimator", "servo", "planner", "detector", "fault")


@dataclass(frozen=True)
class Compiled:
    """A sensor's functions for compiled flights (diagrams/wiring), compiled by numba, with their numbers."""

    numbers: Callable[[Any, Any], Any]
    """(scenario, room) -> NamedTuple of floats and arrays, of a class that only this sensor uses."""
    payload: int
    """number n of values in the sensor's message after arrived and stamp."""
    noises: int
    """number of standard normal numbers that a message needs."""
    measure: Callable[..., np.ndarray]
    """(numbers, true x (12), standard normal numbers, t_k [s]) -> payload (n), an empty array if the sensor measures
    nothing; compiled by numba.njit."""
    solve: Callable[..., np.ndarray] | None = None
    """(numbers, payload (n), xhat (15), P (15, 15)) -> [value (m), covariance row by row (m^2)], an empty array if
    there is no solution; compiled by numba.njit. None if the message begins with the value."""


@dataclass(frozen=True)
class Sensor:
    """The complete description of a sensor, or of one sample of a sensor faster than the tick.

    The world sends the onboard half the sensor's message [arrived, stamp, payload ...] (model/signals.py). The filter
    gets a value of m rows and its covariance: y = C x + v.
    """

    name: str
    """name of the sensor and of its message in scenarios, tables and logs."""
    settings: type[Frozen]
    """class of the sensor's group in a scenario, a frozen model with at least a field ``link: Link``."""
    rows: tuple[Row, ...]
    """m rows of y that the filter gets."""
    make_world: Callable[[Any, Any], Any] | None = None
    """(scenario, room) -> System with inputs among state (12), control (4) and disturbance (6), and one output, the
    message, a function of the inputs, the time and noise. For a sensor faster than the tick, the scenario passed has
    the time between samples as h, and the message is one sample. Not used if the sensor has `compiled`; None if an
    element outputs the message."""
    sd: Callable[[Any, Any, np.ndarray], np.ndarray] | None = field(default=None, kw_only=True)
    """(scenario, room, true states (n, 12)) -> standard deviation of each row's noise in the world (n, m), NaN where
    the sensor measures nothing. None if `covariance` and `information` are given instead."""
    make_onboard: Callable[[Any, Any], Any] | None = None
    """(scenario, room) -> System with the message and, optionally, estimate (15) and covariance (225) as inputs, and
    one output, the fix [arrived, stamp, value (m), covariance row by row (m^2)]. None if the message itself begins with
    the value, or is a fix. Not used if the sensor has `compiled`."""
    payload: int | Callable[[Any, Any], int] | None = None
    """number of values in the message after arrived and stamp, or (scenario, room) -> this number. None if the port of
    make_onboard has the size, or if the message holds the value alone, or value and covariance where V is None."""
    V: Callable[[Any], np.ndarray | None] = lambda scenario: None
    """scenario -> noise covariance of the value in the filter (m, m); None if each fix has its own covariance."""
    limits: Callable[[Any, Any], tuple[np.ndarray, np.ndarray]] | None = None
    """(scenario, room) -> smallest and largest payload values that hardware in the loop accepts; by default LARGEST."""
    compiled: Compiled | None = None
    """functions for compiled flights; None if only Drake flies the sensor."""
    covariance: Callable[[Any, Any, np.ndarray], np.ndarray | None] | None = None
    """(scenario, room, true state (12)) -> covariance (m, m) of the value that the filter would get at this state, None
    if there is none. By default the one of independent rows with `sd`."""
    information: Callable[[Any, Any, np.ndarray, np.ndarray], Any] | None = None
    """(scenario, room, true states (n, 12), seen (n)) -> sensors.information_rows.Information, the Fisher information
    of the messages sent in the ticks marked in `seen`; None if it is not known. By default from rows with `sd`."""
    unknown: Callable[[Any, Any], Any] | None = None
    """(scenario, room) -> the errors that the scenario's truth leaves unknown, sensors.unknown_error.Error. By default
    the biases in the filter's settings (estimator.biases.row_sd)."""
    made: Callable[[Any, Any, np.ndarray], tuple[np.ndarray, np.ndarray] | None] | None = None
    """(scenario, room, true state (12)) -> (D (m, l), rows (l, 17)): at this state, errors e of the measurements `rows`
    of `information`, from which the value is computed, give the value the error D e; None if D is not known. By default
    the value is the measurement itself."""
    learned: Callable[[Any, Any, np.ndarray], Any] = lambda scenario, room, x: scenario
    """(scenario, room, true state (12)) -> the scenario with the survey errors that the filter learns at this state."""
    left_out: Callable[[Any], tuple[dict[str, bool], dict[str, bool]]] = lambda scenario: ({}, {})
    """scenario -> (settings that the predicted rms at hover neglects, settings that only this figure includes), each
    with whether the world differs by it."""
    mismatches: tuple[Any, ...] = ()
    """ways in which the sensor's world may differ from the onboard model, sensors.mismatch.Mismatch."""
    whole: Callable[[Any, Any], list[int]] = lambda scenario, room: []
    """(scenario, room) -> indices of the payload's integers."""
    members: Callable[[Any, int], tuple[tuple[str, str], ...]] = lambda scenario, payload: ()
    """(scenario, size of the payload) -> the payload's members in a C struct, each with a comment; () for numbers."""
    element: Callable[[Any, Any, bool], Any] | None = None
    """(scenario, room, whole) -> Box that outputs the message as it is sent, for a built-in sensor; `whole` is True if
    all parts of the message are needed. Other sensors have `compiled` or make_world."""
    after_sensor: Callable[[Any, Any, Any, int], Any] | None = None
    """(scenario, room, the Box of the message, samples per tick) -> Box that changes the message before the errors of
    `truth` are added, None if there is none. The Box may read the true state and the acceleration."""
    solver: Callable[[Any, Any], Any] | None = None
    """(scenario, room) -> Box that computes the fix of a built-in sensor, None if make_onboard's System must do it."""
    drawn: Callable[[Any, Any, Any, Any], Any] | None = None
    """(scenario, room, draws of `truth`, the wiring's boxes) -> values that the boxes get in this world, by the boxes'
    names; for built-in sensors only."""
    needs_forces: bool = False
    """whether the sensor's element reads the forces on the body."""
    is_wired: bool = False
    """whether the sensor belongs to the onboard computer: its messages use no radio, and its clock is the filter's."""
    measures: str | None = None
    """the objects in the room that the sensor measures, 'anchors' or 'landmarks'."""
    port: str | None = None
    """name of the sensor's messages at the ports of Drake's diagrams; by default the sensor's name."""
    title: str | None = None
    """name of the sensor in texts and figures; by default its name in scenarios."""
    components: str | None = None
    """a letter for each row in figures; by default the row's number."""
    only_drake: Callable[[Any], str | None] | None = None
    """scenario -> the setting, as `field: value`, that only Drake can play; None if there is none."""
    check: Callable[[Any, Any], None] | None = None
    """(scenario, room) -> None; raises InputError if the sensor cannot fly."""
    advice: str | None = None
    """hint for a flight in which none of the sensor's values arrived."""
    noise_numbers: Callable[[Any], dict[str, float]] | None = None
    """scenario -> the settings that determine V, by their keys, if each fix has its own covariance."""
    noise_settings: tuple[str, ...] = ()
    """beginnings of these keys."""
    nominal_variances: tuple[float, ...] | None = None
    """variances of the value (m or more) for theory without a position, if each fix has its own covariance. By default
    the noise in the middle of the room."""


@dataclass(frozen=True)
class Part:
    """An estimator, a servo, a planner, a detector or a fault that scenarios may name by its kind."""

    kind: str
    """name after ``kind:`` in a scenario."""
    settings: type[Frozen]
    """class of the part's group in a scenario, a frozen model with a field ``kind: Literal[...]``."""
    make: Callable[..., Any] | None = None
    """function that makes the part as a System; diagrams/onboard.py has the arguments and results. None if `box` makes
    it. For a detector, it makes a function from a picture to boxes, see register_detector."""
    box: Callable[..., Any] | None = None
    """function that makes the part as a Box of an element (loop/own.py), which every player flies; None if only Drake
    flies it. Its arguments: for an estimator the Belief and xbar_0 (15), for a servo or a planner the Belief, for a
    fault its settings, the size of the message that it changes and the tick h [s]. diagrams/wiring/own_part.py has the
    inputs that the Box may read."""
    gain: Callable[[Any], np.ndarray] | None = None
    """for a servo: Belief -> L (4, 15) about hover, u = -L [x - x_ref; i] + u_ff. None if the servo has no gain."""
    linear: Callable[[Any], Any] | None = None
    """for an estimator: Belief -> settings of the paper's filter to which it is equal about hover; None without one."""


# Names of signals, log topics and packets (with channels in capitals), which a sensor's message must not have.
_TAKEN: Final = frozenset(
    (*SENSORS, "detections", "shutter", "image", "velocity", "state", "control", "disturbance", "reference", "belief")
    + ("estimate", "covariance", "force", "measurement", "y", "delta", "v2", "scenario", "tick", "command")
    + ("telemetry", "hello", "goal")
)
_SENSORS: dict[str, Sensor] = {}
_PARTS: dict[tuple[str, str], Part] = {}
_FILES: list[str] = []  # files that registered parts, for worker processes
_registrations = 0  # number of registrations so far: a part that replaces another one may get the same id


def register_sensor(sensor: Sensor) -> None:
    """Register a sensor for scenarios; InputError if the name is taken, or if anything needed is missing or wrong."""
    if not isinstance(sensor, Sensor):
        raise InputError(f"sensor: {sensor!r}: must be an od.Sensor")
    if not sensor.name.isidentifier() or sensor.name.lower() in _TAKEN:
        raise InputError(f"sensor: {sensor.name!r}: must be a plain word, and no name of a built-in signal")
    if "link" not in sensor.settings.model_fields:
        raise InputError(f"sensor: {sensor.name}: its settings need a field 'link: Link'")
    if sensor.make_world is None and sensor.compiled is None:
        raise InputError(f"sensor: {sensor.name}: needs make_world, which makes a System, or compiled")
    if sensor.sd is None and (sensor.covariance is None or sensor.information is None):
        raise InputError(f"sensor: {sensor.name}: must give its noise as sd, or as covariance and information")
    for what, taken in (("measure", "numbers, x, v, t"), ("solve", "numbers, payload, xhat, P")):
        if (function := getattr(sensor.compiled, what, None)) is not None:
            try:
                inspect.signature(function).bind(*taken.split(", "))
            except TypeError as error:
                raise InputError(f"sensor: {sensor.name}: {what}: {error}: must take ({taken})") from None
    _SENSORS[sensor.name] = sensor
    _remember_caller()


def register_part(role: str, part: Part) -> None:
    """Register an estimator, a servo, a planner, a detector or a fault for scenarios; role is one of KINDS."""
    if role not in KINDS:
        raise InputError(f"part: {role!r}: must be one of {', '.join(KINDS)}")
    name, fields = f"{role}: {part.kind}", part.settings.model_fields
    if "kind" not in fields:
        raise InputError(f"{name}: its settings need a field 'kind'")
    kind = fields["kind"].annotation
    if get_origin(kind) is not Literal or part.kind not in get_args(kind):
        raise InputError(f"{name}: the field 'kind' of its settings must be Literal[{part.kind!r}]")
    if role == "fault" and not {"start", "end", "sensor"} <= fields.keys():
        raise InputError(f"{name}: its settings must be a Fault with a field 'sensor': its messages change")
    if part.box is None and (role == "fault" or part.make is None):
        raise InputError(f"{name}: needs make, which makes a System, or box, which makes an element")
    _PARTS[role, part.kind] = part
    _remember_caller()


def _remember_caller() -> None:
    """Count the registration and store the file that made it, so that worker processes can load the file too."""
    global _registrations
    _registrations += 1
    frame = inspect.currentframe()
    while frame is not None and frame.f_globals.get("__name__") in (__name__, "ortilo_drake.api.parts"):
        frame = frame.f_back
    if frame is None or frame.f_globals.get("__name__", "").partition(".")[0] == "ortilo_drake":
        return  # the registration is in our own package
    file = str(Path(frame.f_globals.get("__file__", "")).resolve())
    if "__file__" in frame.f_globals and file not in _FILES:
        _FILES.append(file)


def registered() -> Hashable:
    """Return a key of the register, which changes when a sensor or a part is added or replaced."""
    return (_registrations, *map(id, (*_SENSORS.values(), *_PARTS.values())))


def plugin_files() -> tuple[str, ...]:
    """Return the files that registered parts in this process, for load_plugin in another process."""
    return tuple(_FILES)


def load_plugin(file: str | Path) -> None:
    """Run a Python file that registers parts, once in a process; InputError if the file does not exist or fails."""
    path = Path(file).resolve()
    name = f"ortilo_plugin_{path.stem}_{crc32(bytes(path)):x}"
    if str(path) in _FILES or name in sys.modules:
        return
    spec = importlib.util.spec_from_file_location(name, path) if path.suffix == ".py" else None
    if spec is None or spec.loader is None or not path.is_file():
        raise InputError(f"--plugin {file}: must be a Python file")
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module
    try:
        spec.loader.exec_module(module)
    except Exception as error:  # a user's file may raise anything
        del sys.modules[name]
        raise InputError(f"--plugin {file}: {type(error).__name__}: {error}") from error


@cache
def _load_installed() -> None:
    """Import the plugins of all installed packages, including our own."""
    for point in entry_points(group="ortilo_drake.plugins"):
        point.load()


def find_sensor(name: str) -> Sensor | None:
    """Return the registered sensor with this name, None if there is none; built-in sensors are not included."""
    if name not in _SENSORS and name.isidentifier() and name not in SENSORS:
        _load_installed()
    return _SENSORS.get(name)


def find_part(role: str, kind: str) -> Part | None:
    """Return the registered estimator, servo, planner, detector or fault of this kind, None if there is none."""
    if (role, kind) not in _PARTS:
        _load_installed()
    return _PARTS.get((role, kind))


def own_sensors() -> tuple[Sensor, ...]:
    """Return the registered sensors, sorted by name; built-in sensors are not included."""
    _load_installed()
    return tuple(_SENSORS[name] for name in sorted(_SENSORS))


def known_sensors() -> tuple[str, ...]:
    """Return the names of all sensors, built-in ones first."""
    return (*SENSORS, *(sensor.name for sensor in own_sensors()))


def known_kinds(role: str) -> tuple[str, ...]:
    """Return the registered kinds of a role."""
    _load_installed()
    return tuple(sorted(kind for its_role, kind in _PARTS if its_role == role))
