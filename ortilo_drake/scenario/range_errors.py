"""The errors of ranges, as `ortilo fit` finds them in recordings: NOISE.yaml's `uwb`."""

import math
from typing import Annotated

import numpy as np
from pydantic import Field, NonNegativeFloat
from scipy.special import gammaincinv

from ortilo_drake.model.typed_yaml import Frozen, Positive

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
