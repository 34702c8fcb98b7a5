"""Settings of the links that carry sensor messages to the vehicle, and commands to its rotors."""

import math
from typing import Annotated, Any, Final, Literal

from pydantic import BeforeValidator, Field, NonNegativeFloat, model_validator

from ortilo_drake.model.typed_yaml import Frozen, Positive

MOST_TICKS: Final = 1000.0  # largest control rate [Hz]
MOST_SAMPLES: Final = 100  # most samples of a sensor in one tick: a packet must not grow without limit
ONE_A_TICK: Final = ("uwb", "camera")  # their messages are whole sets of ranges or boxes, which cannot be averaged
Probability = Annotated[float, Field(ge=0.0, le=1.0)]


class NoLoss(Frozen):
    """Every message arrives."""

    kind: Literal["none"] = "none"


class BernoulliLoss(Frozen):
    """Each message is lost with the same probability, independently."""

    kind: Literal["bernoulli"]
    probability: Probability
    """probability that a message is lost [1]."""


class GilbertElliottLoss(Frozen):
    """Burst losses of a two-state Markov chain, whose state sets the probability of a loss.

    The chain starts in the good state and steps once a tick.
    """

    kind: Literal["gilbert_elliott"]
    good_to_bad: Probability
    """probability per tick of leaving the good state [1]."""
    bad_to_good: Probability
    """probability per tick of leaving the bad state [1]."""
    loss_good: Probability = 0.0
    """probability of a loss in the good state [1]."""
    loss_bad: Probability = 1.0
    """probability of a loss in the bad state [1]."""


class BurstLoss(Frozen):
    """Burst losses by two measured figures: every packet in a burst is lost, none between bursts."""

    kind: Literal["bursts"]
    loss: Probability
    """share of the packets that are lost [1]; at most b / (1 + b), where b is the mean length of a burst in ticks."""
    mean_length: Positive
    """mean length of a burst [s], at least one tick."""


class PositionBlackout(Frozen):
    """No message arrives while one true coordinate of the vehicle lies in [start, end)."""

    kind: Literal["position"]
    axis: Literal["x", "y", "z"] = "x"
    """coordinate of p_WB that decides."""
    start: float
    """coordinate at which the blackout begins [m]."""
    end: float
    """coordinate at which the blackout ends [m]."""


class TimeBlackout(Frozen):
    """No message arrives while the time lies in [start, end)."""

    kind: Literal["time"]
    start: NonNegativeFloat
    """time at which the blackout begins [s]."""
    end: NonNegativeFloat
    """time at which the blackout ends [s]."""


def _from_number(loss: Any) -> Any:
    """Return the settings of independent losses if `loss` is a number, their probability; other settings unchanged."""
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
    """samples per second [Hz]. The rate must divide the scenario's control_rate. A sensor other than uwb and camera may
    also have a whole multiple of control_rate: each tick's packet then carries all samples since the last tick, each
    with its stamp. null sends in every tick."""

    def every(self, h: float) -> int:
        """Return the period of the messages in ticks of h [s]."""
        return 1 if self.rate is None else max(1, round(1.0 / (self.rate * h)))

    def samples(self, h: float) -> int:
        """Return the number of samples in a message, more than one if the sensor is faster than the tick h [s]."""
        return 1 if self.rate is None else max(1, round(self.rate * h))


class Link(LinkRate):
    """The link of one sensor to the vehicle: it delivers or loses each packet as a whole."""

    loss: Loss = NoLoss()
    """random losses; a number is the probability of independent losses."""
    blackouts: Annotated[tuple[Blackout, ...], Field(max_length=1000)] = ()
    """places or times at which nothing arrives."""
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
    """Raise ValueError unless a sensor's rate [Hz] divides the control rate [Hz] or is a multiple that can be flown.

    The error names the nearest rates that fit, and a control rate that fits. `field` is the key that the error names,
    by default the rate of the sensor's link.
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
    """Return the hint to set the least multiple of the control rate (other rates divide it too) that `rate` divides."""
    for n in range(1, math.floor(MOST_TICKS / control_rate) + 1):
        ticks = n * control_rate / rate
        if ticks > 0.5 and abs(ticks - round(ticks)) <= 1e-9 * ticks:
            return f"; or set control_rate: {n * control_rate:.12g}, which allows it"
    return ""


class CommandLink(Frozen):
    """The link that carries one control packet per tick to the rotors.

    There is no acknowledgement (as over UDP): filter and servo assume that every command acts at once, unless the
    scenario's `commands` let the world report which commands acted.
    """

    loss: Loss = NoLoss()
    """random losses; a number is the probability of independent losses."""
    when_lost: Literal["hold", "zero"] = "hold"
    """command in a tick in which none arrives: 'hold' repeats the last command, 'zero' commands hover, f_T = m g and no
    torques."""
    delay: Annotated[int, Field(ge=0, le=1000)] = 0
    """fixed delay [ticks]."""
