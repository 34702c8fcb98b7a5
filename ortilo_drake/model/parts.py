"""The register of sensors, estimators, servos, planners, detectors and faults that a scenario may name.

A part comes from a package with an entry point in the group ``ortilo_drake.plugins``, whose module registers it when
imported; from a file given by ``--plugin FILE.py``; or from a call of register_* before the scenario is loaded. A
scenario file by itself never runs code.
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
    """A sensor's share in compiled flights (diagrams/wiring): functions compiled by numba, and their numbers."""

    numbers: Callable[[Any, Any], Any]
    """(scenario, room) -> NamedTuple of floats and arrays, of a class that is this sensor's alone."""
    payload: int
    """numbers n in its message after arrived and stamp."""
    noises: int
    """standard normal numbers that a message takes."""
    measure: Callable[..., np.ndarray]
    """(numbers, true x (12), standard normal numbers, t_k [s]) -> payload (n), an empty array where the sensor gives
    nothing; compiled by numba.njit."""
    solve: Callable[..., np.ndarray] | None = None
    """(numbers, payload (n), xhat (15), P (15, 15)) -> [value (m), covariance row by row (m^2)], an empty array where
    there is no solution; compiled likewise. None if the message begins with the value."""


@dataclass(frozen=True)
class Sensor:
    """Everything that the laboratory knows about a sensor, or about one sample of a sensor faster than the tick.

    What crosses from the world to the onboard half is its message [arrived, stamp, payload ...] (model/signals.py).
    What reaches the filter is a value of m rows and its covariance: y = C x + v.
    """

    name: str
    """in scenarios, tables and logs; its message has that name too."""
    settings: type[Frozen]
    """its group in a scenario, a frozen model with at least a field ``link: Link``."""
    rows: tuple[Row, ...]
    """what it tells the filter, m rows of y."""
    make_world: Callable[[Any, Any], Any] | None = None
    """(scenario, room) -> System with inputs among state (12), control (4) and disturbance (6), and one output, the
    message, a function of its inputs, the time and noise. Where the sensor is faster than the tick, that scenario's h
    is the time from one sample to the next, and its message is one sample. Not asked for where the sensor has a
    compiled share, and None where an element says its message."""
    sd: Callable[[Any, Any, np.ndarray], np.ndarray] | None = field(default=None, kw_only=True)
    """(scenario, room, true states (n, 12)) -> the world's noise of each row there, a standard deviation (n, m), NaN
    where the sensor gives nothing. None if `covariance` and `information` tell it."""
    make_onboard: Callable[[Any, Any], Any] | None = None
    """(scenario, room) -> System with the message as input, if it wants them estimate (15) and covariance (225), and
    one output, the fix [arrived, stamp, value (m), covariance row by row (m^2)]. None if the message itself begins with
    the value, or is a fix. Not asked for where it has a compiled share."""
    payload: int | Callable[[Any, Any], int] | None = None
    """numbers in its message after arrived and stamp, or (scenario, room) -> that. None where make_onboard's port
    tells, for the value alone, or for value and covariance where V says that it comes with each."""
    V: Callable[[Any], np.ndarray | None] = lambda scenario: None
    """scenario -> covariance of the value as the filter believes it (m, m); None where it comes with each fix."""
    limits: Callable[[Any, Any], tuple[np.ndarray, np.ndarray]] | None = None
    """(scenario, room) -> the payload's least and greatest values that hardware in the loop takes; or LARGEST."""
    compiled: Compiled | None = None
    """its share in compiled flights; None if Drake alone flies it."""
    covariance: Callable[[Any, Any, np.ndarray], np.ndarray | None] | None = None
    """(scenario, room, true state (12)) -> covariance of the value that the filter would get there (m, m), None where
    it gets none. By default of independent rows of that sd."""
    information: Callable[[Any, Any, np.ndarray, np.ndarray], Any] | None = None
    """(scenario, room, true states (n, 12), seen (n)) -> sensors.information_rows.Information, the Fisher information
    of the messages that were sent in the ticks that are seen; None where it is not known. By default of rows of that
    sd."""
    unknown: Callable[[Any, Any], Any] | None = None
    """(scenario, room) -> the errors that the scenario's truth leaves unknown, sensors.unknown_error.Error. By default
    those that its filter believes in (estimator.biases.row_sd)."""
    made: Callable[[Any, Any, np.ndarray], tuple[np.ndarray, np.ndarray] | None] | None = None
    """(scenario, room, true state (12)) -> (D (m, l), rows (l, 17)): at that state its value errs by D e if the
    measurements of which it is made, those rows of `information`, err by e; None where D is not known. By default the
    value itself is what is measured."""
    learned: Callable[[Any, Any, np.ndarray], Any] = lambda scenario, room, x: scenario
    """(scenario, room, true state (12)) -> the scenario whose filter has the survey's errors that it learns."""
    left_out: Callable[[Any], tuple[dict[str, bool], dict[str, bool]]] = lambda scenario: ({}, {})
    """scenario -> (settings that are not in the predicted rms at hover, settings that are in it and in no other
    figure), each with whether the world differs by it."""
    mismatches: tuple[Any, ...] = ()
    """ways in which its world may differ from what is believed, sensors.mismatch.Mismatch."""
    whole: Callable[[Any, Any], list[int]] = lambda scenario, room: []
    """(scenario, room) -> which numbers of the payload are whole, by their places in it."""
    members: Callable[[Any, int], tuple[tuple[str, str], ...]] = lambda scenario, payload: ()
    """(scenario, size of the payload) -> its members in a struct in C, each with what it is; () of plain numbers."""
    element: Callable[[Any, Any, bool], Any] | None = None
    """(scenario, room, whole) -> Box that says its message as it is sent, of a sensor that is built in; whole where all
    of the message is asked for. Other sensors have `compiled` or make_world."""
    after_sensor: Callable[[Any, Any, Any, int], Any] | None = None
    """(scenario, room, the Box of its message, samples a tick) -> Box that changes the message before the errors of
    `truth` do, None where nothing does. It reads the true state, and may the acceleration."""
    solver: Callable[[Any, Any], Any] | None = None
    """(scenario, room) -> Box that makes its fix, None where make_onboard's System must; built in likewise."""
    drawn: Callable[[Any, Any, Any, Any], Any] | None = None
    """(scenario, room, what was drawn of `truth`, the wiring's boxes) -> what boxes are given in that world, by their
    names; built in likewise."""
    needs_forces: bool = False
    """whether its element reads what acts on the body."""
    samples_itself: bool = False
    """whether its element says all samples of a tick, where it is faster than that."""
    is_wired: bool = False
    """whether it is the onboard computer's own: its messages go over no radio and its clock is the filter's."""
    measures: str | None = None
    """the things in the room that it measures by, 'anchors' or 'landmarks'."""
    port: str | None = None
    """name of its messages at Drake's diagrams; by default its own."""
    title: str | None = None
    """what texts and figures call it; by default its name."""
    components: str | None = None
    """a letter for each row in figures; by default their numbers."""
    only_drake: Callable[[Any], str | None] | None = None
    """scenario -> the setting, as `field: value`, by which Drake alone can play it; None where none is."""
    check: Callable[[Any, Any], None] | None = None
    """(scenario, room) -> None; raises InputError where the sensor cannot fly."""
    advice: str | None = None
    """the hint for a flight in which none of its values arrived."""
    noise_numbers: Callable[[Any], dict[str, float]] | None = None
    """scenario -> the numbers that state V where it comes with each fix, by their place there."""
    noise_settings: tuple[str, ...] = ()
    """how those places begin."""
    nominal_variances: tuple[float, ...] | None = None
    """variances of the value for theory that is of no place, where V comes with each fix (m or more). By default the
    noise in the middle of the room."""


