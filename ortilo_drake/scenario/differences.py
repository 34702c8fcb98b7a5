"""The settings that go with differences of ranges, uwb.kind differences."""

from typing import Any

from ortilo_drake.scenario.faults import sensors_of_kind

_WHOLE = 1e-6  # within which a number of packets counts as whole


def check_differences(scenario: Any) -> None:
    """Refuse settings that read or change single ranges where the uwb has differences.

    Raises:
        ValueError: naming the setting and what is allowed.
    """
    uwb, estimator = scenario.uwb, scenario.estimator
    if uwb.kind != "differences" or "uwb" not in scenario.sensors:
        return
    with_it = "with uwb.kind differences"
    if getattr(estimator, "kind", None) != "tight":
        raise ValueError(f"estimator.kind: {getattr(estimator, 'kind', None)}: must be tight {with_it}")
    if estimator.ranges.differences:
        raise ValueError(f"estimator.ranges.differences: true: must be false {with_it}: no clock is left in them")
    exact = uwb.packets * uwb.link.every(scenario.h) * scenario.h
    if uwb.rows(scenario.h) < 1 or abs(exact - uwb.rows(scenario.h)) > _WHOLE:
        raise ValueError(f"uwb.packets: {uwb.packets:g}: must be a whole number, 1 or more, in each message: {exact:g}")
    if uwb.round > 0.0:
        raise ValueError(f"uwb.round: {uwb.round:g}: must be 0 {with_it}: they come one by one")
    if uwb.walls.kind not in ("none", "block"):
        raise ValueError(f"uwb.walls.kind: {uwb.walls.kind}: must be none or block {with_it}")
    if uwb.behind_walls == "left_out":
        raise ValueError(f"uwb.behind_walls: left_out: must be used or null {with_it}")
    for i, fault in enumerate(scenario.faults):
        if "uwb" in sensors_of_kind(getattr(fault, "kind", "")):
            raise ValueError(f"faults.{i}: {fault.kind}: is one of single ranges, uwb.kind must be ranges")
