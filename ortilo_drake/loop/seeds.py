"""The seed of a system's noise: the Context's own seed, unless Drake drew the Context or the system was renamed."""

import hashlib

import numpy as np
from pydrake.systems.framework import DiagramBuilder, OutputPort
from pydrake.systems.primitives import LinearSystem


def seed_of(own: int, chance: float, place: str) -> int:
    """Return the seed of all noise of a system.

    Args:
        own: seed of the Context; returned unchanged if chance is 0 and place is empty.
        chance: a number that Drake drew; 0 if Drake drew none.
        place: name of the system in its Diagram; empty if the system has the name that it was made with.
    """
    if chance == 0.0 and not place:
        return own
    text = f"{own} {float(chance).hex()} {place}"
    return int.from_bytes(hashlib.blake2b(text.encode(), digest_size=8).digest(), "little") >> 1


def add_chance(builder: DiagramBuilder, h: float) -> OutputPort:
    """Add the system by which Drake can draw the seed; return its output `chance` (1).

    Drake draws no random state for systems written in Python, but does for its own LinearSystem. This one has
    x_{k+1} = x_k with tick h [s]; x is 0 in a default Context and standard normal after SetRandomContext.
    """
    one, none = np.eye(1), np.zeros((1, 0))
    chance = LinearSystem(A=one, B=none, C=one, D=none, time_period=h)
    chance.configure_random_state(one)
    drawn: OutputPort = builder.AddNamedSystem("chance", chance).get_output_port()
    return drawn
