"""Document of TM-33-23 for a far field: header, one emitter, its luminous intensities.

Names, order and types of the elements are those of the schema in TM-33-23 (root ``IESTM33-22``, version 1.1), as
eulumdat-rs reprints it; the DesignLights Consortium's template for TM-33-18 has the same names, one ``IntData`` for
each pair of angles, v running first and h to 360, and lengths in metres. ``Symm`` may be left out, and is: the whole
turn is written. The schema requires a date of the report and watts: without them, the epoch and 0 are written, and a
comment says so.
"""

from collections.abc import Iterator
from datetime import date
from xml.etree.ElementTree import Element, SubElement, indent, tostring

import numpy as np

from lensforge.sources.photometric.generation import SIMULATED, UNDEFINED
from lensforge.sources.photometric.record import PhotometricFile, single_line
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
    _emitter(SubElement(root, "Emitter"), photometric)
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


def _emitter(emitter: Element, photometric: PhotometricFile) -> None:
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
