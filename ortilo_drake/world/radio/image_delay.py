"""Keeps pictures for a link that delivers them late."""

import numpy as np
from pydrake.common.value import AbstractValue, Value
from pydrake.systems.framework import Context, LeafSystem, State
from pydrake.systems.sensors import ImageRgba8U

from ortilo_drake.model.clock import tick_of
from ortilo_drake.model.input_files import MIB
from ortilo_drake.model.signals import SHUTTER_SIZE, STAMP
from ortilo_drake.model.typed_yaml import InputError

MOST_KEPT = 1024 * MIB  # most memory for pictures on the way [bytes]


def check_kept(every: int, longest: int, width: int, height: int) -> None:
    """Check the memory for pictures (width x height), one every `every` ticks, each kept for `longest` ticks.

    InputError if they are too large; it names the setting and what is allowed.
    """
    kept = (longest // every + 1) * width * height * 4
    if kept > MOST_KEPT:
        raise InputError(
            f"camera.link.delay: {longest} ticks with random_delay: {kept / MIB:.0f} MiB of pictures of "
            f"{width} x {height} px are then on the way, must not exceed {MOST_KEPT / MIB:.0f} MiB"
        )


class ImageDelay(LeafSystem):
    """Outputs the picture that belongs to a late shutter message.

    Ports:
        color_image (ImageRgba8U): what the camera sees now.
        shutter (2): [arrived, stamp] as the link delivers it.
        image (ImageRgba8U, output): the picture taken at the stamp; any picture if nothing arrived.

    State (abstract, updated each tick): the newest pictures by their tick, as arrays (height, width, 4), uint8.

    Args:
        every: ticks from one picture to the next.
        longest: longest delay [ticks].
        h: tick [s].
    """

    def __init__(self, every: int, longest: int, h: float):
        super().__init__()
        self.set_name("image_delay")
        self._every, self._longest, self._h = every, longest, h
        self._color = self.DeclareAbstractInputPort("color_image", Value(ImageRgba8U()))
        self._shutter = self.DeclareVectorInputPort("shutter", SHUTTER_SIZE)
        self._taken = self.DeclareAbstractState(AbstractValue.Make(dict[int, np.ndarray]()))
        self.DeclarePeriodicUnrestrictedUpdateEvent(h, 0.0, self._take)
        needs = {self._color.ticket(), self._shutter.ticket(), self.abstract_state_ticket(self._taken)}
        self.DeclareAbstractOutputPort(
            "image", lambda: Value(ImageRgba8U()), self._calc_image, prerequisites_of_calc=needs
        )

    def _take(self, context: Context, state: State) -> None:
        k = tick_of(context.get_time(), self._h)
        if k % self._every:
            return
        taken = dict(context.get_abstract_state(int(self._taken)).get_value())
        taken[k] = self._color.Eval(context).data.copy()
        state.get_mutable_abstract_state(int(self._taken)).set_value(
            {tick: pixels for tick, pixels in taken.items() if tick >= k - self._longest}
        )

    def _calc_image(self, context: Context, output: Value) -> None:
        taken = context.get_abstract_state(int(self._taken)).get_value()
        pixels = taken.get(tick_of(self._shutter.Eval(context)[STAMP], self._h))
        if pixels is None:
            output.set_value(self._color.Eval(context))
        else:
            image = ImageRgba8U(pixels.shape[1], pixels.shape[0])
            image.mutable_data[:] = pixels
            output.set_value(image)
