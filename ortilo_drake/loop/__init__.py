"""The sampled loop: elements described once, the wiring that joins them, and the players that fly it.

element.py    an element: one box of the block diagram, as two small functions
own.py        boxes of plain functions and values, for parts of one's own
wiring.py     which box reads which, and the order of a tick that follows
native.py     an element's functions as compiled code with a C interface
generated.py  generated modules and where they are kept
addresses.py  arrays and records at an address, for that code
source.py     a tick of a wiring as straight-line source text
player.py     flights of a wiring, compiled
calls.py      the calls of part of a tick, of compiled functions or of plain source
plain.py      the plain source of compiled functions, for Drake's other scalars
shell.py      boxes of a wiring as one Drake system
diagram.py    a wiring in a Drake Diagram: a system for each box, or all elements fused
"""
