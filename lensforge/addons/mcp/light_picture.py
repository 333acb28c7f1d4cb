"""Picture of the light of a result folder, drawn in a process of its own: ``python -m … DIR``."""

import sys
from pathlib import Path

from lensforge.errors import LensforgeError

PICTURE_FILE = "light.png"


def draw(directory: Path) -> None:
    """Draw the map of the light in ``directory`` into its ``PICTURE_FILE``. Raises :class:`InputError` without one."""
    import lensforge as lf

    lf.load(directory).light.save(directory / PICTURE_FILE)


if __name__ == "__main__":
    try:
        draw(Path(sys.argv[1]))
    except LensforgeError as error:
        print(error, file=sys.stderr)
        sys.exit(error.exit_code)
