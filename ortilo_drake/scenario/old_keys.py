"""Settings that have another name now, and scenarios that were saved under the old ones.

A file or a setting that uses an old name is refused with the new one. A flight or a log is read all the same: its
scenario was valid when it was saved, as JSON with every default filled in.
"""

import json
from typing import Any, Final

from ortilo_drake.model.typed_yaml import InputError, validate
from ortilo_drake.scenario.scenario import Scenario

FORMAT: Final = 2  # of a scenario's JSON, written beside it; format 1 had no number

# The first that fits counts, so a key stands before the group that it was in.
OLD_KEYS: Final = {
    "camera": "camera.kind",  # it was a word
    "camera_link.every": "camera.link.rate [Hz]",
    "camera_link": "camera.link",
    "projected_camera": "camera",
    "rendered_camera": "camera",
    "uwb.link.every": "uwb.link.rate [Hz]",
    "imu.link.every": "imu.link.rate [Hz]",
    "camera.link.every": "camera.link.rate [Hz]",
    "handler.uwb_gate": "estimator.gates.uwb",
    "handler.camera_gate": "estimator.gates.camera",
    "handler": "estimator.gates",
    "filter": "estimator",
    "servo.integrator": "estimator.integrator",
}
_NOTHING: Final = object()


def _at(data: Any, key: str) -> Any:
    """Return what stands at a dotted key, or _NOTHING."""
    for name in key.split("."):
        if not isinstance(data, dict) or name not in data:
            return _NOTHING
        data = data[name]
    return data


def refuse_old_keys(data: dict[str, Any], source: str) -> None:
    """Refuse settings under an old name.

    Args:
        data: settings by group, as YAML has them.
        source: what to call them in an error.

    Raises:
        InputError: naming source, the old and the new key.
    """
    for old, new in OLD_KEYS.items():
        value, rest = _at(data, old), ""
        if value is _NOTHING or (new.startswith(f"{old}.") and isinstance(value, dict)):
            continue
        while isinstance(value, dict) and len(value) == 1:  # one setting, as --set has it: name it in full
            name, value = next(iter(value.items()))
            rest += f".{name}"
        raise InputError(f"{source}: {old}{rest}: is now {new}{rest}")


def _in_new_shape(old: dict[str, Any]) -> dict[str, Any]:
    """Return the JSON data of a scenario of format 1 in format 2."""
    data = dict(old)
    kind, drawn = data.pop("camera"), {name: data.pop(f"{name}_camera") for name in ("projected", "rendered")}
    camera = drawn["projected"] | drawn[kind] | {"kind": kind, "link": data.pop("camera_link")}
    sensors = {"uwb": data["uwb"], "camera": camera, "imu": data["imu"]}
    for name, sensor in sensors.items():
        link = dict(sensor["link"])
        every = link.pop("every")
        data[name] = sensor | {"link": link | {"rate": None if every == 1 else data["control_rate"] / every}}
    handler, servo = data.pop("handler"), dict(data["servo"])
    gates = {name: handler[f"{name}_gate"] for name in ("uwb", "camera") if name in data["sensors"]}
    data["estimator"] = data.pop("filter") | {
        "integrator": servo.pop("integrator"),
        "gates": {name: gate for name, gate in gates.items() if gate is not None},
    }
    return data | {"servo": servo}


def scenario_from_json(text: str, version: Any, source: str) -> Scenario:
    """Return the scenario that a flight or a log carries.

    Args:
        text: its JSON.
        version: the format written beside it; 1 if there was none.
        source: what to call it in an error.

    Raises:
        InputError: if it is no scenario of a format up to FORMAT.
        ValueError: if it is no JSON.
    """
    data = json.loads(text)
    if version not in range(1, FORMAT + 1):
        raise InputError(f"{source}: is of format {version}, this version reads formats 1 to {FORMAT}")
    if version == 1:
        try:
            data = _in_new_shape(data)
        except (AttributeError, KeyError, TypeError, ZeroDivisionError):
            raise InputError(f"{source}: is no scenario of format 1") from None
    return validate(Scenario, data, source)
