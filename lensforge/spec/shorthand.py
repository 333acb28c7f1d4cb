"""Sources and targets in a word, as ``lensforge new`` takes them: ``disc:1``, ``rectangle:200x150@300``."""

import re
from pathlib import Path
from typing import Any

from lensforge.errors import InputError

_SOURCE_FIELDS: dict[str, tuple[str, ...]] = {
    "square": ("side_mm",),
    "rectangle": ("width_mm", "height_mm"),
    "disc": ("diameter_mm",),
}
_TARGET_FIELDS: dict[str, tuple[str, ...]] = {
    "rectangle": ("width_mm", "height_mm"),
    "ellipse": ("width_mm", "height_mm"),
    "disc": ("diameter_mm",),
    "cross": ("length_mm", "stroke_mm"),
    "ring": ("outer_diameter_mm", "inner_diameter_mm"),
}
_PHOTOMETRIC = (".ies", ".ldt")
SOURCE_KINDS, TARGET_KINDS = tuple(_SOURCE_FIELDS), (*_TARGET_FIELDS, "text", "beam")


def _shapes(fields: dict[str, tuple[str, ...]], end: str) -> str:
    """Words of each shape: ``ring:OUTERxINNER@DISTANCE``."""
    sizes = {
        kind: "x".join(name.removesuffix("_mm").split("_")[0].upper() for name in names)
        for kind, names in fields.items()
    }
    return ", ".join(f"{kind}:{size}{end}" for kind, size in sizes.items())


SOURCES = f"{_shapes(_SOURCE_FIELDS, '')} in mm, or a ray file"
TARGETS = (
    f"{_shapes(_TARGET_FIELDS, '@DISTANCE')} or text:STRING:WIDTH@DISTANCE in mm, beam:AxB in degrees, or FILE.ies"
)


def source_in(words: str) -> dict[str, Any]:
    """The ``[source]`` that ``words`` stand for. Raises :class:`InputError`."""
    kind, _, size = words.partition(":")
    if kind in _SOURCE_FIELDS and size:
        return {"kind": kind, **_sizes("--source", words, size, _SOURCE_FIELDS[kind])}
    if not Path(words).is_file():
        raise InputError(f"--source {words}: neither a kind with its size nor a file that is there; give {SOURCES}")
    return {"kind": "rayfile", "file": words, "origin": "virtual_focus"}


def target_in(words: str) -> dict[str, Any]:
    """The ``[target]`` that ``words`` stand for. Raises :class:`InputError`."""
    if Path(words).suffix.lower() in _PHOTOMETRIC:
        if not Path(words).is_file():
            raise InputError(f"--target {words}: there is no such file; give {TARGETS}")
        return {"kind": "photometric", "file": words}
    kind, _, rest = words.partition(":")
    if kind == "beam":
        angles = list(_sizes("--target", words, rest, ("A", "B")).values())
        return {"kind": kind, "fwhm_deg": angles}
    size, at, distance = rest.rpartition("@")
    if not at or kind not in (*_TARGET_FIELDS, "text"):
        raise InputError(f"--target {words}: not understood; give {TARGETS}")
    away = _sizes("--target", words, distance, ("distance_mm",))
    if kind != "text":
        return {"kind": kind, **_sizes("--target", words, size, _TARGET_FIELDS[kind]), **away}
    text, _, width = size.rpartition(":")
    if not text:
        raise InputError(f"--target {words}: give its text and width, such as text:LF:200@150")
    return {"kind": kind, "text": text, **_sizes("--target", words, width, ("width_mm",)), **away}


def _sizes(option: str, words: str, given: str, names: tuple[str, ...]) -> dict[str, float]:
    """Numbers of ``given``, separated by ``x``; one stands for a width and a height."""
    numbers = re.split("[x×]", given)
    if len(numbers) == 1 and names in (("width_mm", "height_mm"), ("A", "B")):
        numbers *= 2
    try:
        values = [float(each) for each in numbers]
    except ValueError:
        values = []
    if len(values) != len(names) or not all(0.0 < value < 1e9 for value in values):
        expected = "x".join(names).replace("_mm", "")
        raise InputError(f"{option} {words}: {given!r} must be {expected}, {len(names)} above 0, such as 200x150")
    return dict(zip(names, values, strict=True))
