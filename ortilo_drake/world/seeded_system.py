"""The seed of all noise, a parameter of the Context: one Diagram flies any number of seeds."""

from pydrake.common.value import Value
from pydrake.systems.framework import Context, LeafSystem


class SeededSystem(LeafSystem):
    """A system of floats whose noise is a function of the seed in its Context.

    Parameters of the Context:
        seed (abstract, int): any that a scenario allows; a number would hold no more than 2^53.

    Args:
        seed: the seed of a default Context.
    """

    def __init__(self, seed: int):
        super().__init__()
        self._seed = self.DeclareAbstractParameter(Value[object](seed))

    def seed_in(self, context: Context) -> int:
        """Return the seed in a context of this system."""
        seed: int = context.get_abstract_parameter(self._seed).get_value()
        return seed

    def set_seed_in(self, context: Context, seed: int) -> None:
        """Set the seed in a context of this system."""
        context.get_mutable_abstract_parameter(self._seed).set_value(seed)
