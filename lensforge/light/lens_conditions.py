"""Conditions under which a lens is simulated: its own, those of its design, or others that an argument asks for."""

from math import isclose
from pathlib import Path
from typing import TypeVar

from lensforge.errors import InputError
from lensforge.results import Conditions
from lensforge.scene.lens import Lens
from lensforge.sources.measured_rays import held_back
from lensforge.sources.ray_bundle import Source
from lensforge.spec import Spec
from lensforge.spec.source_sections import RayfileSource, SourceSpec
from lensforge.spec.spec_files import input_hashes, section_sha256

# Fields of a source that another LED in its place has, too.
_KEPT = ("flux_w", "flux_lm", "luminous_efficacy_lm_per_w", "rotate_z_deg", "tilt_deg", "position_mm")
_Value = TypeVar("_Value")


def source_of(spec: Spec) -> Source:
    """The source of ``spec``, with the dispersion of the lens material."""
    from lensforge.sources.build_source import build_source

    return build_source(spec.source, spec.lens.dispersion)


def judging_source(spec: Spec) -> Source:
    """The source of ``spec`` as all that judges its lens sees it: of measured rays those that no search uses."""
    return held_back(source_of(spec))


def inputs_of(lens: Lens, source: SourceSpec) -> dict[str, str]:
    """Hashes of the inputs of an evaluation: the lens, the source, and every file that the source names."""
    return {"lens": lens.sha256, "source": section_sha256(source), **input_hashes(source)}


def rays_of(rays: int | None, own: int, source: Source) -> tuple[int, Conditions | None]:
    """Number of rays to trace, at most those that ``source`` has, and the conditions where it is not the ``own``."""
    most = source.ray_count or 2**40
    count = min(rays or own, most)
    return count, Conditions.of(rays=unless_own(count, min(own, most)))


def photometry_conditions(lens: Lens, source: Source, rays: int | None, lumens: float | None) -> Conditions | None:
    """Conditions of a photometry of ``lens``.

    Any ``rays`` that are given: by default their number follows the noise. ``lumens`` are among them only where the
    spec knows its own.
    """
    from lensforge.sources.build_source import summarise

    known_lm = summarise(source, lens.spec.source).flux_lm
    own = known_lm is None or lumens is None or isclose(lumens, known_lm)
    return Conditions.of(rays=rays, lumens=None if own else lumens)


def unless_own(value: _Value | None, own: _Value) -> _Value | None:
    """``value``, or None where it is None or the lens's ``own``."""
    return None if value == own else value


def source_with_file(spec: Spec, file: Path) -> SourceSpec:
    """The source of ``spec`` with ``file`` as its ray file.

    Another source is replaced by the file with its virtual focus at the origin, placed as the source was, and with the
    flux that the spec states.
    """
    if isinstance(spec.source, RayfileSource):
        return spec.source.model_copy(update={"file": file.absolute()})
    kept = {name: getattr(spec.source, name) for name in _KEPT}
    return RayfileSource(file=file, origin="virtual_focus", **kept)


def has_rays_of(source: SourceSpec, own: SourceSpec) -> bool:
    """True where ``source`` takes rays of a file of ``own``, under any name and in any place; the same source has."""
    if source == own:
        return True
    files = set(input_hashes(source).values())
    try:
        return not files.isdisjoint(input_hashes(own).values())
    except InputError:  # the lens's own files are no longer there
        return False


def is_same_source(source: SourceSpec, own: SourceSpec) -> bool:
    """True where both have the same fields and files; False where the lens's own files are no longer there."""
    if source == own:
        return True
    wanted = section_sha256(source)
    try:
        return wanted == section_sha256(own)
    except InputError:
        return False


def name_of_source(source: SourceSpec) -> str:
    """Short name of a source: the names of its files without their ends, or its title."""
    return "_".join(Path(file.removeprefix("file:")).stem for file in input_hashes(source)) or source.title
