"""What `ortilo hil check` says first."""

from typing import Any

import pytest

from ortilo_drake.commands.hil.check import check_verdict

NONE = {"median": None, "p99": None, "max": None}
IN_TIME = {"median": 2.42, "p99": 6.26, "max": 9.0}


def report(**changes: Any) -> dict[str, Any]:
    plain = {"ticks": 91, "identical": None, "latency_ms": IN_TIME, "missed_deadlines": 2, "lost": None}
    return plain | changes


@pytest.mark.parametrize(
    ("found", "said"),
    [
        (
            report(),
            "flew 3.0 s, not lost; a command came 2.4 ms (99 %: 6.3 ms) after its measurement; 2 of 91 ticks of "
            "33.3 ms missed their deadline",
        ),
        (
            report(identical=True, latency_ms=NONE, missed_deadlines=None),
            "flew 3.0 s, not lost; in lockstep its 91 ticks are bit for bit as in a single process",
        ),
        (
            report(identical=False, lost={"time": 2.26, "cause": "touched 'wall'"}),
            "lost at 2.3 s: touched 'wall'; in lockstep its 91 ticks are NOT the same as in a single process",
        ),
        (report(latency_ms=NONE, missed_deadlines=91), "flew 3.0 s, not lost; none of 91 ticks was answered"),
    ],
)
def test_the_sentence(found: dict[str, Any], said: str) -> None:
    assert check_verdict(found, 1.0 / 30.0) == said
