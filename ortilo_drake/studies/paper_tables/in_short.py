"""The paper's tables in at most five lines."""

from ortilo_drake.studies.paper_tables.tables import SCENARIOS, Tables

TITLES = {"imu_uwb": "IMU+UWB", "imu_uwb_yolo": "IMU+UWB+YOLO"}


def in_short(tables: Tables) -> list[str]:
    """Return what the tables say in short, as Markdown's list: at most five lines, whatever stands beside the paper's.

    Args:
        tables: what make_tables returned.
    """
    lost = [f"{TITLES.get(name, name)} {count} of {tables.flights}" for name, count in tables.lost.items()]
    lines = [f"Flights lost: {', '.join(lost)}."]
    for name in SCENARIOS:
        ours = [axis["median"] for axis in tables.estimation[name].values()]
        paper = [f"{axis['median']:.4f}" for axis in tables.paper.estimation[name].values()]
        found = [f"{value:.4f}" for value in ours if value is not None]
        said = f"{', '.join(found)} m² in {', '.join(tables.estimation[name])}" if found else "none"
        lines.append(f"{TITLES[name]}, median squared error: {said} (paper: {', '.join(paper)}).")
    if tables.drop_in_x is not None:
        change = tables.drop_in_x.median
        lines.append(f"The camera {'lowers' if change >= 0.0 else 'raises'} that in x by {abs(change):.0%}.")
    nees = [f"{TITLES.get(name, name)} {value:.2f}" for name, value in tables.nees.items() if value is not None]
    if nees:
        lines.append(f"Mean NEES of the position, 3 if the filter claims what it knows: {', '.join(nees)}.")
    return ["## In short", "", *(f"- {line}" for line in lines), ""]
