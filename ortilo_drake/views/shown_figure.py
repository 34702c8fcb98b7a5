"""Figures that a notebook shows."""

import io
from typing import Any

import matplotlib as mpl
from matplotlib.figure import Figure


class ShownFigure(Figure):
    """A figure that a notebook shows as the result of a cell, also where `%matplotlib inline` was not called.

    It is written in the dpi that it has by now, which a theme may have set; Matplotlib takes those that it was made in.
    """

    def savefig(self, fname: Any, **settings: Any) -> None:
        """Write the figure, as Matplotlib's savefig."""
        if settings.get("dpi", mpl.rcParams["savefig.dpi"]) == "figure":
            settings["dpi"] = self.dpi
        super().savefig(fname, **settings)

    def _repr_png_(self) -> bytes:
        drawn = io.BytesIO()
        self.savefig(drawn, format="png", dpi="figure")
        return drawn.getvalue()
