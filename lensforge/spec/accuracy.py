"""Accuracy presets in one table, so that every stage reads the same settings.

The rule, measured by benchmarks/convergence_studies.py (docs/accuracy.md): the irradiance error of a preset's tables
stays below a hundredth of the noise of the rays that are traced with it. On the flat top, the cross and the pi it is
0.0014 of that noise at most, so accuracy takes more rays: from one preset to the next the noise (NMSE) of the
evaluation falls, first to 1/13, then to less than 1/2.
"""

from dataclasses import dataclass, replace

from lensforge.errors import InputError
from lensforge.spec import Accuracy


@dataclass(frozen=True)
class SearchEffort:
    """Effort of a search that chooses levels and steps itself.

    ``finest``: functions of the finest level that it tries. ``steps``: of the stage of each level, and of the long
    stages that follow. ``rays``: of a gradient step, at first and at most. ``validation_rays``: of each of the two
    samples that judge the lens. ``step_gain``: share by which a long stage must lower the error, else the search ends.
    ``level_gain``: share by which a level must lower it, else it is left out.
    """

    finest: int
    steps: tuple[int, int]
    rays: tuple[int, int]
    validation_rays: int
    step_gain: float
    level_gain: float

    def with_rays_of(self, count: int | None) -> "SearchEffort":
        """Effort for a source of ``count`` measured rays: twice as many rays in a step, at most all.

        Rays of a file are drawn at random, with more noise than as many of a low-discrepancy sequence: with twice the
        number a draft of led_rayfile from 24,000 rays ends at an NMSE of 0.014 instead of 0.018 to 0.020.
        """
        first, most = (each if count is None else min(2 * each, count) for each in self.rays)
        return replace(self, rays=(first, most))


@dataclass(frozen=True)
class Preset:
    """Settings of a preset.

    ``nodes_per_sigma``: table nodes across the narrowest SRBF's sigma at the apex, while designing;
    ``evaluate_nodes_per_sigma``: the same where the finished lens is evaluated and verified.
    Of a search with given levels, ``design_rays``: rays of a gradient step; ``coarse_steps``, ``fine_steps``: gradient
    steps of every level but the last, and of the last. ``effort``: of one that chooses its levels. ``evaluate_rays``:
    rays that evaluate the finished lens. ``photometry_rays``: the most that its far field takes by itself.
    ``verify_rays``: rays of the independent ray cast. ``single``: the search traces rays in single precision.
    """

    nodes_per_sigma: float
    evaluate_nodes_per_sigma: float
    design_rays: int
    coarse_steps: int
    fine_steps: int
    evaluate_rays: int
    photometry_rays: int
    verify_rays: int
    effort: SearchEffort
    single: bool = True


# The finest level: 289 functions serve a flat top, letters need 1,089, a source of 0.1 mm gains from 4,225. Steps, rays
# and gains were chosen on pi, cross and flat_top: a standard search takes one to three times as long as one with
# the given levels of version 0.1.0 on the same machine, the longer the more it still gains; docs/results.md.
_DRAFT = SearchEffort(
    finest=289, steps=(40, 80), rays=(2**13, 2**15), validation_rays=2**15, step_gain=0.5, level_gain=0.1
)
_STANDARD = SearchEffort(
    finest=1089, steps=(60, 200), rays=(2**15, 2**17), validation_rays=2**16, step_gain=0.3, level_gain=0.05
)
_REFERENCE = SearchEffort(
    finest=4225, steps=(80, 300), rays=(2**16, 2**19), validation_rays=2**18, step_gain=0.05, level_gain=0.02
)

PRESETS: dict[Accuracy, Preset] = {
    "draft": Preset(2.5, 6.0, 2**14, 60, 120, 2**20, 2**20, 2**14, _DRAFT),
    "standard": Preset(3.4, 8.0, 2**16, 100, 300, 2**23, 2**22, 2**16, _STANDARD),
    "reference": Preset(5.0, 12.0, 2**18, 150, 600, 2**24, 2**24, 2**17, _REFERENCE, single=False),
}


# Of the levels that a search chooses itself. On flat_top, the pi and a rectangle of `lensforge new`, five searches,
# NMSE is 0.76 to 1.6 times a draft's, the efficiency its own to 2 %, the time of the search 0.57 to 1.04 times as long.
_PREVIEW_STEPS = (25, 50)


def for_preview(preset: Preset) -> Preset:
    """The ``preset`` with fewer steps, for a first look."""
    return replace(preset, effort=replace(preset.effort, steps=_PREVIEW_STEPS))


def preset_of(accuracy: str) -> Preset:
    """The settings of an accuracy preset. Raises :class:`InputError` for an unknown name."""
    for name, preset in PRESETS.items():
        if name == accuracy:
            return preset
    raise InputError(f"accuracy = {accuracy!r}: one of {', '.join(PRESETS)}")
