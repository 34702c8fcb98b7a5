"""Settings of the onboard half apart from its estimator: detector, fixes and servo."""

import math
from typing import Annotated, Literal

from pydantic import Field, NonNegativeFloat, model_validator

from ortilo_drake.model.measurement import ATTITUDE_CAMERA, CAMERA, Row
from ortilo_drake.model.typed_yaml import FileName, Frozen, Positive
from ortilo_drake.scenario.sensors import ProportionalNoise, RangeNoise

PositiveVec3 = tuple[Positive, Positive, Positive]
Gate = Annotated[float, Field(gt=0.0, lt=1.0)]
Share = Annotated[float, Field(ge=0.0, le=10.0)]
Worth = Annotated[float, Field(ge=1.0, le=1.0e6)]


class Exclusion(Frozen):
    """The test that excludes ranges that do not fit the others."""

    probability: Gate = 0.9999
    """probability that correct ranges pass the chi-square test of their residuals [1]."""
    least_ranges: Annotated[int, Field(ge=5, le=1000)] = 5
    """smallest number of ranges from which one may be excluded [1]."""
    share: Annotated[float, Field(ge=0.0, le=0.9)] = 0.5
    """largest share of the ranges that may be excluded [1]; if more do not fit, there is no fix."""
    clock: bool = True
    """whether to also estimate an offset common to all ranges, such as a clock offset."""


class Multilateration(Frozen):
    """Position from ranges."""

    method: Literal["nearest_three", "least_squares"] = "least_squares"
    """'nearest_three' intersects the spheres of the three nearest anchors, as the authors do; 'least_squares' is
    weighted nonlinear least squares over all ranges."""
    noise: RangeNoise = ProportionalNoise()
    """noise of the ranges that the solver assumes."""
    bias_sd: NonNegativeFloat = 0.0
    """standard deviation of the lasting part of a range's error [m]: the range's bias and the survey error of its
    anchor. It changes the weights of 'least_squares' and the test whether ranges fit a position, but not the fix's
    covariance: estimator.biases.uwb_sd describes the lasting part of a fix's error."""
    bias_bank: Annotated[tuple[Share, ...], Field(min_length=2, max_length=8)] | None = None
    """shares of bias_sd [1], such as [0, 0.4, 1] for a survey that may be exact; the residuals of the ranges choose
    among them in flight. The result replaces estimator.biases.uwb_sd. null uses bias_sd as it is. Only with
    'least_squares', and without exclude."""
    noise_scale: Worth | None = None
    """number of residuals [1] that the configured noise counts as (10 is about one fix of twelve ranges) while the
    noise's scale is learned in flight from the ranges' residuals, together with bias_bank. null uses the noise as it
    is. Only with 'least_squares', and without exclude."""
    exclude: Exclusion | None = None
    """the test that excludes ranges that do not fit the others; null excludes none. Only with 'least_squares'."""

    @model_validator(mode="after")
    def _has_what_it_learns_of(self) -> "Multilateration":
        others = self.method != "least_squares"
        if self.exclude is not None and others:
            raise ValueError(f".exclude: must be null with method {self.method!r}: it needs 'least_squares'")
        learns = [name for name in ("bias_bank", "noise_scale") if getattr(self, name) is not None]
        if learns and (others or self.exclude is not None):
            unfit, too = f"method {self.method!r}" if others else "exclude", ", and so must ".join(["", *learns[1:]])
            raise ValueError(f".{learns[0]}: must be null with {unfit}{too}: the residuals of all ranges are needed")
        if self.bias_bank is not None and self.bias_sd == 0.0:
            raise ValueError(".bias_bank: must be null without bias_sd: it holds shares of bias_sd")
        if (size := sum(self.noise.sds)) <= 0.0:
            raise ValueError(f".noise: {size}: must be greater than 0, ranges are weighted by it")
        return self


