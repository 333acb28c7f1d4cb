"""ANSI/IES TM-33 (`.iesxml`, `.xml`): luminaire data as XML, the luminous intensity of one emitter read and written.

Roots: ``IESTM33-22`` of TM-33-23, ``IESTM33`` of TM-33-18, ``UNI11733`` of the Italian edition; all have the elements
that are read here. Each ``IntData`` is an intensity with its angles h (C) and v (gamma). ``AbsolutePhotometry`` false:
candela for ``RatedLumens``, as LM-63 has them. The standard library's parser is enough, without a package to harden it:
a file with a DOCTYPE is refused, and entities, by which a small file may grow or fetch another, are declared nowhere
else. Elements that the record has no field for are kept by their paths.
"""

import re
from collections.abc import Iterator
from dataclasses import replace
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

import numpy as np
from jaxtyping import Float

from lensforge.errors import InputError, refused
from lensforge.sources.photometric.candela_table import CandelaTable
from lensforge.sources.photometric.half_planes import tabulated
from lensforge.sources.photometric.ies_labels import NOT_STATED
from lensforge.sources.photometric.opening import LuminousOpening
from lensforge.sources.photometric.photometric_file import (
    MOST_NUMBERS,
    SIMULATED,
    UNDEFINED,
    LampSet,
    PhotometricFile,
    PhotometricFormat,
    finite_number,
    single_line,
    stated_or_none,
)
from lensforge.sources.photometric.tm33_document import (
    DATE_UNKNOWN,
    GENERATED,
    ISSUED,
    METHOD,
    NO_DATE,
    ORDER,
    ROUND_HOUSING,
    TURNS,
    WATTS_UNKNOWN,
    document,
)

_ROOT = re.compile(r"<(?:\w+:)?(IESTM33(?:-\d\d)?|UNI11733)(?=[\s>])")
_EDITIONS = {"IESTM33-22": "TM-33-23", "IESTM33": "TM-33-18", "UNI11733": "UNI 11733"}
_LABEL = re.compile(r"\[(\w+)\] (.+)")
_HEAD = 65536  # characters in which the root begins, after comments of any sensible length
_INTENSITY = "LuminousData/LuminousIntensity"
_AREA = "EmissionAreas/BottomFace/BottomArea"
# Paths below which all is in fields of the record, or follows from the rest of the document.
_KEPT = ("GTIN", "DocumentCreationDate", "UniqueIdentifier", "Reference", "MoreInfoURI")  # of the header, as others
_HELD = (
    "Version",
    "Luminaire/Dimensions",
    "Luminaire/NumEmitter",
    "Equipment/Gonioradiometer/Type",
    *(f"Header/{name}" for name in ORDER["Header"] if name not in _KEPT),
    *(f"Emitter/{name}" for name in (*ORDER["Emitter"][:5], "LuminousData", "ColorTemperature/FixedCCT")),
    *(f"Emitter/DataGeneration/{name}" for name in ("Simulation", "IntensityScaling", "AngleInterpolation")),
    "Emitter/ColorRendering/CIE_CRI/Ra",
    *(f"Emitter/EmissionAreas/{face}Face/Number{face}" for face in ("Bottom", *TURNS)),
    *(
        f"Emitter/EmissionAreas/{face}Face/{face}Area/{size}"
        for face in ("Bottom", *TURNS)
        for size in ("Length", "Width", "Height", "Circular")
    ),
)


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
    lamp, absolute, of_lamp = _lamp(root, emitter, name)
    labels, remarks = _labels(root)
    keywords = dict(reversed(labels))
    issued = _text(root, "Header/ReportDate")
    simulated = _is_true(emitter, "DataGeneration/Simulation")
    return PhotometricFile(
        intensity=intensity,
        lamps=(replace(lamp, lumens=None) if absolute else lamp,),
        stated_lumens=stated_or_none(_number(emitter, "LuminousData/LuminousFlux", name)),
        title=_text(root, "Header/Description"),
        maker=_text(root, "Header/Manufacturer"),
        catalogue=_text(root, "Header/CatalogNumber"),
        test=_text(root, "Header/ReportNumber"),
        laboratory=_text(root, "Header/Laboratory"),
        issued=keywords.get(ISSUED, "") if issued == NO_DATE else issued,
        generated=keywords.get(GENERATED, SIMULATED if simulated else UNDEFINED),
        method=keywords.get(METHOD, ""),
        edition=_EDITIONS.get(root.tag, root.tag),
        opening=_opening(emitter, name),
        housing_mm=_housing_mm(root, name),
        format="tm33",
        remarks=remarks,
        others=(*(label for label in labels if label[0] not in (ISSUED, GENERATED, METHOD)), *_others(root, emitter)),
        warnings=(*warnings, *of_lamp, *more, *_of_symmetry(emitter, intensity)),
    )