@dataclass(frozen=True)
class Part:
    """An estimator, a servo, a planner, a detector or a fault that scenarios may name by its kind."""

    kind: str
    """what stands after ``kind:`` in a scenario."""
    settings: type[Frozen]
    """its group in a scenario, a frozen model with a field ``kind: Literal[...]``."""
    make: Callable[..., Any] | None = None
    """makes it as a System; see diagrams/onboard.py for what each takes and returns. None where `box` makes it. A
    detector's makes a function from a picture to what it finds, see register_detector."""
    box: Callable[..., Any] | None = None
    """makes it as a Box of an element (loop/own.py), which every player flies; None if Drake alone flies it. An
    estimator's takes the Belief and xbar_0 (15), a servo's and a planner's the Belief, a fault's its settings, the size
    of the message that it changes and the tick h [s]. What each may read: diagrams/wiring/own_part.py."""
    gain: Callable[[Any], np.ndarray] | None = None
    """of a servo, Belief -> L (4, 15) about hover, u = -L [x - x_ref; i] + u_ff. None if it has none."""
    linear: Callable[[Any], Any] | None = None
    """of an estimator, Belief -> the paper's filter (its settings) that it is about hover. None if it is none."""


# Names of signals, of logs' topics and of packets, whose channels are in capitals: a sensor's message would be theirs.
_TAKEN: Final = frozenset(
    (*SENSORS, "detections", "shutter", "image", "velocity", "state", "control", "disturbance", "reference", "belief")
    + ("estimate", "covariance", "force", "measurement", "y", "delta", "v2", "scenario", "tick", "command")
    + ("telemetry", "hello", "goal")
)
_SENSORS: dict[str, Sensor] = {}
_PARTS: dict[tuple[str, str], Part] = {}
_FILES: list[str] = []  # where parts came from, for worker processes
_registrations = 0  # so far: what replaces a part may get its id


