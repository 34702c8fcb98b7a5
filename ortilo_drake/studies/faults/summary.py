"""A study of faults in at most five lines."""

from ortilo_drake.studies.faults.fault_flights import FaultStudy
from ortilo_drake.views.numbers import count


def fault_summary(found: FaultStudy) -> list[str]:
    """Return a summary of a study, as Markdown's list: at most five lines."""
    lines = []
    for scenario, without in list(zip(found.scenarios, found.lost_without, strict=True))[:3]:
        its = [row for row in found.rows if row.scenario == scenario]
        passed, lost = sum(row.passed for row in its), sum(row.lost for row in its)
        flown = sum(row.flights for row in its)
        line = f"`{scenario}` passes {passed} of {len(its)} faults and loses {count(lost, flown)} flights"
        lines.append(f"{line}, {count(without, found.flights)} without a fault.")
    by_fault = {name: [row for row in found.rows if row.fault == name] for name in dict.fromkeys(_names(found))}
    none = [name for name, rows in by_fault.items() if not any(row.passed for row in rows)]
    every = [name for name, rows in by_fault.items() if all(row.passed for row in rows)]
    lines.append(f"Passed by none: {', '.join(none) or 'no fault'}.")
    lines.append(f"Passed by all: {', '.join(every) or 'no fault'}.")
    return ["## In short", "", *(f"- {line}" for line in lines), ""]


def _names(found: FaultStudy) -> list[str]:
    return [row.fault for row in found.rows]
