"""The record of a flight in real time: for each tick the world's messages and the onboard half's answer."""

import numpy as np
import xarray as xr

from ortilo_drake.flight.flight import flight_dataset
from ortilo_drake.flight.lost import Lost
from ortilo_drake.flight.signals import Record, Signals, output_sizes
from ortilo_drake.hil.wire.unpack import Packet
from ortilo_drake.scenario import Scenario


class FlightRecord:
    """Collects the ticks of a flight, and records each once its telemetry has had time to arrive, in order.

    Outputs that were lost are recorded as NaN.
    """

    def __init__(self, scenario: Scenario, record: Record | None):
        self._record, self._sizes = record, output_sizes(scenario.measurement)
        self._states: list[np.ndarray] = []
        self._sent: list[Signals] = []
        self._heard: dict[int, Signals] = {}
        self._recorded = 0

    def send(self, x: np.ndarray, messages: Signals) -> None:
        """Take the true state (12) and the messages of the next tick."""
        self._states.append(x)
        self._sent.append(messages)

    def receive(self, packet: Packet) -> None:
        """Take a command or telemetry."""
        outputs = {"control": packet.value} if packet.name == "command" else packet.value
        self._heard.setdefault(packet.tick, {}).update(outputs)

    def state(self, tick: int) -> np.ndarray:
        """Return the true state (12) of a tick."""
        return self._states[tick]

    def outputs(self, tick: int) -> Signals:
        """Return the onboard half's outputs of a tick; NaN where nothing came."""
        heard = self._heard.get(tick, {})
        return {name: heard.get(name, np.full(size, np.nan)) for name, size in self._sizes.items()}

    def record_until(self, end: int) -> None:
        """Record the ticks before `end` that are not recorded yet."""
        for k in range(self._recorded, min(end, len(self._states))):
            if self._record:
                self._record(k, self._states[k], self._sent[k], self.outputs(k))
            self._sent[k] = {}
            self._recorded = k + 1

    def dataset(self, scenario: Scenario, lost: Lost | None) -> xr.Dataset:
        """Return the flight, as flight.fly does but without its real_time_factor."""
        rows = [np.concatenate([x, *self.outputs(k).values()]) for k, x in enumerate(self._states)]
        return flight_dataset(scenario, np.arange(len(rows)) * scenario.h, np.array(rows), lost)
