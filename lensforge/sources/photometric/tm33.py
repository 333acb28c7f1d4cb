"""ANSI/IES TM-33 (`.iesxml`, `.xml`): luminaire data as XML, the luminous intensity of one emitter read and written.

Roots: ``IESTM33-22`` of TM-33-23, ``IESTM33`` of TM-33-18, ``UNI11733`` of the Italian edition; all have the elements
that are read here. Each ``IntData`` is an intensity with its angles h (C) and v (gamma). ``AbsolutePhotometry`` false:
candela for ``RatedLumens``, as LM-63 has them. The standard library's parser is enough, without a package to harden it:
a file with a DOCTYPE is refused, and entities, by which a small file may grow or fetch another, are declared nowhere
else.

Names, order and types of the written elements are those of the schema in TM-33-23 (root ``IESTM33-22``, version 1.1),
as eulumdat-rs reprints it; the DesignLights Consortium's template for TM-33-18 has the same names, one ``IntData`` for
each pair of angles, v running first and h to 360, and lengths in metres. ``Symm`` may be left out, and is: the whole
turn is written. The schema requires a date of the report and watts: without them, the epoch and 0 are written, and a
comment says so.
"""

import re
from collections.abc import Iterator
from datetime import date
from xml.etree import ElementTree
from xml.etree.ElementTree import Element, SubElement, indent, tostring

import numpy as np

from lensforge.errors import InputError
from lensforge.sources.intensity import TabulatedIntensity
from lensforge.sources.photometric.half_planes import tabulated
from lensforge.sources.photometric.photometric_file import (
    MOST_NUMBERS,
    SIMULATED,
    UNDEFINED,
    PhotometricFile,
    PhotometricFormat,
    finite_number,
    single_line,
    stated_or_none,
)
from lensforge.version import __version__

NO_DATE = "1970-01-01"  # of a document that states none: the clock's would change its bytes from run to run
_NOT_STATED = "not stated"


def document(photometric: PhotometricFile) -> str:
    """XML text of ``photometric``: absolute candela, or relative to the lumens of the lamp where they are known."""
    root = Element("IESTM33-22")
    _put(root, "Version", "1.1")
    _header(SubElement(root, "Header"), photometric)
    gonioradiometer = SubElement(SubElement(root, "Equipment"), "Gonioradiometer")
    _put(gonioradiometer, "Type", "IES_C")  # of the angles; the data themselves say that they are simulated
    _emitter_element(SubElement(root, "Emitter"), photometric)
    indent(root)
    return '<?xml version="1.0" encoding="UTF-8"?>\n' + tostring(root, encoding="unicode") + "\n"


def _header(header: Element, photometric: PhotometricFile) -> None:
    _put(header, "Manufacturer", photometric.maker or _NOT_STATED)
    if photometric.catalogue:
        _put(header, "CatalogNumber", photometric.catalogue)
    _put(header, "Description", photometric.title or _NOT_STATED)
    _put(header, "Laboratory", photometric.laboratory or _NOT_STATED)
    _put(header, "ReportNumber", photometric.test or _NOT_STATED)
    _put(header, "ReportDate", _date(photometric) or NO_DATE)
    _put(header, "DocumentCreator", f"lensforge {__version__}")
    for comment in _comments(photometric):
        _put(header, "Comment", comment)


def _comments(photometric: PhotometricFile) -> Iterator[str]:
    yield from filter(None, (photometric.method, *photometric.remarks))
    if not _date(photometric):
        yield f"date of the report: {photometric.issued or _NOT_STATED}; {NO_DATE} stands for none"
    if photometric.watts <= 0.0:
        yield "input wattage not known: 0 stands for none"


def _date(photometric: PhotometricFile) -> str:
    """Date as the schema has it; empty where none is stated, or in another way than ISO 8601, such as 7/8/2021."""
    try:
        return date.fromisoformat(photometric.issued).isoformat()
    except ValueError:
        return ""


