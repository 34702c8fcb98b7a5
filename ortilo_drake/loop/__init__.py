"""The sampled loop: elements described once, the wiring that joins them, and the players that fly it.

element.py    an element: one box of the block diagram, as two small functions
own.py        boxes of plain functions and values, for your own parts
wiring.py     which box reads which, and the resulting order of calls in a tick
raised.py     errors that functions of your own raise in flight
native.py     an element's functions as compiled code with a C interface
source.py     a tick of a wiring as straight-line source text
player.py     flights of a wiring, compiled
calls.py      the calls of a part of a tick, to compiled functions or to plain source
plain.py      the plain source of compiled functions, for Drake's other scalars
shell.py      boxes of a wiring as one Drake system
diagram.py    a wiring in a Drake Diagram: a system for each box, or all elements fused
"""