class Detector(Frozen):
    """The network that finds landmarks in the rendered camera's pictures: ours, or one from a file."""

    kind: Literal["network"] = "network"
    cfg: FileName | None = None
    """a Darknet .cfg to use instead of our network, together with `weights`; needs torch."""
    weights: FileName | None = None
    """the .weights file of `cfg`."""
    onnx: FileName | None = None
    """an ONNX file of YOLOv5, v8 or v11 to use instead of our network; needs onnxruntime."""
    names: FileName | None = None
    """a file of the class names of `cfg` or `onnx`, one a line; by default FILE.names beside FILE.cfg, the names in the
    ONNX file, or the 80 classes of MS COCO."""
    backend: Literal["auto", "onnxruntime", "opencv", "torch"] = "auto"
    """library that computes our network: 'onnxruntime' is the fastest, 'opencv' is always installed, 'torch' trained
    the network; 'auto' uses the first of these that is installed."""
    threshold: Annotated[float, Field(gt=0.0, lt=1.0)] = 0.4
    """smallest score of a box [1]."""
    overlap: Annotated[float, Field(gt=0.0, lt=1.0)] = 0.45
    """IoU [1] above which two boxes of the same class count as one object."""

    @model_validator(mode="after")
    def _files_come_together(self) -> "Detector":
        if (self.cfg is None) != (self.weights is None):
            raise ValueError(f".cfg {self.cfg!r}, .weights {self.weights!r}: give both or neither")
        if self.cfg is not None and self.backend not in ("auto", "torch"):
            raise ValueError(f".backend {self.backend!r}: is for our own network, a .cfg takes 'auto' or 'torch'")
        if self.onnx is not None and self.cfg is not None:
            raise ValueError(f".onnx {self.onnx!r}, .cfg {self.cfg!r}: give one of them")
        if self.onnx is not None and self.backend not in ("auto", "onnxruntime"):
            raise ValueError(f".backend {self.backend!r}: a file of .onnx takes 'auto' or 'onnxruntime'")
        return self

    @property
    def files(self) -> dict[str, str]:
        """The files of the user's network by their keys; empty for our network."""
        named = {key: getattr(self, key) for key in ("cfg", "weights", "onnx", "names")}
        return {key: file for key, file in named.items() if file is not None}


class LandmarkFix(Frozen):
    """Position from landmark boxes."""

    method: Literal["known_attitude", "known_tilt", "pose", "cosine_law", "pnp"] = "known_attitude"
    """'known_attitude' (two landmarks or more; attitude from the filter), 'known_tilt' (two or more; roll and pitch
    from the filter; solves for position and yaw), 'pose' (two or more; solves for position and attitude), 'cosine_law'
    (three or more; the paper's method) or 'pnp' (four or more; OpenCV's SQPNP in RANSAC)."""
    center_sd: Positive = 3.0
    """standard deviation of a small box's centre that the solver assumes [px]."""
    center_growth: NonNegativeFloat = 0.0
    """g [1/px]: a box that is b px long along an axis has the error center_sd sqrt(1 + (g b)^2) along this axis."""
    gate: Annotated[float, Field(gt=0.0, lt=1.0)] = 0.999
    """probability [1] of the gate about a landmark's predicted projection; boxes beyond it are not associated."""
    max_residual: Positive = 4.0
    """number of standard deviations [1] by which a box may disagree with the rest; 'known_attitude', 'known_tilt' and
    'pose' drop boxes beyond it."""
    margin: NonNegativeFloat = 0.0
    """a box is ignored if assigning it to another landmark increases the sum of squared distances by less than this
    [1]; 0 ignores none."""
    joint: Gate | None = None
    """probability [1] of a test of all boxes together against the estimate: boxes are ignored until the rest pass.
    While no fix is left, the estimate is trusted less and less. null for no test."""
    inside: NonNegativeFloat | None = None
    """a landmark is ignored if its predicted box ends nearer to the image's border than this [px]; null uses the
    detected box alone."""
    prior_sd: tuple[Positive, Positive] | None = None
    """assumed error of the estimate's position [m] and angles [rad] for the association; null uses the filter's
    covariance."""
    survey_sd: NonNegativeFloat = 0.0
    """standard deviation of each coordinate of a landmark's surveyed position [m]. It is added to the errors of boxes.
    The lasting part of a fix's error is estimator.biases.camera_sd, or the result of survey_bank."""
    survey_bank: Annotated[tuple[Share, ...], Field(min_length=2, max_length=8)] | None = None
    """shares of survey_sd [1]; the residuals of the boxes choose among them in flight, as in multilateration.bias_bank.
    The result is added to estimator.biases.camera_sd. null uses survey_sd as it is. Only with method 'pose'."""
    noise_scale: Worth | None = None
    """number of residuals [1] that center_sd counts as while its scale is learned in flight from the boxes' residuals,
    as in multilateration.noise_scale. null uses center_sd as it is. Only with method 'pose'."""
    shapes: Literal["outlines", "boxes"] = "outlines"
    """known shapes of the landmarks: 'outlines' are the outlines in the room's file, 'boxes' only the sizes."""

    @model_validator(mode="after")
    def _has_what_the_bank_shares(self) -> "LandmarkFix":
        if self.survey_bank is not None and (self.method != "pose" or self.survey_sd == 0.0):
            raise ValueError(".survey_bank: must be null without survey_sd, whose shares it holds, and method 'pose'")
        if self.noise_scale is not None and self.method != "pose":
            raise ValueError(f".noise_scale: must be null with method {self.method!r}: it needs 'pose'")
        return self

    @property
    def rows(self) -> tuple[Row, ...]:
        """The rows of y that a fix fills."""
        more = {"known_tilt": ATTITUDE_CAMERA[2:], "pose": ATTITUDE_CAMERA}
        return CAMERA + more.get(self.method, ())


