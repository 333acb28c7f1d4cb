"""A small lens with tolerances of a test's own, and the study of its parts."""

from scenes import random_surface, small_spec

from lensforge.made.part_study import PartStudy, Recipe
from lensforge.scene.lens import Lens
from lensforge.spec.tolerances_section import PRESET_AMOUNTS

NONE = dict.fromkeys(PRESET_AMOUNTS["standard"], 0)


def lens_with(tolerances: dict | None = None, **sections: object) -> Lens:
    """A lens with these tolerances and no others; None: those of the preset."""
    inner, outer = random_surface(1, 3.0, 0.01, (9, 25)), random_surface(2, 6.0, 0.01, (9, 25))
    own = {} if tolerances is None else {**NONE, **tolerances}
    return Lens(inner, outer, small_spec().replace(tolerances=own, **sections), 0, "draft")


def study_of(tolerances: dict | None = None, parts: int = 64, rays: int = 4096, seed: int = 0) -> PartStudy:
    return PartStudy(Recipe(lens_with(tolerances), parts, rays, seed, rays))
