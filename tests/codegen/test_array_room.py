"""The room for arrays that functions make: newest first, none beyond its end; and who may not make any."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from exports import do, needs

from ortilo_drake.codegen.c_header import ROOM
from ortilo_drake.codegen.c_source import ROOM_TEXT
from ortilo_drake.codegen.exported_half import STRICT
from ortilo_drake.codegen.ir import box_ir
from ortilo_drake.codegen.object_code import object_code
from ortilo_drake.codegen.targets import TARGETS
from ortilo_drake.loop.element import Element
from ortilo_drake.loop.own import box
from ortilo_drake.model.typed_yaml import InputError

HEAD = f"#include <stddef.h>\n#include <stdint.h>\n{ROOM}typedef struct {{ ortilo_room room; }} ortilo;\n"
MAIN = """
#include <assert.h>
int main(void) {
    assert(sizeof(block) == 32); /* as ir.py has it */
    static ortilo half;
    void *room = room_of(&half);
    block *a = ortilo_take(room, 100), *b = ortilo_take(room, 8), *c = ortilo_take(room, 0);
    assert(a && b && c && a->data == (void *)(a + 1) && a->holders == 1);
    assert((char *)b->data - (char *)a->data >= 100 && (char *)(a + 1) + 100 <= (char *)b);
    const int64_t all = half.room.top;
    ortilo_give(room, b); /* a newer one stands on it */
    assert(half.room.top == all);
    ortilo_give(room, c);
    assert(half.room.last == 0);
    block *again = ortilo_take(room, 8);
    assert(again == b && half.room.most == all);
    assert(ortilo_take(room, ORTILO_ROOM) == NULL && ortilo_take(room, -8) == NULL);
    assert(ortilo_take(room, INT64_MAX) == NULL);
    ortilo_give(room, again), ortilo_give(room, a);
    assert(half.room.top == 0 && half.room.last == -1);
    int64_t count = 0;
    block *made;
    for (; (made = ortilo_take(room, 64)) != NULL; count++)
        assert((char *)made->data + 64 <= (char *)(&half + 1));
    assert(count > ORTILO_ROOM / 128);
    return 0;
}
"""


def test_blocks_stand_one_after_the_other_and_within_the_room(tmp_path: Path) -> None:
    needs("gcc")
    (tmp_path / "room.c").write_text(HEAD + ROOM_TEXT + MAIN)
    do("gcc", *STRICT, "-fsanitize=address,undefined", "room.c", "-o", "room", folder=tmp_path)
    do("./room", folder=tmp_path)


def halved(belief: np.ndarray, out: np.ndarray) -> None:
    its = belief.copy()
    its[1:] = its[:-1]
    its[:2] /= 2.0
    out[:] = its


HALVED = """
#include <stdio.h>
int32_t ortilo_own_out(void *, const void *, int64_t, const void *, int64_t);
int main(void) {
    static ortilo half;
    const double belief[] = {8, 6, 4};
    double out[3] = {0};
    const int stopped = ortilo_own_out(room_of(&half), belief, 3, out, 3);
    return !(stopped == 0 && half.room.top == 0 && out[0] == 4 && out[1] == 4 && out[2] == 6);
}
"""


@pytest.mark.long
def test_a_part_of_an_array_is_put_into_another_part_of_the_same(tmp_path: Path) -> None:
    needs("gcc")
    irs = box_ir("own", Element("halved", out=halved, allocates=True), False)
    assert "@NRT_Allocate(" in irs["ortilo_own_out"].split("define internal")[0]
    (tmp_path / "own.o").write_bytes(object_code(irs, TARGETS["x86-64"]))
    (tmp_path / "room.c").write_text(HEAD + ROOM_TEXT + HALVED)
    do("gcc", *STRICT, "room.c", "own.o", "-o", "room", folder=tmp_path)
    do("./room", folder=tmp_path)


def scaled(n: Any, estimate: np.ndarray, out: np.ndarray) -> None:
    out[:] = n.gain * estimate


@pytest.mark.long
def test_an_element_of_ones_own_that_makes_arrays_is_refused_in_a_line() -> None:
    with pytest.raises(InputError) as refused:
        box_ir("own", box(3, scaled, numbers={"gain": 2.0}).element, False)
    assert str(refused.value) == "export: own: out makes arrays while it flies: an element of your own must not"
