"""The world's messages, put together tick by tick as they come."""

from ortilo_drake.flight.stepped_halves import Signals
from ortilo_drake.hil.wire.unpack import Packet


class TickInbox:
    """Puts the packets of each tick together; they may come in any order.

    Overtaken counts the messages that were dropped for a newer one on the same port.
    """

    def __init__(self) -> None:
        self._sent: dict[int, tuple[str, ...]] = {}
        self._messages: dict[int, Signals] = {}
        self.overtaken = 0

    def put(self, packet: Packet) -> None:
        """Take a packet of the world."""
        if packet.name == "tick":
            self._sent[packet.tick] = packet.value
        else:
            self._messages.setdefault(packet.tick, {})[packet.name] = packet.value

    def is_complete(self, tick: int) -> bool:
        """Return whether everything that was sent in a tick is here."""
        return tick in self._sent and self._messages.get(tick, {}).keys() >= set(self._sent[tick])

    def pop(self, tick: int) -> Signals:
        """Return a tick's messages and forget them."""
        self._sent.pop(tick, None)
        return self._messages.pop(tick, {})

    def pop_until(self, tick: int, keep_from: int) -> Signals:
        """Return the messages of a tick and late ones of earlier ticks; of several on a port the newest.

        Those not returned are dropped, but kept from the tick keep_from on, for a later tick without one on their port.
        """
        taken: Signals = {}
        for k in sorted((k for k in self._messages if k <= tick), reverse=True):
            here = self._messages.pop(k)
            rest = {name: value for name, value in here.items() if name in taken}
            taken = here | taken
            if rest and k >= keep_from:
                self._messages[k] = rest
            else:
                self.overtaken += len(rest)
        self._sent = {k: names for k, names in self._sent.items() if k > tick}
        return taken
