"""The colours and the style of all figures, including the notebooks' figures.

The colours are from Okabe and Ito's palette, whose colours colour-blind readers can tell apart.
"""

from typing import Any, Final

BLUE: Final = "#0072B2"
ORANGE: Final = "#D55E00"
GREEN: Final = "#009E73"
PURPLE: Final = "#CC79A7"
SKY: Final = "#56B4E9"
YELLOW: Final = "#F0E442"

PLANNED: Final = "k"
TRUE: Final = ORANGE
ESTIMATED: Final = BLUE
SHADE: Final = "0.9"  # background of the curves while UWB is blacked out
GREY: Final = "0.55"  # reference lines

# Colours by scenario and by sensor; OTHER is for all other names.
COLOR: Final = {"imu_uwb": BLUE, "imu_uwb_yolo": ORANGE, "uwb": BLUE, "camera": ORANGE, "flow": PURPLE, "imu": GREEN}
OTHER: Final = GREEN

PLAIN: Any = {
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.formatter.min_exponent": 4,  # 0.01 on logarithmic axes, not a power of ten
    "legend.frameon": False,
}
STYLE: Any = PLAIN | {"font.size": 9, "figure.dpi": 130}
