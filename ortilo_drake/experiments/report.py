"""The tables as text: ours with intervals, beside the paper's."""

from typing import Any

from ortilo_drake.experiments.tables import SCENARIOS, STATISTICS

_TITLE = {"imu_uwb": "IMU+UWB", "imu_uwb_yolo": "IMU+UWB+YOLO"}
_NAME = {"mean": "mean", "median": "median", "p75": "75 %", "p25": "25 %"}


def _cell(value: float | None, interval: list[float] | None) -> str:
    if value is None:
        return "none"
    return f"{value:.4f}" + (f" [{interval[0]:.4f}, {interval[1]:.4f}]" if interval else "")


def _rows(tables: dict[str, Any], scenario: str, columns: dict[str, tuple[Any, Any]]) -> list[str]:
    lines = [
        f"| {_TITLE[scenario]} | " + " | ".join(f"{name} | paper" for name in columns) + " |",
        "|---" * (1 + 2 * len(columns)) + "|",
    ]
    for statistic in STATISTICS:
        cells = []
        for name, (ours, paper) in columns.items():
            cells += [
                _cell(ours[statistic], tables["intervals"][scenario][name][statistic]),
                f"{paper[statistic]:.4f}",
            ]
        lines.append(f"| {_NAME[statistic]} | " + " | ".join(cells) + " |")
    return lines


def table_text(tables: dict[str, Any]) -> str:
    """Return tables I and II as Markdown, ours (bootstrap 95 % intervals) beside the paper's.

    Args:
        tables: what make_tables returned.
    """
    paper = tables["paper"]
    lines = [f"# The paper's tables, preset '{tables['preset']}', {tables['flights']} flights a scenario", ""]
    lines += ["Mean squared errors [m²] of flights not lost, with bootstrap 95 % intervals.", ""]
    lines += ["## Table I: estimation error, xhat(k|k-1)", ""]
    for scenario in SCENARIOS:
        ours = tables["estimation"][scenario]
        lines += [
            *_rows(tables, scenario, {a: (ours[a], paper["estimation"][scenario][a]) for a in ours}),
            "",
        ]
    lines += ["## Table II: path-following error, deviation in y at the actual x", ""]
    for scenario in SCENARIOS:
        columns = {"path": (tables["path"][scenario], paper["path"][scenario])}
        lines += [*_rows(tables, scenario, columns), ""]
    lines += ["## Beside the tables", ""]
    drop = tables["drop_in_x"]
    if drop is not None:
        low, high = drop["interval"]
        lines.append(
            f"- The camera lowers the median MSE in x by {drop['median']:.1%} [{low:.1%}, {high:.1%}]; paper 93.35 %."
        )
    for scenario in SCENARIOS:
        rates = [f"{sensor} {rate:.1%}" for sensor, rate in tables["arrivals"][scenario].items() if rate is not None]
        nees = tables["nees"][scenario]
        distance = tables["path_distance"][scenario]["median"]
        lines.append(
            f"- {_TITLE[scenario]}: {tables['lost'][scenario]} of {tables['flights']} flights lost, "
            f"{tables['touched'][scenario]} touched furniture; fixes used of due: {', '.join(rates) or 'none'}; "
            f"mean position NEES {'none' if nees is None else format(nees, '.2f')} (3 if consistent); "
            f"median squared distance to the path {_cell(distance, None)} m²."
        )
    return "\n".join(lines) + "\n"
