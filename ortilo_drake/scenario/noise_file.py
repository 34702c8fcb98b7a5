"""NOISE.yaml: what recordings tell a simulation of its sensors' errors."""

import math
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from pydantic import Field, NonNegativeFloat

from ortilo_drake.model.input_files import read_text
from ortilo_drake.model.typed_yaml import Frozen, InputError, Positive, nearest, parse_yaml, validate
from ortilo_drake.scenario.range_errors import Outliers, Share, UwbNoise
from ortilo_drake.scenario.truth import Truth, UwbTruth

PRESETS = Path(__file__).parent / "presets"
Three = tuple[NonNegativeFloat, NonNegativeFloat, NonNegativeFloat]


class ImuNoise(Frozen):
    """White noise of the IMU in flight, by axis, the spread of its biases, and its rate."""

    rotation: Three = Field(description="Body rates [rad/s/√Hz].")
    force: Three = Field(description="Specific force [m/s²/√Hz].")
    rotation_rest: Three | None = Field(default=None, description="The same before take-off; a figure.")
    force_rest: Three | None = Field(default=None, description="The same before take-off; a figure.")
    rotation_bias: Three = Field(default=(0.0, 0.0, 0.0), description="Spread of the biases of a flight [rad/s].")
    force_bias: Three = Field(default=(0.0, 0.0, 0.0), description="Spread of the biases of a flight [m/s²].")
    bandwidth: Positive = Field(default=40.0, description="Of the unit's low-pass, by which its noise passes [Hz].")
    rate: NonNegativeFloat = Field(default=0.0, description="Samples in a second; a figure.")
    missing: Share = Field(default=0.0, description="Share of the samples that do not come; a figure.")


class NoiseFile(Frozen):
    """The fitted noise, its intervals by name, and the recordings that it was fitted to."""

    source: str = ""
    uwb: UwbNoise
    imu: ImuNoise | None = None
    intervals: dict[str, tuple[float, float]] = Field(
        default={}, description="95 % of each number, by its name as uwb.lasting.time."
    )
    recordings: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()


def preset_names() -> list[str]:
    """Return the names of the files that come with the package."""
    return sorted(path.stem for path in PRESETS.glob("*.yaml"))


def load_noise(name_or_file: str, field: str = "noise", folder: Path = Path()) -> NoiseFile:
    """Read NOISE.yaml, meant from a folder, or one of the package; InputError, by a field, if it is wrong."""
    path = folder / name_or_file
    if path.suffix not in (".yaml", ".yml"):
        names = preset_names()
        if name_or_file not in names:
            known, shown = " ".join(names), name_or_file[:100]
            raise InputError(
                f"{field}: {shown!r} is unknown{nearest(shown, names)}: give a .yaml file or one of {known}"
            )
        path = PRESETS / f"{name_or_file}.yaml"
    return validate(NoiseFile, parse_yaml(read_text(path), str(path)), str(path))


def noise_text(noise: NoiseFile) -> str:
    """Return the file's text, without default values."""
    return yaml.safe_dump(noise.model_dump(mode="json", exclude_defaults=True), sort_keys=False, allow_unicode=True)


def as_white(noise: NoiseFile) -> NoiseFile:
    """Return white noise of the same size: what lasts of the errors is drawn anew for each row."""
    uwb = noise.uwb
    lasts = sum(part.sd**2 for part in (uwb.lasting, uwb.field) if part is not None)
    white = math.sqrt(uwb.white_rms**2 + (2.0 if uwb.differences else 1.0) * lasts)
    outliers = Outliers(share=uwb.outliers.share, sd=uwb.outliers.sd)
    plain = uwb.model_copy(
        update={"white": white, "freedom": None, "lasting": None, "field": None, "outliers": outliers}
    )
    return noise.model_copy(update={"uwb": plain})


def settings_of(noise: NoiseFile, file: str, below: Truth) -> dict[str, Any]:
    """Return the settings of a scenario whose ranges and IMU have the errors of a NOISE.yaml.

    The scenario names the file so; its base has the truth `below`, whose own errors of the ranges are set back to none.
    """
    imu, unfitted = noise.imu, UwbTruth()
    found: dict[str, Any] = {"uwb": {"errors": "fitted", "file": file}}
    truth: dict[str, Any] = {}
    if own := {name: getattr(unfitted, name) for name, value in below.uwb if value != getattr(unfitted, name)}:
        truth["uwb"] = own
    if imu is not None:
        found["imu"] = {"rate_density": _rms(imu.rotation), "specific_force_density": _rms(imu.force)}
        truth["imu"] = {"rates_sd": _rms(imu.rotation_bias), "specific_force_sd": _rms(imu.force_bias)}
    return found | ({"truth": truth} if truth else {})


def _rms(axes: tuple[float, float, float]) -> float:
    return float(f"{np.sqrt(np.mean(np.square(axes))):.3g}")