def _lamp(root: Element, emitter: Element, name: str) -> tuple[LampSet, bool, tuple[str, ...]]:
    """Lamps of the emitter; whether its intensities are absolute; and warnings on unclear statements."""
    warnings = []
    quantity = _number(emitter, "Quantity", name) or 1.0
    if quantity != 1.0:
        warnings.append(f"{quantity:g} emitters in one: the intensities are taken as those of all")
    factor = _number(emitter, "BallastFactor", name)
    if factor not in (0.0, 1.0):
        warnings.append(f"states a ballast factor, {factor:g}: the intensities are taken with it, as they stand")
    absolute = _is_true(emitter, f"{_INTENSITY}/AbsolutePhotometry")
    rated = stated_or_none(_number(emitter, "RatedLumens", name) * max(quantity, 1.0))
    if rated is None and not absolute:
        warnings.append("neither absolute photometry nor lumens of its lamps stated: taken as absolute")
    kind = _text(emitter, "Description")
    lamp = LampSet(
        rated,
        watts=stated_or_none(_number(emitter, "InputWattage", name)) or 0.0,
        count=int(max(quantity, 1.0)),
        kind="" if kind == _text(root, "Header/Description") else kind,
        catalogue=_text(emitter, "CatalogNumber"),
        colour=_text(emitter, "ColorTemperature/FixedCCT"),
        rendering=_text(emitter, "ColorRendering/CIE_CRI/Ra"),
    )
    return lamp, absolute, tuple(warnings)


def _labels(root: Element) -> tuple[list[tuple[str, str]], tuple[str, ...]]:
    """Keywords of LM-63 and their texts in the comments, and remarks."""
    texts = [single_line(comment.text or "") for comment in root.findall("Header/Comment")]
    labels = [label.groups() for text in texts if (label := _LABEL.fullmatch(text)) is not None]
    remarks = (text for text in texts if text not in ("", DATE_UNKNOWN, WATTS_UNKNOWN))
    return [(keyword, text) for keyword, text in labels], tuple(
        remark for remark in remarks if not _LABEL.fullmatch(remark)
    )


def _others(root: Element, emitter: Element) -> Iterator[tuple[str, str]]:
    """Elements without a field: path and text of leaves, path alone for lists of numbers."""
    for part in root:
        if part.tag != "Emitter" or part is emitter:
            yield from _leaves(part, part.tag)
    if len(emitter.findall(_AREA)) > 1:
        yield f"Emitter/{_AREA}", ""


def _leaves(element: Element, path: str) -> Iterator[tuple[str, str]]:
    text = single_line(element.text or "")
    if _is_held(path) or (path, text) == ("Luminaire/Shape", ROUND_HOUSING):
        return
    if any(child.attrib for child in element):
        yield path, ""
    elif len(element):
        for child in element:
            yield from _leaves(child, f"{path}/{child.tag}")
    elif text and not (path.endswith("Offset") and text.strip("0.") == ""):
        yield path, text


def _is_held(path: str) -> bool:
    """True for an element that has a field in the record, or follows from the others."""
    return any(path == held or path.startswith(f"{held}/") for held in _HELD)


def _opening(emitter: Element, name: str) -> LuminousOpening:
    """The opening by its lower face, if it has one, and its sides; lengths of TM-33 are in metres."""
    if len(emitter.findall(_AREA)) != 1:
        return LuminousOpening()
    length, width = (1000.0 * max(_number(emitter, f"{_AREA}/{size}", name), 0.0) for size in ("Length", "Width"))
    heights = [_number(emitter, f"EmissionAreas/{turn}Face/{turn}Area/Height", name) for turn in TURNS]
    c0, c90, c180, c270 = (1000.0 * max(height, 0.0) for height in heights)
    return LuminousOpening.of_area(length, width, (c0, c90, c180, c270), _is_true(emitter, f"{_AREA}/Circular"))


def _housing_mm(root: Element, name: str) -> tuple[float, float, float]:
    """Length, width and height of the luminaire, the width 0 if it is round."""
    sizes = [_number(root, f"Luminaire/Dimensions/{size}", name) for size in ("Length", "Width", "Height")]
    length, width, height = (1000.0 * max(size, 0.0) for size in sizes)
    is_round = _text(root, "Luminaire/Shape").replace(" ", "") == ROUND_HOUSING and length == width
    return length, 0.0 if is_round else width, height


def _parsed(text: str, name: str) -> ElementTree.Element:
    """The tree of ``text`` without namespaces. Raises :class:`InputError` if it is malformed, or might expand."""
    if "<!DOCTYPE" in text:
        raise InputError(f"{name}: XML with a DOCTYPE, which TM-33 does not have and which may hide more; export again")
    if text.count("<") > MOST_NUMBERS:
        raise InputError(f"{name}: more than {MOST_NUMBERS} tags; not a photometric file")
    with refused(name, "its XML is damaged (…); export it again", ElementTree.ParseError, ValueError):
        root = ElementTree.fromstring(text)
    for element in root.iter():
        element.tag = str(element.tag).rpartition("}")[2]
    return root


