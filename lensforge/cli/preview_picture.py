"""The picture of a preview: the light of the lens that a search has come to, drawn beside it in a second process.

What draws takes a second to load, as torch does, which only the search needs: side by side the first picture is there
earlier. The bits are the same in either process.
"""

from pathlib import Path
from time import monotonic

import click

from lensforge.kernels.parallel import kernel_threads
from lensforge.light.evaluation_result import Light
from lensforge.light.lens_light import evaluate
from lensforge.results.child_pool import Called, ChildPool
from lensforge.scene.lens import Lens
from lensforge.search.design_result import Progress
from lensforge.spec.accuracy import preset_of

_LEVEL_RAYS = 2**15
_PAUSE_S = 1.0  # from one picture to the next


class PreviewPicture:
    """Evaluates the current lens during a search, and overwrites the ``picture`` with its light.

    ``second``: where pictures on the way are drawn. ``shown``: whether the first one is opened.
    """

    def __init__(self, picture: Path, second: ChildPool, *, shown: bool) -> None:
        self._picture = picture
        self._second = second
        self._to_show = shown
        self._drawn: Called[None] | None = None
        self._next = 0.0
        second.call(load_what_draws)

    def on_step(self, step: Progress) -> None:
        """Draw at the end of a level, but not twice in a second, nor before the last picture is there."""
        if self._drawn is not None and self._drawn.is_done:
            self._show()
        if step.level_done and monotonic() > self._next and (self._drawn is None or self._drawn.is_done):
            self._drawn = self._second.call(draw_on_the_way, step.lens(), self._picture)
            if not self._second.runs:
                self._drawn.result()
            self._next = monotonic() + _PAUSE_S

    def at_the_end(self, lens: Lens) -> Light:
        """Draw the light of the finished ``lens``, and return it."""
        if self._drawn is not None:
            self._drawn.result()  # else an earlier picture might follow the last one
        light = evaluate(lens)
        self._second.call(save_picture, light, self._picture).result()
        self._show()
        return light

    def _show(self) -> None:
        if self._to_show:
            click.launch(str(self._picture))
        self._to_show = False


def load_what_draws() -> None:
    """Load the libraries that evaluate a lens and draw its light."""
    import matplotlib.figure  # noqa: F401

    import lensforge.light.evaluation  # noqa: F401


def draw_on_the_way(lens: Lens, picture: Path) -> None:
    """Draw the light of ``lens`` by few rays, on one thread: the others are the search's."""
    preset = preset_of(lens.accuracy)
    coarse = preset.replace("look", table_error=False, evaluate_nodes_per_sigma=preset.nodes_per_sigma)
    with kernel_threads(1):
        light = evaluate(lens, rays=min(_LEVEL_RAYS, lens.spec.evaluate.rays or _LEVEL_RAYS), accuracy=coarse)
    save_picture(light, picture)


def save_picture(light: Light, picture: Path) -> None:
    """Draw ``light`` into the file ``picture``."""
    light.save(picture)
