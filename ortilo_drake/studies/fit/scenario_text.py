"""A scenario whose ranges and IMU err as a NOISE.yaml describes them."""

import os
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from ortilo_drake.scenario import Scenario
from ortilo_drake.scenario.load import resolve
from ortilo_drake.scenario.noise_file import NoiseFile
from ortilo_drake.scenario.truth import UwbTruth


def base_seen_from(file: Path, base: str) -> str:
    """Return a base, a ready-made scenario's name or a file, as the scenario in `file` must name it."""
    at = resolve(base, "--base")
    return base if at.stem == base else seen_from(file, at)


def seen_from(file: Path, other: Path) -> str:
    """Return another file's name relative to `file`'s folder."""
    return os.path.relpath(os.path.realpath(other), os.path.realpath(file.parent))


def scenario_text(noise: NoiseFile, noise_file: str, base: str, below: Scenario) -> str:
    """Return a scenario file's text, laid over another scenario, whose own errors of ranges and IMU it replaces.

    Args:
        noise: what was fitted.
        noise_file: its file, as the scenario must name it, or the name of one of the package.
        base: the other scenario, likewise.
        below: what that is.
    """
    imu, unfitted = noise.imu, UwbTruth()
    data: dict[str, Any] = {"base": base, "uwb": {"errors": "fitted", "file": noise_file}}
    truth: dict[str, Any] = {}
    if own := {name: getattr(unfitted, name) for name, value in below.truth.uwb if value != getattr(unfitted, name)}:
        truth["uwb"] = own
    if imu is not None:
        data["imu"] = {"rate_density": _rms(imu.rotation), "specific_force_density": _rms(imu.force)}
        truth["imu"] = {"rates_sd": _rms(imu.rotation_bias), "specific_force_sd": _rms(imu.force_bias)}
    return yaml.safe_dump(data | ({"truth": truth} if truth else {}), sort_keys=False)


def _rms(axes: tuple[float, float, float]) -> float:
    return float(f"{np.sqrt(np.mean(np.square(axes))):.3g}")