def _emitter_element(emitter: Element, photometric: PhotometricFile) -> None:
    """One emitter: what it is, how its data were made, intensities, and the round opening from which they come."""
    _put(emitter, "Quantity", "1")
    _put(emitter, "Description", photometric.title or _NOT_STATED)
    if photometric.lamp_lumens is not None:
        _put(emitter, "RatedLumens", _decimal(photometric.lamp_lumens))
    _put(emitter, "InputWattage", _decimal(photometric.watts))
    if photometric.generated != UNDEFINED:
        made = SubElement(emitter, "DataGeneration")
        _put(made, "Simulation", _boolean(photometric.generated == SIMULATED))
        _put(made, "IntensityScaling", _boolean("scaled" in photometric.generated))
        _put(made, "AngleInterpolation", _boolean("interpolated" in photometric.generated))
    data = SubElement(emitter, "LuminousData")
    _intensities(SubElement(data, "LuminousIntensity"), photometric)
    _put(data, "LuminousFlux", _decimal(photometric.intensity.flux()))
    if photometric.diameter_mm > 0.0:
        face = SubElement(SubElement(emitter, "EmissionAreas"), "BottomFace")
        _put(face, "NumberBottom", "1")
        area, diameter = SubElement(face, "BottomArea"), _decimal(photometric.diameter_mm / 1000.0)
        for name, text in (("Length", diameter), ("Width", diameter), ("LengthOffset", "0"), ("WidthOffset", "0")):
            _put(area, name, text)
        _put(area, "Circular", "true")


def _intensities(parent: Element, photometric: PhotometricFile) -> None:
    table = photometric.intensity
    h, v = [_decimal(angle) for angle in table.c_deg], [_decimal(angle) for angle in table.gamma_deg]
    _put(parent, "AbsolutePhotometry", _boolean(photometric.lamp_lumens is None))
    for name, count in (("NumberMeasured", len(h) * len(v)), ("NumberHorz", len(h)), ("NumberVert", len(v))):
        _put(parent, name, str(count))
    for row, plane in enumerate(h):
        for column, angle in enumerate(v):
            SubElement(parent, "IntData", h=plane, v=angle).text = _decimal(table.values[row, column])


def _put(parent: Element, name: str, text: str) -> None:
    SubElement(parent, name).text = single_line(text)


def _boolean(value: bool) -> str:
    return "true" if value else "false"


def _decimal(number: float) -> str:
    """Seven digits without an exponent, which xs:decimal does not have."""
    return np.format_float_positional(float(f"{number:.7g}"), trim="-")


_ROOT = re.compile(r"<(?:\w+:)?(IESTM33(?:-\d\d)?|UNI11733)(?=[\s>])")
_EDITIONS = {"IESTM33-22": "TM-33-23", "IESTM33": "TM-33-18", "UNI11733": "UNI 11733"}
_HEAD = 65536  # characters in which the root begins, after comments of any sensible length
_INTENSITY = "LuminousData/LuminousIntensity"


def matches(text: str) -> bool:
    """True where ``text`` is XML with one of the roots."""
    return text.lstrip().startswith("<") and _ROOT.search(text[:_HEAD]) is not None


def decode(text: str, name: str) -> PhotometricFile:
    """The far field in ``text``; ``name`` is the file in errors. Raises :class:`InputError`."""
    root = _parsed(text, name)
    emitter, warnings = _emitter(root, name)
    kind = _text(root, "Equipment/Gonioradiometer/Type")
    if kind.replace(" ", "") not in ("", "IES_C", "CIE_C"):
        raise InputError(f"{name}: goniometer of type {kind[:20]!r}: IES_C and CIE_C are read; export it as type C")
    intensity, more = _intensity(emitter, name)
    quantity = _number(emitter, "Quantity", name) or 1.0
    if quantity != 1.0:
        more = (*more, f"{quantity:g} emitters in one: the intensities are taken as those of all")
    absolute = _text(emitter, f"{_INTENSITY}/AbsolutePhotometry").lower() in ("true", "1")
    rated = _number(emitter, "RatedLumens", name) * max(quantity, 1.0)
    simulated = _text(emitter, "DataGeneration/Simulation").lower() in ("true", "1")
    issued = _text(root, "Header/ReportDate")
    return PhotometricFile(
        intensity=intensity,
        lamp_lumens=None if absolute else stated_or_none(rated),
        stated_lumens=stated_or_none(_number(emitter, "LuminousData/LuminousFlux", name)),
        title=_text(root, "Header/Description"),
        maker=_text(root, "Header/Manufacturer"),
        catalogue=_text(root, "Header/CatalogNumber"),
        test=_text(root, "Header/ReportNumber"),
        laboratory=_text(root, "Header/Laboratory"),
        issued="" if issued == NO_DATE else issued,
        generated=SIMULATED if simulated else UNDEFINED,
        method="",
        edition=_EDITIONS.get(root.tag, root.tag),
        diameter_mm=_diameter_mm(emitter, name),
        watts=stated_or_none(_number(emitter, "InputWattage", name)) or 0.0,
        format="tm33",
        warnings=(*warnings, *more),
    )


