"""Signals as in the foreground: what a shell starts in the background ignores Ctrl-C, with all its children."""

import signal


def default_signals() -> None:
    """Signals as a shell gives them to a command in the foreground; for ``preexec_fn`` of a child process."""
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, signal.SIG_DFL)