class ServoWeights(Frozen):
    """Diagonals of the servo's Q (by group of states) and R."""

    position: PositiveVec3 = (6.0, 6.0, 6.0)
    """weights of x, y, z [1/m^2]."""
    angle: tuple[NonNegativeFloat, NonNegativeFloat, Positive] = (1.0, 1.0, 1.0)
    """weights of roll, pitch, yaw [1/rad^2]."""
    velocity: tuple[NonNegativeFloat, NonNegativeFloat, NonNegativeFloat] = (1.0, 1.0, 1.0)
    """weights of the velocity [s^2/m^2]."""
    rate: tuple[NonNegativeFloat, NonNegativeFloat, NonNegativeFloat] = (0.1, 0.1, 0.1)
    """weights of the Euler rates [s^2/rad^2]."""
    integral: PositiveVec3 = (3.0e-4, 3.0e-4, 3.0e-4)
    """weights of the integral states, which are sums of positions over ticks [1/m^2]."""
    control: tuple[Positive, Positive, Positive, Positive] = (0.02, 1.0, 1.0, 1.0)
    """weights of f_T [1/N^2] and of tau_x, tau_y, tau_z [1/(N m)^2]."""


class LqServo(Frozen):
    """The LQ servo."""

    kind: Literal["lq"] = "lq"
    form: Literal["paper", "error"] = "error"
    """'paper' is u = -L [xhat; i]; 'error' is u = -L [xhat - x_ref; i] with the planner's acceleration fed forward, as
    in the authors' code."""
    velocities: Literal["estimate", "truth"] = "estimate"
    """source of the servo's velocities and Euler rates; 'truth' gives it the true ones, as the authors did."""
    yaw: Annotated[float, Field(ge=-2.0 * math.pi, le=2.0 * math.pi)] = 0.0
    """psi_r, the heading to hold [rad]; filter and servo are linearised at hover under it. Only in the error form."""
    weights: ServoWeights = ServoWeights()
    """Q and R."""

    @model_validator(mode="after")
    def _paper_holds_no_yaw(self) -> "LqServo":
        if self.form == "paper" and self.yaw != 0.0:
            raise ValueError(f".yaw: {self.yaw}: must be 0 with form 'paper', which holds none; form 'error' does")
        return self
