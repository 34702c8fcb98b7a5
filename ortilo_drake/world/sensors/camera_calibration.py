"""The calibration file: measurements of the rendered camera and its detector.

All tables are linear between their knots and constant beyond. Beyond the last distance nothing is found. Let a landmark
at distance d have the share a in the image and the share s not hidden. It is found with the probability

    P = found(class, d) inside(a) visible(s)

and its box, cut at the image's border and b px wide (high), has errors along u (v)

    center  e = m_c(b) g(s) g'(a) q_c(z),    width (height)  e = m_s(b) g(s) g'(a) q_s(z),

where m is the mean size of the error, g and g' its growth on hidden and on cut landmarks, and q maps a standard normal
number z to the error's quantile (in units of m). Successive pictures are alike, and so are their errors: z = sqrt(w)
z_slow + sqrt(1 - w) z_white, see projected_camera.py.
"""

from collections.abc import Mapping, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Annotated

from pydantic import Field, NonNegativeFloat, PositiveInt, model_validator

from ortilo_drake.model.input_files import exists
from ortilo_drake.model.typed_yaml import Frozen, InputError, Positive, load_yaml
from ortilo_drake.scenario.camera import MeasuredErrors
from ortilo_drake.scenario.link import Probability

CALIBRATION = Path(__file__).with_name("camera_calibration.yaml")
OTHER = "other"  # the class of landmarks that were not measured

Rates = tuple[Probability, ...]
Values = tuple[float, ...]
Sizes = tuple[Positive, ...]


class Source(Frozen):
    """The source of a calibration: flights of a scenario, the pictures in them, and the detector's digest.

    flown_by names the player that flew, empty in files that do not say it.
    """

    scenario: str
    seeds: tuple[int, ...]
    flown_by: str = ""
    pictures: PositiveInt
    landmarks_found: PositiveInt
    detector: str
    width: Annotated[int, Field(ge=16, le=8192)]


class Found(Frozen):
    """Detection rates by distance [m] for each class; factors by the shares inside the image and not hidden."""

    distance: Values
    rate: dict[str, Rates]
    inside: Values
    inside_factor: Rates
    visible: Values
    visible_factor: Rates


class BoxErrors(Frozen):
    """Errors of found boxes.

    size, center, extent: mean errors [px] by the box's width or height [px]. visible_growth, inside_growth: growth by
    the shares not hidden and inside the image. border_factor: factor for an edge at the image's border, by the share
    inside. quantiles: of the centre's u and v, width and height, in mean sizes, at the standard normal quantiles
    `normal`.
    """

    size: Values
    center: Sizes
    extent: Sizes
    visible_growth: Sizes
    inside_growth: Sizes
    border_factor: tuple[NonNegativeFloat, ...]
    normal: Values
    quantiles: dict[str, Values]


class Slow(Frozen):
    """The share of an error's variance that changes slowly, and how slowly: time between its nodes [s]."""

    share: Probability
    period: Positive


class FalseBoxes(Frozen):
    """False boxes: mean number per picture, share of each class, and quantiles of width and height [px]."""

    mean: Annotated[float, Field(ge=0.0, le=5.0)]
    classes: dict[str, Probability]
    width: Sizes
    height: Sizes


QUANTILES = ("center_u", "center_v", "width", "height")


class CameraCalibration(Frozen):
    """The errors of a camera and its detector."""

    source: Source
    found: Found
    errors: BoxErrors
    slow_errors: Slow
    slow_misses: Slow
    false_boxes: FalseBoxes

    @model_validator(mode="after")
    def _tables_fit(self) -> "CameraCalibration":
        found, errors = self.found, self.errors
        if OTHER not in found.rate:
            raise ValueError(f"found.rate: no rates for '{OTHER}' classes")
        if tuple(sorted(errors.quantiles)) != tuple(sorted(QUANTILES)):
            raise ValueError(f"errors.quantiles: {sorted(errors.quantiles)}: must be {sorted(QUANTILES)}")
        rates = {f"found.rate.{name}": rate for name, rate in found.rate.items()}
        inside = {"found.inside_factor": found.inside_factor, "errors.inside_growth": errors.inside_growth}
        inside |= {"errors.border_factor": errors.border_factor}
        visible = {"found.visible_factor": found.visible_factor, "errors.visible_growth": errors.visible_growth}
        sizes = {"errors.center": errors.center, "errors.extent": errors.extent}
        quantiles = {f"errors.quantiles.{name}": its for name, its in errors.quantiles.items()}
        width, heights = self.false_boxes.width, {"false_boxes.height": self.false_boxes.height}
        tables: list[tuple[str, Sequence[float], Mapping[str, Sequence[float]]]] = [
            ("found.distance", found.distance, rates),
            ("found.inside", found.inside, inside),
            ("found.visible", found.visible, visible),
            ("errors.size", errors.size, sizes),
            ("errors.normal", errors.normal, quantiles),
            ("false_boxes.width", range(len(width)), heights),
        ]
        for name, knots, columns in tables:
            if len(knots) < 2 or any(b <= a for a, b in pairwise(knots)):
                raise ValueError(f"{name}: {list(knots)}: needs two knots or more, rising")
            for column, values in columns.items():
                if len(values) != len(knots):
                    raise ValueError(f"{column}: {len(values)} values for the {len(knots)} of {name}")
        return self


def load_calibration(settings: MeasuredErrors) -> CameraCalibration:
    """Return the calibration that the settings name.

    InputError if its file is missing or wrong.
    """
    path = CALIBRATION if settings.file == "rendered" else Path(settings.file)
    if not exists(path):
        raise InputError(f"camera.errors.file: {path}: no such camera calibration (ortilo detector calibrate)")
    return load_yaml(CameraCalibration, path)
