"""Every error that a user may see, each with the exit code of the command line.

An error message is one line: what is wrong, the value, what is allowed, and what to try.
"""


class LensforgeError(Exception):
    """Base of all errors raised on purpose; anything else that escapes is a bug."""

    exit_code = 1


class InputError(LensforgeError):
    """The user's input cannot be used: a spec field, a file, an option."""

    exit_code = 2


class GateFailed(LensforgeError):
    """A result was reached but fails a gate: a constraint, watertightness, a form error."""

    exit_code = 1


class MissingResult(InputError, AttributeError):
    """A stage has not run yet, so its result is not there to be had: ``hasattr`` answers False."""


class OutdatedResult(InputError):
    """A record of another version of the program: the stage has to run again."""


class Cancelled(LensforgeError):
    """The caller's ``progress`` said stop; the checkpoint, where one was asked for, holds the state."""

    exit_code = 130
