"""Loop margins of a scenario at the plant's input, nominal and with sensors lost; defined in loop_margins.py.

If no sensor sees some states, the loop has modes of eigenvalue 1 that no measurement corrects. No output shows these
modes, so they do not change the loop's transfer function, and the other channels still have margins. Without position
these are the attitude loops, and the filter predicts velocity and position from attitude and control alone.
"""

import math
from dataclasses import dataclass

import numpy as np

from ortilo_drake.model.signals import CONTROL_NAMES, N_X
from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.scenario import LqServo, Scenario, ServoWeights
from ortilo_drake.studies.loop.hover_loop import VELOCITIES, HoverLoop, filter_V, hover_loop, message_of
from ortilo_drake.studies.loop.input_loop import InputLoop, input_loop
from ortilo_drake.theory.margins.loop_margins import (
    SILENT,
    ChannelMargins,
    JointMargins,
    channel_margins,
    joint_margins,
)
from ortilo_drake.theory.margins.loop_response import LOWEST, closed, one_channel, response, spectral_radius

STILL = 1e-9  # a closed loop's radius this near 1 is 1: what drifts drifts on


@dataclass(frozen=True)
class LoopMargins:
    """One loop's margins.

    Attributes:
        spectral_radius: of the closed loop; None where the filter has no steady gain.
        lost: states that no sensor sees.
        channels: by control, None where nothing is fed back; None for a loop that is not stable.
        joint: of all controls at once; None for a loop that is not stable.
        note: in words, what is lost or not stable; None if nothing is.
    """

    spectral_radius: float | None
    lost: tuple[str, ...]
    channels: dict[str, ChannelMargins | None] | None
    joint: JointMargins | None
    note: str | None


def _explain(inner: InputLoop, silent: list[str]) -> str | None:
    if not inner.lost:
        return None
    text = (
        f"no sensor sees {', '.join(inner.lost)}: their modes have eigenvalue 1 and are"
        " left out; the margins are those of what is still seen (position lost: the attitude), with the filter"
        " predicting the rest from it"
    )
    return text + (f"; nothing is fed back to {', '.join(silent)}" if silent else "")


def loop_margins(inner: InputLoop, h: float, R: np.ndarray) -> LoopMargins:
    """Return one loop's margins.

    Args:
        inner: the loop.
        h: tick [s].
        R: diagonal of the servo's weight of the controls, in which the joint margins are.
    """
    loop = inner.loop
    radius = spectral_radius(closed(loop))
    lost = tuple(inner.lost)
    if not radius < 1.0 - STILL:
        note = f"the closed loop is not stable (radius {radius:.6g}): it has no margins"
        return LoopMargins(radius, lost, None, None, note)
    L = response(loop, np.geomspace(LOWEST, math.pi, 40))
    silent = [name for k, name in enumerate(CONTROL_NAMES) if abs(L[:, k, k]).max() < SILENT]
    channels = {
        name: None if name in silent else channel_margins(one_channel(loop, k), h)
        for k, name in enumerate(CONTROL_NAMES)
    }
    return LoopMargins(radius, lost, channels, joint_margins(loop, h, R), _explain(inner, silent))


def loops_by_case(hover: HoverLoop, V: np.ndarray, sensors: tuple[str, ...]) -> dict[str, InputLoop | LoopMargins]:
    """Return the loops of a scenario: nominal, each sensor lost, all position sensors lost, and with true states.

    A loop with a sensor lost whose filter has no steady gain is LoopMargins that say why.
    """
    known = [s for s in hover.measurement.sensors if message_of(s, hover.measurement) == s]
    present = tuple(s for s in known if s in sensors)
    if not present:
        raise InputError(f"sensors: none: margins need at least one of {', '.join(known)}")
    lost: dict[str, tuple[str, ...]] = {f"without {s}": (s,) for s in present}
    is_position = dict(zip(hover.measurement.sensors, hover.measurement.layout.is_position, strict=True))
    fixes = tuple(s for s in present if is_position[s])
    if len(fixes) > 1:
        lost[f"without {' and '.join(fixes)}"] = fixes
    loops: dict[str, InputLoop | LoopMargins] = {"nominal": input_loop(hover, V, present)}
    for name, these in lost.items():
        left = tuple(s for s in present if s not in these)
        if not left:
            continue
        try:
            loops[name] = input_loop(hover, V, left)
        except InputError:
            loops[name] = LoopMargins(None, (), None, None, "the filter has no steady gain with these sensors")
    loops["true velocities"] = input_loop(hover, V, present, VELOCITIES)
    loops["full state"] = input_loop(hover, V, present, tuple(range(N_X)))
    return loops


def margins_report(scenario: Scenario, V: np.ndarray) -> dict[str, LoopMargins]:
    """Return loop_margins of every case of a scenario, by name.

    The joint margins of a servo of one's own are in the weights that an LQ servo has by default.

    Args:
        scenario: its sensors are the nominal ones.
        V: covariance of all measurements (p x p), positive definite.

    Returns:
        'nominal', 'without uwb', ..., 'true velocities' (the paper's: velocities and rates from the truth) and
        'full state' (the LQ loop by itself) -> loop_margins.
    """
    hover = hover_loop(scenario)
    weights = scenario.servo.weights if isinstance(scenario.servo, LqServo) else ServoWeights()
    R = np.array(weights.control)
    loops = loops_by_case(hover, filter_V(scenario, V), scenario.sensors)
    return {
        name: inner if isinstance(inner, LoopMargins) else loop_margins(inner, hover.h, R)
        for name, inner in loops.items()
    }
