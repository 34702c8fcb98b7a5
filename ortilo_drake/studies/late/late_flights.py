"""The same flights with late measurements ignored, dropped and replayed: the three ways of estimator.delay."""

from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np
import scipy  # not scipy.stats: that takes a second to import, and loads by itself when it is used

from ortilo_drake.flight.ensemble import fly_many
from ortilo_drake.model.typed_yaml import validate
from ortilo_drake.scenario import Scenario
from ortilo_drake.views.markdown import table

MODES: Final = ("ignore", "drop", "replay")
ERRORS: Final = ("path_mse", "path_distance_mse", "estimation_mse")


class LateLinks(NamedTuple):
    """Loss and delay of the sensors' links, all alike, and of the command link.

    Attributes:
        loss: probability that a message is lost, independently.
        delay: fixed delay of the sensors' messages [ticks].
        random_delay: largest additional delay [ticks], drawn uniformly for each message.
        command_loss: probability that a command is lost.
        command_delay: delay of the commands [ticks].
    """

    loss: float = 0.2
    delay: int = 1
    random_delay: int = 1
    command_loss: float = 0.0
    command_delay: int = 0


# 40 ms +- 20 ms: a message sent at t_k arrives 20 to 60 ms later and is used one or two ticks later at 30 Hz, two to
# six at 100 Hz.
AT_30_HZ: Final = LateLinks()
AT_100_HZ: Final = LateLinks(delay=2, random_delay=4)
# The same with the commands lost as often and 33 or 40 ms late, as behind a relay that stands between the halves.
BOTH_WAYS_AT_30_HZ: Final = AT_30_HZ._replace(command_loss=0.2, command_delay=1)
BOTH_WAYS_AT_100_HZ: Final = AT_100_HZ._replace(command_loss=0.2, command_delay=4)


def late_scenario(scenario: Scenario, links: LateLinks, mode: str) -> Scenario:
    """Return a scenario behind such links, with estimator.delay as given; rates and blackouts stay.

    Raises:
        InputError: if a link or the mode cannot be.
    """
    data = scenario.model_dump(mode="json")
    for link in (data["uwb"]["link"], data["imu"]["link"], data["camera"]["link"]):
        link["loss"] = {"kind": "bernoulli", "probability": links.loss}
        link["delay"], link["random_delay"] = links.delay, links.random_delay
    data["command_link"]["loss"] = {"kind": "bernoulli", "probability": links.command_loss}
    data["command_link"]["delay"] = links.command_delay
    data["estimator"]["delay"] = mode
    return validate(Scenario, data, scenario.name)


def late_flights(
    scenario: Scenario,
    seeds: Iterable[int],
    out: Path,
    links: LateLinks = AT_30_HZ,
    workers: int = 1,
    progress: Callable[[dict[str, Any]], None] | None = None,
) -> dict[str, Any]:
    """Fly the same seeds in each of the modes and return how they compare, as plain data.

    Args:
        scenario: the scenario; its links' loss and delay, its seed and its estimator.delay are not used.
        seeds: the seeds.
        out: folder for the flights.
        links: loss and delay of the messages.
        workers: worker processes; 1 flies in this process.
        progress: called with each mode's entry of the report.

    Returns:
        scenario, control_rate, seeds, links; 'modes': what mode_report says of each; 'against': replay compared with
        each of the others by paired.

    Raises:
        InputError: if a flight cannot be flown, or a link cannot be.
    """
    seeds = list(seeds)
    flown = {}
    reports = {}
    for mode in MODES:
        flown[mode] = fly_many(late_scenario(scenario, links, mode), seeds, out, workers)
        reports[mode] = {"mode": mode} | mode_report(flown[mode])
        if progress:
            progress(reports[mode])
    return {
        "scenario": scenario.name,
        "control_rate": scenario.control_rate,
        "seeds": seeds,
        "links": links._asdict(),
        "modes": reports,
        "against": {mode: paired(flown["replay"], flown[mode]) for mode in ("ignore", "drop")},
    }


def errors_of(summaries: list[dict[str, Any]], name: str) -> np.ndarray:
    """Return an error of ERRORS over flights [m^2], the estimation's summed over the axes; NaN where there is none."""
    if name == "estimation_mse":
        return np.array([sum(s["mse"].values()) for s in summaries])
    return np.array([np.nan if s[name] is None else s[name] for s in summaries])


def mode_report(summaries: list[dict[str, Any]]) -> dict[str, Any]:
    """Return flights, how many were lost, the medians of ERRORS, and the mean NEES of position (3 if consistent)."""
    medians = {name: float(np.nanmedian(errors_of(summaries, name))) for name in ERRORS}
    lost = sum(s["lost"] is not None for s in summaries)
    return (
        {"flights": len(summaries), "lost": lost} | medians | {"nees": float(np.mean([s["nees"] for s in summaries]))}
    )


def paired(ours: list[dict[str, Any]], theirs: list[dict[str, Any]]) -> dict[str, dict[str, float]]:
    """Compare two modes seed by seed, for each of ERRORS.

    A lost flight's errors are those up to its loss, which is kind to a mode that loses flights.

    Returns:
        better: in how many seeds ours is the smaller; pairs: of how many; ratio: median of ours / theirs; p: the
        one-sided Wilcoxon signed-rank probability of logarithms that differ so much in our favour by chance.
    """
    compared = {}
    for name in ERRORS:
        a, b = errors_of(ours, name), errors_of(theirs, name)
        both = np.isfinite(a) & np.isfinite(b)
        logarithm = np.log(a[both] / b[both])
        p = float(scipy.stats.wilcoxon(logarithm, alternative="less").pvalue) if np.any(logarithm) else 1.0
        compared[name] = {
            "better": int(np.sum(logarithm < 0.0)),
            "pairs": int(both.sum()),
            "ratio": float(np.exp(np.median(logarithm))),
            "p": p,
        }
    return compared


def late_table(reports: Iterable[dict[str, Any]]) -> list[str]:
    """Return the reports of late_flights as a Markdown table, a row for each scenario and mode."""
    header = [
        "scenario",
        "estimator.delay",
        "lost",
        "path MSE",
        "path distance MSE",
        "estimation MSE",
        "NEES",
        "replay better",
    ]
    rows = []
    for report in reports:
        what = f"{report['scenario']}, {report['control_rate']:g} Hz, " + _late(report["links"])
        for mode, found in report["modes"].items():
            against = report["against"].get(mode, {}).get("path_mse")
            rows.append(
                [what, mode, f"{found['lost']} of {found['flights']}"]
                + [f"{found[name]:.4f}" for name in ERRORS]
                + [f"{found['nees']:.2f}"]
                + [f"{against['better']} of {against['pairs']}, p = {against['p']:.1g}" if against else ""]
            )
    return table(header, rows)


def _late(links: dict[str, float] | str) -> str:
    if isinstance(links, str):
        return links
    return "both ways" if links["command_loss"] or links["command_delay"] else "sensors only"
