"""The default blueprint of the Rerun viewer: the views with which it opens a recording."""

import numpy as np
import rerun.blueprint as rrb

from ortilo_drake.interop.rerun.vehicle_drawn import CAMERA, TIMELINE
from ortilo_drake.model.room import Room

TABS = {
    "arrivals": ["/arrivals/**"],
    "commands": ["/control/**"],
    "ranges": ["/ranges/**", "/differences/**"],
    "innovations": ["/innovation/**"],
    "attitude": ["/truth/attitude", "/estimate/attitude"],
}

AWAY, FROM = 1.0, np.array([0.0, -0.68, 0.73])  # eye: distance over the longest side; direction, from south and above


def default_layout(room: Room, has_camera: bool) -> rrb.Blueprint:
    """Return the blueprint: the room on the left; on the right the picture, the errors, and tabs of other signals."""
    low, high = np.array(room.interior.min), np.array(room.interior.max)
    middle, away = (low + high) / 2, AWAY * max(high - low)
    eye = rrb.EyeControls3D(position=middle + away * FROM, look_target=middle, eye_up=[0.0, 0.0, 1.0])
    view = rrb.Spatial3DView(origin="/world", name="room", eye_controls=eye)
    errors = rrb.Vertical(*(rrb.TimeSeriesView(origin=f"/errors/{axis}", name=f"{axis} error [m]") for axis in "xyz"))
    others = [rrb.TimeSeriesView(contents=contents, name=name) for name, contents in TABS.items()]
    tabs = rrb.Tabs(*others, name="signals")
    picture = [rrb.Spatial2DView(origin=f"/{CAMERA}", name="picture")] if has_camera else []
    right = rrb.Vertical(*picture, errors, tabs, row_shares=[*([3] if has_camera else []), 4, 2])
    return rrb.Blueprint(
        rrb.Horizontal(view, right, column_shares=[3, 2]),
        rrb.BlueprintPanel(state="collapsed"),
        rrb.SelectionPanel(state="collapsed"),
        rrb.TimePanel(state="collapsed", timeline=TIMELINE),
        auto_views=False,
    )
