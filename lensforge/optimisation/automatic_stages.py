"""Stages of a search that chooses its levels: how far, with how many rays and for how many steps each of them goes."""

from dataclasses import dataclass, replace

from lensforge.accuracy import SearchEffort
from lensforge.optimisation.levels import UsefulLevels
from lensforge.optimisation.schedule import Stage

# Measured on pi, cross and flat_top (docs/results.md): further in the first steps than a spec's learning rate,
# which is for levels that are converged.
_FIRST_RATE, _LEVEL_RATE = 1.5, 0.65  # of the spec's, and of a level's relative to that of the one before
_AGAIN_RATE = 0.4  # of a level's, where that gained too little: its steps may have led astray
_LAST_RATE = 0.75  # of the first long stage, relative to its level's; half of it in each one that follows
_UNIFORM_RATE = 0.3  # of the first stage for the uniformity, likewise
_OF_IMAGES = 0.25  # exponent: with a square's 8 images 1.7 times as far, and 2.8 times in long stages; flat_top
# Levels from this one on take twice the rays: their functions are so narrow that few rays meet each of them. With twice
# the rays in its long stages, too, flat_top of 404 functions takes 1.4 times as long: three seeds gain 0.1 % of their
# efficiency and 3 % of NMSE, and deviate from uniform light by 0.80 % for 0.97 %. With half of them cross of 1,493
# loses 0.2 % and 4 %.
_TWICE_FROM = 4
# Gradients of the narrow functions are 1e-2 to 3e-3 where light is, and a tenth of that at the rim, where noise then
# takes them ten times as far. On cross this brings facets there a quarter to a third nearer to the face.
_LEAST_GRADIENT = 3e-4


@dataclass(frozen=True)
class AutomaticStages:
    """Stages for ``levels`` with the steps and rays of ``effort``, from a spec's ``learning_rate``.

    ``images``: mirror images of every ray; their mean has less noise, so that steps may be larger. ``start_level``: of
    the lens from which it starts, all of whose functions stay while the broad ones move.
    """

    levels: UsefulLevels
    effort: SearchEffort
    learning_rate: float
    images: int = 1
    start_level: int = 0

    def level_stage(self, level: int, most_steps: int | None = None, *, again: bool = False) -> Stage:
        """The stage of one level, cut to ``most_steps``; ``again``: for the second time, with smaller steps."""
        share = _AGAIN_RATE if again else 1.0
        return self._stage(level, _cut(self.effort.steps[0], most_steps), 0, share)

    def long_stage(self, level: int, before: int, most_steps: int | None) -> Stage:
        """A stage after ``before`` other long ones, cut to ``most_steps``."""
        rate = _LAST_RATE * 0.5**before * self.images**_OF_IMAGES
        return self._stage(level, _cut(self.effort.steps[1], most_steps), before, rate)

    def uniform_stage(self, level: int, before: int, most_steps: int | None) -> Stage:
        """A stage for the uniformity after ``before`` others, cut to ``most_steps``."""
        rate = _UNIFORM_RATE * 0.5**before
        stage = self._stage(level, _cut(self.effort.steps[1], most_steps), before, rate)
        return replace(stage, uniformity_from=0)

    def _stage(self, level: int, steps: int, doublings: int, share: float) -> Stage:
        counts, (first, most) = self.levels.counts, self.effort.rays
        levels = counts[: max(level, self.start_level) + 1]
        rate = _FIRST_RATE * self.learning_rate * _LEVEL_RATE**level * share * self.images**_OF_IMAGES
        rays = min(first * 2 ** (level // _TWICE_FROM + doublings), most)
        return Stage(
            level,
            levels,
            sum(counts[: level + 1]),
            steps,
            rays,
            rate,
            uniformity_from=steps,
            least_gradient=_LEAST_GRADIENT,
        )


def _cut(steps: int, most: int | None) -> int:
    return steps if most is None else min(steps, most)
