"""A small lens with tolerances of a test's own, the study of its parts, and fewer rays than a command takes."""

from presets import FEW
from scenes import NO_TOLERANCES, random_surface, small_spec, tolerance_changes

from lensforge.made.part_study import PartStudy, Recipe
from lensforge.scene.lens import Lens
from lensforge.scene.made_part import MadePart
from lensforge.spec.accuracy import Preset

STUDY = FEW.replace("few_of_a_study", studies={"budget_parts": 128})


def lens_with(
    tolerances: dict | None = None,
    roughness: float = 0.01,
    target: dict | None = None,
    accuracy: Preset = STUDY,
    **sections: object,
) -> Lens:
    """A lens with these tolerances and no others; None: those of the preset."""
    inner, outer = (random_surface(seed, 3.0 * seed, roughness, (9, 25)) for seed in (1, 2))
    fields = {} if tolerances is None else tolerance_changes({**NO_TOLERANCES, **tolerances})
    fields |= {} if target is None else {"target": target}
    return Lens.double(inner, outer, small_spec(**fields).replace(**sections), 0, accuracy)


def part_of(study: PartStudy, number: int) -> tuple[MadePart, ...]:
    """The lenses of a part, with the first LED."""
    return study.leds[0].made(study.deviations(number))


def study_of(tolerances: dict | None = None, parts: int = 64, rays: int = 4096, seed: int = 0) -> PartStudy:
    return PartStudy(Recipe(lens_with(tolerances), parts, rays, seed, rays))
