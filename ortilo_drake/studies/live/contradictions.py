"""Errors of the map that make a live filter's estimates unfit for flight, whatever variance they claim."""

from ortilo_drake.studies.live.anchor_bank import AnchorWatch
from ortilo_drake.studies.live.rates_watch import RatesWatch
from ortilo_drake.studies.recorded.heading_doubts import HeadingWatch


def lasting_cause(rates: RatesWatch | None, heading: HeadingWatch | None, places: AnchorWatch) -> str:
    """Return the lasting error that was found in the map, in words; empty if there is none."""
    if rates is not None and rates.doubt:
        return "the body rates are not those that the map says"
    if heading is not None and heading.doubt is not None:
        return "the heading is wrong"
    if heading is not None and heading.mirror is not None:
        return "the anchors are a mirror image"
    if places.wrong is not None and places.wrong.place is None:
        return "two anchors are exchanged"
    return ""
