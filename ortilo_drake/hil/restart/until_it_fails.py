"""Writing of files that a flight does not need, a log or a checkpoint: a full disk must not end the flight."""

from collections.abc import Callable
from typing import Any

from ortilo_drake.model.typed_yaml import InputError


class UntilItFails:
    """A function that is called in flight until it first raises InputError.

    `say` then takes a line about the error, and `error` keeps it, to be raised after the flight; None before an error.
    """

    def __init__(self, write: Callable[..., None], say: Callable[[str], None]):
        self._write, self._say = write, say
        self.error: InputError | None = None

    def __call__(self, *arguments: Any) -> None:
        """Call the function, unless it has failed before."""
        if self.error is None:
            try:
                self._write(*arguments)
            except InputError as error:
                self.error = error
                self._say(f"{error}; flying on without it")
