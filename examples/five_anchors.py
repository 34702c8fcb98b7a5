"""Fly in a room of your own: the hall of five_anchors.yaml, around the shelves in its middle.

    python examples/five_anchors.py
    ortilo fly imu_uwb --set room=examples/five_anchors.yaml --set 'planner.start=[1.5, 1.5]' \
        --set 'planner.goal=[8.5, 6.5]' --set 'uwb.link.blackouts=[]'

The planner finds its way around what stands in the room; ranges come from the room's own anchors.
"""

from pathlib import Path

import numpy as np

import ortilo_drake as od

ROOM = Path(__file__).with_name("five_anchors.yaml")


def main(**settings: object) -> od.Flight:
    """Fly, and print the verdict and how well each anchor was in reach."""
    path = {"planner__start": [1.5, 1.5], "planner__goal": [8.5, 6.5]}
    flight = od.fly("imu_uwb", room=ROOM, uwb__link__blackouts=[], **(path | settings))
    print(flight)
    anchors = flight.scenario.load_room().anchor_positions
    distance = np.linalg.norm(flight.data["truth"].values[:, np.newaxis, :3] - anchors, axis=2)
    for k, (nearest, farthest) in enumerate(zip(distance.min(axis=0), distance.max(axis=0), strict=True)):
        print(f"anchor {k}: {nearest:.1f} to {farthest:.1f} m away")
    return flight


if __name__ == "__main__":
    main()
