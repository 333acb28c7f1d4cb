"""File that opens the page in the browser, so that the secret is in no command line.

A command line can be read by every user of a machine. The file sends the browser on to the page; it can be read by its
owner alone, in a folder of its own, and is deleted with the studio.
"""

import html
import os
import webbrowser
from pathlib import Path
from tempfile import TemporaryDirectory

_PAGE = (
    '<!DOCTYPE html><meta charset="utf-8"><meta name="referrer" content="no-referrer"><title>lensforge studio</title>'
    '<meta http-equiv="refresh" content="0; url={address}"><a href="{address}">lensforge studio</a>\n'
)


class Door:
    """The file of a page's ``address``."""

    def __init__(self, address: str) -> None:
        self._folder = TemporaryDirectory(prefix="lensforge-studio-")  # of mode 0700
        self.path = Path(self._folder.name) / "studio.html"
        handle = os.open(self.path, os.O_CREAT | os.O_EXCL | os.O_WRONLY, 0o600)
        with os.fdopen(handle, "w", encoding="utf-8") as file:
            file.write(_PAGE.format(address=html.escape(address)))

    def open(self) -> bool:
        """Open the page in the desktop's browser; False where there is none."""
        return webbrowser.open(self.path.as_uri())

    def close(self) -> None:
        """Delete the file."""
        self._folder.cleanup()