def _parsed(text: str, name: str) -> ElementTree.Element:
    """The tree of ``text`` without namespaces. Raises :class:`InputError` where it is no XML, or might expand."""
    if "<!DOCTYPE" in text:
        raise InputError(f"{name}: XML with a DOCTYPE, which TM-33 does not have and which may hide more; export again")
    if text.count("<") > MOST_NUMBERS:
        raise InputError(f"{name}: more than {MOST_NUMBERS} tags; not a photometric file")
    try:
        root = ElementTree.fromstring(text)
    except (ElementTree.ParseError, ValueError) as error:
        raise InputError(f"{name}: its XML is damaged ({single_line(str(error))}); export it again") from None
    for element in root.iter():
        element.tag = str(element.tag).rpartition("}")[2]
    return root


def _emitter(root: ElementTree.Element, name: str) -> tuple[ElementTree.Element, tuple[str, ...]]:
    """The only emitter of the file with luminous intensities, and words on those without."""
    emitters = root.findall("Emitter")
    lit = [emitter for emitter in emitters if emitter.find(_INTENSITY) is not None]
    if len(lit) != 1:
        raise InputError(
            f"{name}: {len(lit)} of its {len(emitters)} emitters have luminous intensities; a file with one is read: "
            f"export it as luminous data of one emitter"
        )
    unused = len(emitters) - 1
    return lit[0], (f"{unused} emitters without luminous intensities are left out",) * bool(unused)


def _intensity(emitter: ElementTree.Element, name: str) -> tuple[TabulatedIntensity, tuple[str, ...]]:
    """Intensity over C and gamma, from a list that has every pair of its angles once, in any order."""
    entries = emitter.findall(f"{_INTENSITY}/IntData")
    rows = np.array([_datum(each, name) for each in entries]).reshape(-1, 3)
    h_deg, v_deg = np.unique(rows[:, 0]), np.unique(rows[:, 1])
    promised = [_number(emitter, f"{_INTENSITY}/{count}", name) for count in ("NumberHorz", "NumberVert")]
    for angles, count in zip((h_deg, v_deg), promised, strict=True):
        if count not in (0.0, len(angles)):
            raise InputError(
                f"{name}: {len(angles)} angles of one kind, its header promises {count:g}; export it again"
            )
    pairs = np.unique(rows[:, :2], axis=0)
    if not len(rows) == len(pairs) == len(h_deg) * len(v_deg) > 0:
        raise InputError(
            f"{name}: {len(rows)} intensities for {len(h_deg)} angles h and {len(v_deg)} angles v: one is needed for "
            f"each pair; export it again"
        )
    candela = rows[np.lexsort((rows[:, 1], rows[:, 0])), 2].reshape(len(h_deg), len(v_deg))
    factor = _number(emitter, f"{_INTENSITY}/Multiplier", name) or 1.0
    return tabulated(h_deg, v_deg, candela * factor, name)


def _datum(element: ElementTree.Element, name: str) -> tuple[float, float, float]:
    """Angles h and v of one intensity, and its value."""
    h, v = (finite_number(element.get(angle, ""), f"angle {angle} of IntData", name) for angle in ("h", "v"))
    return h, v, finite_number((element.text or "").strip(), "IntData", name)


def _diameter_mm(emitter: ElementTree.Element, name: str) -> float:
    """Diameter of the opening, where it is one circle that faces downwards; lengths of TM-33 are in metres."""
    area = "EmissionAreas/BottomFace/BottomArea"
    if len(emitter.findall(area)) != 1 or _text(emitter, f"{area}/Circular").lower() not in ("true", "1"):
        return 0.0
    return 1000.0 * max(_number(emitter, f"{area}/Length", name), 0.0)


def _text(element: ElementTree.Element, path: str) -> str:
    return single_line(element.findtext(path) or "")


def _number(element: ElementTree.Element, path: str, name: str) -> float:
    """Number at ``path``, 0 where the file has none."""
    return finite_number(_text(element, path) or "0", path, name)


FORMAT = PhotometricFormat(".iesxml", matches, decode, document, "utf-8")
