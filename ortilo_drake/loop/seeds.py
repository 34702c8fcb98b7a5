"""The seed of a system's noise: its Context's own, unless Drake draws the Context or the system has another place."""

import hashlib

import numpy as np
from pydrake.systems.framework import DiagramBuilder, OutputPort
from pydrake.systems.primitives import LinearSystem


def seed_of(own: int, chance: float, place: str) -> int:
    """Return the seed of all noise of a system.

    Args:
        own: seed of the Context; the answer where nothing else is given.
        chance: a number that Drake drew; 0 where it drew none.
        place: where the system is; empty where it has the name that it was made with.
    """
    if chance == 0.0 and not place:
        return own
    text = f"{own} {float(chance).hex()} {place}"
    return int.from_bytes(hashlib.blake2b(text.encode(), digest_size=8).digest(), "little") >> 1


def add_chance(builder: DiagramBuilder, h: float) -> OutputPort:
    """Add what lets Drake draw the seed; return its output, `chance` (1).

    Python's systems are not asked for a random Context. Drake's linear system is: x_{k+1} = x_k, of tick h [s], is 0
    in a default Context, and standard normal in one of SetRandomContext.
    """
    one, none = np.eye(1), np.zeros((1, 0))
    chance = LinearSystem(A=one, B=none, C=one, D=none, time_period=h)
    chance.configure_random_state(one)
    drawn: OutputPort = builder.AddNamedSystem("chance", chance).get_output_port()
    return drawn
