"""Picture of the light of a result folder, drawn in a process of its own: ``python -m … DIR``."""

import sys
from pathlib import Path

from lensforge.errors import LensforgeError

PICTURE_FILE = "light.png"
_DOTS_PER_INCH = 100


def draw(directory: Path) -> None:
    """Draw the map of the light in ``directory`` into its ``PICTURE_FILE``. Raises :class:`InputError` for none."""
    from matplotlib.figure import Figure

    import lensforge as lf

    light = lf.load(directory).light
    figure = Figure(layout="constrained")
    light.plot(figure.subplots())
    figure.savefig(directory / PICTURE_FILE, dpi=_DOTS_PER_INCH)


if __name__ == "__main__":
    try:
        draw(Path(sys.argv[1]))
    except LensforgeError as error:
        print(error, file=sys.stderr)
        sys.exit(error.exit_code)
