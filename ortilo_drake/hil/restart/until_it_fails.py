"""Files that a flight can do without, a log or a checkpoint: a full disk must not end the flight."""

from collections.abc import Callable
from typing import Any

from ortilo_drake.model.typed_yaml import InputError


class UntilItFails:
    """A function called in flight until it first raises InputError; then no more.

    That is told in a line, and kept as `error` to be raised once the flight is over; None if there was none.
    """

    def __init__(self, write: Callable[..., None], say: Callable[[str], None]):
        self._write, self._say = write, say
        self.error: InputError | None = None

    def __call__(self, *arguments: Any) -> None:
        """Call the function, if it has not failed yet."""
        if self.error is None:
            try:
                self._write(*arguments)
            except InputError as error:
                self.error = error
                self._say(f"{error}; flying on without it")
