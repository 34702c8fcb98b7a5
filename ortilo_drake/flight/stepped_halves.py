"""The world and the onboard half as two objects that are stepped tick by tick.

At t_k the world gives its messages (sample), the onboard half takes them and gives the control (receive, answer), and
only then do both go on to t_{k+1} (advance). Drake's AdvanceTo stops at t_k before the updates of t_k. So each half
updates from the same values as over a wire, and the flight equals the one of diagrams/closed_loop.py bit for bit.

A tick's *messages* are a dict from the name of an onboard input port to its value. The values are message vectors
(model/signals.py), those that are all zero left out, and 'image' (height, width, 4), uint8, if the shutter message
arrived. A tick's *outputs* are a dict of the onboard half's logged signals, see flight/signals.py.
"""

import numpy as np
from pydrake.common.value import AbstractValue, Value
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import Context, PortDataType
from pydrake.systems.sensors import ImageRgba8U
from pydrake.trajectories import Trajectory

from ortilo_drake.diagrams.onboard import Onboard, make_onboard
from ortilo_drake.diagrams.world import make_world
from ortilo_drake.flight.flight import fix_steps
from ortilo_drake.flight.signals import Signals, output_sizes
from ortilo_drake.model.signals import ARRIVED, N_XBAR
from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.onboard.estimator.resume import about_reference, after_gap
from ortilo_drake.onboard.planner.planned import planned, start_of
from ortilo_drake.onboard.planner.players import path_value
from ortilo_drake.scenario import Belief, Scenario
from ortilo_drake.world.vehicle.acted_report import NO_COMMAND
from ortilo_drake.world.vehicle.failsafe import MODES


class WorldHalf:
    """The world of a scenario; its vehicle hovers at the start of the planned path.

    The world reads its command input every `command_period` [s], see diagrams/world.py, by default every tick. `draws`
    says whether this object draws the pictures of a rendered camera.
    """

    def __init__(self, scenario: Scenario, command_period: float | None = None, draws: bool = True):
        self._diagram = make_world(scenario, command_period, fused=True, r_0=start_of(planned(scenario)))
        ports = [self._diagram.get_output_port(i) for i in range(self._diagram.num_output_ports())]
        views = ("state", "failsafe_mode", "image", "depth_image", "label_image")
        self._messages = {port.get_name(): port for port in ports if port.get_name() not in views}
        self._image = self._diagram.GetOutputPort("image") if scenario.is_rendered and draws else None
        self._state, self._h = self._diagram.GetOutputPort("state"), scenario.h
        self._control = self._diagram.GetInputPort("control" if command_period is None else "command")
        is_told = self._diagram.HasInputPort("command_stamp")
        self._stamp = self._diagram.GetInputPort("command_stamp") if is_told else None
        self._hover = np.array([scenario.vehicle.hover_thrust, 0.0, 0.0, 0.0, 0.0])[: self._control.size()]
        # A throwaway start, as in flight/flight.py: numba compiles, and VTK draws its very first picture of a scene,
        # which differs from the later ones in the last bits of a few pixels.
        self._start(scenario)
        self.sample()
        self.advance_to(self._h, self._hover)
        self._start(scenario)

    def _start(self, scenario: Scenario) -> None:
        self._simulator, self._k = Simulator(self._diagram), 0
        fix_steps(self._simulator, scenario)
        self._diagram.SetSeed(self._simulator.get_mutable_context(), scenario.seed)
        self._control.FixValue(self._simulator.get_mutable_context(), self._hover)  # until a command comes
        if self._stamp is not None:
            self._stamp.FixValue(self._simulator.get_mutable_context(), np.array([NO_COMMAND]))
        self._simulator.Initialize()

    @property
    def state(self) -> np.ndarray:
        """The true state x at this time (12)."""
        return np.array(self._state.Eval(self._simulator.get_context()))

    @property
    def failsafe_mode(self) -> str | None:
        """The mode of the failsafe, one of MODES; None without a command_period, for then there is no failsafe."""
        if not self._diagram.HasOutputPort("failsafe_mode"):
            return None
        mode = self._diagram.GetOutputPort("failsafe_mode").Eval(self._simulator.get_context())
        return MODES[int(mode[0])]

    def change_body(self, heavier: float, push: np.ndarray) -> None:
        """Multiply the vehicle's mass by 1 + heavier and push it by `push` in W (3) [N] from now on, see ChangeBody."""
        self._diagram.ChangeBody(self._simulator.get_mutable_context(), heavier, push)

    def sample(self) -> Signals:
        """Return the messages of this tick."""
        context = self._simulator.get_context()
        values = {name: np.array(port.Eval(context)) for name, port in self._messages.items()}
        messages = {name: value for name, value in values.items() if value.any()}
        if self._image is not None and "shutter" in messages and messages["shutter"][ARRIVED] == 1.0:
            messages["image"] = np.array(self._image.Eval(context).data)
        return messages

    def advance(self, control: np.ndarray) -> None:
        """Go on to the next tick with a control u (4); with a command_period with a command (5)."""
        self._k += 1
        self.advance_to(self._k * self._h, control)

    def advance_to(self, time: float, control: np.ndarray, stamp: float = NO_COMMAND) -> None:
        """Same as advance, up to a time [s]; `stamp` is the time of the tick that sent the command [s]."""
        if self._stamp is not None:
            self._stamp.FixValue(self._simulator.get_mutable_context(), np.array([stamp]))
        self._control.FixValue(self._simulator.get_mutable_context(), control)
        self._simulator.AdvanceTo(time, interruptible=False)


