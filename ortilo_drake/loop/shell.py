"""Elements as Drake systems: boxes of a wiring, one or many, as one LeafSystem of any scalar type.

Floats run through compiled functions: of one box each function is called by itself, of several a generated function
calls them one after the other. AutoDiffXd and Expression run through the plain source (plain.py).
"""

import hashlib
import sys
from collections.abc import Iterable
from typing import Any

import numpy as np
from pydrake.autodiffutils import AutoDiffXd
from pydrake.common.value import Value
from pydrake.symbolic import Expression
from pydrake.systems.framework import BasicVector_, DiagramBuilder, LeafSystem_, OutputPort, ValueProducer
from pydrake.systems.primitives import LinearSystem
from pydrake.systems.scalar_conversion import TemplateSystem

from ortilo_drake.loop.calls import PlainCalls, Reading, compiled_calls
from ortilo_drake.loop.element import OUTSIDE, Values
from ortilo_drake.loop.player import Memory
from ortilo_drake.loop.raised import listen, tell
from ortilo_drake.loop.source import places_of
from ortilo_drake.loop.wiring import Wire, Wiring

_NOTHING = np.zeros(0)


@TemplateSystem.define("WiredSystem_", T_list=[float, AutoDiffXd, Expression], scope=sys.modules[__name__])
def WiredSystem_(T: type) -> type:
    """Return the system for a scalar type: float, AutoDiffXd or Expression."""

    class Impl(LeafSystem_[T]):
        """Boxes of a wiring as one system.

        Ports:
            <input>: what a box of OUTSIDE stands for, by its name.
            chance (1): only where a box draws noise; not connected or 0, the seed is the Context's, else another one.
            <output> (outputs): what is asked for, by the names that are given.

        State (discrete, updated every h): the states of all boxes, one after the other; none where no box has a step,
        as they are constants then.

        Parameter of the Context, abstract (player.Memory): the seed of all noise, and the boxes' numbers and tables,
        which a world that differs sets anew. A system that has another name in its Diagram than it was made with, such
        as a second one of its kind, has other noise (seed_of).

        Within a tick an output depends on the inputs that what it shows is made of. What is said is computed once a
        tick: other outputs and the update read it from the cache.

        Args:
            name: of the system.
            wiring: its boxes, with one of OUTSIDE for each input.
            outputs: what each output port shows, by its name: signals, "box" or "box.part", one after the other.
            h: tick [s].
            seed: of all noise in a default Context.
        """

        def _construct(
            self,
            name: str,
            wiring: Wiring,
            outputs: dict[str, tuple[str, ...]],
            h: float,
            seed: int = 0,
            converter: Any = None,
        ) -> None:
            LeafSystem_[T].__init__(self, converter=converter)
            self.set_name(name)
            self._arguments = {"name": name, "wiring": wiring, "outputs": outputs, "h": h, "seed": seed}
            self._h, self._wiring, self._places = h, wiring, places_of(wiring)
            self._checked = any(box.element.checked for box in wiring.boxes.values())
            reading, memory = Reading(wiring), Memory(wiring, self._places)
            memory.seeds = np.array([seed])
            self._given = self.DeclareAbstractParameter(Value[object](memory))
            self._chance: Any = None
            self._ports = {i: self.DeclareVectorInputPort(i, box.size) for i, box in reading.inputs.items()}
            if reading.draws:
                self._chance = self.DeclareVectorInputPort("chance", 1)
                made = ValueProducer(lambda: Value[object](memory), self._calc_seeded)
                tickets = {self.all_parameters_ticket(), self._chance.ticket()}
                self._seeded = self.DeclareCacheEntry("seeded", made, tickets)
            self._state = None
            if reading.steps and memory.S.size:
                self._state = self.DeclareDiscreteState(BasicVector_[T](memory.S))
            self._calls = {f"said_{i}": calls for i, calls in enumerate(reading.groups.values())}
            self._calls["step"] = reading.steps
            if T is float:
                self._compiled = compiled_calls(wiring, self._calls)
            else:
                self._plain = PlainCalls(wiring, T)
            self._all, self._unsaid = reading.all, [name for name in reading.inputs if name not in reading.all]
            self._groups: dict[frozenset[str], Any] = {}
            if self._places.sizes["Y"]:
                for i, needs in enumerate(reading.groups):
                    self._declare_group(i, needs)
            for port, said in outputs.items():
                self._declare_output(port, [wiring.wire(its, port) for its in said], reading)
            if reading.steps:
                self.DeclarePeriodicDiscreteUpdateEvent(h, 0.0, self._update)

        def _construct_copy(self, other: Any, converter: Any = None) -> None:
            Impl._construct(self, **other._arguments, converter=converter)

        def _tickets(self, needs: frozenset[str]) -> set[Any]:
            tickets = {self._ports[i].ticket() for i in needs} | {self.time_ticket(), self.all_parameters_ticket()}
            tickets |= set() if self._chance is None else {self._chance.ticket()}
            return tickets if self._state is None else tickets | {self.xd_ticket()}

        def _place(self) -> str:
            """Return its name in its Diagram, or nothing where that is the name it was made with."""
            name = self.get_name()
            if name == "wrapped":  # Clone puts it into a Diagram that has its name
                name = self.GetSystemPathname().split("::")[-2]
            return "" if name == self._arguments["name"] else name

        def _calc_seeded(self, context: Any, cached: Any) -> None:
            memory = self._memory_in(context)
            chance = _value_of(self._chance.Eval(context)[0]) if self._chance.HasValue(context) else 0.0
            own = int(memory.seeds[0])
            seed = seed_of(own, chance, self._place())
            if seed != own:
                memory = memory.copy()
                memory.seeds = np.array([seed])
            cached.set_value(memory)

        def _declare_group(self, i: int, needs: frozenset[str]) -> None:
            size = self._places.sizes["Y"]

            def calc(context: Any, cached: Any) -> None:
                Y = self._groups[frozenset()].Eval(context).copy() if needs else np.full(size, T(0.0))
                self._put_inputs(context, needs, Y)
                self._make(f"said_{i}", context, self._state_in(context), Y)
                cached.set_value(Y)

            made = ValueProducer(lambda: Value[object](_NOTHING), calc)
            self._groups[needs] = self.DeclareCacheEntry(f"said_{i}", made, self._tickets(needs))

        def _declare_output(self, name: str, wires: list[Wire], reading: Reading) -> None:
            size, places = sum(wire.size for wire in wires), [self._places.of(wire) for wire in wires]
            letters, is_whole = {place.letter for place in places}, len(wires) == 1 and size == self._places.sizes["S"]
            if self._state is not None and letters == {"S"} and is_whole:
                self.DeclareStateOutputPort(name, self._state)
                return
            needs = frozenset().union(*(reading.of(wire.box) for wire in wires))
            needs = needs if needs in self._groups else self._all
            source: Any = self._groups.get(needs)

            def calc(context: Any, output: Any) -> None:
                Y = source.Eval(context) if "Y" in letters else _NOTHING
                S = self._state_in(context) if "S" in letters else _NOTHING
                said = [place.of(S if place.letter == "S" else Y) for place in places]
                output.SetFromVector(said[0] if len(said) == 1 else np.concatenate(said))

            kept = self.all_parameters_ticket() if self._state is None else self.xd_ticket()
            tickets = self._tickets(needs) if "Y" in letters else {kept}
            self.DeclareVectorOutputPort(name, size, calc, prerequisites_of_calc=tickets)

        def _state_in(self, context: Any) -> Any:
            if self._state is None:
                constants = self._memory_in(context).S
                return constants if T is float else np.array([T(value) for value in constants], dtype=object)
            state = context.get_discrete_state_vector()
            return state.value() if T is float else state.CopyToVector()

        def _put_inputs(self, context: Any, names: Iterable[str], Y: Any) -> None:
            for name in names:
                self._places.said[name].of(Y)[:] = self._ports[name].Eval(context)

        def _make(self, what: str, context: Any, S: Any, Y: Any) -> None:
            """Make the calls of one kind, on states and on what is said."""
            drawn = self._chance is not None
            memory = self._seeded.Eval(context) if drawn else self._memory_in(context)
            k = int(_value_of(context.get_time()) / self._h + 0.5)
            if T is float:
                if self._checked:
                    listen()
                self._compiled[what](memory, S, Y, k)
                if self._checked:
                    tell(self._wiring.boxes.values())
            else:
                with np.errstate(invalid="ignore"):  # Drake's symbols leave floating-point flags raised
                    self._plain.make(self._calls[what], memory, S, Y, k)
                for array in (S, Y):
                    for i, value in enumerate(array):
                        if not isinstance(value, T):
                            array[i] = T(value)

        def _update(self, context: Any, values: Any) -> None:
            said = self._groups.get(self._all)
            Y = np.zeros(0) if said is None else said.Eval(context).copy()  # with the inputs that it was made of
            self._put_inputs(context, self._unsaid, Y)
            S = context.get_discrete_state(self._state).CopyToVector()
            self._make("step", context, S, Y)
            values.set_value(self._state, S)

        def _memory_in(self, context: Any) -> Memory:
            memory: Memory = context.get_abstract_parameter(self._given).get_value()
            return memory

        def seed_in(self, context: Any) -> int:
            """Return the seed in a context of this system."""
            return int(self._memory_in(context).seeds[0])

        def set_seed_in(self, context: Any, seed: int) -> None:
            """Set the seed in a context of this system."""
            memory = self._memory_in(context).copy()
            memory.seeds = np.array([seed])
            context.get_mutable_abstract_parameter(self._given).set_value(memory)

        def boxes(self) -> frozenset[str]:
            """Return the names of its boxes, but for those that stand for inputs."""
            return frozenset(name for name, box in self._wiring.boxes.items() if box.element is not OUTSIDE)

        def give(self, context: Any, given: dict[str, Values]) -> None:
            """Give boxes other numbers, tables or states in a context of this system, by their names."""
            memory = self._memory_in(context).copy()
            for name, its in given.items():
                plain = {state: values for state, values in its.start.items() if np.asarray(values).dtype != object}
                memory.put(name, Values(its.numbers, plain, its.tables))  # a state with slopes is the context's alone
            context.get_mutable_abstract_parameter(self._given).set_value(memory)
            states = {(name, state): its.start[state] for name, its in given.items() for state in its.start}
            if states and self._state is not None:
                whole = context.get_discrete_state(self._state).CopyToVector()
                for key, values in states.items():
                    self._places.arrays[key].of(whole)[...] = values
                context.SetDiscreteState(whole)

        def state_of(self, context: Any, box: str, state: str) -> Any:
            """Return a box's state in a context of this system, in its shape."""
            return self._places.arrays[box, state].of(self._state_in(context)).copy()

    return Impl


def _value_of(scalar: Any) -> float:
    """Return the value of a scalar of Drake's."""
    if isinstance(scalar, AutoDiffXd):
        return float(scalar.value())
    return float(scalar.Evaluate() if isinstance(scalar, Expression) else scalar)


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
