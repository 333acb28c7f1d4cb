"""What a search tells of itself after every gradient step, and how it is told to stop."""

from collections.abc import Callable
from dataclasses import dataclass

from lensforge.lens import Lens
from lensforge.spec import Accuracy


@dataclass(frozen=True)
class Progress:
    """The state of a search; ``lens()`` makes the lens as it is now, for those who ask.

    ``level`` counts from 0; ``functions``: how many of each surface move in it. ``level_done``: this was its last step.
    """

    level: int
    step: int
    steps_done: int
    steps_total: int
    nmse: float
    efficiency: float
    functions: int
    level_done: bool
    accuracy: Accuracy
    lens: Callable[[], Lens]


# Called after every gradient step; a search whose observer returns False stops, all else goes on.
Observer = Callable[[Progress], object]
