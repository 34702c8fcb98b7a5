"""Settings of the landmark camera: its pictures or boxes, the errors of its detector, its calibration."""

from typing import Annotated, Literal

from pydantic import Field, NonNegativeFloat, model_validator

from ortilo_drake.model.lens import Coefficients, Distortion
from ortilo_drake.model.room import OWN_CAMERA, CameraModel, Side
from ortilo_drake.model.typed_yaml import FileName, Frozen, Positive
from ortilo_drake.scenario.link import Link, LinkRate, Probability
from ortilo_drake.scenario.sensors import SensorSetup


class MeasuredErrors(Frozen):
    """The measured errors of a detector."""

    kind: Literal["measured"] = "measured"
    file: FileName = "rendered"
    """'rendered' for the errors of our own detector on the rendered camera, or the path of a calibration file (ortilo
    detector calibrate)."""


class ParametricErrors(Frozen):
    """Errors of a detector, described by a few numbers and drawn anew in every tick."""

    kind: Literal["parametric"]
    edge_sd: NonNegativeFloat = 1.3
    """standard deviation of each box edge that the image's border does not cut [px]."""
    miss_base: Probability = 0.02
    """miss rate at distance 0 [1]."""
    miss_per_metre: NonNegativeFloat = 0.02
    """growth of the miss rate with distance [1/m]."""
    max_distance: Positive = 12.0
    """distance beyond which a landmark is never found [m]."""
    min_size: NonNegativeFloat = 6.0
    """a landmark whose box is smaller than this in either direction is never found [px]."""
    min_visible: Probability = 0.6
    """a landmark can only be found if walls and stands leave at least this share of it visible [1]."""
    false_boxes: Annotated[float, Field(ge=0.0, le=5.0)] = 0.1
    """mean number of false boxes per image (Poisson) [1]."""


CameraErrors = Annotated[MeasuredErrors | ParametricErrors, Field(discriminator="kind")]


class Calibration(Frozen):
    """A calibrated camera that replaces the room's camera; a file of Kalibr, ROS or OpenCV may be named instead."""

    width: Side
    """width of the pictures used for calibration [px]; camera.width scales the calibration."""
    height: Side
    """height of the pictures used for calibration [px]."""
    focal_length: tuple[Positive, Positive]
    """focal lengths along width and height [px]."""
    center: tuple[float, float]
    """principal point; the first pixel's centre is (0, 0) [px]."""
    distortion: Distortion = "none"
    """model of the lens distortion: 'brown_conrady' is OpenCV's usual model (plumb_bob, rational_polynomial, radtan),
    'fisheye' is OpenCV's fisheye model (equidistant)."""
    coefficients: Coefficients = ()
    """distortion coefficients [1]: k1, k2, p1, p2, and optionally k3, or k3, k4, k5, k6, with 'brown_conrady'; k1, k2,
    k3, k4 with 'fisheye'."""

    @model_validator(mode="after")
    def _is_a_camera(self) -> "Calibration":
        self.on(OWN_CAMERA).check_lens()
        return self

    def on(self, camera: CameraModel) -> CameraModel:
        """Return the calibrated camera, at the position of the room's camera."""
        f_u, f_v = self.focal_length
        its = {"focal_length": f_u, "aspect": f_v / f_u, "position": camera.position}
        return CameraModel.model_construct(**(self.model_dump() | its))


class CameraSetup(SensorSetup):
    """The settings of the landmark camera that the onboard half knows."""

    link: LinkRate = LinkRate(rate=10.0)
    """rate of the pictures or boxes."""
    kind: Literal["projected", "rendered"] = "projected"
    """'rendered' draws pictures for a detector. 'projected' computes boxes with the measured errors of our detector,
    eighty times as fast."""
    width: Annotated[int, Field(ge=16, le=8192)] = 320
    """image width, to which the room's camera is scaled [px]: 16 to 8192, or 64 to 2048 if the camera is rendered."""
    latency: Annotated[int, Field(ge=0, le=1000)] = 1
    """time from picture to boxes [ticks]; at least 1 if the camera is rendered (its detector needs about a third of a
    tick of 1/30 s)."""
    calibration: Calibration | None = None
    """the calibrated camera; null uses the room's camera. A scenario file, or `--set`, may name a file of Kalibr, ROS
    (camera_info) or OpenCV (FileStorage) instead, by a path as in `room`."""

    @model_validator(mode="after")
    def _can_be_rendered(self) -> "CameraSetup":
        if self.kind == "rendered" and not 64 <= self.width <= 2048:
            raise ValueError(f".width: {self.width}: must be 64 to 2048 where the camera is rendered")
        if self.kind == "rendered" and self.latency < 1:
            raise ValueError(f".latency: {self.latency}: must be at least 1 tick where the camera is rendered")
        return self


class Camera(CameraSetup):
    """The landmark camera: pictures or boxes, and their link."""

    link: Link = Link(rate=10.0)
    """rate and delivery of the pictures or boxes."""
    errors: CameraErrors = MeasuredErrors()
    """missed landmarks, box errors and false boxes, for a projected camera and for the theory."""
