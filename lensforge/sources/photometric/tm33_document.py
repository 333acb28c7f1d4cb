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
# Keywords of comments.
METHOD = "FILEGENINFO"
ISSUED = "ISSUEDATE"
GENERATED = "FILEGENTYPE"
ROUND_HOUSING = "Align_Z"
TURNS = ("C0", "C90", "C180", "C270")
INTENSITY = "Emitter/LuminousData/LuminousIntensity"
KELVIN = re.compile(r"(\d{4,5})\s*K?", re.IGNORECASE)
INDEX = re.compile(r"(?:Ra|CRI)?\s*(\d{1,3})", re.IGNORECASE)
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
    """``text`` if all of it matches a whole number by ``pattern``; else empty."""
    match = pattern.fullmatch(text.strip())
    return "" if match is None else match.group(1)


def document(photometric: PhotometricFile) -> str:
    """XML text of ``photometric``: absolute candela, or relative to the lumens of the lamp where they are known."""
    root = Element("IESTM33-22")
    others = ((path, text) for path, text in photometric.others if "/" in path)
    for path, text in (*_texts(photometric).items(), *_comments(photometric), *others):
        if text:
            _insert(root, path, text)
    _add_intensities(root, photometric)
    indent(root)
    return '<?xml version="1.0" encoding="UTF-8"?>\n' + tostring(root, encoding="unicode") + "\n"


def _texts(photometric: PhotometricFile) -> dict[str, str]:
    """Texts of the elements by their paths, without empty ones."""
    table = photometric.intensity
    lamp = photometric.lamps[0]
    lumens = photometric.written_lumens
    planes = len(table.c_deg)
    angles = len(table.gamma_deg)
    return {
        "Version": "1.1",
        "Header/Manufacturer": photometric.maker or NOT_STATED,
        "Header/CatalogNumber": photometric.catalogue,
        "Header/Description": photometric.title or NOT_STATED,
        "Header/Laboratory": photometric.laboratory or NOT_STATED,
        "Header/ReportNumber": photometric.test or NOT_STATED,
        "Header/ReportDate": _date(photometric) or NO_DATE,
        "Header/DocumentCreator": f"lensforge {__version__}",
        **_housing(photometric.housing_mm),
        "Equipment/Gonioradiometer/Type": "IES_C",  # of the angles; the data themselves say that they are simulated
        "Emitter/Quantity": "1",
        "Emitter/Description": lamp.kind or photometric.title or NOT_STATED,
        "Emitter/CatalogNumber": lamp.catalogue,
        "Emitter/RatedLumens": "" if lumens is None else _decimal(lumens),
        "Emitter/InputWattage": _decimal(photometric.watts),
        "Emitter/ColorTemperature/FixedCCT": whole_in(lamp.colour, KELVIN),
        "Emitter/ColorRendering/CIE_CRI/Ra": whole_in(lamp.rendering, INDEX),
        **_generation(photometric.generated),
        f"{INTENSITY}/AbsolutePhotometry": _boolean(photometric.absolute),
        f"{INTENSITY}/NumberMeasured": str(planes * angles),
        f"{INTENSITY}/NumberHorz": str(planes),
        f"{INTENSITY}/NumberVert": str(angles),
        "Emitter/LuminousData/LuminousFlux": _decimal(table.flux()),
        **_faces(photometric.opening),
    }


def _comments(photometric: PhotometricFile) -> Iterator[tuple[str, str]]:
    """Statements that have no element of their own: keywords of LM-63 with their text, then remarks."""
    labels = [(METHOD, photometric.method), *(label for label in photometric.others if "/" not in label[0])]
    if photometric.generated not in (SIMULATED, UNDEFINED):
        labels.append((GENERATED, photometric.generated))
    if photometric.issued and not _date(photometric):
        labels.append((ISSUED, photometric.issued))
    texts = [*(f"[{keyword}] {text}" for keyword, text in labels if text), *photometric.remarks]
    texts += [] if _date(photometric) else [DATE_UNKNOWN]
    texts += [WATTS_UNKNOWN] if photometric.watts <= 0.0 else []
    yield from (("Header/Comment", text) for text in texts)


def _date(photometric: PhotometricFile) -> str:
    """Date as in the schema; empty if none is stated, or not in ISO 8601, such as 7/8/2021."""
    try:
        return date.fromisoformat(photometric.issued).isoformat()
    except ValueError:
        return ""


def _housing(housing_mm: tuple[float, float, float]) -> dict[str, str]:
    if not any(housing_mm):
        return {}
    length, width, height = housing_mm
    sizes = {"Length": length, "Width": width or length, "Height": height}
    return {
        **{f"Luminaire/Dimensions/{name}": _metres(size) for name, size in sizes.items()},
        "Luminaire/Shape": "" if width else ROUND_HOUSING,
        "Luminaire/NumEmitter": "1",
    }


def _generation(keyword: str) -> dict[str, str]:
    """Generation of the data by the ``keyword`` of LM-63-2019; empty if undefined."""
    flags = {
        "Simulation": keyword == SIMULATED,
        "IntensityScaling": "scaled" in keyword,
        "AngleInterpolation": "interpolated" in keyword,
    }
    return {f"Emitter/DataGeneration/{name}": _boolean(text) for name, text in flags.items() if keyword != UNDEFINED}


def _faces(opening: LuminousOpening) -> dict[str, str]:
    """The lower face of the opening, and its sides if they have a height; empty for a point."""
    if opening.shape == POINT:
        return {}
    length = {"Length": opening.length_mm}
    width = {"Width": opening.width_mm}
    texts = _face("Bottom", length | width)
    texts["Emitter/EmissionAreas/BottomFace/BottomArea/Circular"] = "true" if opening.rounded else ""
    for turn, height in zip(TURNS, opening.heights_mm, strict=True):
        if height > 0.0:
            texts |= _face(turn, (length if turn in ("C0", "C180") else width) | {"Height": height})
    return texts


def _face(face: str, sizes_mm: dict[str, float]) -> dict[str, str]:
    place = f"Emitter/EmissionAreas/{face}Face"
    sizes = sizes_mm | {f"{name}Offset": 0.0 for name in sizes_mm}
    areas = {f"{place}/{face}Area/{name}": _metres(size) for name, size in sizes.items()}
    return {f"{place}/Number{face}": "1", **areas}


def _insert(root: Element, path: str, text: str) -> None:
    """Add an element at ``path``, in the order of the schema; existing elements stay."""
    parent = root
    for name in path.split("/"):
        child = parent.find(name)
        if child is None or name == path.rpartition("/")[2]:
            order = ORDER.get(parent.tag, ())
            later = order[order.index(name) + 1 :] if name in order else ()
            place = next((k for k, child in enumerate(parent) if child.tag in later), len(parent))
            child = Element(name)
            parent.insert(place, child)
        parent = child
    parent.text = single_line(text)


def _add_intensities(root: Element, photometric: PhotometricFile) -> None:
    table = photometric.intensity
    parent = root.find(INTENSITY)
    assert parent is not None
    v = [_decimal(angle) for angle in table.gamma_deg]
    for plane, values in zip(map(_decimal, table.c_deg), table.values, strict=True):
        for angle, value in zip(v, values, strict=True):
            SubElement(parent, "IntData", h=plane, v=angle).text = _decimal(value)


def _boolean(value: bool) -> str:
    return "true" if value else "false"


def _metres(size_mm: float) -> str:
    return _decimal(size_mm / 1000.0)


def _decimal(number: float) -> str:
    """Seven digits without an exponent, which xs:decimal does not have."""
    return np.format_float_positional(float(f"{number:.7g}"), trim="-")
