"""The message that goes with a picture."""

from pydrake.systems.framework import BasicVector, Context, LeafSystem

from ortilo_drake.model.signals import SHUTTER_SIZE


class Shutter(LeafSystem):
    """Memoryless: [arrived, stamp] of a picture taken now.

    Ports:
        shutter (2, output): 1 and the time [s].
    """

    def __init__(self) -> None:
        super().__init__()
        self.set_name("shutter")
        self.DeclareVectorOutputPort(
            "shutter", SHUTTER_SIZE, self._calc_shutter, prerequisites_of_calc={self.time_ticket()}
        )

    def _calc_shutter(self, context: Context, output: BasicVector) -> None:
        output.SetFromVector([1.0, context.get_time()])
