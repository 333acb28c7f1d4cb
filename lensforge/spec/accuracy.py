"""Accuracy presets in one table, so that every stage reads the same settings.

The rule, measured by benchmarks/convergence_studies.py (docs/validation.md): the irradiance error of a preset's tables
stays below a hundredth of the noise of the rays that are traced with it. On the flat top, the cross and the pi it is
0.0014 of that noise at most, so accuracy takes more rays: from one preset to the next the noise (NMSE) of the
evaluation falls, first to 1/13, then to less than 1/2.

A lens keeps the preset of its design, and every stage takes it from there: one of the table by its name, one of a
script with all its settings, so that ``lens.json`` says what was done and any program reads it back.
"""

import hashlib
from typing import Annotated, Any, Literal

from pydantic import Discriminator, Field, JsonValue, Tag

from lensforge.errors import InputError
from lensforge.public import public
from lensforge.results.arguments import with_known_names
from lensforge.spec.spec_section import Section, check, section_of

Accuracy = Literal["draft", "standard", "reference"]
_Count = Annotated[int, Field(strict=True, ge=1, le=2**40)]
_Counts = tuple[_Count, _Count]
_Share = Annotated[float, Field(ge=0.0, le=1.0)]
_PerSigma = Annotated[float, Field(ge=1.0, le=100.0)]


class SearchEffort(Section):
    """Effort of a search that chooses levels and steps itself.

    ``finest``: functions of the finest level that it tries. ``steps``: of the stage of each level, and of the long
    stages that follow. ``rays``: of a gradient step, at first and at most. ``validation_rays``: of each of the two
    samples that judge the lens. ``step_gain``: share by which a long stage must lower the error, else the search ends.
    ``level_gain``: share by which a level must lower it, else it is left out. ``size_step``: share to which the size of
    the smallest lens is known, where that is sought. Of any search, ``learning_rate``: step
    size relative to the starting offset while functions are few and broad; ``multiplier_steps``: steps between updates
    of the constraints' multipliers.
    """

    finest: _Count
    steps: _Counts
    rays: _Counts
    validation_rays: _Count
    step_gain: _Share
    level_gain: _Share
    size_step: Annotated[float, Field(ge=1e-4, le=0.5)] = 0.01
    learning_rate: Annotated[float, Field(gt=0.0, le=1.0)] = 0.004
    multiplier_steps: _Count = 10

    def with_rays_of(self, count: int | None) -> "SearchEffort":
        """Effort for a source of ``count`` measured rays: twice as many rays in a step, at most all.

        Rays of a file are drawn at random, with more noise than as many of a low-discrepancy sequence: with twice the
        number a draft of led_rayfile from 24,000 rays ends at an NMSE of 0.014 instead of 0.018 to 0.020.
        """
        first, most = (ray if count is None else min(2 * ray, count) for ray in self.rays)
        return self.changed(rays=(first, most))


class PartEffort(Section):
    """Effort of a part and its check.

    ``spline_nodes``: least across a face, whose form may need more. ``mesh_rings``: equal ones; None: as many as the
    faces need, with facets split to their tolerance. ``check_nodes``: across a face, where it is checked; odd, so that
    the apex is one.
    """

    spline_nodes: Annotated[int, Field(strict=True, ge=18, le=320)] = 24
    mesh_rings: _Count | None = None
    check_nodes: Annotated[int, Field(strict=True, ge=11, le=1001)] = 161


class StudyEffort(Section):
    """Rays and parts of studies of made parts.

    ``sensitivity_rays``: of each lens; the error of the change of an NMSE of 0.001 is then 1e-5 to 2e-4.
    ``part_rays``: of a part, at first and at most. ``designed_rays``: of the lens as designed, whose error is common to
    all parts. ``budget_parts``: the standard error of a share of 0.95 is then 0.02, that of an amount about a tenth;
    ``budget_rays``: fewest of each, which only tell whether it passes. ``worst_rays``: of the maps of the worst parts.
    ``compared_rays``: the most that simulate a measured face.
    """

    sensitivity_rays: _Count = 2**17
    part_rays: _Counts = (2**16, 2**20)
    designed_rays: _Count = 2**20
    budget_parts: _Count = 128
    budget_rays: _Count = 2**14
    worst_rays: _Count = 2**19
    compared_rays: _Count = 2**20


