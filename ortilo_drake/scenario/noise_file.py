"""NOISE.yaml: what recordings tell a simulation of its sensors' errors."""

import math
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import yaml
from pydantic import Field, NonNegativeFloat
from scipy.special import gammaincinv

from ortilo_drake.model.input_files import read_text
from ortilo_drake.model.typed_yaml import Frozen, InputError, Positive, nearest, parse_yaml, validate
from ortilo_drake.scenario.truth import Truth, UwbTruth

Share = Annotated[float, Field(ge=0.0, le=0.5)]
Length = Annotated[float, Field(ge=-100.0, le=100.0)]


SCALES = 6  # normals of a heavy tail


def white_scales(freedom: float | None) -> np.ndarray:
    """Return the factors of the white deviation, each as likely: one, or those of Student's t.

    Student's t is a mixture of normals, of variances n / chi^2 at n degrees of freedom (Lange, Little and Taylor,
    J. Am. Stat. Assoc. 84, 1989). The quantiles of six equal parts stand for all, so that no row errs without bounds.
    """
    if freedom is None:
        return np.ones(1)
    return np.asarray(np.sqrt(0.5 * freedom / gammaincinv(0.5 * freedom, (np.arange(SCALES) + 0.5) / SCALES)))


class LastingNoise(Frozen):
    """A first-order Gauss-Markov error of each anchor."""

    time: Positive
    """how long it lasts, its correlation time [s]."""
    sd: NonNegativeFloat
    """standard deviation [m]."""


class FieldNoise(Frozen):
    """An error of each anchor that is a field in space, Matérn 3/2, the same for all flights of a day."""

    length: Positive
    """over which it changes [m]."""
    sd: NonNegativeFloat
    """standard deviation [m]."""


class Outliers(Frozen):
    """Rows that err by more."""

    share: Share = 0.0
    """of all rows [1]."""
    sd: NonNegativeFloat = 0.0
    """standard deviation of the addition [m]."""
    burst: Annotated[float, Field(ge=1.0, le=1e4)] = 1.0
    """how many rows of an anchor in a row are outliers, on average [1]."""


class UwbNoise(Frozen):
    """Errors of ranges, or of each anchor in a difference of ranges."""

    white: NonNegativeFloat
    """standard deviation of a row's white error [m]; Student's t scale if `freedom` is given."""
    freedom: Annotated[float, Field(ge=0.5, le=100.0)] | None = None
    """Student's t degrees of freedom of the white error [1], fewer for a heavier tail; null if it is normal."""
    lasting: LastingNoise | None = None
    """the lasting part of each anchor's error; null for none."""
    field: FieldNoise | None = None
    """the part that belongs to places; null for none."""
    outliers: Outliers = Outliers()
    """rows that err by more."""
    constants_sd: NonNegativeFloat = 0.0
    """root mean square of the anchors' constants [m]."""
    constants: Annotated[tuple[Length, ...], Field(max_length=1000)] | None = None
    """each anchor's constant [m], if they are known; null has them drawn by constants_sd."""
    differences: bool = False
    """whether the rows that it was fitted to are differences: white and outliers are those of two anchors then."""
    near_floor: NonNegativeFloat = 0.0
    """height at which the floor doubles errors: they grow by (this / height)^4 [m]."""
    rate: NonNegativeFloat = 0.0
    """rows in a second, of all anchors; a figure [1/s]."""
    missing: Share = 0.0
    """share of the rows that do not come [1]."""

    @property
    def white_rms(self) -> float:
        """The root mean square of the white error, its tail with it [m]."""
        return self.white * float(np.sqrt(np.mean(white_scales(self.freedom) ** 2)))

    @property
    def of_single_ranges(self) -> "UwbNoise":
        """The errors of single ranges.

        A difference has the white noise of two ranges, and errs by more where one of them does: a range has half the
        white variance, and is an outlier with probability 1 - sqrt(1 - share).
        """
        if not self.differences:
            return self
        outliers = self.outliers.model_copy(update={"share": 1.0 - math.sqrt(1.0 - self.outliers.share)})
        update = {"white": self.white / math.sqrt(2.0), "outliers": outliers, "differences": False}
        return self.model_copy(update=update)


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
