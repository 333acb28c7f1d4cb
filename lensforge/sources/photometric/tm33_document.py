"""Document of ANSI/IES TM-33: the far field of one emitter, and what is stated of it, as XML.

Names, order and types of the elements are those of the schema in TM-33-23 (root ``IESTM33-22``, version 1.1), as
eulumdat-rs reprints it; the DesignLights Consortium's template for TM-33-18 has the same names, one ``IntData`` for
each pair of angles, v running first and h to 360, and lengths in metres. ``Symm`` may be left out, and is: the whole
turn is written. The schema requires a date of the report and watts: without them, the epoch and 0 are written, and a
comment says so. What has no element is a comment, keywords of LM-63 before their texts.
"""

import re
from collections.abc import Iterator
from datetime import date
from xml.etree.ElementTree import Element, SubElement, indent, tostring

import numpy as np

from lensforge.sources.photometric.ies_labels import NOT_STATED
from lensforge.sources.photometric.opening import POINT, LuminousOpening
from lensforge.sources.photometric.photometric_file import SIMULATED, UNDEFINED, PhotometricFile, single_line
from lensforge.version import __version__

NO_DATE = "1970-01-01"  # of a document that states none: the clock's would change its bytes from run to run
DATE_UNKNOWN = f"date of the report not known: {NO_DATE} stands for none"
WATTS_UNKNOWN = "input wattage not known: 0 stands for none"
METHOD, ISSUED, GENERATED = "FILEGENINFO", "ISSUEDATE", "FILEGENTYPE"  # keywords of comments
ROUND_HOUSING = "Align_Z"
TURNS = ("C0", "C90", "C180", "C270")
KELVIN, INDEX = re.compile(r"(\d{4,5})\s*K?", re.IGNORECASE), re.compile(r"(?:Ra|CRI)?\s*(\d{1,3})", re.IGNORECASE)
# Elements in the order of the schema where others may be kept.
ORDER = {
    "IESTM33-22": ("Version", "Header", "Luminaire", "Equipment", "Emitter", "CustomData"),
    "Luminaire": ("Dimensions", "Shape", "NumEmitter"),
    "Header": (
        "Manufacturer", "CatalogNumber", "GTIN", "Description", "Laboratory", "ReportNumber", "ReportDate",
        "DocumentCreator", "DocumentCreationDate", "UniqueIdentifier", "Comment", "Reference", "MoreInfoURI",
    ),
    "Emitter": (
        "Quantity", "Description", "CatalogNumber", "RatedLumens", "InputWattage", "PowerFactor", "BallastFactor",
        "TiltAngles", "ColorTemperature", "ColorRendering", "Duv", "SPRatio", "DataGeneration", "LuminousData",
        "RadiantData", "PhotonData", "SpectralData", "AngularColor", "IllumData", "IrradData", "PFDData",
        "SpecIrradData", "Channels", "EmissionAreas", "EmitterCenter", "Regulatory",
    ),
}  # fmt: skip


def whole_in(text: str, pattern: re.Pattern[str]) -> str:
    """The whole number that all of ``text`` says by ``pattern``; empty where it says another thing."""
    found = pattern.fullmatch(text.strip())
    return "" if found is None else found.group(1)


def document(photometric: PhotometricFile) -> str:
    """XML text of ``photometric``: absolute candela, or relative to the lumens of the lamp where they are known."""
    root = Element("IESTM33-22")
    _put(root, "Version", "1.1")
    _header(SubElement(root, "Header"), photometric)
    if any(photometric.housing_mm):
        _housing(SubElement(root, "Luminaire"), photometric.housing_mm)
    gonioradiometer = SubElement(SubElement(root, "Equipment"), "Gonioradiometer")
    _put(gonioradiometer, "Type", "IES_C")  # of the angles; the data themselves say that they are simulated
    _emitter_element(SubElement(root, "Emitter"), photometric)
    for path, text in photometric.others:
        if "/" in path and text:
            _insert(root, path, text)
    indent(root)
    return '<?xml version="1.0" encoding="UTF-8"?>\n' + tostring(root, encoding="unicode") + "\n"


def _header(header: Element, photometric: PhotometricFile) -> None:
    _put(header, "Manufacturer", photometric.maker or NOT_STATED)
    if photometric.catalogue:
        _put(header, "CatalogNumber", photometric.catalogue)
    _put(header, "Description", photometric.title or NOT_STATED)
    _put(header, "Laboratory", photometric.laboratory or NOT_STATED)
    _put(header, "ReportNumber", photometric.test or NOT_STATED)
    _put(header, "ReportDate", _date(photometric) or NO_DATE)
    _put(header, "DocumentCreator", f"lensforge {__version__}")
    for comment in _comments(photometric):
        _put(header, "Comment", comment)


