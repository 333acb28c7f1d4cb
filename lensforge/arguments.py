"""What every verb does with its arguments: refuse what cannot be used, in one line, and make what follows from them."""

from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, TypeVar

from lensforge.accuracy import PRESETS, Preset
from lensforge.errors import InputError
from lensforge.spec import Spec
from lensforge.spec.source import Source as SourceSpec

if TYPE_CHECKING:
    from lensforge.sources.bundle import Source

_Kind = TypeVar("_Kind")


def source_of(spec: Spec, instead: SourceSpec | None = None) -> "Source":
    """The emitter of ``spec``, or ``instead`` of it, in the material of its lens."""
    from lensforge.sources.build import build_source

    return build_source(spec.source if instead is None else instead, spec.lens.dispersion)


def preset_of(accuracy: str) -> Preset:
    """The knobs of an accuracy preset. Raises :class:`InputError` for a name that is none."""
    for name, preset in PRESETS.items():
        if name == accuracy:
            return preset
    raise InputError(f"accuracy = {accuracy!r}: one of {', '.join(PRESETS)}")


@contextmanager
def threads_of_torch(threads: int | None) -> Iterator[None]:
    """Let torch and the tracer use ``threads`` threads inside of the block; None leaves the number as it is."""
    if threads is None:
        yield
        return
    if not (isinstance(threads, int) and threads >= 1):
        raise InputError(f"threads = {threads!r}: an integer, at least 1")
    import torch

    before = torch.get_num_threads()
    torch.set_num_threads(threads)
    try:
        yield
    finally:
        torch.set_num_threads(before)


def require_count(name: str, value: object) -> None:
    """Raise :class:`InputError` for what is neither None nor a whole number above 0."""
    if value is not None and not (isinstance(value, int) and not isinstance(value, bool) and value >= 1):
        raise InputError(f"{name} = {value!r}: an integer, at least 1")


def require(value: object, kind: type[_Kind], verb: str) -> _Kind:
    """Return ``value`` if it is a ``kind``; else :class:`InputError`, which says what makes one."""
    if isinstance(value, kind):
        return value
    remedy = _MAKES.get(kind.__name__, "one of the classes of lensforge")
    raise InputError(f"{verb}: {str(value)[:60]!r} is a {type(value).__name__}, must be a {kind.__name__}: {remedy}")


_MAKES = {"Lens": "design(spec).lens or load(folder).lens", "Part": "build(lens)", "Light": "evaluate(lens)"}
