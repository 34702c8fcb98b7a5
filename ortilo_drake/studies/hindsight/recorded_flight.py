"""A flight with all messages that reached its onboard half: flown here again, or read from a log."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import xarray as xr
from pydrake.common.value import AbstractValue
from pydrake.systems.analysis import Simulator
from pydrake.systems.sensors import ImageRgba8U

from ortilo_drake.flight.signals import Signals
from ortilo_drake.flight.stepped_halves import image_value
from ortilo_drake.interop.log.logged_flight import fly_logged
from ortilo_drake.interop.log.reader import holds_what_was_sent, log_scenario, read_log, read_ticks
from ortilo_drake.model.input_error import InputError
from ortilo_drake.model.signals import N_X, SHUTTER_SIZE
from ortilo_drake.onboard.detector.detector_network import make_detector
from ortilo_drake.scenario import Scenario, with_seed


@dataclass(frozen=True)
class RecordedFlight:
    """A flight and its messages, up to where truth or estimate are no longer finite."""

    scenario: Scenario
    """the scenario that was flown, including its seed."""
    flight: xr.Dataset
    """a Dataset like flight.fly's (n ticks)."""
    messages: tuple[Signals, ...]
    """messages that the onboard half took in at each tick, by port (n). Pictures are not kept, only the boxes that the
    scenario's detector finds in them."""


class BoxFinder:
    """A detector of a rendered camera's pictures, apart from the onboard half's own; it begins at the tick `start`."""

    def __init__(self, scenario: Scenario, start: int = 0):
        self._h, self._detector = scenario.h, make_detector(scenario, scenario.load_room())
        self._simulator = Simulator(self._detector)
        context = self._simulator.get_mutable_context()
        context.SetTime(start * scenario.h)
        self._detector.GetInputPort("image").FixValue(context, AbstractValue.Make(ImageRgba8U()))
        self._detector.GetInputPort("shutter").FixValue(context, np.zeros(SHUTTER_SIZE))
        self._simulator.Initialize()

    def boxes(self, k: int, messages: Signals) -> np.ndarray:
        """Return the detections message of tick k and take its picture in, if there is one; ticks come in order."""
        context = self._simulator.get_mutable_context()
        found = np.array(self._detector.get_output_port().Eval(context))
        shutter = messages.get("shutter", np.zeros(SHUTTER_SIZE))
        self._detector.GetInputPort("shutter").FixValue(context, shutter)
        if "image" in messages:
            self._detector.GetInputPort("image").FixValue(context, image_value(messages["image"]))
        self._simulator.AdvanceTo((k + 1) * self._h, interruptible=False)
        return found


def _kept(messages: Signals, boxes: np.ndarray | None) -> Signals:
    kept = {name: np.array(value) for name, value in messages.items() if name != "image"}
    return kept if boxes is None or not boxes.any() else kept | {"detections": boxes}


def fly_recorded(scenario: Scenario, seed: int) -> RecordedFlight:
    """Fly a seed of a scenario, its two halves in lockstep (flight/lockstep.py); InputError as flight.fly."""
    scenario = with_seed(scenario, seed)
    finder = BoxFinder(scenario) if scenario.is_rendered else None
    messages: list[Signals] = []

    def record(k: int, state: np.ndarray | None, its: Signals, outputs: Signals) -> None:
        messages.append(_kept(its, finder.boxes(k, its) if finder else None))

    return _whole(scenario, fly_logged(scenario, None, also=record), messages)


def read_recorded(log: Path) -> RecordedFlight:
    """Return the flight of a log by `ortilo fly --log`, or by an onboard half that received the truth.

    InputError if there is no such log, or it holds a world's sent messages instead of received ones, or no true states.
    """
    if holds_what_was_sent(log):
        raise InputError(f"{log}: is the log of a world in real time: must be a log of what the onboard half received")
    scenario, flight = log_scenario(log), read_log(log)
    messages: list[Signals] = [{} for _ in range(flight.sizes["tick"])]
    finder = None
    for tick in read_ticks(log):
        if scenario.is_rendered and finder is None and "detections" not in tick.messages:
            finder = BoxFinder(scenario, tick.k)
        looks = finder is not None and "detections" not in tick.messages
        messages[tick.k] = _kept(tick.messages, finder.boxes(tick.k, tick.messages) if finder and looks else None)
    if np.isnan(flight["truth"].values).all():
        raise InputError(f"{log}: holds no true states, by which an estimate could be judged")
    return _whole(scenario, flight, messages)


def _whole(scenario: Scenario, flight: xr.Dataset, messages: list[Signals]) -> RecordedFlight:
    """Return the flight up to its first tick that is not finite."""
    values = (flight[name].values.reshape(flight.sizes["tick"], -1) for name in ("truth", "estimate", "covariance"))
    whole = np.logical_and.reduce([np.isfinite(value).all(axis=1) for value in values])
    end = len(whole) if whole.all() else int(np.argmin(whole))
    if end < 2:
        raise InputError(f"{scenario.name}: the flight has no two ticks with true state and estimate from its start")
    assert flight["truth"].shape[1] == N_X
    return RecordedFlight(scenario, flight.isel(tick=slice(0, end)), tuple(messages[:end]))
