"""Settings that no part of a flight reads: a change of one has no effect, so the user gets a warning.

Each rule names settings, a test whether a scenario's parts read them, and the part that would. Settings without a rule,
and all that a registered estimator might read, count as read: no warning is wrong, but some are missing.
"""

from collections.abc import Callable, Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

from ortilo_drake.model.input_files import read_text
from ortilo_drake.model.parts import known_sensors
from ortilo_drake.model.typed_yaml import parse_yaml
from ortilo_drake.scenario.load import SCENARIO_FOLDER, Setting, load_scenario, parsed, resolve
from ortilo_drake.scenario.scenario import Scenario


class Rule(NamedTuple):
    """Settings or groups of settings, a test whether a scenario reads them, and the part that would read them."""

    keys: tuple[str, ...]
    read: Callable[[Any], bool]
    by: str


def _flies(*sensors: str) -> Callable[[Any], bool]:
    return lambda s: any(sensor in s.sensors for sensor in sensors)


def _of(kind: str, condition: Callable[[Any], bool]) -> Callable[[Any], bool]:
    """Return `condition` for estimators of a kind, True for all others."""
    return lambda s: s.estimator.kind != kind or condition(s)


_paper, _tight = partial(_of, "intermittent"), partial(_of, "tight")


def _lasts(of: str) -> Callable[[Any], bool]:
    """Return the test whether the paper's filter estimates the biases with the correlation time `<of>_time`."""

    def estimated(s: Any) -> bool:
        biases = s.estimator.biases
        if of in ("uwb", "camera"):
            return of in s.sensors and any(getattr(biases, f"{of}_sd"))
        return bool(biases.row_sd) if of == "row" else biases.level_sd > 0.0 or biases.yaw_sd > 0.0

    return estimated


def _imu(*names: str) -> tuple[str, ...]:
    """Return the keys of the errors of the named IMU outputs."""
    ends = ("", "_sd", "_walk", "_factor", "_factor_sd")
    return tuple(f"truth.imu.{name}{end}" for name in names for end in ends)


_RATES = _paper(lambda s: s.estimator.rates == "measured" or s.estimator.robust is not None)
_FORCE = _paper(lambda s: s.estimator.force == "measured" or s.estimator.robust is not None)
_LEVEL = _tight(lambda s: s.estimator.imu.level_sd > 0.0 or s.estimator.imu.yaw_sd > 0.0)
_W, _B, _T = "estimator.walks.", "estimator.biases.", "estimator."

