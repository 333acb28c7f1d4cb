"""Errors that a user may see, each with the exit code of the command line.

An error message is one line: what is wrong, the value, what is allowed, and what to try. That of a spec has a line for
each wrong field.
"""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager

from lensforge.public import public


@public
class LensforgeError(Exception):
    """Base of all errors raised on purpose; anything else that escapes is a bug."""

    exit_code = 1


@public
class InputError(LensforgeError):
    """Input that cannot be used: a spec field, a file, an option."""

    exit_code = 2


class SeveralErrors(LensforgeError):
    """Several things are wrong: one complete line for each, maybe with an excerpt ``beneath`` it."""

    beneath: tuple[str, ...] = ()

    @property
    def lines(self) -> tuple[str, ...]:
        """The lines."""
        return tuple(str(self).splitlines())


class WrongFields(SeveralErrors, InputError):
    """Several fields of a spec are wrong."""


@public
class CriterionMissed(LensforgeError):
    """A result misses an acceptance criterion: a constraint, watertightness, a form error."""

    exit_code = 1


class FailedDesigns(SeveralErrors):
    """Designs of one call that failed, each with its name; the exit code is the worst."""

    def __init__(self, errors: Mapping[str, LensforgeError]) -> None:
        super().__init__("\n".join(f"{name}: {error}" for name, error in errors.items()))
        self.exit_code = max(error.exit_code for error in errors.values())


@public
class MissingResult(InputError, AttributeError):
    """A stage has not run yet, so it has no result; ``hasattr`` gives False."""


class OutdatedResult(InputError):
    """A record of another version of the program: the stage has to run again."""


@public
class SourceWarning(UserWarning):
    """A doubt about a source, told before its light is traced."""


@public
class FileWarning(UserWarning):
    """A file that can be read in two ways, or that was repaired: which way was taken."""


@public
class Cancelled(LensforgeError):
    """Search or study that its ``progress`` has stopped; the checkpoint, if there is one, holds the state."""

    exit_code = 130


@contextmanager
def remedy(advice: str) -> Iterator[None]:
    """Append ``advice`` to an :class:`InputError` raised inside the block by code that knows no option or field."""
    try:
        yield
    except InputError as error:
        raise type(error)(f"{error}; {advice}") from None


@contextmanager
def refused(where: object, message: str, *causes: type[Exception]) -> Iterator[None]:
    """Raise an :class:`InputError` for one of the ``causes`` inside the block: ``message`` on ``where``, the cause."""
    try:
        yield
    except causes as error:
        cause = " ".join(str(getattr(error, "strerror", None) or error).split())
        raise InputError(f"{where}: {message.replace('…', cause)}") from None


_MOST_CHARACTERS = 80  # of a value in a message


def shortened(text: str, most: int = _MOST_CHARACTERS) -> str:
    """``text`` as part of a message: what cannot be printed as "?", and no more than ``most`` characters."""
    text = "".join(character if character.isprintable() else "?" for character in text[: most + 1])
    return text if len(text) <= most else f"{text[: most - 3]}..."