PRESETS: "dict[Accuracy, Preset]" = {}


@public
class Preset(Section):
    """Settings of an accuracy.

    ``name``: of its own, where a setting is none of draft, standard or reference. ``nodes_per_sigma``: table nodes
    across the narrowest SRBF's sigma at the apex, while designing. ``evaluate_nodes_per_sigma``: the same where the
    finished lens is evaluated and verified. ``design_rays``: rays of a gradient step of a search with given levels.
    ``coarse_steps``, ``fine_steps``: its gradient steps of every level but the last, and of the last. ``effort``: of a
    search that chooses its levels. ``evaluate_rays``: rays that evaluate the finished lens. ``photometry_rays``: of its
    far field by itself, at first and at most; the first take half a second, and are enough for a smooth beam.
    ``verify_rays``: rays of the independent ray cast. ``stray_rays``: the most that are followed through the part; each
    splits into about ten. ``part``: of splines and meshes. ``studies``: of rays and parts in studies of made parts.
    ``single``: the search traces rays in single precision. ``table_error``: every evaluation measures the error of its
    tables.
    """

    name: Annotated[str, Field(pattern=r"^\w[\w.-]{0,39}$")]
    nodes_per_sigma: _PerSigma
    evaluate_nodes_per_sigma: _PerSigma
    design_rays: _Count
    coarse_steps: _Count
    fine_steps: _Count
    evaluate_rays: _Count
    photometry_rays: _Counts
    verify_rays: _Count
    effort: SearchEffort
    stray_rays: _Count = 2**15
    part: PartEffort = PartEffort()
    studies: StudyEffort = StudyEffort()
    single: bool = True
    table_error: bool = True

    @check
    def _name_is_its_own(self) -> None:
        known = _in_table(self.name)
        if known is not None and PRESETS[known] != self:
            raise ValueError(f"name = {self.name!r}: that of a preset of the program with other settings; take another")

    def replace(self, name: str, **changes: Any) -> "Preset":
        """Make another preset; a group of settings is an object or a table of its changes: ``effort={"finest": 81}``.

        Raises :class:`InputError` for an invalid change.
        """
        content = self.model_dump() | {"name": name}
        for field, value in changes.items():
            content[field] = content.get(field, {}) | value if isinstance(value, dict) else value
        return section_of(Preset, content, f"preset {name!r}")

    def __str__(self) -> str:
        """Its name; of one that is not in the table with a hash of its settings, which may change under a name."""
        if _in_table(self.name) is not None:
            return self.name
        return f"{self.name}_{hashlib.sha256(self.model_dump_json().encode()).hexdigest()[:8]}"


# As a record states it: the name of a preset of the table, or all settings of any other.
AnyAccuracy = Annotated[
    Annotated[Accuracy, Tag("name")] | Annotated[Preset, Tag("preset")],
    Discriminator(lambda given: "name" if isinstance(given, str) else "preset"),
]


def _in_table(name: object) -> Accuracy | None:
    return next((known for known in PRESETS if known == name), None)


