"""A small lens with tolerances of a test's own, the study of its parts, and fewer rays than a command takes."""

import pytest
from scenes import NO_TOLERANCES, random_surface, small_spec, tolerance_changes

from lensforge.made.part_study import PartStudy, Recipe
from lensforge.scene.lens import Lens


def lens_with(
    tolerances: dict | None = None, roughness: float = 0.01, target: dict | None = None, **sections: object
) -> Lens:
    """A lens with these tolerances and no others; None: those of the preset."""
    inner, outer = (random_surface(seed, 3.0 * seed, roughness, (9, 25)) for seed in (1, 2))
    own = {} if tolerances is None else tolerance_changes({**NO_TOLERANCES, **tolerances})
    own |= {} if target is None else {"target": target}
    return Lens.double(inner, outer, small_spec(**own).replace(**sections), 0, "draft")


def few_rays(patch: pytest.MonkeyPatch, designed: int = 2**12, worst: int = 2**12) -> None:
    """Of the lens as designed, and of the maps of the worst parts: a million each, of which most tests read nothing."""
    patch.setattr("lensforge.made.yield_study.DESIGNED_RAYS", designed)
    patch.setattr("lensforge.made.yield_study._WORST_RAYS", worst)


def study_of(tolerances: dict | None = None, parts: int = 64, rays: int = 4096, seed: int = 0) -> PartStudy:
    return PartStudy(Recipe(lens_with(tolerances), parts, rays, seed, rays))
