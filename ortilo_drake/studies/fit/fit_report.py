"""The report of a fit in lines of text, and a scenario whose ranges and IMU have the errors of a NOISE.yaml."""

import os
from pathlib import Path
from typing import Any

import yaml

from ortilo_drake.scenario import Scenario
from ortilo_drake.scenario.load import resolve
from ortilo_drake.scenario.noise_file import NoiseFile, settings_of

UNITS = {
    "white": "m",
    "time": "s",
    "sd": "m",
    "length": "m",
    "constants": "m",
    "share": "",
    "rotation": "rad/s/√Hz",
    "force": "m/s²/√Hz",
    "rotation_rest": "rad/s/√Hz",
    "force_rest": "m/s²/√Hz",
}


def fit_lines(found: NoiseFile) -> list[str]:
    """Return the numbers with their intervals, then the other figures and the notes."""
    lines = []
    for name, (low, high) in found.intervals.items():
        value: Any = found.model_dump()
        for key in name.split("."):
            value = value["xyz".index(key)] if key in ("x", "y", "z") else value[int(key) if key.isdigit() else key]
            if value is None:  # the constants, if some anchors were not heard
                break
        shown = "-" if value is None else f"{value:.3g}"
        unit = next((UNITS[part] for part in reversed(name.split(".")) if part in UNITS), "")
        lines.append(f"{name:24} {shown:>9} {unit:10} {low:.3g} to {high:.3g}".rstrip())
    uwb, imu = found.uwb, found.imu
    lines.append(f"outliers: {uwb.outliers.sd:.2g} m, {uwb.outliers.burst:.2g} of an anchor in a row")
    lines.append(f"ranges: {uwb.rate:.0f} in a second, {uwb.missing:.1%} missing of the usual interval's")
    if imu is not None:
        lines.append(f"imu: {imu.rate:.0f} samples in a second, {imu.missing:.1%} missing of the usual interval's")
    return [*lines, *found.notes]


def base_seen_from(file: Path, base: str) -> str:
    """Return the name by which the scenario in `file` must call a base: a ready-made scenario's name, or a file."""
    at = resolve(base, "--base")
    return base if at.stem == base else seen_from(file, at)


def seen_from(file: Path, other: Path) -> str:
    """Return another file's name relative to `file`'s folder."""
    return os.path.relpath(os.path.realpath(other), os.path.realpath(file.parent))


def scenario_text(noise: NoiseFile, noise_file: str, base: str, below: Scenario) -> str:
    """Return the text of a scenario with the errors of a noise file, laid over `base`; `below` is that base, loaded.

    It replaces the base's own errors of ranges and IMU. Files are named as the scenario must name them.
    """
    return yaml.safe_dump({"base": base} | settings_of(noise, noise_file, below.truth), sort_keys=False)