def register_sensor(sensor: Sensor) -> None:
    """Let scenarios name a sensor; InputError if the name is taken, or link, message or noise are missing."""
    if not isinstance(sensor, Sensor):
        raise InputError(f"sensor: {sensor!r}: must be an od.Sensor")
    if not sensor.name.isidentifier() or sensor.name.lower() in _TAKEN:
        raise InputError(f"sensor: {sensor.name!r}: must be a plain word that is no built-in signal's")
    if "link" not in sensor.settings.model_fields:
        raise InputError(f"sensor: {sensor.name}: its settings need a field 'link: Link'")
    if sensor.make_world is None and sensor.compiled is None:
        raise InputError(f"sensor: {sensor.name}: must be given as a System, make_world, or by a share, compiled")
    if sensor.sd is None and (sensor.covariance is None or sensor.information is None):
        raise InputError(f"sensor: {sensor.name}: must tell its noise by sd, or by covariance and information")
    _SENSORS[sensor.name] = sensor
    _remember_caller()


def register_part(role: str, part: Part) -> None:
    """Let scenarios name an estimator, a servo, a planner, a detector or a fault; role is one of KINDS."""
    if role not in KINDS:
        raise InputError(f"part: {role!r}: must be one of {', '.join(KINDS)}")
    name, fields = f"{role}: {part.kind}", part.settings.model_fields
    if "kind" not in fields:
        raise InputError(f"{name}: its settings need a field 'kind'")
    kind = fields["kind"].annotation
    if get_origin(kind) is not Literal or part.kind not in get_args(kind):
        raise InputError(f"{name}: the field 'kind' of its settings must be Literal[{part.kind!r}]")
    if role == "fault" and not {"start", "end", "sensor"} <= fields.keys():
        raise InputError(f"{name}: its settings must be a Fault with a field 'sensor', whose messages change")
    if part.box is None and (role == "fault" or part.make is None):
        raise InputError(f"{name}: must be given as a System, make, or as an element, box")
    _PARTS[role, part.kind] = part
    _remember_caller()


def _remember_caller() -> None:
    """Count what is registered; remember the file that does it, so that worker processes can load it as well."""
    global _registrations
    _registrations += 1
    frame = inspect.currentframe()
    while frame is not None and frame.f_globals.get("__name__") in (__name__, "ortilo_drake.api.parts"):
        frame = frame.f_back
    if frame is None or frame.f_globals.get("__name__", "").partition(".")[0] == "ortilo_drake":
        return  # comes with the package
    file = str(Path(frame.f_globals.get("__file__", "")).resolve())
    if "__file__" in frame.f_globals and file not in _FILES:
        _FILES.append(file)


def registered() -> Hashable:
    """Return a key of the register: it differs once a sensor or a part is added or replaced."""
    return (_registrations, *map(id, (*_SENSORS.values(), *_PARTS.values())))


def plugin_files() -> tuple[str, ...]:
    """Return the files that registered parts in this process, for load_plugin in another one."""
    return tuple(_FILES)


def load_plugin(file: str | Path) -> None:
    """Run a Python file that registers parts, once in a process; InputError if there is no such file, or it fails."""
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
    except Exception as error:  # whatever a user's file does wrong
        del sys.modules[name]
        raise InputError(f"--plugin {file}: {type(error).__name__}: {error}") from error


@cache
def _load_installed() -> None:
    """Import the plugins of installed packages, ours among them."""
    for point in entry_points(group="ortilo_drake.plugins"):
        point.load()


def find_sensor(name: str) -> Sensor | None:
    """Return the registered sensor of a name, None if there is none; built-in ones are not among them."""
    if name not in _SENSORS and name.isidentifier() and name not in SENSORS:
        _load_installed()
    return _SENSORS.get(name)


def find_part(role: str, kind: str) -> Part | None:
    """Return the registered estimator, servo, planner, detector or fault of a kind, None if there is none."""
    if (role, kind) not in _PARTS:
        _load_installed()
    return _PARTS.get((role, kind))


def own_sensors() -> tuple[Sensor, ...]:
    """Return the registered sensors by their names; built-in ones are not among them."""
    _load_installed()
    return tuple(_SENSORS[name] for name in sorted(_SENSORS))


def known_sensors() -> tuple[str, ...]:
    """Return the names of all sensors, built-in ones first."""
    return (*SENSORS, *(sensor.name for sensor in own_sensors()))


def known_kinds(role: str) -> tuple[str, ...]:
    """Return the registered kinds of a role."""
    _load_installed()
    return tuple(sorted(kind for its_role, kind in _PARTS if its_role == role))
