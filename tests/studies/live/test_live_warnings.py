"""Once a cause is named for good, what it explains is not warned of any more."""

from types import SimpleNamespace

import numpy as np
import pytest
from live_messages import IMU, RANGES, START, messages_of
from made_up_motion import as_map, made_up, quick_place

from ortilo_drake.studies.live.live_bridge import LiveBridge
from ortilo_drake.studies.live.live_filter import LiveFilter
from ortilo_drake.studies.live.live_warnings import LiveWarnings


def at_rates(mirrors: bool) -> SimpleNamespace:
    return SimpleNamespace(doubt="the rates", mirrors=mirrors)


def at_heading(doubt: str, mirror: str) -> SimpleNamespace:
    texts = (None if not text else SimpleNamespace(text=lambda text=text: text) for text in (doubt, mirror))
    return SimpleNamespace(**dict(zip(("doubt", "mirror"), texts, strict=True)))


@pytest.mark.parametrize(
    ("watches", "said"),
    [
        ([(at_rates(False), at_heading("", "")), (at_rates(False), at_heading("turned", ""))], ["the rates"]),
        ([(at_rates(True), at_heading("", "")), (at_rates(True), at_heading("", "a mirror"))], ["the rates"]),
        ([(at_rates(False), at_heading("", "")), (at_rates(False), at_heading("", "a mirror"))], ["rates", "a mirror"]),
        ([(None, at_heading("", "a mirror")), (at_rates(True), at_heading("", "a mirror"))], ["a mirror"]),
        ([(None, at_heading("turned", "")), (at_rates(False), at_heading("turned", ""))], ["turned", "the rates"]),
    ],
    ids=["turned by rates", "a mirror that rates told of", "another cause", "rates of a mirror", "turned before"],
)
def test_what_a_named_cause_explains_is_not_said(watches, said) -> None:
    """The ranges contradict the estimate all the while behind it, and that nobody is told either."""
    lines, places = list[str](), SimpleNamespace(scatter=None, widened=1.0, wrong=None, suspected=False, judges=True)
    agreement = SimpleNamespace(doubt=lambda *_: "the gate rejects 20%", is_unfit=lambda *_: True, alone=lambda: None)
    warnings = LiveWarnings(as_map(RANGES + IMU), lines.append)
    for t, (rates, heading) in enumerate(watches):
        filter_ = SimpleNamespace(begun=False, force_doubt="", lost=0, gate=0.0, anchors=None, agreement=agreement)
        filter_.rates, filter_.heading, filter_.places, filter_.due = rates, heading, places, 10.0 * t
        filter_.wrong, warnings._fit_at = LiveFilter.wrong.fget(filter_), 0.0
        warnings.look_at(filter_)
    assert len(lines) == len(said)
    assert all(part in line for part, line in zip(said, lines, strict=True))


@pytest.mark.long
def test_rates_of_a_wrong_sign_are_named_and_the_heading_that_they_turn_is_not() -> None:
    """A heading off by -60 degrees was named 2 s behind the rates, though the map's is right, and ranges 6 s later."""
    motion, lines = made_up(11.0, place=quick_place), list[str]()
    motion.imu[:, 2] *= -1.0
    start = START.replace("[3, 6.1, 1.4]", str(quick_place(np.zeros(1))[0].tolist()))
    bridge = LiveBridge(as_map(RANGES + IMU + start), lines.append)
    for message in messages_of(motion):
        bridge.receive(*message)
    assert bridge._filter.heading.doubt is not None  # it is there, and not said
    assert bridge._filter.agreement.doubt(0.0, 1.0)
    assert sum(line.startswith("warning  imu: the ranges contradict the body rates") for line in lines) == 1
    assert not any(line.startswith(("warning  heading", "warning  ranges", "warning  the anchors")) for line in lines)
