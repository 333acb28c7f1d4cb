"""GLDF 1.0: the file of a luminaire for DIALux and Relux, a ZIP of ``product.xml`` and its EULUMDAT files.

Elements and their order are those of its schema 1.0.0-rc.3. A luminaire with several states has a variant for each. The
same photometry gives the same bytes: dates are those of the spec, identifiers are hashes of the content.
"""

import hashlib
import uuid
import zipfile
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from io import BytesIO
from xml.etree import ElementTree
from xml.etree.ElementTree import Element, SubElement

from lensforge.addons.office.product_figures import GLARE_DEG, ProductFigures
from lensforge.errors import InputError
from lensforge.light.photometry_result import Photometry
from lensforge.sources.photometric.photometric_file import PhotometricFile
from lensforge.sources.photometric.photometric_io import photometric_of
from lensforge.spec import Spec
from lensforge.version import __version__

GLDF_FILE = "lens.gldf"
_SCHEMA = "https://gldf.io/xsd/gldf/1.0.0-rc.3/gldf.xsd"
_INSTANCE = "http://www.w3.org/2001/XMLSchema-instance"
_UNDATED = "1970-01-01"  # its schema asks for a date
_ZIP_DATE = (1980, 1, 1, 0, 0, 0)  # the earliest that a ZIP holds
_MOST_LM_PER_W = 683.0


@dataclass(frozen=True, eq=False)
class LuminaireVariant:
    """The light of a luminaire in one state: its EULUMDAT file, its record, and figures of its data sheet."""

    name: str
    ldt: bytes
    photometry: Photometry
    file: PhotometricFile
    figures: ProductFigures


def variants_of(photometry: Photometry, spec: Spec) -> list[LuminaireVariant]:
    """A variant for each state; of a lamp with several lenses the light of all.

    Raises :class:`InputError` where the lumens of the source are not known.
    """
    if photometry.per_1000_lm:
        raise InputError(
            f"{spec.name}: GLDF states lumens, and those of the source are not known; give source.flux_lm in the spec, "
            "or run `lensforge photometry` with --lumens"
        )
    variants = []
    for case in photometry.cases():
        ldt = case.result.luminaire_ldt or case.result.ldt
        file = photometric_of(ldt, "lens.ldt")
        variants.append(LuminaireVariant(case.led or spec.name, ldt, case.result, file, ProductFigures.of(file)))
    return variants


