"""The loss curve of a training."""

from pathlib import Path

from matplotlib.figure import Figure

from ortilo_drake.views.pictures import save_picture


def losses_figure(history: list[dict[str, float]], path: Path) -> Path:
    """Draw the loss of each epoch and its parts to a PNG; return its path."""
    figure = Figure(figsize=(6.0, 3.6), dpi=120, layout="constrained")
    axes = figure.add_subplot()
    epochs = range(1, len(history) + 1)
    for name in ("loss", "box", "object", "class"):
        axes.semilogy(epochs, [row[name] for row in history], "k" if name == "loss" else "", label=name, marker=".")
    axes.set(xlabel="epoch", ylabel="loss a picture")
    axes.grid(alpha=0.3)
    axes.legend(frameon=False)
    return save_picture(figure, path)
