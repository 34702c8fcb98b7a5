"""The report of a fit, in lines of plain text."""

from typing import Any

from ortilo_drake.scenario.noise_file import NoiseFile

UNITS = {
    "white": "m",
    "time": "s",
    "sd": "m",
    "length": "m",
    "constants": "m",
    "share": "",
    "rotation": "rad/s/√Hz",
    "force": "m/s²/√Hz",
    "rotation_rest": "rad/s/√Hz",
    "force_rest": "m/s²/√Hz",
}


def fit_lines(found: NoiseFile) -> list[str]:
    """Return the numbers with their intervals, then the other figures and the notes."""
    lines = []
    for name, (low, high) in found.intervals.items():
        value: Any = found.model_dump()
        for key in name.split("."):
            value = value["xyz".index(key)] if key in ("x", "y", "z") else value[int(key) if key.isdigit() else key]
            if value is None:  # constants of anchors some of which were not heard
                break
        shown = "-" if value is None else f"{value:.3g}"
        unit = next((UNITS[part] for part in reversed(name.split(".")) if part in UNITS), "")
        lines.append(f"{name:24} {shown:>9} {unit:10} {low:.3g} to {high:.3g}".rstrip())
    uwb, imu = found.uwb, found.imu
    lines.append(f"outliers: {uwb.outliers.sd:.2g} m, {uwb.outliers.burst:.2g} of an anchor in a row")
    lines.append(f"ranges: {uwb.rate:.0f} in a second, {uwb.missing:.1%} missing of the usual interval's")
    if imu is not None:
        lines.append(f"imu: {imu.rate:.0f} samples in a second, {imu.missing:.1%} missing of the usual interval's")
    return [*lines, *found.notes]
