"""Settings of the onboard half for commands that act late, or never."""

from typing import Annotated, Literal

from pydantic import Field

from ortilo_drake.model.typed_yaml import Frozen


class Commands(Frozen):
    """How filter and servo account for the delay and loss of commands on their way to the rotors."""

    filter: Literal["sent", "acted"] = "sent"
    """'sent' predicts with each command as if it acted at its tick, the paper's filter. 'acted' predicts with the
    commands that acted and when, as the world reports them, and puts right the ticks of which it learns later; only
    with estimator.delay 'replay'."""
    servo: Literal["present", "predicted", "augmented"] = "present"
    """'present' acts on the state of the tick. 'predicted' acts on the state and the reference of the time at which its
    command will act, with the commands on the way. 'augmented' acts on the state of the tick and the commands on the
    way, by the LQ gain of a plant that has them as states."""
    delay: Annotated[float, Field(ge=0.0, le=1.0)] | None = None
    """time from the tick of a command until it acts [s]. null uses the delays that the world reports; 'augmented' needs
    a number, because its gain is computed before the flight."""

    @property
    def are_reported(self) -> bool:
        """True if the world reports which commands acted."""
        return self.filter == "acted" or (self.servo == "predicted" and self.delay is None)

    @property
    def are_kept(self) -> bool:
        """True if the onboard half keeps its commands."""
        return self.filter == "acted" or self.servo == "predicted"
