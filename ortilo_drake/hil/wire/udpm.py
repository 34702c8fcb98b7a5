r"""LCM's datagrams over UDP multicast (LCM's lcm_udpm.c), packed, and unpacked from any sender.

A short message is one datagram, a longer one is cut into fragments (all numbers big-endian):

    "LC02"  sequence (4)                                                             channel \0  data
    "LC03"  sequence (4)  size (4)  offset (4)  number (2)  total (2)  [channel \0]  data

A sender counts its messages in `sequence`. `size` is that of the whole data, `offset` where a fragment's data stand in
it; only fragment number 0 carries the channel. LCM itself adds offset and length without looking whether they wrap
(lcm-proj/lcm pull request 628), so that one datagram writes out of bounds: hence these lines in its place.
"""

import struct
from collections import Counter
from itertools import pairwise
from typing import Final, NamedTuple

SHORT, FRAGMENT = 0x4C433032, 0x4C433033  # "LC02", "LC03"
MOST_SHORT: Final = 65_499  # bytes of channel, \0 and data in one datagram
MOST_FRAGMENT: Final = 65_487
MOST_CHANNEL: Final = 63
LARGEST: Final = 2**24  # bytes of a message: a picture of the widest camera
PENDING: Final = 8  # incomplete messages of one sender
SENDERS: Final = 16  # that may have incomplete messages
HELD: Final = 2**25  # bytes of all incomplete messages
OVERHEAD: Final = 256  # bytes of memory for a fragment besides its data
AGE: Final = 1.0  # after which an incomplete message is given up [s]

_SHORT: Final = struct.Struct(">II")
_FRAGMENT: Final = struct.Struct(">IIIIHH")

Sender = tuple[str, int]  # address and port


class BadDatagram(Exception):
    """Bytes that are no datagram of LCM's; `reason` is the word under which they are counted."""

    def __init__(self, reason: str):
        super().__init__(reason)
        self.reason = reason


class Short(NamedTuple):
    """A whole message."""

    channel: str
    data: bytes


class Fragment(NamedTuple):
    """A part of a message; channel is empty except in number 0."""

    sequence: int
    size: int
    offset: int
    number: int
    total: int
    channel: str
    data: bytes


def encode(channel: str, sequence: int, data: bytes) -> list[bytes]:
    """Return the datagrams of a message, as LCM makes them.

    Args:
        channel: 1 to 63 ASCII characters.
        sequence: how many messages were sent before, modulo 2^32.
        data: at most LARGEST bytes.
    """
    name = channel.encode("ascii") + b"\0"
    if not 1 < len(name) <= MOST_CHANNEL + 1 or len(data) > LARGEST:
        raise ValueError(f"channel {channel!r} with {len(data)} bytes: LCM has no such message")
    if len(name) + len(data) <= MOST_SHORT:
        return [_SHORT.pack(SHORT, sequence) + name + data]
    cuts = [0, *range(MOST_FRAGMENT - len(name), len(data), MOST_FRAGMENT), len(data)]
    parts = [data[begin:end] for begin, end in pairwise(cuts)]
    heads = [_FRAGMENT.pack(FRAGMENT, sequence, len(data), cuts[i], i, len(parts)) for i in range(len(parts))]
    return [head + (b"" if i else name) + part for i, (head, part) in enumerate(zip(heads, parts, strict=True))]


def _channel(datagram: bytes, start: int) -> tuple[str, int]:
    """Return the channel at an offset, and the offset after it."""
    end = datagram.find(b"\0", start, start + MOST_CHANNEL + 1)
    name = datagram[start:end]
    if end <= start or not name.isascii():
        raise BadDatagram("channel")
    return name.decode("ascii"), end + 1


def decode(datagram: bytes) -> Short | Fragment:
    """Return the content of a datagram; BadDatagram if it is not LCM's, or its sizes are wrong."""
    magic = int.from_bytes(datagram[:4], "big")
    if magic == SHORT and len(datagram) >= _SHORT.size:
        channel, start = _channel(datagram, _SHORT.size)
        return Short(channel, datagram[start:])
    if magic != FRAGMENT or len(datagram) < _FRAGMENT.size:
        raise BadDatagram("datagram")
    _, sequence, size, offset, number, total = _FRAGMENT.unpack_from(datagram)
    channel, start = _channel(datagram, _FRAGMENT.size) if number == 0 else ("", _FRAGMENT.size)
    data = datagram[start:]
    # Python's integers do not wrap.
    if number >= total or size > LARGEST or offset + len(data) > size or (number == 0 and offset > 0):
        raise BadDatagram("fragment")
    return Fragment(sequence, size, offset, number, total, channel, data)


