"""Text of a new spec: sources and targets in a word, and commented TOML of what was asked for.

A word is such as ``disc:1`` or ``rectangle:200x150@300``. Each value that follows from others has its reason beside
it.
"""

import re
from collections.abc import Iterator, Mapping, Sequence
from math import cos, radians, sin
from pathlib import Path
from typing import Any

import tomli_w

from lensforge.errors import InputError
from lensforge.spec.derived_values import receiver_of
from lensforge.spec.emitter_section import EmitterSection
from lensforge.spec.led_packages import led_package, led_packages, near_packages
from lensforge.spec.lens_section import LensShape
from lensforge.spec.spec_reference import SCHEMA_FILE
from lensforge.spec.target_sections import TargetSection

_SOURCE_FIELDS = {kind: source.in_a_word for kind, source in EmitterSection.kinds.items() if source.in_a_word}
_TARGET_FIELDS = {
    kind: tuple(f"{name}_mm" for name in target.needs)
    for kind, target in TargetSection.kinds.items()
    if target.has_word
} | {"line": ("length_mm", "width_mm")}
_PHOTOMETRIC = (".ies", ".ldt")
_WIDEST_FLOOD_DEG = 130.0
_DRAWN = {"text": "text", "image": "file"}  # the field of what is drawn, of each picture by its width
SOURCE_KINDS = tuple(_SOURCE_FIELDS)
LIST_OF_PACKAGES = "list"
TARGET_KINDS = (*_TARGET_FIELDS, *_DRAWN, "beam", "zoom")


def _shapes(fields: dict[str, tuple[str, ...]], end: str) -> str:
    """Words of each shape: ``ring:OUTER-DIAMETERxINNER-DIAMETER@DISTANCE``."""
    sizes = {
        kind: "x".join(name.removesuffix("_mm").replace("_", "-").upper() for name in names)
        for kind, names in fields.items()
    }
    return ", ".join(f"{kind}:{size}{end}" for kind, size in sizes.items())


_PACKAGES = f"a package such as 3030 (--source {LIST_OF_PACKAGES}: all)"
SOURCES = f"{_shapes(_SOURCE_FIELDS, '')} in mm, {_PACKAGES}, or a ray file"
TARGETS = (
    f"{_shapes(_TARGET_FIELDS, '@DISTANCE')}, text:STRING:WIDTH@DISTANCE or "
    "image:FILE:WIDTH@DISTANCE in mm, beam:A or beam:AxB in degrees, zoom:A-B from a spot to a flood, or FILE.ies"
)


def source_in(text: str) -> dict[str, Any]:
    """The ``[source]`` that ``text`` stand for. Raises :class:`InputError`."""
    kind, _, size = text.partition(":")
    if kind in _SOURCE_FIELDS and size:
        return {"kind": kind, **_sizes("--source", text, size, _SOURCE_FIELDS[kind])}
    if Path(text).is_file():
        return {"kind": "rayfile", "file": text, "origin": "virtual_focus"}
    package = led_package(text)
    if package is None:
        near = near_packages(text)
        meant = f"; did you mean {' or '.join(near)}" if near else ""
        raise InputError(
            f"--source {text}: no kind with its size, no package and no file that is there{meant}; give {SOURCES}"
        )
    return package.source


def source_note(text: str) -> str:
    """Note on the source that ``text`` stand for: the package and its sizes; empty for other ones."""
    package = None if Path(text).is_file() else led_package(text)
    return "" if package is None else f"package {package.name}: {package.phrase}"


def listed_packages() -> str:
    """The packages that ``--source`` takes, a line each."""
    return "".join(f"{name}\t{package.phrase}\n" for name, package in led_packages().items())


def zoom_in(text: str) -> tuple[float, float] | None:
    """Full widths (degrees) of spot and flood of a target ``zoom:15-45``; None for another one.

    Raises :class:`InputError` for widths that make no zoom.
    """
    kind, _, widths = text.partition(":")
    if kind != "zoom":
        return None
    given = re.fullmatch(r"(\d*\.?\d+)-(\d*\.?\d+)", widths.strip())
    if given is None:
        raise InputError(
            f"--target {text}: {widths!r} must be A-B, the full widths of spot and flood in degrees, such as 15-45"
        )
    spot_deg, flood_deg = map(float, given.groups())
    if not 0.0 < spot_deg < flood_deg <= _WIDEST_FLOOD_DEG:
        raise InputError(
            f"--target {text}: the spot is narrower than the flood, which is {_WIDEST_FLOOD_DEG:g} degrees wide at "
            "most; give both, such as zoom:15-45"
        )
    return spot_deg, flood_deg


def line_in(text: str) -> float | None:
    """Length (mm) of the line of light that ``text`` stands for; None of another light."""
    target = target_in(text)
    return target["width_mm"] if text.startswith("line:") else None