class OnboardHalf:
    """The onboard half of a scenario.

    It takes only the scenario's belief. With `detects` it detects landmarks in a rendered camera's pictures, else it
    receives detections. With `fused` all elements are one system, which is faster, else each element is a system.
    """

    def __init__(self, scenario: Belief, detects: bool = True, fused: bool = True):
        scenario = scenario.belief
        plan = planned(scenario)
        self._path = plan if isinstance(plan, Trajectory) else None
        self._diagram = make_onboard(scenario, self._path, detects, takes_paths=True, fused=fused)
        ports = [self._diagram.get_input_port(i) for i in range(self._diagram.num_input_ports())]
        self._ports = {port.get_name(): port for port in ports}
        self._absent = {
            name: np.zeros(port.size())
            for name, port in self._ports.items()
            if port.get_data_type() == PortDataType.kVectorValued
        }
        self._outputs = {name: self._diagram.GetOutputPort(name) for name in output_sizes(scenario.measurement)}
        self._h, self._yaw = scenario.h, scenario.yaw
        self.restart()

    def restart(self) -> None:
        """Start again, at tick 0."""
        self._simulator, self._k = Simulator(self._diagram), 0
        self.receive({})
        if self._path is not None:
            self.fly_path(self._path)
        if "image" in self._ports:
            self._ports["image"].FixValue(self._simulator.get_mutable_context(), AbstractValue.Make(ImageRgba8U()))
        self._simulator.Initialize()

    @property
    def diagram(self) -> Onboard:
        """The Diagram of diagrams/onboard.py."""
        return self._diagram

    @property
    def context(self) -> Context:
        """The Context of `diagram` at this time."""
        return self._simulator.get_context()

    @property
    def path(self) -> Trajectory | None:
        """The path that is flown, p_WB(t) (3 rows) [m]; None where the planner is a System."""
        return self._path

    def fly_path(self, path: Trajectory) -> None:
        """Fly another path, p_WB(t) (3 rows) [m], from this tick on; call this before the tick's receive.

        InputError if the planner is a System.
        """
        if "path" not in self._ports:
            raise InputError("planner: is a System: cannot take a new path in flight")
        self._path = path
        self._ports["path"].FixValue(self._simulator.get_mutable_context(), path_value(path))

    def receive(self, messages: Signals) -> None:
        """Put this tick's messages on the input ports."""
        context = self._simulator.get_mutable_context()
        for name, nothing in self._absent.items():
            self._ports[name].FixValue(context, messages.get(name, nothing))
        if "image" in messages:
            self._ports["image"].FixValue(context, image_value(messages["image"]))

    def answer(self) -> np.ndarray:
        """Return the control u_k (4)."""
        return np.array(self._outputs["control"].Eval(self._simulator.get_context()))

    def outputs(self) -> Signals:
        """Return every logged signal of this tick, with the values that the filter uses."""
        context = self._simulator.get_context()
        return {name: np.array(port.Eval(context)) for name, port in self._outputs.items()}

    def state(self) -> np.ndarray:
        """Return the whole discrete state at this time, group after group."""
        groups = self._simulator.get_context().get_discrete_state()
        return np.concatenate([groups.value(i) for i in range(groups.num_groups())])

    def resume(self, tick: int, state: np.ndarray | None, gap: float) -> None:
        """Join a flight at a tick, with the state() of `gap` [s] ago, or None if there is none; see resume.py."""
        context = self._simulator.get_mutable_context()
        context.SetTime(tick * self._h)
        groups = context.get_mutable_discrete_state()
        if state is not None:
            edges = np.cumsum([groups.value(i).size for i in range(groups.num_groups())])
            for i, part in enumerate(np.split(state, edges[:-1])):
                groups.set_value(i, part)
        if state is None:
            reference = self._outputs["reference"].Eval(self._simulator.get_context())
            xbar, P = about_reference(reference, self._yaw)
        else:
            xbar, P = (self._outputs[name].Eval(context) for name in ("estimate", "covariance"))
            xbar, P = after_gap(xbar, P.reshape(N_XBAR, N_XBAR), gap)
        self._diagram.SetBelief(context, xbar, P)
        self._k = tick
        self._simulator.Initialize()

    def set_belief(self, xbar: np.ndarray, P: np.ndarray) -> None:
        """Set the estimator's estimate (15) and covariance (15 x 15)."""
        self._diagram.SetBelief(self._simulator.get_mutable_context(), xbar, P)

    def advance(self) -> None:
        """Go on to the next tick."""
        self._k += 1
        self._simulator.AdvanceTo(self._k * self._h, interruptible=False)


def image_value(pixels: np.ndarray) -> AbstractValue:
    """Return a picture (height, width, 4), uint8, as the value of an image port."""
    height, width, _ = pixels.shape
    image = ImageRgba8U(width, height)
    image.mutable_data[:] = pixels
    return Value(image)
