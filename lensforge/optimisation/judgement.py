"""Judgement of a lens by held rays, and what one lens gains over another, with the error of that gain."""

from typing import Annotated, NamedTuple

import numpy as np
from pydantic import Field

from lensforge.jackknife import jackknife_error
from lensforge.records import Count, NotNegative, Number, Positive, Record

SLICES = 8  # of the held rays: the error of a gain is then known to a quarter of itself
# Standard errors that a gain must reach: by chance one stage in six would. With two, a level that halves the error of a
# lens for 20,000 measured rays is left out (led_colours, 53 +- 32 %).
_ERRORS = 1.0


class Gain(NamedTuple):
    """Share by which the error was lowered, and its standard error."""

    share: float
    standard_error: float

    def reaches(self, least: float) -> bool:
        """True for a gain of ``least`` or more that is no mere noise."""
        return self.share >= max(least, _ERRORS * self.standard_error)


class Judgement(Record):
    """A lens judged by held rays: ``merit``, all terms; ``image``, the error of the image alone.

    ``without``: the merit without one slice of the rays, for each of them.
    """

    merit: Number
    image: Positive
    without: Annotated[tuple[Number, ...], Field(min_length=SLICES, max_length=SLICES)]

    def gain_of(self, later: "Judgement") -> Gain:
        """The gain of ``later``, relative to the error of this image; by jackknife, as both see the same rays."""
        lowered = np.array(self.without) - np.array(later.without)
        return Gain((self.merit - later.merit) / self.image, jackknife_error(lowered) / self.image)


class Outcome(Record):
    """End of a stage after ``steps``: ``seconds`` of the search, judgements of its lens where a schedule needs them.

    ``light``: by image and flux. ``even``: with the uniformity before the image, in a scene that has a region of
    uniform light.
    """

    steps: Count
    seconds: NotNegative
    light: Judgement | None = None
    even: Judgement | None = None

    def gain_of(self, later: "Outcome", even: bool) -> Gain:
        """The gain of ``later`` over this one."""
        before, after = (self.even, later.even) if even else (self.light, later.light)
        assert before is not None and after is not None, "an automatic schedule has only outcomes with judgements"
        return before.gain_of(after)
