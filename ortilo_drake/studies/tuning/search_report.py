"""The result of a search by flights, as text and as a scenario that flies."""

import yaml

from ortilo_drake.studies.tuning.search import LOST, Found

SHOWN = 6  # significant digits


def _millimetres(metres: float) -> str:
    return f"{round(1000.0 * metres, 1) + 0.0:.1f} mm"  # never -0.0


def search_lines(found: Found) -> list[str]:
    """Return the result in short."""
    judged, search = found.judged, found.search
    low, high = _millimetres(judged.low), _millimetres(judged.high)
    said = "no difference is shown" if judged.low <= 0.0 <= judged.high else "better" if judged.high < 0.0 else "worse"
    lines = [
        f"{len(found.history)} candidates, {search.flights} flights each: {_millimetres(found.start.cost)} -> "
        f"{_millimetres(found.best.cost)}, on the seeds that were searched on",
        f"on {judged.flights} other seeds: {_millimetres(judged.start)} -> {_millimetres(judged.found)}, "
        f"difference {_millimetres(judged.difference)} ({low} to {high}, 95 %): {said}",
    ]
    for name, (count, least, most) in (("start", judged.start_lost), ("found", judged.found_lost)):
        lines.append(f"{name}: {count} of {judged.flights} lost ({least:.2%} to {most:.2%})")
    lines.append(f"the mean over flights of the RMS distance from the path, a lost flight counting {LOST:g} m")
    if found.by_drake is not None:
        lines.append(f"Drake flew, not the engine: {found.by_drake}")
    return lines


def found_text(found: Found, base: str) -> str:
    """Return the best candidate as a scenario file over a base, with the result in a comment before it."""
    data: dict[str, object] = {"base": base}
    for key, value in (*found.search.settings.items(), *found.best.settings.items()):
        *groups, last = key.split(".")
        inner = data
        for group in groups:
            below = inner.setdefault(group, {})
            assert isinstance(below, dict)
            inner = below
        inner[last] = _rounded(value)
    return "".join(f"# {line}\n" for line in search_lines(found)) + yaml.safe_dump(data, sort_keys=False)


def _rounded(value: object) -> object:
    if isinstance(value, list):
        return [_rounded(one) for one in value]
    return float(f"{value:.{SHOWN}g}") if isinstance(value, float) else value
