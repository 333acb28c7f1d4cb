"""``python -m lensforge`` and the program ``lensforge`` are the command line.

Signals are noted before anything else is loaded: an interrupt in the first half second is one line, too.

``python -m`` puts the current folder before all others, so that any module is searched there first; this one can only
put it behind the others for what is loaded from here on. ``python -P -m lensforge``, and the installed program, never
search the current folder, which may be one that somebody else has sent.
"""

import sys

if __name__ == "__main__" and not sys.flags.safe_path:
    sys.path.append(sys.path.pop(0))

from lensforge.cli.interrupts import Interrupts

_interrupts = Interrupts().install()

from lensforge.results.worker import collect_garbage_seldom, ignore_settings_of_libraries, keep_freed_memory  # noqa: E402

ignore_settings_of_libraries()
collect_garbage_seldom()
keep_freed_memory()

from lensforge.cli.cli import main  # noqa: E402
from lensforge.results.made_cache import keep_what_is_made  # noqa: E402


def run() -> None:
    """Entry point of the installed program."""
    keep_what_is_made()
    main(_interrupts)


if __name__ == "__main__":
    run()
