"""Settings of the robust form of the paper's filter."""

from typing import Annotated, Literal

from pydantic import Field, NonNegativeFloat

from ortilo_drake.model.typed_yaml import Frozen, Positive
from ortilo_drake.scenario.onboard import Gate


class HuberWeight(Frozen):
    """Huber's weight: a value weighs less the farther it is, from some distance on."""

    kind: Literal["huber"] = "huber"
    c: Annotated[float, Field(ge=0.1, le=100.0)] = 4.0
    """Mahalanobis distance d of a value from its prediction up to which it weighs in full; beyond, its covariance is
    taken d / c times as large [1]."""


class StudentWeight(Frozen):
    """The weight of Student's t distribution, whose tails are longer than the Gaussian's."""

    kind: Literal["student_t"]
    dof: Annotated[float, Field(ge=1.0, le=1000.0)] = 5.0
    """degrees of freedom nu; the covariance of a value of m rows is taken (nu + d^2) / (nu + m) times as large where
    that is more than 1 [1]."""


class Adaptation(Frozen):
    """Noise that is taken for larger while innovations are larger than believed."""

    time: Positive = 5.0
    """over which the squared Mahalanobis distance of accepted values, per row, is averaged [s]."""
    tolerates: Annotated[float, Field(ge=1.0, le=100.0)] = 2.0
    """average up to which the noise stays what it is believed to be [1]; it is 1 where all is right."""
    most: Annotated[float, Field(ge=1.0, le=1e4)] = 16.0
    """factor on a covariance at most [1]."""


class Opening(Frozen):
    """By how much the filter believes its estimate less where it is opened; standard deviations per axis."""

    position: NonNegativeFloat = 0.5
    """[m]."""
    angle: NonNegativeFloat = 0.1
    """of roll, pitch and yaw [rad]."""
    velocity: NonNegativeFloat = 0.3
    """[m/s]."""
    rate: NonNegativeFloat = 0.1
    """of the Euler rates [rad/s]."""
    gyroscope: NonNegativeFloat = 0.01
    """of the gyroscope's bias, where it is estimated [rad/s]."""


class Robust(Frozen):
    """The filter's treatment of values beyond their believed noise; no effect on values within it."""

    gate: Gate = 0.999999
    """probability that a correct value is used [1]: a value is rejected if its squared Mahalanobis distance from the
    filter's prediction exceeds the chi-square quantile."""
    weight: Annotated[HuberWeight | StudentWeight, Field(discriminator="kind")] = HuberWeight()
    """how much values within the gate count."""
    adaptation: Adaptation | None = Adaptation()
    """how the believed noise of each sensor follows its innovations; null keeps it."""
    reacquire_after: Annotated[float, Field(ge=0.1, le=60.0)] = 1.0
    """if a sensor was rejected for so long [s], and no other that measures the same was used, it is trusted more than
    the estimate: the estimate's covariance is increased."""
    opening: Opening = Opening()
    """by how much."""
    drift: Annotated[float, Field(ge=0.1, le=60.0)] | None = 1.0
    """time over which innovations of the imu's angles are averaged [s]; if their mean is not 0, by the gate's
    probability, the gyroscope's bias is estimated anew. Only with rates 'measured'; null for no such test."""
    stuck: Annotated[int, Field(ge=2, le=1000)] | None = 3
    """after so many messages [1] in a row with the same content a sensor counts as stuck; it is ignored until its
    values change. null for no such test."""