RULES = (
    Rule(("imu.rate_density", *_imu("rates")), _RATES, "estimator.kind tight, or estimator.rates measured"),
    Rule(("imu.specific_force_density", *_imu("specific_force")), _FORCE, "estimator.kind tight, or force measured"),
    Rule(
        ("imu.angle_density", "imu.ahrs", *_imu("level", "yaw", "angles")[:-2]),
        _tight(lambda s: s.estimator.imu.angle_density is not None),
        "estimator.imu.angle_density that is not null",
    ),
    Rule(("truth.imu",), _flies("imu"), "an imu that flies"),
    Rule(("multilateration", "truth.uwb", "truth.survey.anchors", "truth.survey.anchors_sd"), _flies("uwb"), "uwb"),
    Rule(("uwb.pairs", "uwb.packets"), lambda s: s.uwb.kind == "differences", "uwb.kind differences"),
    Rule(("truth.uwb.bias",), lambda s: s.uwb.kind == "ranges", "uwb.kind ranges; it is the same in both of a pair"),
    Rule(("uwb.noise",), lambda s: s.uwb.errors == "white", "uwb.errors white"),
    Rule(("uwb.file", "uwb.fitted"), lambda s: s.uwb.errors == "fitted", "uwb.errors fitted"),
    Rule(("multilateration",), _tight(lambda s: False), "estimator.kind intermittent; tight has its own ranges"),
    Rule(
        ("detector", "landmark_fix", "truth.camera", "truth.survey.landmarks", "truth.survey.landmarks_sd"),
        _flies("camera"),
        "a camera that flies",
    ),
    Rule(("detector",), lambda s: s.camera.kind == "rendered", "camera.kind rendered"),
    Rule(("camera.errors",), lambda s: s.camera.kind == "projected", "camera.kind projected"),
    Rule(
        tuple(
            f"landmark_fix.{name}"
            for name in ("center_sd", "center_growth", "max_residual", "joint", "prior_sd", "survey_sd", "survey_bank")
            + ("noise_scale",)
        ),
        _tight(lambda s: False),
        "estimator.kind intermittent",
    ),
    Rule(
        ("vehicle.rotor_lift", "vehicle.rotor_drag", "vehicle.rotor_time_constant", "vehicle.rotor_max_speed")
        + ("vehicle.arm_length", "vehicle.arms"),
        lambda s: s.world.rotors.kind == "first_order",
        "world.rotors of kind first_order",
    ),
    Rule(("report_link",), lambda s: s.commands.are_reported, "commands.filter acted"),
    Rule(("command_link.when_lost",), lambda s: s.command_link.loss.kind != "none", "command_link.loss"),
    Rule(("failsafe",), lambda s: False, "`ortilo hil world`, in real time"),
    Rule(("truth.force.gust_time",), lambda s: s.truth.force.gust_sd > 0.0, "truth.force.gust_sd above 0"),
    Rule(("truth.uwb.slow_time",), lambda s: s.truth.uwb.slow_sd > 0.0, "truth.uwb.slow_sd above 0"),
    # The paper's estimator.
    Rule((_T + "horizon",), _paper(lambda s: s.estimator.delay == "replay"), "estimator.delay replay"),
    Rule((_T + "V.imu",), _flies("imu"), "an imu that flies"),
    Rule((_T + "V.specific_force",), _paper(lambda s: s.estimator.force == "measured"), "force measured"),
    Rule((_T + "walks",), _paper(lambda s: s.estimator.force != "none"), "estimator.force thrust or measured"),
    Rule((_T + "biases",), _paper(lambda s: s.estimator.force != "none"), "estimator.force thrust or measured"),
    Rule((_T + "V.uwb", _B + "uwb_sd"), _flies("uwb"), "uwb that flies"),
    Rule((_T + "V.camera", _B + "camera_sd"), _flies("camera"), "a camera that flies"),
    Rule((_W + "torque_rate",), _paper(lambda s: s.estimator.walks.torque_sd > 0.0), _W + "torque_sd above 0"),
    Rule(
        (_W + "accelerometer_sd", _W + "accelerometer_rate"),
        _paper(lambda s: s.estimator.force == "measured"),
        "estimator.force measured",
    ),
    Rule(
        (_T + "V.rates", _W + "gyroscope_sd", _W + "gyroscope_rate")
        + (_T + "robust.drift", _T + "robust.opening.gyroscope"),
        _paper(lambda s: s.estimator.rates == "measured"),
        "estimator.rates measured",
    ),
    Rule(("imu.standstill",), _FORCE, "estimator.kind tight, or force measured"),
    Rule(
        tuple(f"{_T}{of}.{sensor}_sd" for of in ("walks", "imu") for sensor in ("accelerometer", "gyroscope")),
        lambda s: s.samples_at_rest == 0 or s.estimator.kind not in ("intermittent", "tight"),
        "imu.standstill of 0: the imu was zeroed at rest",
    ),
    *(
        Rule((f"{_B}{of}_time",), _paper(_lasts(of)), f"estimator.biases of {of} above 0")
        for of in ("uwb", "camera", "imu", "row")
    ),
    # The tight estimator.
    Rule(
        (_T + "imu.rate_density", _T + "imu.specific_force_density"),
        _tight(lambda s: s.estimator.imu.datasheet == "none"),
        "estimator.imu.datasheet none",
    ),
    Rule((_T + "imu.angles_rate",), _LEVEL, "estimator.imu.level_sd or yaw_sd above 0"),
    Rule((_T + "ranges",), _tight(_flies("uwb")), "uwb that flies"),
    Rule((_T + "pixels",), _tight(_flies("camera")), "a camera that flies"),
    Rule((_T + "ranges.bias_rate",), _tight(lambda s: s.estimator.ranges.bias_sd > 0.0), "ranges.bias_sd above 0"),
    Rule((_T + "ranges.slow_time",), _tight(lambda s: s.estimator.ranges.slow_sd > 0.0), "ranges.slow_sd above 0"),
    Rule((_T + "pixels.slow_time",), _tight(lambda s: s.estimator.pixels.slow_share > 0.0), "slow_share above 0"),
)


def why_unread(key: str, scenario: Scenario) -> str | None:
    """Return the part that would read a setting that no part of a scenario reads; None if some part reads it."""
    group, _, rest = key.partition(".")
    sensor = rest.split(".")[1] if key.startswith("truth.sensors.") and rest.count(".") else group
    if sensor in known_sensors() and sensor not in scenario.sensors:
        return f"{sensor}, which is not in sensors, [{', '.join(scenario.sensors)}]"
    for rule in RULES:
        if any(key == known or key.startswith(f"{known}.") for known in rule.keys) and not rule.read(scenario):
            return rule.by
    return None


def unread_settings(scenario: Scenario, name_or_file: str | Path, settings: Sequence[Setting] = ()) -> list[str]:
    """Return a warning for each setting that a user gave and that no part of the flown scenario reads.

    The user gives `settings`, and also the settings in a .yaml file; the settings of ready-made scenarios do not count.
    """
    given = [key for key, value, _ in map(parsed, settings) for key in _leaves(key, value)]
    given += _own_of(resolve(name_or_file, "scenario"))
    lines = []
    for key in dict.fromkeys(given):
        reader = why_unread(key, scenario)
        if reader is not None:
            lines.append(f"{key}: has no effect here: no part of this flight reads it, only {reader}")
    return lines


def _leaves(key: str, value: Any) -> Iterator[str]:
    """Yield the keys of the single settings in a group, or the key itself if the value is no group."""
    if isinstance(value, dict):
        for name, inner in value.items():
            yield from _leaves(f"{key}.{name}" if key else str(name), inner)
    else:
        yield key


def _own_of(path: Path) -> list[str]:
    """Return the keys in a user's file, and in the user's files that are its bases, that differ from their base."""
    if path.parent == SCENARIO_FOLDER:
        return []
    data = parse_yaml(read_text(path), str(path)) or {}
    base = data.pop("base", None)
    below = Scenario() if base is None else load_scenario(_beside(path, base))
    under, further = below.model_dump(mode="json"), [] if base is None else _own_of(_beside(path, base))
    return [key for key in _leaves("", data) if _at(under, key) != _at(data, key)] + further


def _beside(path: Path, base: str) -> Path:
    return path.parent / resolve(base, "base")  # a ready-made scenario's path is absolute


def _at(data: Any, key: str) -> Any:
    for name in key.split("."):
        data = data.get(name) if isinstance(data, dict) else None
    return data
