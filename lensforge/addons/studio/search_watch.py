"""Observer of a search: shows its steps on the page, and tells it to go on, to end or to stop.

It looks at the lens by a thread of its own, so that a search never waits for a picture.
"""

import threading
import time

import numpy as np
import torch

from lensforge.addons.studio.job_pipe import JobPipe
from lensforge.addons.studio.lens_view import as_tabulated, drawn
from lensforge.addons.studio.physics import chart_head
from lensforge.errors import LensforgeError
from lensforge.light.lens_light import source_of
from lensforge.scene.lens import Lens
from lensforge.scene.receiver_shapes import receivers_of
from lensforge.scene.target_pattern import target_light
from lensforge.search.design_result import ENOUGH, Progress
from lensforge.sources.build_source import summarise
from lensforge.spec import Spec

_BETWEEN_S = (0.25, 0.9)  # from one look to the next
_SHARE = 0.04  # of the time of one core for looks
_MEMORY = 0.8  # of the mean picture of the steps of a level, that stays at each step
_ENDINGS = {"": None, "enough": ENOUGH}  # what an observer answers to a wish; False to any other


class SearchWatch:
    """The mean picture and the figures of all steps of a search, and looks at its lens."""

    def __init__(self, pipe: JobPipe, spec: Spec) -> None:
        self._pipe = pipe
        self._steps = list[tuple[float, float]]()
        self._light = tuple[np.ndarray, ...]()
        first = spec.in_first_state
        pairs = list(zip(first.all_receivers, receivers_of(first, spec.optimise.pixels), strict=True))
        lumens = summarise(source_of(first), first.source).lumens_per_watt
        self._heads = [chart_head(section, shape.grid.width, shape.grid.height, lumens) for section, shape in pairs]
        self._measures = [shape.pixel_measure / (lumens or 1.0) for _, shape in pairs]
        self._targets = [target_light(section.targets, shape) for section, shape in pairs]
        self._last: Progress | None = None
        self._new = threading.Event()
        self._over = threading.Event()
        self._looking = threading.Thread(target=self._look_on, daemon=True)
        self._looking.start()

    def on_step(self, step: Progress) -> object:
        """Note a step, and answer whether the search goes on."""
        self._steps.append((step.nmse, step.efficiency))
        same_level = self._last is not None and step.level == self._last.level
        before = self._light if same_level else step.images
        self._light = tuple(_MEMORY * a + (1.0 - _MEMORY) * b for a, b in zip(before, step.images, strict=True))
        self._last = step
        self._new.set()
        return _ENDINGS.get(self._pipe.asked, False)

    def closed(self) -> Lens | None:
        """End the thread, and return the lens of the last step; None if there was no step."""
        self._over.set()
        self._new.set()
        self._looking.join()
        return None if self._last is None else self._last.lens()

    def _look_on(self) -> None:
        torch.set_num_threads(1)  # of this thread: those of a pool of its own would spin beside the search
        while not self._over.is_set():
            self._new.wait()
            self._new.clear()
            if self._last is not None:
                begun = time.thread_time()
                try:
                    self._look(self._last, self._light)
                except LensforgeError as error:  # of a lens on its way; the search goes on
                    self._pipe.warn(f"no picture: {error}")
                least, most = _BETWEEN_S
                self._over.wait(min(max(least, (time.thread_time() - begun) / _SHARE), most))

    def _look(self, step: Progress, images: tuple[np.ndarray, ...]) -> None:
        arrays = dict[str, np.ndarray]()
        for number, (image, target, measure) in enumerate(zip(images, self._targets, self._measures, strict=True)):
            arrays |= {f"light{number}": image / measure, f"target{number}": target * (image.sum() / measure)}
        arrays["nmse"], arrays["efficiency"] = np.array(self._steps).T
        lens = step.lens()
        lens, traced = (lens, None) if step.tables is None or lens.others else as_tabulated(lens, *step.tables())
        arrays |= drawn(lens, self._pipe.figure, traced)
        figures = {"level": step.level, "step": step.steps_done, "steps": step.steps_total, "seconds": step.seconds}
        self._pipe.send("step", arrays, receivers=self._heads, figure=self._pipe.figure, **figures)