def target_in(text: str) -> dict[str, Any]:
    """The ``[target]`` that ``text`` stand for, of a zoom that of its spot. Raises :class:`InputError`."""
    zoom = zoom_in(text)
    if zoom is not None:
        return {"kind": "beam", "fwhm_deg": zoom[0]}
    if Path(text).suffix.lower() in _PHOTOMETRIC:
        if not Path(text).is_file():
            raise InputError(f"--target {text}: there is no such file; give {TARGETS}")
        return {"kind": "photometric", "file": text}
    kind, _, rest = text.partition(":")
    if kind == "beam":
        angles = list(_sizes("--target", text, rest, ("A", "B")).values())
        return {"kind": kind, "fwhm_deg": angles}
    size, at, distance = rest.rpartition("@")
    if not at or kind not in (*_TARGET_FIELDS, *_DRAWN):
        raise InputError(f"--target {text}: not understood; give {TARGETS}")
    away = _sizes("--target", text, distance, ("distance_mm",))
    if kind not in _DRAWN:
        sizes = _sizes("--target", text, size, _TARGET_FIELDS[kind])
        if kind == "line":  # a rectangle, by lengths of its own
            kind = "rectangle"
            sizes = dict(zip(_TARGET_FIELDS["rectangle"], sizes.values(), strict=True))
        return {"kind": kind, **sizes, **away}
    drawn, _, width = size.rpartition(":")
    if not drawn:
        raise InputError(f"--target {text}: give its {_DRAWN[kind]} and width, such as {kind}:LF:200@150")
    if kind == "image" and not Path(drawn).is_file():
        raise InputError(f"--target {text}: there is no file {drawn}; give {TARGETS}")
    return {"kind": kind, _DRAWN[kind]: drawn, **_sizes("--target", text, width, ("width_mm",)), **away}


def receiver_beside(target: Mapping[str, Any], off_axis_deg: float = 0.0, tilt_deg: float = 0.0) -> Mapping[str, Any]:
    """Table of ``[[receivers]]`` with ``target`` on a plane whose centre is off the axis, towards +x, at its distance.

    ``tilt_deg``: of the plane's normal from the axis, about y. Raises :class:`InputError` for a target on no plane.
    """
    section = TargetSection.kinds[target["kind"]](**target)
    side_mm = receiver_of(section).get("receiver_mm") if section.distance_mm is not None else None
    if section.distance_mm is None or side_mm is None:
        raise InputError(f"--off-axis, --tilt: go with a target on a plane, KIND:SIZE@DISTANCE, not {section.kind!r}")
    away = section.distance_mm
    off = radians(off_axis_deg)
    return {
        "kind": "plane",
        "centre_mm": [round(away * sin(off), 3), 0.0, round(away * cos(off), 3)],
        "tilt_deg": [0.0, tilt_deg],
        "width_mm": side_mm,
        "height_mm": side_mm,
        "targets": [{name: value for name, value in target.items() if name != "distance_mm"}],
    }


def _sizes(option: str, text: str, given: str, names: tuple[str, ...]) -> dict[str, float]:
    """Numbers of ``given``, separated by ``x``; one stands for a width and a height."""
    numbers = re.split("[xX×]", given)
    if any(re.fullmatch(r"\d+,\d+", number.strip()) for number in numbers):
        raise InputError(f"{option} {text}: a number has a decimal point; write {given.replace(',', '.')}")
    if len(numbers) == 1 and names in (("width_mm", "height_mm"), ("A", "B")):
        numbers *= 2
    try:
        values = [float(number) for number in numbers]
    except ValueError:
        values = []
    if len(values) != len(names) or not all(0.0 < value < 1e9 for value in values):
        expected = "x".join(name.removesuffix("_mm").replace("_", " ").upper() for name in names) + " in mm"
        example = "x".join(("200", "150", "100")[: len(names)])
        if names == ("A", "B"):
            expected = "A or AxB in degrees"
            example = "10 or 60x25"
        raise InputError(f"{option} {text}: {given!r} must be {expected}, above 0, such as {example}")
    return dict(zip(names, values, strict=True))


