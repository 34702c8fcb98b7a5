"""NOISE.yaml: the sensor errors of a simulation, fitted to recordings."""

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


SCALES = 6  # number of normals that stand for a heavy tail


def white_scales(freedom: float | None) -> np.ndarray:
    """Return equally likely factors of the white standard deviation: 1 if errors are normal, else Student's (SCALES).

    Student's t with n degrees of freedom is a mixture of normals with variances n / chi^2 (Lange, Little and Taylor,
    J. Am. Stat. Assoc. 84, 1989). The medians of six equally likely parts stand for all, so factors stay bounded.
    """
    if freedom is None:
        return np.ones(1)
    return np.asarray(np.sqrt(0.5 * freedom / gammaincinv(0.5 * freedom, (np.arange(SCALES) + 0.5) / SCALES)))


class LastingNoise(Frozen):
    """A first-order Gauss-Markov error of each anchor."""

    time: Positive
    """correlation time of the error [s]."""
    sd: NonNegativeFloat
    """standard deviation [m]."""


class FieldNoise(Frozen):
    """An error of each anchor that is a Matérn 3/2 field in space, the same for all flights of a day."""

    length: Positive
    """length scale of the field [m]."""
    sd: NonNegativeFloat
    """standard deviation [m]."""


class Outliers(Frozen):
    """Rows with an additional error."""

    share: Share = 0.0
    """share of outliers among all rows [1]."""
    sd: NonNegativeFloat = 0.0
    """standard deviation of the additional error [m]."""
    burst: Annotated[float, Field(ge=1.0, le=1e4)] = 1.0
    """mean number of successive rows of an anchor that are outliers [1]."""


class UwbNoise(Frozen):
    """Errors of ranges, or of each anchor in a difference of ranges."""

    white: NonNegativeFloat
    """standard deviation of a row's white error [m]; the scale of Student's t if `freedom` is given."""
    freedom: Annotated[float, Field(ge=0.5, le=100.0)] | None = None
    """degrees of freedom of the white error's Student's t [1], fewer for a heavier tail; null for normal errors."""
    lasting: LastingNoise | None = None
    """the lasting part of each anchor's error; null for none."""
    field: FieldNoise | None = None
    """the part of each anchor's error that depends on the place; null for none."""
    outliers: Outliers = Outliers()
    """rows with an additional error."""
    constants_sd: NonNegativeFloat = 0.0
    """root mean square of the anchors' constant errors [m]."""
    constants: Annotated[tuple[Length, ...], Field(max_length=1000)] | None = None
    """constant error of each anchor [m], if known; null draws them with constants_sd."""
    differences: bool = False
    """whether the noise was fitted to differences: white errors and outliers are then the ones of two anchors."""
    near_floor: NonNegativeFloat = 0.0
    """height at which the floor doubles the errors [m]: they are multiplied by 1 + (near_floor / height)^4."""
    rate: NonNegativeFloat = 0.0
    """rows per second from all anchors [1/s]; for information only."""
    missing: Share = 0.0
    """share of the rows that do not arrive [1]."""

    @property
    def white_rms(self) -> float:
        """The root mean square of the white error with its tail [m]."""
        return self.white * float(np.sqrt(np.mean(white_scales(self.freedom) ** 2)))

    @property
    def of_single_ranges(self) -> "UwbNoise":
        """The errors of single ranges.

        A difference has the white noise of two ranges and is an outlier if one of them is. So a range has half the
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
    """White noise of the IMU in flight by axis, the spread of its biases, and its rate."""

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
    """The fitted noise, the intervals of its numbers by name, and the recordings to which it was fitted."""

    source: str = ""
    uwb: UwbNoise
    imu: ImuNoise | None = None
    intervals: dict[str, tuple[float, float]] = Field(
        default={}, description="95 % of each number, by its name as uwb.lasting.time."
    )
    recordings: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()


def preset_names() -> list[str]:
    """Return the names of the noise files that come with the package."""
    return sorted(path.stem for path in PRESETS.glob("*.yaml"))


def load_noise(name_or_file: str, field: str = "noise", folder: Path = Path()) -> NoiseFile:
    """Read a NOISE.yaml relative to `folder`, or one of the package's; InputError, naming `field`, if it is wrong."""
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
    """Return the text of a NOISE.yaml, without default values."""
    return yaml.safe_dump(noise.model_dump(mode="json", exclude_defaults=True), sort_keys=False, allow_unicode=True)


def as_white(noise: NoiseFile) -> NoiseFile:
    """Return white noise of the same size: the lasting errors become white too."""
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

    `file` is the file's name in the scenario. `below` is the truth of the scenario's base; its range errors are reset.
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
