"""Settings of the links that carry sensor messages to the vehicle, and commands to its rotors."""

import math
from typing import Annotated, Any, Final, Literal

from pydantic import BeforeValidator, Field, NonNegativeFloat, model_validator

from ortilo_drake.model.typed_yaml import Frozen, Positive

MOST_TICKS: Final = 1000.0  # a second
MOST_SAMPLES: Final = 100  # of a sensor in one tick: a packet is not to grow without limit
ONE_A_TICK: Final = ("uwb", "camera")  # their messages are whole sets of ranges or boxes, which have no mean
Probability = Annotated[float, Field(ge=0.0, le=1.0)]


class NoLoss(Frozen):
    """Every message arrives."""

    kind: Literal["none"] = "none"


class BernoulliLoss(Frozen):
    """Each message is lost with the same probability, independently."""

    kind: Literal["bernoulli"]
    probability: Probability
    """of a loss [1]."""


class GilbertElliottLoss(Frozen):
    """Bursts: a two-state Markov chain steps once a tick; messages are lost at the rate of its state.

    The chain starts in the good state.
    """

    kind: Literal["gilbert_elliott"]
    good_to_bad: Probability
    """probability a tick of leaving the good state [1]."""
    bad_to_good: Probability
    """probability a tick of leaving the bad state [1]."""
    loss_good: Probability = 0.0
    """probability of a loss in the good state [1]."""
    loss_bad: Probability = 1.0
    """probability of a loss in the bad state [1]."""


class BurstLoss(Frozen):
    """Bursts by their measured figures: everything is lost within one, nothing between two."""

    kind: Literal["bursts"]
    loss: Probability
    """share of the packets that are lost [1], at most b / (1 + b) with bursts of b ticks on average."""
    mean_length: Positive
    """mean length of a burst [s], a tick or more."""


class PositionBlackout(Frozen):
    """No message while the vehicle's true coordinate on one axis lies in [start, end)."""

    kind: Literal["position"]
    axis: Literal["x", "y", "z"] = "x"
    """which coordinate of p_WB."""
    start: float
    """where it begins [m]."""
    end: float
    """where it ends [m]."""


class TimeBlackout(Frozen):
    """No message while the time lies in [start, end)."""

    kind: Literal["time"]
    start: NonNegativeFloat
    """when it begins [s]."""
    end: NonNegativeFloat
    """when it ends [s]."""


def _from_number(loss: Any) -> Any:
    """Take a number for the probability of independent losses."""
    if isinstance(loss, int | float) and not isinstance(loss, bool):
        return {"kind": "bernoulli", "probability": loss} if loss else {"kind": "none"}
    if loss is None or isinstance(loss, bool | str | list):
        allowed = "must be a number from 0 to 1, as 0.1 or 1.0e-1, or {kind: bursts, loss: 0.3, mean_length: 1.0}"
        raise ValueError(f"{loss!r}: {allowed}")
    return loss


AnyLoss = Annotated[NoLoss | BernoulliLoss | BurstLoss | GilbertElliottLoss, Field(discriminator="kind")]
Loss = Annotated[AnyLoss, BeforeValidator(_from_number, json_schema_input_type=AnyLoss | Probability)]
Blackout = Annotated[PositionBlackout | TimeBlackout, Field(discriminator="kind")]


class LinkRate(Frozen):
    """The rate at which a sensor sends."""

    rate: Annotated[float, Field(ge=1e-3)] | None = None
    """samples a second [Hz]. It divides the scenario's control_rate; or it is a whole multiple of it (not of uwb and
    camera), and each tick's packet carries the samples taken since the tick before, each with its stamp. null sends on
    every tick."""

    def every(self, h: float) -> int:
        """Return the period of the messages in ticks of h [s]."""
        return 1 if self.rate is None else max(1, round(1.0 / (self.rate * h)))

    def samples(self, h: float) -> int:
        """Return the number of samples in a message: more than one if the sensor is faster than the tick of h [s]."""
        return 1 if self.rate is None else max(1, round(self.rate * h))


class Link(LinkRate):
    """The link of one sensor to the vehicle: one packet in each tick that is due, delivered or lost as a whole."""

    loss: Loss = NoLoss()
    """random losses; a number is the probability of independent losses."""
    blackouts: Annotated[tuple[Blackout, ...], Field(max_length=1000)] = ()
    """where or when nothing arrives."""
    delay: Annotated[int, Field(ge=0, le=1000)] = 0
    """fixed delay [ticks]."""
    random_delay: Annotated[int, Field(ge=0, le=1000)] = 0
    """largest additional delay [ticks], drawn uniformly for each message."""

    @model_validator(mode="after")
    def _blackouts_have_a_length(self) -> "Link":
        for blackout in self.blackouts:
            if blackout.start >= blackout.end:
                raise ValueError(f"blackout: start {blackout.start} must be below end {blackout.end}")
        return self


def check_rate(sensor: str, rate: float, control_rate: float, field: str = "") -> None:
    """Check that a sensor's rate [Hz] divides the control rate [Hz], or is a multiple that can be flown.

    The field is its key, by default that of the sensor's link. ValueError if it does not; it names the nearest rates
    that do, and a control rate that fits.
    """
    ticks, samples = control_rate / rate, rate / control_rate
    if abs(ticks - max(1, round(ticks))) <= 1e-9 * ticks:
        return
    wrong = f"{field or f'{sensor}.link.rate'}: {rate}: must divide control_rate, {control_rate:g} Hz"
    if ticks > 1.0:
        below, above = control_rate / math.ceil(ticks), control_rate / math.floor(ticks)
        wrong += f"; the nearest that do are {below:.12g} and {above:.12g}"
    elif sensor in ONE_A_TICK:
        wrong += f", or be null: of {sensor} comes no more than one message a tick"
    else:
        is_multiple = abs(samples - round(samples)) <= 1e-9 * samples
        if is_multiple and samples <= MOST_SAMPLES:
            return
        wrong += f", or be 2 to {MOST_SAMPLES} times it"
        if samples <= MOST_SAMPLES:
            below, above = control_rate * math.floor(samples), control_rate * math.ceil(samples)
            wrong += f"; the nearest that are: {below:.12g} and {above:.12g}"
    raise ValueError(wrong + _control_rate_for(rate, control_rate))


def _control_rate_for(rate: float, control_rate: float) -> str:
    """Return the least multiple of the control rate that a rate divides, as a hint: what divided it still does."""
    for n in range(1, math.floor(MOST_TICKS / control_rate) + 1):
        ticks = n * control_rate / rate
        if ticks > 0.5 and abs(ticks - round(ticks)) <= 1e-9 * ticks:
            return f"; or set control_rate: {n * control_rate:.12g}, which allows it"
    return ""


class CommandLink(Frozen):
    """The link of the control packets to the rotors, one a tick.

    There is no acknowledgement (as over UDP): filter and servo assume that every command is applied at once, unless the
    scenario's `commands` have the world report which acted.
    """

    loss: Loss = NoLoss()
    """what is lost at random; a number is the probability of independent losses."""
    when_lost: Literal["hold", "zero"] = "hold"
    """the command in a tick in which none arrives: 'hold' repeats the last one, 'zero' is hover, f_T = m g and no
    torques."""
    delay: Annotated[int, Field(ge=0, le=1000)] = 0
    """fixed delay [ticks]."""
