"""A study of mismatches in at most five lines."""

from collections.abc import Mapping

from ortilo_drake.studies.sensitivity.sensitivity_flights import LOST_SHARE, NONE, Limit, Sensitivity
from ortilo_drake.views.numbers import count


def sensitivity_summary(found: Sensitivity, careful: Mapping[str, float], together: str) -> list[str]:
    """Return a summary of a study, as Markdown's list: at most five lines.

    Args:
        found: the study; at least one limit was searched.
        careful: what a careful team leaves of each mismatch, by its name.
        together: the name of all mismatches at once, which is left out where single ones are compared.
    """
    calm = next(row for row in found.rows if row.mismatch == NONE)
    lines = [f"Without any mismatch {count(calm.lost, calm.flights)} flights are lost."]
    alone = [limit for limit in found.limits if limit.mismatch != together]
    known = [limit for limit in alone if limit.value]

    def room(limit: Limit) -> float:
        return (limit.value or 0.0) / careful[limit.mismatch]

    below = [limit.mismatch for limit in alone if limit.value == 0.0]
    if below:
        lines.append(f"{LOST_SHARE:.0%} are lost at less than was flown of: {'; '.join(below)}.")
    if known:
        least = min(known, key=room)
        lines.append(
            f"Least room is left by '{least.mismatch}': {LOST_SHARE:.0%} are lost at {least.value:.3g}, "
            f"{room(least):.2g} times what a careful team leaves ({careful[least.mismatch]:g})."
        )
    beyond = sum(limit.value is None for limit in alone)
    lines.append(f"{beyond} of {len(alone)} mismatches were not found to lose that many at any value flown.")
    lines += [_together(limit) for limit in found.limits if limit.mismatch == together]
    return ["## In short", "", *(f"- {line}" for line in lines), ""]


def _together(limit: Limit) -> str:
    if limit.value is None:
        return f"All together were not found to lose {LOST_SHARE:.0%} at any value flown."
    if limit.value == 0.0:
        return f"All together lose {LOST_SHARE:.0%} at less than was flown."
    return f"All together lose {LOST_SHARE:.0%} at {limit.value:.2g} times what a careful team leaves of each."