_COLUMN = 36  # of the comments
_HEAD = """#:schema ./{schema}
# {title}
# Lengths in mm, angles in degrees; every field: docs/spec.md, or `lensforge schema --page`.
# Lines such as `# cavity_radius_mm = ...  # derived` are derived values: they change with source, target and size.
# Without its first # a value is fixed.
# {possible}
"""
_OPTIONS = {
    "source": [
        "flux_lm = 200.0: of the LED; without it 1 W, or what its ray file states",
        "position_mm, tilt_deg: where it sits in the lens",
    ],
    "lens": ['symmetry = "auto": the largest that source and target share'],
    "constraints": ['max_height_mm: of the lens; keep_out = "board.step": solids to stay clear of'],
}
_OPTIONS["target"] = _OPTIONS["receivers.targets"] = [
    "edge_mm: soft edges; a source of finite size makes no sharp ones"
]
_READ = "read from behind the receiver; mirrored = true: from the lens's side, as a wall"
_MEASURED = "measured: 99 % of the ray file's flux starts inside"
_OF_CAVITY = ("constraints.cavity_radius_mm", "constraints.cavity_height_mm")
_NOTES = {
    "lens.material": "its index by wavelength comes from the catalogue",
    "source.origin": "the file's virtual focus lies at the lens origin",
    **dict.fromkeys(_OF_CAVITY, _MEASURED),
    "lens.profile": "coefficients of each face; lens and ring of the exit have half of them each",
    "lens.exit.groove_radius_mm": "of that between them: a STEP follows no finer one",
    "constraints.max_height_mm": "so high the lens is: the least with 0.98 of the light of any height",
    "manufacture.cutter_radius_mm": "of the ball, which reaches all of both faces",
    "manufacture.process": "the search keeps what its tools need; milled, turned, moulded, extruded, printed, or none",
    "receivers.centre_mm": "(x, y, z), from the LED",
    **{f"{target}.{field}": _READ for target in ("target", "receivers.targets") for field in _DRAWN.values()},
    "receivers.tilt_deg": "of its normal from the axis, about x, then about y",
    "tolerances.preset": "of parts that are moulded",
    "states.shift_mm": "0.75 x max_radius_mm x half of the change of width (rad), towards the lens",
    "base.flat_mm": "marks +x: the light is not round",
}


_RADIUS = {  # by whether it is about the axis
    True: "outer radius of the lens, from its axis",
    False: "outer radius of the lens, from the origin: so the height, too",
}
_LEVELS = {True: "refined until the error stops improving", False: "functions that shape its faces further"}  # "auto"
_OF_FACES = {  # said of the first face alone
    "draft_deg": "no undercut, as seen from the tool or the mould's other half",
}


def new_text(
    content: Mapping[str, Any],
    derived: Mapping[str, str],
    title: str,
    possible: str,
    of_lens: Sequence[str] = (),
    of_source: str = "",
) -> str:
    """TOML of ``content``, its ``derived`` values as comments with the reasons under their dotted names.

    ``of_lens``: what its lens may have besides, a commented line each. ``of_source``: a note on its source.
    """
    first = next((face for face, fields in content["lens"].items() if isinstance(fields, Mapping)), "")
    notes = _NOTES | {f"lens.{first}.{field}": note for field, note in _OF_FACES.items()}
    shape = LensShape.kinds[content["lens"].get("kind", LensShape.usual_kind)]
    notes["source.kind"] = of_source
    notes["constraints.max_radius_mm"] = _RADIUS[shape.radius_about_axis]
    notes["lens.levels"] = _LEVELS[content["lens"].get("levels") == "auto"]
    if "states" in content:
        notes |= dict.fromkeys(_OF_CAVITY, "room for the LED at both stops and between them")
    options = {**_OPTIONS, "lens": [*_OPTIONS["lens"], *of_lens]}
    head = _HEAD.format(schema=SCHEMA_FILE, title=title, possible=possible)
    return "\n".join([head + _line("name", content["name"], ""), *_sections(content, derived, notes, options)]) + "\n"


_Options = Mapping[str, Sequence[str]]  # commented lines of a section, by its name


def _sections(
    content: Mapping[str, Any], derived: Mapping[str, str], notes: Mapping[str, str], options: _Options
) -> Iterator[str]:
    for section, value in content.items():
        for table in _tables(value):
            yield f"\n[{section}]" if table is value else f"\n[[{section}]]"
            yield from _section(section, table, derived, notes, options)


def _tables(value: object) -> list[Mapping[str, Any]]:
    return [table for table in (value if isinstance(value, list) else [value]) if isinstance(table, Mapping)]


def _section(
    section: str,
    table: Mapping[str, Any],
    derived: Mapping[str, str],
    notes: Mapping[str, str],
    options: _Options,
) -> Iterator[str]:
    """Lines of a table; the tables within it follow, as TOML has it."""
    for field, value in table.items():
        name = f"{section}.{field}"
        if name in derived:
            yield _line(field, value, f"derived: {derived[name]}", "# ")
        elif not _tables(value):
            yield _line(field, value, notes.get(name, ""))
    far = section == "target" and "distance_mm" not in table
    yield from (f"# {note}" for note in options.get(section, ()) if not far)
    yield from _sections({f"{section}.{name}": value for name, value in table.items()}, derived, notes, options)


def _line(field: str, value: object, comment: str, before: str = "") -> str:
    text = before + " ".join(tomli_w.dumps({field: value}).split())
    return f"{text:<{_COLUMN}} # {comment}" if comment else text