# The finest level: 289 functions serve a flat top, letters need 1,089, a source of 0.1 mm gains from 4,225. Steps, rays
# and gains were chosen on pi, cross and flat_top: a standard search takes one to three times as long as one with
# the given levels of version 0.1.0 on the same machine, the longer the more it still gains; benchmarks/README.md.
PRESETS["draft"] = Preset(
    name="draft", nodes_per_sigma=2.5, evaluate_nodes_per_sigma=6.0, design_rays=2**14, coarse_steps=60, fine_steps=120,
    evaluate_rays=2**20, photometry_rays=(2**20, 2**20), verify_rays=2**14, effort=SearchEffort(
        finest=289, steps=(40, 80), rays=(2**13, 2**15), validation_rays=2**15, step_gain=0.5, level_gain=0.1,
        size_step=0.02,
    ),
)  # fmt: skip
PRESETS["standard"] = Preset(
    name="standard", nodes_per_sigma=3.4, evaluate_nodes_per_sigma=8.0, design_rays=2**16, coarse_steps=100,
    fine_steps=300, evaluate_rays=2**23, photometry_rays=(2**20, 2**22), verify_rays=2**16, effort=SearchEffort(
        finest=1089, steps=(60, 200), rays=(2**15, 2**17), validation_rays=2**16, step_gain=0.3, level_gain=0.05
    ),
)  # fmt: skip
PRESETS["reference"] = Preset(
    name="reference", nodes_per_sigma=5.0, evaluate_nodes_per_sigma=12.0, design_rays=2**18, coarse_steps=150,
    fine_steps=600, evaluate_rays=2**24, photometry_rays=(2**20, 2**24), verify_rays=2**17, effort=SearchEffort(
        finest=4225, steps=(80, 300), rays=(2**16, 2**19), validation_rays=2**18, step_gain=0.05, level_gain=0.02,
        size_step=0.005,
    ), single=False,
)  # fmt: skip


# By 8,192 rays a step sees lit places of a far field of 256 x 256 pixels dark: drafts of road_m3, and of it as a road
# of class M4, held 9 and 8 of 10 limits. By one ray for a pixel they hold all, by two with a twentieth more light.
_RAYS_PER_PIXEL = 2
_MOST_FOR_PIXELS = 2**17


def for_places(preset: Preset, pixels: int) -> Preset:
    """The ``preset`` with rays enough where limits read places on pictures of ``pixels`` along a side."""
    least = min(1 << (_RAYS_PER_PIXEL * pixels**2 - 1).bit_length(), _MOST_FOR_PIXELS)  # as sequences are even
    effort = preset.effort
    rays = tuple(max(ray, least) for ray in preset.effort.rays)
    seen = effort.changed(rays=rays, validation_rays=max(effort.validation_rays, least))
    return preset.changed(design_rays=max(preset.design_rays, least), effort=seen)


# Of the levels that a search chooses itself. On flat_top, the pi and a rectangle of `lensforge new`, five searches,
# NMSE is 0.76 to 1.6 times a draft's, the efficiency its own to 2 %, the time of the search 0.57 to 1.04 times as long.
_PREVIEW_STEPS = (25, 50)


def for_preview(preset: Preset) -> Preset:
    """The ``preset`` with fewer steps, for a first look."""
    return preset.changed(effort=preset.effort.changed(steps=_PREVIEW_STEPS))


def accuracy_of(given: object) -> AnyAccuracy:
    """An accuracy as a lens keeps it: a preset of the table by its name, any other as it is.

    Raises :class:`InputError` for an unknown name, and for anything else.
    """
    if isinstance(given, Preset):
        settled = section_of(Preset, given.model_dump(), "accuracy")  # also of one that was copied with changes
        return _in_table(settled.name) or settled
    name = _in_table(given)
    if name is not None:
        return name
    raise InputError(f"accuracy = {given!r}: one of {', '.join(PRESETS)}, or a Preset")


def stated(accuracy: AnyAccuracy) -> JsonValue:
    """An accuracy as JSON: the name of a preset of the table, or all settings of any other."""
    settled = accuracy_of(accuracy)
    return settled.model_dump(mode="json") if isinstance(settled, Preset) else settled


@public
@with_known_names
def preset_of(accuracy: AnyAccuracy) -> Preset:
    """Settings of an accuracy.

    Args:
        accuracy: "draft", "standard" or "reference", or a preset, which is returned.
    Returns: The preset; its ``replace`` makes another.
    Raises: :class:`InputError` for an unknown name.
    Example:
        >>> preset = lf.preset_of("draft").replace("mine", evaluate_rays=2**18)
        >>> print(preset.evaluate_rays, preset.effort.steps)
    """
    settled = accuracy_of(accuracy)
    return settled if isinstance(settled, Preset) else PRESETS[settled]