def _comments(photometric: PhotometricFile) -> Iterator[str]:
    """Statements that have no element: keywords of LM-63 with their text, then remarks."""
    labels = [(METHOD, photometric.method), *(each for each in photometric.others if "/" not in each[0])]
    if photometric.generated not in (SIMULATED, UNDEFINED):
        labels.append((GENERATED, photometric.generated))
    if photometric.issued and not _date(photometric):
        labels.append((ISSUED, photometric.issued))
    yield from (f"[{keyword}] {text}" for keyword, text in labels if text)
    yield from photometric.remarks
    if not _date(photometric):
        yield DATE_UNKNOWN
    if photometric.watts <= 0.0:
        yield WATTS_UNKNOWN


def _date(photometric: PhotometricFile) -> str:
    """Date as the schema has it; empty where none is stated, or in another way than ISO 8601, such as 7/8/2021."""
    try:
        return date.fromisoformat(photometric.issued).isoformat()
    except ValueError:
        return ""


def _housing(luminaire: Element, housing_mm: tuple[float, float, float]) -> None:
    length, width, height = (size / 1000.0 for size in housing_mm)
    dimensions = SubElement(luminaire, "Dimensions")
    for name, size in (("Length", length), ("Width", width or length), ("Height", height)):
        _put(dimensions, name, _decimal(size))
    if width == 0.0:
        _put(luminaire, "Shape", ROUND_HOUSING)
    _put(luminaire, "NumEmitter", "1")


def _emitter_element(emitter: Element, photometric: PhotometricFile) -> None:
    """One emitter: what it is, how its data were made, intensities, and the opening from which they come."""
    lamp, lumens = photometric.lamps[0], photometric.written_lumens
    _put(emitter, "Quantity", "1")
    _put(emitter, "Description", lamp.kind or photometric.title or NOT_STATED)
    if lamp.catalogue:
        _put(emitter, "CatalogNumber", lamp.catalogue)
    if lumens is not None:
        _put(emitter, "RatedLumens", _decimal(lumens))
    _put(emitter, "InputWattage", _decimal(photometric.watts))
    if kelvin := whole_in(lamp.colour, KELVIN):
        _put(SubElement(emitter, "ColorTemperature"), "FixedCCT", kelvin)
    if index := whole_in(lamp.rendering, INDEX):
        _put(SubElement(SubElement(emitter, "ColorRendering"), "CIE_CRI"), "Ra", index)
    if photometric.generated != UNDEFINED:
        made = SubElement(emitter, "DataGeneration")
        _put(made, "Simulation", _boolean(photometric.generated == SIMULATED))
        _put(made, "IntensityScaling", _boolean("scaled" in photometric.generated))
        _put(made, "AngleInterpolation", _boolean("interpolated" in photometric.generated))
    data = SubElement(emitter, "LuminousData")
    _intensities(SubElement(data, "LuminousIntensity"), photometric)
    _put(data, "LuminousFlux", _decimal(photometric.intensity.flux()))
    if photometric.opening.shape != POINT:
        _faces(SubElement(emitter, "EmissionAreas"), photometric.opening)


def _faces(areas: Element, opening: LuminousOpening) -> None:
    """The lower face of the opening, and its sides where they have a height."""
    length, width = opening.length_mm, opening.width_mm
    sizes = [("Length", length), ("Width", width), ("LengthOffset", 0.0), ("WidthOffset", 0.0)]
    area = _face(areas, "Bottom", sizes)
    if opening.rounded:
        _put(area, "Circular", "true")
    for turn, height in zip(TURNS, opening.heights_mm, strict=True):
        name, size = ("Length", length) if turn in ("C0", "C180") else ("Width", width)
        if height > 0.0:
            _face(areas, turn, [(name, size), ("Height", height), (f"{name}Offset", 0.0), ("HeightOffset", 0.0)])


def _face(areas: Element, which: str, sizes_mm: list[tuple[str, float]]) -> Element:
    face = SubElement(areas, f"{which}Face")
    _put(face, f"Number{which}", "1")
    area = SubElement(face, f"{which}Area")
    for name, size in sizes_mm:
        _put(area, name, _decimal(size / 1000.0))
    return area


def _insert(root: Element, path: str, text: str) -> None:
    """Add an element at ``path``, where the schema has its name among those beside it; what is there stays."""
    parent = root
    for name in path.split("/"):
        found = parent.find(name)
        if found is None or name == path.rpartition("/")[2]:
            order = ORDER.get(parent.tag, ())
            later = order[order.index(name) + 1 :] if name in order else ()
            place = next((k for k, child in enumerate(parent) if child.tag in later), len(parent))
            found = Element(name)
            parent.insert(place, found)
        parent = found
    parent.text = single_line(text)


def _intensities(parent: Element, photometric: PhotometricFile) -> None:
    table = photometric.intensity
    h, v = [_decimal(angle) for angle in table.c_deg], [_decimal(angle) for angle in table.gamma_deg]
    _put(parent, "AbsolutePhotometry", _boolean(photometric.absolute))
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
