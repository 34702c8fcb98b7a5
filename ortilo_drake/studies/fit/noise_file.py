"""NOISE.yaml: what recordings tell a simulation of its sensors' errors."""

from pathlib import Path
from typing import Annotated

import yaml
from pydantic import Field, NonNegativeFloat

from ortilo_drake.model.input_files import read_text
from ortilo_drake.model.typed_yaml import Frozen, InputError, Positive, nearest, parse_yaml, validate

PRESETS = Path(__file__).parent / "presets"
Three = tuple[NonNegativeFloat, NonNegativeFloat, NonNegativeFloat]
Share = Annotated[float, Field(ge=0.0, le=0.5)]


class LastingNoise(Frozen):
    """A first-order Gauss-Markov error of each anchor."""

    time: Positive = Field(description="How long it lasts [s].")
    sd: NonNegativeFloat = Field(description="Standard deviation [m].")


class FieldNoise(Frozen):
    """An error of each anchor that is a field in space, Matérn 3/2, the same for all flights of a day."""

    length: Positive = Field(description="Length over which it changes [m].")
    sd: NonNegativeFloat = Field(description="Standard deviation [m].")


class Outliers(Frozen):
    """Rows that err by more."""

    share: Share = Field(default=0.0, description="Of all rows.")
    sd: NonNegativeFloat = Field(default=0.0, description="Standard deviation of what is added [m].")
    burst: Annotated[float, Field(ge=1.0, le=1e4)] = Field(
        default=1.0, description="How many rows of an anchor in a row are outliers, on average."
    )


class UwbNoise(Frozen):
    """Errors of ranges, or of each anchor in a difference of ranges."""

    white: NonNegativeFloat = Field(description="Standard deviation of a row's white error [m].")
    lasting: LastingNoise | None = None
    field: FieldNoise | None = None
    outliers: Outliers = Outliers()
    constants_sd: NonNegativeFloat = Field(default=0.0, description="Root mean square of the anchors' constants [m].")
    constants: tuple[float, ...] | None = Field(default=None, description="Each anchor's constant [m], if known.")
    differences: bool = Field(default=False, description="Whether the rows that it was fitted to are differences.")
    near_floor: NonNegativeFloat = Field(
        default=0.0, description="Height [m] at which the floor doubles errors: they grow by (this / height)^4."
    )
    rate: NonNegativeFloat = Field(default=0.0, description="Rows in a second, of all anchors; a figure.")
    missing: Share = Field(default=0.0, description="Share of the rows that do not come; a figure.")


class ImuNoise(Frozen):
    """White noise of the IMU in flight, by axis, and what holds all flight long."""

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
    """What was fitted, its intervals by name, and what it was fitted to."""

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


def load_noise(name_or_file: str) -> NoiseFile:
    """Read NOISE.yaml or one that comes with the package; InputError if anything is wrong."""
    path = Path(name_or_file)
    if path.suffix not in (".yaml", ".yml"):
        names = preset_names()
        if name_or_file not in names:
            known = " ".join(names)
            raise InputError(
                f"noise: '{name_or_file}' is unknown{nearest(name_or_file, names)}: give a .yaml file or one of {known}"
            )
        path = PRESETS / f"{name_or_file}.yaml"
    return validate(NoiseFile, parse_yaml(read_text(path), str(path)), str(path))


def noise_text(noise: NoiseFile) -> str:
    """Return the file's text, without what is as by default."""
    return yaml.safe_dump(noise.model_dump(mode="json", exclude_defaults=True), sort_keys=False, allow_unicode=True)
