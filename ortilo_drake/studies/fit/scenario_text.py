"""A scenario whose ranges and IMU err as a NOISE.yaml describes, as far as a scenario's settings say it.

Outliers, near-floor growth and fields are left out; a field's variance counts as that of errors that last. A scenario
has single ranges: of a difference's white variance each has a half.
"""

import os
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from ortilo_drake.scenario.load import resolve
from ortilo_drake.studies.fit.noise_file import NoiseFile


def base_seen_from(file: Path, base: str) -> str:
    """Return a base, a ready-made scenario's name or a file, as the scenario in `file` must name it."""
    at = resolve(base, "--base")
    return base if at.stem == base else os.path.relpath(os.path.realpath(at), os.path.realpath(file.parent))


def scenario_text(noise: NoiseFile, base: str) -> str:
    """Return a scenario file's text, laid over another scenario."""
    uwb, imu = noise.uwb, noise.imu
    lasts = [part.sd for part in (uwb.lasting, uwb.field) if part is not None]
    white = float(f"{uwb.white / np.sqrt(2.0 if uwb.differences else 1.0):.3g}")
    truth: dict[str, Any] = {"uwb": {"bias_sd": uwb.constants_sd}}
    if lasts:
        time = uwb.lasting.time if uwb.lasting is not None else 1.0
        truth["uwb"] |= {"slow_sd": float(f"{np.linalg.norm(lasts):.3g}"), "slow_time": time}
    data: dict[str, Any] = {"base": base, "uwb": {"noise": {"kind": "constant", "sd": white}}}
    if imu is not None:
        data["imu"] = {"rate_density": _rms(imu.rotation), "specific_force_density": _rms(imu.force)}
        truth["imu"] = {"rates_sd": _rms(imu.rotation_bias), "specific_force_sd": _rms(imu.force_bias)}
    return yaml.safe_dump(data | {"truth": truth}, sort_keys=False)


def _rms(axes: tuple[float, float, float]) -> float:
    return float(f"{np.sqrt(np.mean(np.square(axes))):.3g}")