def _emitter(root: ElementTree.Element, name: str) -> tuple[ElementTree.Element, tuple[str, ...]]:
    """The only emitter of the file with luminous intensities, and warnings on those without."""
    emitters = root.findall("Emitter")
    lit = [emitter for emitter in emitters if emitter.find(_INTENSITY) is not None]
    if len(lit) != 1:
        raise InputError(
            f"{name}: {len(lit)} of its {len(emitters)} emitters have luminous intensities; a file with one is read: "
            f"export it as luminous data of one emitter"
        )
    unused = len(emitters) - 1
    return lit[0], (f"{unused} emitters without luminous intensities are left out",) * bool(unused)


def _intensity(emitter: ElementTree.Element, name: str) -> tuple[CandelaTable, tuple[str, ...]]:
    """Intensity over C and gamma, from a list that has every pair of its angles once, in any order."""
    entries = emitter.findall(f"{_INTENSITY}/IntData")
    rows = np.array([_datum(entry, name) for entry in entries]).reshape(-1, 3)
    h_deg = np.unique(rows[:, 0])
    v_deg = np.unique(rows[:, 1])
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


# Mirror images about C 0 and about C 90 that each word of Symm states; "Full" is light of revolution.
_SYMMETRIES = {"none": (False, False), "bi0": (True, False), "bi90": (False, True), "quad": (True, True)}
_REVOLUTION = "full"
_SAME_IMAGE = 0.02  # of the largest intensity


def _of_symmetry(emitter: ElementTree.Element, intensity: CandelaTable) -> Iterator[str]:
    """Warning on a stated symmetry that the intensities or the angles h do not have."""
    stated = _text(emitter, f"{_INTENSITY}/Symm")
    word = stated.lower().removeprefix("symm").strip("_ ")
    h_deg = np.unique([float(element.get("h", "nan")) for element in emitter.findall(f"{_INTENSITY}/IntData")])
    first = float(h_deg[0])
    last = float(h_deg[-1])
    if word not in (*_SYMMETRIES, _REVOLUTION):
        if stated:
            yield f"Symm = {stated[:20]!r} is not known: its angles h decide on symmetry"
        return
    about = _SYMMETRIES.get(word, (True, True))
    taken = (last in (first, 90.0, 180.0), last in (first, 90.0) or (first, last) == (90.0, 270.0))
    more = any(mirrored and not allowed for mirrored, allowed in zip(taken, about, strict=True))
    if more or (first == last and word != _REVOLUTION):
        turn = "light of revolution" if first == last else f"mirrored at h {last:g}"
        yield f"Symm = {stated!r}, but its angles h are {first:g} to {last:g}: taken as {turn}"
    elif not _has_images(intensity, about, word == _REVOLUTION):
        yield f"Symm = {stated!r}, but its intensities have not that symmetry: they are taken as they stand"


def _has_images(intensity: CandelaTable, about: tuple[bool, bool], revolution: bool) -> bool:
    """True if the table is its own mirror image ``about`` C 0 and C 90, where required, or of ``revolution``."""
    if len(intensity.c_deg) == 1:
        return True
    values = intensity.values
    largest = intensity.values.max()
    place = np.arange(len(intensity.c_deg))
    images = [
        np.interp((axis - intensity.c_deg) % 360.0, intensity.c_deg, place)
        for axis, is_required in zip((360.0, 180.0), about, strict=True)
        if is_required
    ]
    apart = [np.abs(_planes_at(values, image) - values).max() for image in images]
    if revolution:
        apart.append(np.ptp(values, axis=0).max())
    return max(apart, default=0.0) <= _SAME_IMAGE * largest


def _planes_at(values: Float[np.ndarray, "c g"], places: Float[np.ndarray, " c"]) -> Float[np.ndarray, "c g"]:
    """Half-planes between those of a table, linear."""
    low = np.minimum(places.astype(int), len(values) - 2)
    share = (places - low)[:, None]
    planes: Float[np.ndarray, "c g"] = (1.0 - share) * values[low] + share * values[low + 1]
    return planes


def _datum(element: ElementTree.Element, name: str) -> tuple[float, float, float]:
    h, v = (finite_number(element.get(angle, ""), f"angle {angle} of IntData", name) for angle in ("h", "v"))
    return h, v, finite_number((element.text or "").strip(), "IntData", name)


def _text(element: ElementTree.Element, path: str) -> str:
    text = single_line(element.findtext(path) or "")
    return "" if text == NOT_STATED else text


def _is_true(element: ElementTree.Element, path: str) -> bool:
    return _text(element, path).lower() in ("true", "1")


def _number(element: ElementTree.Element, path: str, name: str) -> float:
    return finite_number(_text(element, path) or "0", path, name)


FORMAT = PhotometricFormat("ANSI/IES TM-33", ".iesxml", matches, decode, document, "utf-8")
