"""Writing that a flight can do without, when it fails."""

from ortilo_drake.hil.restart.until_it_fails import UntilItFails
from ortilo_drake.model.typed_yaml import InputError


def test_it_is_called_until_it_fails_once() -> None:
    called: list[int] = []
    said: list[str] = []

    def write(k: int) -> None:
        called.append(k)
        if k == 2:
            raise InputError("log: cannot be written: no space left")

    record = UntilItFails(write, said.append)
    for k in range(5):
        record(k)
    assert called == [0, 1, 2]
    assert said == ["log: cannot be written: no space left; flying on without it"]
    assert str(record.error) == "log: cannot be written: no space left"
