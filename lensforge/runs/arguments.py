"""Arguments of the verbs: validated with one-line errors, and converted to sources, presets, devices and threads."""

import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from math import isfinite
from operator import index
from pathlib import Path
from typing import TYPE_CHECKING, SupportsFloat, SupportsIndex, TypeVar, cast

from lensforge.errors import InputError, SourceWarning
from lensforge.light.source_photometry import SourceLumens
from lensforge.results.record_fields import LARGEST_COUNT
from lensforge.results.validation import its_type
from lensforge.scene.lens import Lens
from lensforge.sources.measured_rays import held_back
from lensforge.spec import Spec
from lensforge.spec.accuracy import PRESETS, Preset
from lensforge.spec.source_sections import SourceSpec
from lensforge.spec.spec_files import input_hashes, section_sha256
from lensforge.spec.spec_section import iso_date

if TYPE_CHECKING:
    import torch

    from lensforge.sources.ray_bundle import Source

_Kind = TypeVar("_Kind")
_MAKES = {
    "Lens": "design(spec).lens or load(folder).lens",
    "Part": "build(lens)",
    "Light": "evaluate(lens)",
    "TolerancesSection": 'TolerancesSection(preset="precision")',
}


def source_of(spec: Spec) -> "Source":
    """The source of ``spec``, with the dispersion of the lens material."""
    from lensforge.sources.build_source import build_source

    return build_source(spec.source, spec.lens.dispersion)


def judging_source(spec: Spec) -> "Source":
    """The source of ``spec`` as all that judges its lens sees it: of measured rays those that no search uses."""
    return held_back(source_of(spec))


def warned_source(
    spec: Spec, warn: Callable[[str], None] | None, start: Lens | None = None, *, anyway: bool = False
) -> "Source":
    """The source of ``spec``, after ``warn`` was called with each warning on it, on given faces and on the scene.

    By default they are Python's own warnings. Raises :class:`InputError` where no search can help and, unless
    ``anyway``, where less than half of what the targets ask for is possible.
    """
    from lensforge.search.scene_check import SceneCheck, source_clearance_warnings
    from lensforge.sources.build_source import summarise

    source = source_of(spec)
    summary = summarise(source, spec.source)
    SourceLumens.of(None, summary).require_known(spec.photometry)  # not after a search
    room = source_clearance_warnings(spec, source)
    scene = SceneCheck.of(spec, source, start)
    scene.require_light(anyway=anyway)
    for words in (*spec.lens.warnings, *summary.warnings, *scene.warnings(), *room):
        if warn is None:
            warnings.warn(words, SourceWarning, stacklevel=3)
        else:
            warn(words)
    return source


def inputs_of(lens: Lens, source: SourceSpec) -> dict[str, str]:
    """Hashes of the inputs of an evaluation: the lens, the source, and every file that the source names."""
    return {"lens": lens.sha256, "source": section_sha256(source), **input_hashes(source)}


def preset_of(accuracy: str) -> Preset:
    """The settings of an accuracy preset. Raises :class:`InputError` for an unknown name."""
    for name, preset in PRESETS.items():
        if name == accuracy:
            return preset
    raise InputError(f"accuracy = {accuracy!r}: one of {', '.join(PRESETS)}")


def device_of(name: str) -> "torch.device | None":
    """The device on which torch traces the rays of a search; None for "cpu", where the compiled kernels trace them.

    Raises :class:`InputError` where torch does not find the device.
    """
    import torch

    if name == "cpu":
        return None
    if name != "cuda" or not torch.cuda.is_available():
        raise InputError(
            f"device = {name!r}: torch {torch.__version__} finds no such device; allowed here: cpu; "
            "for an NVIDIA GPU install a CUDA build of torch"
        )
    return torch.device(name)


@contextmanager
def threads_of_torch(threads: int | None) -> Iterator[None]:
    """Let torch and the tracer use ``threads`` threads inside the block; None leaves the number unchanged."""
    if threads is None:
        yield
        return
    wanted = count_of("threads", threads)
    assert wanted is not None
    import torch

    before = torch.get_num_threads()
    torch.set_num_threads(wanted)
    try:
        yield
    finally:
        torch.set_num_threads(before)


def count_of(name: str, value: object, least: int = 1, most: int = LARGEST_COUNT) -> int | None:
    """``value`` as an int, from NumPy integers too; None stays None. Raises :class:`InputError` for anything else."""
    if value is None:
        return None
    try:
        count = index(cast(SupportsIndex, value))
    except TypeError:
        count = least - 1
    if isinstance(value, bool) or count < least:
        raise InputError(f"{name} = {value!r}: an integer, at least {least}")
    if count > most:
        raise InputError(f"{name} = {float(min(count, 10**300)):.7g}: an integer, at most {most}")
    return count


def number_of(name: str, value: object) -> float | None:
    """``value`` as a finite number; None stays None. Raises :class:`InputError` for anything else."""
    if value is None:
        return None
    if isinstance(value, bool | str) or not isinstance(value, SupportsFloat) or not isfinite(float(value)):
        raise InputError(f"{name} = {value!r}: a finite number")
    return float(value)


def date_of(name: str, value: object) -> str | None:
    """``value`` as the text of a date; None stays None. Raises :class:`InputError` for anything else."""
    try:
        return None if value is None else iso_date(value)
    except ValueError as error:
        raise InputError(f"{name} = {str(value)[:60]!r}: {error}") from None


def path_of(name: str, value: object) -> Path | None:
    """``value`` as a path; None stays None. Raises :class:`InputError` for anything else."""
    if value is None:
        return None
    if not isinstance(value, Path | str):
        raise InputError(f"{name} = {value!r}: give the path of a file")
    return Path(value)


def require(value: object, kind: type[_Kind], verb: str) -> _Kind:
    """Return ``value`` if it is a ``kind``; else raise an :class:`InputError` that says how to obtain one."""
    if isinstance(value, kind):
        return value
    remedy = _MAKES.get(kind.__name__, "one of the classes of lensforge")
    raise InputError(f"{verb}: {str(value)[:60]!r} is {its_type(value)}, must be a {kind.__name__}: {remedy}")
