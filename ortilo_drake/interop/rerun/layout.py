"""What the viewer shows when it opens a recording: its default blueprint."""

import rerun.blueprint as rrb

from ortilo_drake.interop.rerun.sending import TIMELINE
from ortilo_drake.interop.rerun.vehicle_drawn import CAMERA

TABS = {
    "arrivals": ["/arrivals/**"],
    "commands": ["/control/**"],
    "ranges": ["/ranges/**"],
    "innovations": ["/innovation/**"],
    "attitude": ["/truth/attitude", "/estimate/attitude"],
}


def default_layout(has_camera: bool) -> rrb.Blueprint:
    """Return the blueprint: the room left; right the picture above the errors, and tabs of other signals."""
    room = rrb.Spatial3DView(origin="/world", name="room")
    errors = rrb.Vertical(*(rrb.TimeSeriesView(origin=f"/errors/{axis}", name=f"{axis} error [m]") for axis in "xyz"))
    others = [rrb.TimeSeriesView(contents=contents, name=name) for name, contents in TABS.items()]
    tabs = rrb.Tabs(*others, name="signals")
    picture = [rrb.Spatial2DView(origin=f"/{CAMERA}", name="camera")] if has_camera else []
    right = rrb.Vertical(*picture, errors, tabs, row_shares=[*([3] if has_camera else []), 4, 2])
    return rrb.Blueprint(
        rrb.Horizontal(room, right, column_shares=[3, 2]),
        rrb.BlueprintPanel(state="collapsed"),
        rrb.SelectionPanel(state="collapsed"),
        rrb.TimePanel(state="collapsed", timeline=TIMELINE),
        auto_views=False,
    )
