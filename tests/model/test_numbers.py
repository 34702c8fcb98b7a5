"""Numbers as text: the digits 0 to 9 alone."""

import pytest

from ortilo_drake.commands.room.survey import _numbers
from ortilo_drake.hil.wire.address import address
from ortilo_drake.interop.mavlink import udp_address
from ortilo_drake.model.input_error import InputError
from ortilo_drake.model.inputs.numbers import decimal, is_port, whole
from ortilo_drake.studies.rooms.new_room import parse_size

OTHERS = ["\u0663", "\uff11\uff12", "\u00b2", "1_0", ""]


@pytest.mark.parametrize("text", OTHERS)
def test_digits_of_other_scripts_are_no_numbers(text: str) -> None:
    assert not is_port(text)
    for read in (whole, decimal):
        with pytest.raises(ValueError, match=r"number|convert"):
            read(text)


@pytest.mark.parametrize("text", OTHERS[:-1])
def test_no_address_and_no_option_takes_them(text: str) -> None:
    for read, line in (
        (address, f"tcp://127.0.0.1:{text}"),
        (udp_address, f"udpout:127.0.0.1:{text}"),
        (_numbers, f"0,{text}"),
        (parse_size, f"8x{text}x3"),
    ):
        with pytest.raises(InputError):
            read(line)


def test_plain_numbers_are_read() -> None:
    assert (whole("-12"), decimal("2.5e-1"), is_port("65535"), is_port("65536")) == (-12, 0.25, True, False)
