"""The errors of a scenario's world that the theory at hover leaves out.

Margins, arrival rates and lost commands are of the world that the filter believes, with the rotors' drag. The predicted
rms at hover has what is wrong besides (error_moments.py), and what is learned of the survey (learned_survey.py).
"""

from typing import Any

from ortilo_drake.scenario import Scenario, Truth
from ortilo_drake.scenario.range_errors import UwbNoise

# Entries of truth that no linear error stands for: they scale what changes little at hover, or pass before it counts.
FACTORS = {
    "truth.vehicle": ("inertia_factor",),
    "truth.imu": ("angles_factor", "rates_factor", "specific_force_factor"),
    "truth.uwb": ("factor",),
    "truth.camera": ("focal_factor",),
}
OTHERS = ("clock", "start")


def left_out(scenario: Scenario) -> list[str]:
    """Return the settings of a scenario's world that the predicted rms at hover leaves out."""
    uwb, noise = scenario.uwb, _fitted(scenario)
    found = {
        "imu.ahrs": "imu" in scenario.sensors and scenario.imu.ahrs is not None,
        "uwb.round": "uwb" in scenario.sensors and uwb.round > 0.0,
        f"uwb.{'noise' if noise is None else 'fitted.white'}": "uwb" in scenario.sensors
        and uwb.sds != scenario.multilateration.noise.sds,
        "uwb.fitted.outliers": noise is not None and noise.outliers.share > 0.0 and noise.outliers.sd > 0.0,
        "uwb.fitted.constants": noise is not None and any(noise.constants or ()),
        "uwb.fitted.near_floor": noise is not None and noise.near_floor > 0.0,
        "uwb.fitted.missing": noise is not None and noise.missing > 0.0,
        "uwb.walls": "uwb" in scenario.sensors and uwb.walls.kind in ("bias", "excess"),
        "multilateration.noise_scale": "uwb" in scenario.sensors and scenario.multilateration.noise_scale is not None,
        "landmark_fix.noise_scale": "camera" in scenario.sensors and scenario.landmark_fix.noise_scale is not None,
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
    noise = _fitted(scenario)
    found = {
        "uwb.fitted.lasting": noise is not None and noise.lasting is not None and noise.lasting.sd > 0.0,
        "uwb.fitted.field": noise is not None and noise.field is not None and noise.field.sd > 0.0,
        "uwb.fitted.constants_sd": noise is not None and noise.constants is None and noise.constants_sd > 0.0,
        "multilateration.bias_bank": "uwb" in scenario.sensors and scenario.multilateration.bias_bank is not None,
        "landmark_fix.survey_bank": "camera" in scenario.sensors and scenario.landmark_fix.survey_bank is not None,
    }
    groups = {f"truth.{name}": FACTORS.get(f"truth.{name}", ()) for name in Truth.model_fields if name not in OTHERS}
    for group, factors in _flown(scenario, groups).items():
        its, usual = _group(scenario.truth, group), _group(Truth(), group)
        if group == "truth.sensors":
            found[group] = its != usual
            continue
        names = [n for n in type(its).model_fields if n.removesuffix("_sd") not in factors and not n.endswith("_time")]
        found[group] = any(getattr(its, name) != getattr(usual, name) for name in names)
    return [name for name, there in found.items() if there]


def _fitted(scenario: Scenario) -> UwbNoise | None:
    """Return the fitted errors of the ranges that fly; None if there are none."""
    return scenario.uwb.fitted if "uwb" in scenario.sensors and scenario.uwb.errors == "fitted" else None


def _flown(scenario: Scenario, groups: dict[str, tuple[str, ...]]) -> dict[str, tuple[str, ...]]:
    """Return the groups of truth without those of sensors that do not fly."""
    return {
        group: names
        for group, names in groups.items()
        if (sensor := group.removeprefix("truth.")) not in ("imu", "uwb", "camera") or sensor in scenario.sensors
    }


def _group(truth: Truth, group: str) -> Any:
    return getattr(truth, group.removeprefix("truth."))


def _differs(scenario: Scenario, group: str, name: str) -> bool:
    return bool(getattr(_group(scenario.truth, group), name) != getattr(_group(Truth(), group), name))