def gldf_bytes(variants: Sequence[LuminaireVariant], spec: Spec, watts: float | None = None) -> bytes:
    """The file of a luminaire; ``watts``: its electrical power, 0 in the file where it is not known.

    Raises :class:`InputError` for a power that is not above 0, or too little for the light.
    """
    for variant in variants:
        lumens = variant.file.intensity.flux()
        if watts is not None and not lumens / _MOST_LM_PER_W < watts:
            raise InputError(
                f"watts = {watts:g}: must be above {lumens / _MOST_LM_PER_W:.3g} for {lumens:.5g} lm; give the "
                "electrical power of the luminaire"
            )
    content = BytesIO()
    with zipfile.ZipFile(content, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr(zipfile.ZipInfo("product.xml", _ZIP_DATE), _product(variants, spec, watts))
        for number, variant in enumerate(variants, 1):
            archive.writestr(zipfile.ZipInfo(f"ldc/{_ldt_name(number)}", _ZIP_DATE), variant.ldt)
    return content.getvalue()


def _ldt_name(number: int) -> str:
    return f"light{number}.ldt"


def _product(variants: Sequence[LuminaireVariant], spec: Spec, watts: float | None) -> bytes:
    root = Element("Root", {"xmlns:xsi": _INSTANCE, "xsi:noNamespaceSchemaLocation": _SCHEMA})
    shop = spec.manufacture
    digest = hashlib.sha256(b"".join(variant.ldt for variant in variants)).digest()
    header = SubElement(root, "Header")
    _text(header, "Manufacturer", shop.organisation or "lensforge")
    SubElement(header, "FormatVersion", {"major": "1", "minor": "0", "pre-release": "3"})
    _text(header, "CreatedWithApplication", f"lensforge {__version__}")
    _text(header, "GldfCreationTimeCode", f"{shop.date or _UNDATED}T00:00:00Z")
    _text(header, "UniqueGldfId", str(uuid.UUID(bytes=digest[:16], version=4)))
    if shop.author:
        _text(header, "Author", shop.author)
    _definitions(SubElement(root, "GeneralDefinitions"), variants, watts)
    product = SubElement(root, "ProductDefinitions")
    about = SubElement(product, "ProductMetaData")
    _text(about, "UniqueProductId", str(uuid.UUID(bytes=digest[16:], version=4)))
    _local(about, "ProductNumber", spec.drawing.part_number or spec.name)
    _local(about, "Name", spec.drawing.part_name or spec.name)
    _local(about, "Description", _description(watts))
    listed = SubElement(product, "Variants")
    for number, variant in enumerate(variants, 1):
        element = SubElement(listed, "Variant", {"id": f"variant{number}"})
        _local(element, "Name", variant.name)
        if bright := variant.figures.luminance_cd_per_m2:
            _local(element, "Description", f"Luminance at {GLARE_DEG:g}°: {bright:.0f} cd/m² at most")
        SubElement(SubElement(element, "Geometry"), "EmitterReference", {"emitterId": f"emitter{number}"})
    ElementTree.indent(root)
    return bytes(ElementTree.tostring(root, encoding="UTF-8", xml_declaration=True))


def _description(watts: float | None) -> str:
    simulated = "Light by tracing rays through the design, not measured"
    return simulated if watts is not None else f"{simulated}; the electrical power is not known, and 0 here"


def _definitions(general: Element, variants: Sequence[LuminaireVariant], watts: float | None) -> None:
    """Files, photometry, sources and emitters, one for each variant."""
    files, lights, sources, emitters = (
        SubElement(general, name) for name in ("Files", "Photometries", "LightSources", "Emitters")
    )
    for number, variant in enumerate(variants, 1):
        entry = {"id": f"file{number}", "contentType": "ldc/eulumdat", "type": "localFileName"}
        _text(files, "File", _ldt_name(number), entry)
        light = SubElement(lights, "Photometry", {"id": f"photometry{number}"})
        SubElement(light, "PhotometryFileReference", {"fileId": f"file{number}"})
        described = SubElement(light, "DescriptivePhotometry")
        for name, value in _described(variant, watts):
            if isinstance(value, str):
                _text(described, name, value)
            else:
                pair = SubElement(described, name)
                for part, text in value.items():
                    _text(pair, part, text)
        source = SubElement(sources, "FixedLightSource", {"id": f"source{number}"})
        _local(source, "Name", "LED")
        _text(source, "RatedInputPower", f"{watts or 0.0:.6g}")
        emitter = SubElement(SubElement(emitters, "Emitter", {"id": f"emitter{number}"}), "FixedLightEmitter")
        SubElement(emitter, "PhotometryReference", {"photometryId": f"photometry{number}"})
        SubElement(emitter, "LightSourceReference", {"fixedLightSourceId": f"source{number}"})
        _text(emitter, "RatedLuminousFlux", f"{variant.file.rated_lumens:.0f}")


def _described(variant: LuminaireVariant, watts: float | None) -> Iterator[tuple[str, str | dict[str, str]]]:
    """Elements of ``DescriptivePhotometry`` in the order of the schema; unknown figures are omitted."""
    lit = variant.photometry
    ratio = lit.light_output_ratio.value
    down = variant.file.intensity.share_up_to(90.0)
    yield "LightOutputRatio", f"{ratio:.4f}"
    if watts is not None:
        yield "LuminousEfficacy", f"{variant.file.intensity.flux() / watts:.4g}"
    yield "DownwardFluxFraction", f"{down:.4f}"
    yield "DownwardLightOutputRatio", f"{ratio * down:.4f}"
    yield "UpwardLightOutputRatio", f"{ratio * (1.0 - down):.4f}"
    for name, figure in (("TenthPeakDivergence", "field_angle_deg"), ("HalfPeakDivergence", "beam_angle_deg")):
        widths = [getattr(plane, figure) for plane in (lit.beam_c0, lit.beam_c90)]
        if None not in widths:  # its angles are from the middle of the beam
            half = [f"{0.5 * width.value:.2f}" for width in widths]
            yield name, dict(zip(("C0-C180", "C90-C270"), half, strict=True))
    yield "CIE-FluxCode", lit.figures.flux_code_words
    if variant.figures.cut_off_deg is not None:
        yield "CutOffAngle", f"{variant.figures.cut_off_deg:.1f}"
    if variant.figures.glare is not None:
        lengthways, across = variant.figures.glare
        yield "UGR-4H8H-70-50-20-LQ", {"X": f"{lengthways:.1f}", "Y": f"{across:.1f}"}


def _text(parent: Element, name: str, text: str, attributes: dict[str, str] | None = None) -> None:
    SubElement(parent, name, attributes or {}).text = text


def _local(parent: Element, name: str, text: str) -> None:
    """An element with its ``text`` in English."""
    _text(SubElement(parent, name), "Locale", text, {"language": "en"})