class _Message:
    """A message of which fragments are missing; parts is None if nobody listens to its channel."""

    def __init__(self, first: Fragment, now: float):
        self.shape = first.size, first.total
        self.since = now
        self.channel = ""
        self.numbers: set[int] = set()
        self.parts: list[Fragment] | None = []
        self.held = 0  # bytes


class Reassembly:
    """Puts messages together from datagrams. Whatever comes, it raises nothing and holds at most HELD bytes.

    It allocates for the data that came, not for the size in a header, and drops the oldest incomplete message for a
    newer one.

    Attributes:
        channels: those to put together; messages on others are dropped as soon as their channel is known.
        refused: how many datagrams or messages were dropped, by reason: datagram, channel and fragment if they
            are not LCM's, overlap for fragments that do not make a whole, incomplete for messages given up.
        held: bytes of all incomplete messages, with OVERHEAD for each fragment.
    """

    def __init__(self) -> None:
        self.channels: set[str] = set()
        self.refused: Counter[str] = Counter()
        self.held = 0
        self._pending: dict[tuple[Sender, int], _Message] = {}  # the oldest first

    def take(self, sender: Sender, datagram: bytes, now: float) -> Short | None:
        """Return the message that a datagram completes, if it does, on one of the channels.

        Args:
            sender: the sender's address.
            datagram: any bytes.
            now: a clock's reading [s].
        """
        try:
            part = decode(datagram)
        except BadDatagram as problem:
            self.refused[problem.reason] += 1
            return None
        if isinstance(part, Short):
            return part if part.channel in self.channels else None
        return self._put(sender, part, now)

    def _put(self, sender: Sender, part: Fragment, now: float) -> Short | None:
        while self._pending and next(iter(self._pending.values())).since < now - AGE:
            self._give_up(next(iter(self._pending)))
        key = sender, part.sequence
        message = self._pending.get(key) or self._begin(key, part, now)
        if (part.size, part.total) != message.shape or part.number in message.numbers:
            self.refused["overlap"] += 1
            return None
        message.numbers.add(part.number)
        self._hold(message, OVERHEAD)
        if part.number == 0:
            message.channel = part.channel
            if part.channel not in self.channels:
                message.parts = None
                self._hold(message, len(message.numbers) * OVERHEAD - message.held)
        if message.parts is not None:
            message.parts.append(part)
            self._hold(message, len(part.data))
        if len(message.numbers) == part.total:
            del self._pending[key]
            self.held -= message.held
            return self._whole(message)
        while self.held > HELD:
            self._give_up(next(iter(self._pending)))
        return None

    def _begin(self, key: tuple[Sender, int], part: Fragment, now: float) -> _Message:
        of_sender = [known for known in self._pending if known[0] == key[0]]
        if len(of_sender) >= PENDING:
            self._give_up(of_sender[0])
        elif len(self._pending) >= PENDING * SENDERS:
            self._give_up(next(iter(self._pending)))
        self._pending[key] = _Message(part, now)
        return self._pending[key]

    def _hold(self, message: _Message, more: int) -> None:
        message.held += more
        self.held += more

    def _give_up(self, key: tuple[Sender, int]) -> None:
        message = self._pending.pop(key)
        self.held -= message.held
        self.refused["incomplete"] += message.parts is not None

    def _whole(self, message: _Message) -> Short | None:
        if message.parts is None:
            return None
        end = 0
        for part in sorted(message.parts, key=lambda part: part.number):
            if part.offset != end:
                self.refused["overlap"] += 1
                return None
            end += len(part.data)
        if end != message.shape[0]:
            self.refused["overlap"] += 1
            return None
        return Short(message.channel, b"".join(part.data for part in sorted(message.parts, key=lambda p: p.number)))
