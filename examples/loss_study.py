"""A study of your own: how many messages may be lost before the estimate gets bad, as a table and a picture.

    python examples/loss_study.py

Each point is a scenario with one setting changed, flown with the same seeds; out/loss_study.png shows medians, and the
middle half of the flights.
"""

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd

import ortilo_drake as od

LOSSES = (0.0, 0.3, 0.6, 0.9)


def fly(losses: tuple[float, ...] = LOSSES, seeds: range = range(4), **settings: object) -> pd.DataFrame:
    """Return a row for each flight: the loss rate of both radio links, whether it was lost, and its RMS error [m]."""
    rows = []
    for loss in losses:
        links = {"uwb__link__loss": loss, "camera__link__loss": loss, "camera__kind": "projected"}
        for flight in od.fly_many("imu_uwb_yolo", seeds, **links, **settings):
            rms = float(np.sqrt((flight.error**2).sum("axis").mean()))
            rows.append({"loss": loss, "lost": flight.lost is not None, "rms": rms})
    return pd.DataFrame(rows)


def draw(flights: pd.DataFrame, file: Path) -> None:
    """Draw the RMS error of the flights that were not lost against the loss rate."""
    kept = flights[~flights["lost"]].groupby("loss")["rms"]
    figure, axes = plt.subplots(figsize=(5, 3), layout="constrained")
    axes.fill_between(kept.median().index, 100 * kept.quantile(0.25), 100 * kept.quantile(0.75), alpha=0.2)
    axes.plot(kept.median().index, 100 * kept.median(), marker="o")
    axes.set(xlabel="messages lost [1]", ylabel="RMS error of the position [cm]", ylim=(0, None))
    file.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(file, dpi=150)
    plt.close(figure)


def main(file: Path = Path("out/loss_study.png"), **settings: object) -> pd.DataFrame:
    """Fly the study, print its table, draw its picture."""
    flights = fly(**settings)
    print(flights.groupby("loss").agg(flights=("rms", "size"), lost=("lost", "sum"), median_rms=("rms", "median")))
    draw(flights, file)
    print(f"wrote {file}")
    return flights


if __name__ == "__main__":
    main()
