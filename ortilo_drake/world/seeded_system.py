"""The seed of all noise, a parameter of the Context: one Diagram flies any number of seeds."""

from typing import Any

from pydrake.common.value import Value
from pydrake.systems.framework import Context, Diagram, LeafSystem


class Seeded:
    """The seed of a LeafSystem of any scalar type, whose noise is a function of it.

    Parameters of the Context:
        seed (abstract, int): any that a scenario allows; a number would hold no more than 2^53.
    """

    def declare_seed(self: Any, seed: int) -> None:
        """Declare the parameter, with its value in a default Context."""
        self._seed = self.DeclareAbstractParameter(Value[object](seed))

    def seed_in(self, context: Any) -> int:
        """Return the seed in a context of this system."""
        seed: int = context.get_abstract_parameter(self._seed).get_value()
        return seed

    def set_seed_in(self, context: Any, seed: int) -> None:
        """Set the seed in a context of this system."""
        context.get_mutable_abstract_parameter(self._seed).set_value(seed)


class SeededSystem(LeafSystem, Seeded):
    """A system of floats whose noise is a function of the seed in its Context, see Seeded.

    Args:
        seed: the seed of a default Context.
    """

    def __init__(self, seed: int):
        super().__init__()
        self.declare_seed(seed)


def set_seed(world: Diagram, context: Context, seed: int) -> None:
    """Set the seed of a world's noise, of every source alike; the context is the root's."""
    for system in world.GetSystems():
        if isinstance(system, Seeded):
            source: Any = system
            source.set_seed_in(source.GetMyMutableContextFromRoot(context), seed)
