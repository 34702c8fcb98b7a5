"""The report of a study in hindsight."""

from ortilo_drake.studies.hindsight.hindsight import FLOOR, FLOWN, GRAPH, RTS, Hindsight
from ortilo_drake.views.markdown import table

_HEADER = ["estimate", "x [mm]", "y [mm]", "z [mm]", "distance [mm]", "over flown", "NEES"]
_NAMES = {RTS: "RTS, in hindsight", GRAPH: "graph, in hindsight", FLOOR: "Cramér-Rao floor of a filter"}


def hindsight_text(found: Hindsight) -> str:
    """Return the report in Markdown."""
    n = len(found.flights)
    seeds = ", ".join(str(flight.seed) for flight in found.flights)
    lines = [f"# In hindsight: {found.scenario}", ""]
    lost = f", {found.lost} of them lost" if found.lost else ""
    lines += [f"{n} flight{'s' * (n > 1)} (seed{'s' * (n > 1)} {seeds}){lost}.", ""]
    flown = next(row for row in found.rows if row.way == FLOWN)
    rows = []
    for row in found.rows:
        name = f"{found.estimator}, as it flew" if row.way == FLOWN else _NAMES[row.way]
        errors = [f"{1e3 * value:.1f}" for value in (*row.rms, row.rms_distance)]
        share = f"{row.rms_distance / flown.rms_distance:.2f}" if flown.rms_distance else "-"
        rows.append([name, *errors, share, "-" if row.nees is None else f"{row.nees:.2f}"])
    lines += table(_HEADER, rows)
    lines += [
        "Root mean squares of the estimated position less the true one, over all ticks of all flights; NEES is 3 on "
        "average where the covariance is right. Hindsight knows the messages of the whole flight, a filter those until "
        "then: so it may err less than a filter's floor.",
        "",
    ]
    for line in found.missing:
        lines += [f"No row: {line}", ""]
    return "\n".join(lines)
