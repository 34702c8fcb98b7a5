"""The errors of ranges, as `ortilo fit` finds them in recordings: NOISE.yaml's `uwb`."""

import math
from typing import Annotated

from pydantic import Field, NonNegativeFloat

from ortilo_drake.model.typed_yaml import Frozen, Positive

Share = Annotated[float, Field(ge=0.0, le=0.5)]
Length = Annotated[float, Field(ge=-100.0, le=100.0)]


class LastingNoise(Frozen):
    """A first-order Gauss-Markov error of each anchor.

    Attributes:
        time: how long it lasts, its correlation time [s].
        sd: standard deviation [m].
    """

    time: Positive
    sd: NonNegativeFloat


class FieldNoise(Frozen):
    """An error of each anchor that is a field in space, Matérn 3/2, the same for all flights of a day.

    Attributes:
        length: over which it changes [m].
        sd: standard deviation [m].
    """

    length: Positive
    sd: NonNegativeFloat


class Outliers(Frozen):
    """Rows that err by more.

    Attributes:
        share: of all rows [1].
        sd: standard deviation of the addition [m].
        burst: how many rows of an anchor in a row are outliers, on average [1].
    """

    share: Share = 0.0
    sd: NonNegativeFloat = 0.0
    burst: Annotated[float, Field(ge=1.0, le=1e4)] = 1.0


class UwbNoise(Frozen):
    """Errors of ranges, or of each anchor in a difference of ranges.

    Attributes:
        white: standard deviation of a row's white error [m].
        lasting: the lasting part of each anchor's error; null for none.
        field: the part that belongs to places; null for none.
        outliers: rows that err by more.
        constants_sd: root mean square of the anchors' constants [m].
        constants: each anchor's constant [m], if they are known; null has them drawn by constants_sd.
        differences: whether the rows that it was fitted to are differences: white and outliers are those of two
            anchors then.
        near_floor: height at which the floor doubles errors: they grow by (this / height)^4 [m].
        rate: rows in a second, of all anchors; a figure [1/s].
        missing: share of the rows that do not come [1].
    """

    white: NonNegativeFloat
    lasting: LastingNoise | None = None
    field: FieldNoise | None = None
    outliers: Outliers = Outliers()
    constants_sd: NonNegativeFloat = 0.0
    constants: Annotated[tuple[Length, ...], Field(max_length=1000)] | None = None
    differences: bool = False
    near_floor: NonNegativeFloat = 0.0
    rate: NonNegativeFloat = 0.0
    missing: Share = 0.0

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
