"""The errors of a scenario's world that the theory at hover leaves out.

Margins, arrival rates and lost commands are of the world that the filter believes, once it has learned what its banks
learn of the survey (sensors/learned_survey.py), with the rotors' drag. The predicted rms at hover has what is wrong
besides (error_moments.py).
"""

from typing import Any

from ortilo_drake.model.signals import SENSORS
from ortilo_drake.scenario import Scenario, Truth
from ortilo_drake.sensors.described import described

# Entries of truth that no linear error stands for: they scale what changes little at hover, or pass before it counts.
FACTORS = {
    "truth.vehicle": ("inertia_factor",),
    "truth.imu": ("angles_factor", "rates_factor", "specific_force_factor"),
    "truth.uwb": ("factor",),
    "truth.camera": ("focal_factor",),
}
OTHERS = ("clock", "start")


def left_out(scenario: Scenario) -> list[str]:
    """Return the settings by which a scenario's world differs at hover from what the predicted rms has of it."""
    found = _of_sensors(scenario, 0) | {
        "world.rotors": scenario.world.rotors.kind == "first_order",
        "faults": bool(scenario.faults),
    }
    for group, factors in _flown(scenario, FACTORS).items():
        for name in factors:
            found[f"{group}.{name}"] = _differs(scenario, group, name) or _differs(scenario, group, f"{name}_sd")
    found |= {f"truth.{name}": getattr(scenario.truth, name) != getattr(Truth(), name) for name in OTHERS}
    return [name for name, there in found.items() if there]


def in_the_rms_alone(scenario: Scenario) -> list[str]:
    """Return the settings that the predicted rms has, and the other figures have not."""
    found = _of_sensors(scenario, 1)
    groups = {f"truth.{name}": FACTORS.get(f"truth.{name}", ()) for name in Truth.model_fields if name not in OTHERS}
    for group, factors in _flown(scenario, groups).items():
        its, usual = _group(scenario.truth, group), _group(Truth(), group)
        if group == "truth.sensors":
            found[group] = its != usual
            continue
        names = [n for n in type(its).model_fields if n.removesuffix("_sd") not in factors and not n.endswith("_time")]
        found[group] = any(getattr(its, name) != getattr(usual, name) for name in names)
    return [name for name, there in found.items() if there]


def _of_sensors(scenario: Scenario, which: int) -> dict[str, bool]:
    """Return the first (0) or second (1) group of settings in `left_out` (model/parts.py) of the sensors that fly."""
    return {
        name: there
        for sensor in scenario.sensors
        for name, there in described(sensor).left_out(scenario)[which].items()
    }


def _flown(scenario: Scenario, groups: dict[str, tuple[str, ...]]) -> dict[str, tuple[str, ...]]:
    """Return the groups of truth without those of sensors that do not fly."""
    return {
        group: names
        for group, names in groups.items()
        if (sensor := group.removeprefix("truth.")) not in SENSORS or sensor in scenario.sensors
    }


def _group(truth: Truth, group: str) -> Any:
    return getattr(truth, group.removeprefix("truth."))


def _differs(scenario: Scenario, group: str, name: str) -> bool:
    return bool(getattr(_group(scenario.truth, group), name) != getattr(_group(Truth(), group), name))
