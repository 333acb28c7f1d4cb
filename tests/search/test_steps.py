"""Steps of a search, counted over all of its levels: each has rays of its own, every tenth changes the multipliers."""

from dataclasses import dataclass, field

import pytest
from scenes import small_spec

from lensforge.search.constraints import AugmentedLagrangian
from lensforge.search.design_result import Progress
from lensforge.search.optimiser import search
from lensforge.sources.build_source import SquareEmitter
from lensforge.sources.ray_bundle import RayBundle

STEPS, RAYS = [21, 11], 65


@dataclass(frozen=True)
class Counted(SquareEmitter):
    """A square LED that remembers the seeds of the steps."""

    seeds: list[int] = field(default_factory=list)

    def sample(self, count: int, seed: int) -> RayBundle:
        if count == RAYS:
            self.seeds.append(seed)
        return super().sample(count, seed)


@pytest.fixture(scope="module")
def counted() -> tuple[Counted, list[int]]:
    """The source of a search, and the updates of the multipliers before the end of each of its steps."""
    spec = small_spec(optimise__steps_per_level=STEPS, optimise__rays=RAYS)
    source, updates, found = Counted(1.0), [], []
    own = AugmentedLagrangian.update

    def update(self: AugmentedLagrangian, fields: object) -> None:
        updates.append(fields)
        own(self, fields)

    def progress(at: Progress) -> None:
        assert at.steps_done == len(found) + 1
        found.append(len(updates))

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(AugmentedLagrangian, "update", update)
        search(spec, source, accuracy="draft", seed=5, progress=progress)
    return source, found


def test_no_two_steps_share_their_rays(counted: tuple[Counted, list[int]]) -> None:
    seeds = counted[0].seeds
    assert len(set(seeds)) == len(seeds) == sum(STEPS)


def test_multipliers_change_after_every_tenth_step_of_a_level(counted: tuple[Counted, list[int]]) -> None:
    first = [step // 10 for step in range(1, STEPS[0] + 1)]
    assert counted[1] == first + [first[-1] + step // 10 for step in range(1, STEPS[1] + 1)]
