"""TM-25-13, the format of the IES (`.tm25ray`): one header, spectral tables, then rows of float32.

Offsets in bytes, all little-endian: 0 fixed fields, 256 column flags, 288 nine texts of 4000 bytes in UTF-32, 36288
spectral tables (each an i32 count and that many wavelength-weight pairs; the block is padded once to a multiple of
32), labels of extra columns (512 bytes each), extra text, rays. Unknown numbers are 0 or NaN.
"""

import struct
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from lensforge.errors import InputError
from lensforge.sources.rayfiles.ray_file import (
    Format,
    HeaderValue,
    RayFile,
    SpectralTable,
    register,
    require_watts_with_wavelengths,
    shared_wavelength,
)
from lensforge.sources.rayfiles.ray_file_rows import HUGE, FileImage, as_float64, float_rows, known, plain_text

_FIXED = struct.Struct("<4s2i2fQ28s2i3f3i168x8i")
_COUNT = struct.Struct("<i")
_VERSION = 2013
_TEXTS = (
    "name", "manufacturer", "model_creator", "ray_file_creator", "equipment",
    "camera", "operation", "additional_info", "data_reference",
)  # fmt: skip
_TEXT_BYTES = 4000
_LABEL_BYTES = 512
_TABLES_START = _FIXED.size + len(_TEXTS) * _TEXT_BYTES
# Columns in the order of the file, with their widths; each has a flag, also in this order but for tristimulus.
_WIDTHS = {
    "position": 3, "direction": 3, "radiant": 1, "wavelength": 1, "luminous": 1,
    "stokes": 6, "tristimulus": 2, "spectrum_index": 1,
}  # fmt: skip
_NOT_USED = ("stokes", "tristimulus")
# A table of 0.01 nm from 200 to 3000 nm has 280,000 pairs, and each becomes two numbers in the header's record.
_MOST_PAIRS = 10**6
_MOST_TABLES = 1000
_MOST_EXTRA_COLUMNS = 1000
_SHOWN_TEXT_BYTES = 2**16  # of the extra text, which may be of any length
_SPECTRAL_IDS = ("none", "single wavelength", "wavelength of each ray", "common tables", "table of each ray")


class _Fields(NamedTuple):
    """The fixed part of the header, in the order of the file."""

    magic: bytes
    version: int
    creation_method: int
    luminous_lm: float
    radiant_w: float
    rays: int
    date: bytes
    start_position: int
    spectral_id: int
    wavelength_nm: float
    wavelength_min_nm: float
    wavelength_max_nm: float
    tables: int
    extra_columns: int
    extra_text_bytes: int
    flags: dict[str, int]

    @property
    def columns(self) -> int:
        return sum(width for name, width in _WIDTHS.items() if self.flags[name]) + self.extra_columns

    def column(self, name: str) -> int:
        """Index of the first column of ``name``."""
        before = list(_WIDTHS)[: list(_WIDTHS).index(name)]
        return sum(_WIDTHS[name_before] for name_before in before if self.flags[name_before])


def _matches(head: bytes, size: int) -> bool:
    return head[:4] == b"TM25"


def _decode(image: FileImage) -> RayFile:
    fields = _read_fields(image)
    tables, position = _read_tables(image, fields)
    labels_end = position + _LABEL_BYTES * fields.extra_columns
    start = labels_end + fields.extra_text_bytes
    rows = image.rows(start, fields.rays, fields.columns)
    shown_end = min(start, labels_end + _SHOWN_TEXT_BYTES)
    labels = [
        plain_text(image.part(at, at + _LABEL_BYTES), "utf-32-le") for at in range(position, labels_end, _LABEL_BYTES)
    ]
    watts = bool(fields.flags["radiant"])
    text = plain_text(image.part(labels_end, shown_end), "utf-32-le")
    header = _describe(image, fields, tables, labels, text)
    return RayFile(
        positions_mm=rows[:, 0:3],
        directions=rows[:, 3:6],
        flux=rows[:, fields.column("radiant" if watts else "luminous")],
        flux_unit="W" if watts else "lm",
        wavelengths_nm=_wavelengths(fields, rows),
        spectrum_numbers=rows[:, fields.column("spectrum_index")] if fields.flags["spectrum_index"] else None,
        format=BINARY.name,
        header_flux_w=known(fields.radiant_w),
        header_flux_lm=known(fields.luminous_lm),
        header_role="mean" if "lighttools" in str(header["ray_file_creator"]).lower() else "total",
        header=header,
        warnings=tuple(_warnings(fields)),
    )


def _read_fields(image: FileImage) -> _Fields:
    values = image.unpack(_FIXED)
    fields = _Fields._make((*values[:15], dict(zip(_WIDTHS, values[15:], strict=True))))
    if fields.version != _VERSION and int.from_bytes(fields.version.to_bytes(4, "little", signed=True), "big") < 10000:
        raise image.refuse("its bytes are in the wrong order (big-endian); TM-25 is little-endian, export it again")
    if image.size < _TABLES_START:
        raise image.refuse(f"truncated: {image.size} bytes, a TM-25 header has {_TABLES_START}; fetch the file again")
    for name, flag in fields.flags.items():
        if flag not in (0, 1):
            raise image.refuse(f"column flag {name} = {flag}: 0 or 1; the header is damaged, fetch the file again")
    if not (fields.flags["position"] and fields.flags["direction"]):
        raise image.refuse("its column flags leave out positions or directions; export both")
    if not (fields.flags["radiant"] or fields.flags["luminous"]):
        raise image.refuse("its column flags announce no flux; export radiant or luminous flux for each ray")
    if min(fields.tables, fields.extra_columns, fields.extra_text_bytes) < 0:
        raise image.refuse("a negative count in the header: it is damaged, fetch the file again")
    if fields.tables > _MOST_TABLES or fields.extra_columns > _MOST_EXTRA_COLUMNS:
        raise image.refuse(
            f"{fields.tables} spectral tables and {fields.extra_columns} extra columns in its header, at most "
            f"{_MOST_TABLES} and {_MOST_EXTRA_COLUMNS} are read; fetch or export it again"
        )
    return fields


def _read_tables(image: FileImage, fields: _Fields) -> tuple[list[dict[str, list[float]]], int]:
    """The spectral tables, and where their padded block ends."""
    tables: list[dict[str, list[float]]] = []
    position = _TABLES_START
    read = 0
    for _ in range(fields.tables):
        (count,) = image.unpack(_COUNT, position)
        position += _COUNT.size
        if not 0 < count <= (image.size - position) // 8:
            raise image.refuse(f"spectral table {len(tables) + 1} claims {count} pairs: more than the file can hold")
        read += count
        if read > _MOST_PAIRS:
            raise image.refuse(f"its spectral tables have {read} pairs or more, at most {_MOST_PAIRS} are read")
        pairs = as_float64(np.frombuffer(image.part(position, position + 8 * count), "<f4").reshape(count, 2))
        if not (np.abs(pairs) < HUGE).all():
            raise image.refuse(
                f"spectral table {len(tables) + 1} holds numbers that are not finite and below {HUGE:g}; export again"
            )
        tables.append({"wavelength_nm": pairs[:, 0].tolist(), "weight": pairs[:, 1].tolist()})
        position += 8 * count
    return tables, _padded(position)


def _padded(position: int) -> int:
    return _TABLES_START + -(-(position - _TABLES_START) // 32) * 32


def _wavelengths(fields: _Fields, rows: np.ndarray) -> np.ndarray | None:
    if fields.flags["wavelength"]:
        return rows[:, fields.column("wavelength")]
    single = known(fields.wavelength_nm) if fields.spectral_id == 1 else None
    return None if single is None else shared_wavelength(single, len(rows))


def _warnings(fields: _Fields) -> Iterator[str]:
    if fields.version != _VERSION:
        yield f"TM-25 version {fields.version}: read as {_VERSION}, because its size fits that layout"
    unused = _unused(fields)
    if unused:
        yield f"columns not used here, and lost when converted: {', '.join(unused)}"
    if fields.flags["radiant"] and fields.flags["luminous"]:
        yield "holds radiant and luminous flux for each ray: the radiant flux (W) is used"
    if fields.spectral_id in (2, 4) and (fields.flags["luminous"] or not fields.flags["radiant"]):
        yield f"spectral identifier {fields.spectral_id} needs radiant flux and no luminous flux"
    if fields.flags["spectrum_index"] != (fields.spectral_id == 4):
        yield "the spectrum-index column and spectral identifier 4 go together; this file has only one of them"
    if fields.flags["wavelength"] != (fields.spectral_id == 2):
        yield "the wavelength column and spectral identifier 2 go together; this file has only one of them"


def _unused(fields: _Fields) -> list[str]:
    return [name for name in _NOT_USED if fields.flags[name]] + ["extra"] * bool(fields.extra_columns)


def _describe(
    image: FileImage, fields: _Fields, tables: list[dict[str, list[float]]], labels: list[str], extra_text: str
) -> dict[str, HeaderValue]:
    """The header as JSON can hold it; ``_encode`` finds its texts and tables here again."""
    spectral = fields.spectral_id
    content: dict[str, HeaderValue] = {
        "version": fields.version,
        "creation_method": {0: "simulated", 1: "measured"}.get(fields.creation_method, "unknown"),
        "date": plain_text(fields.date, "ascii"),
        "start_position": fields.start_position,
        "spectrum": _SPECTRAL_IDS[spectral] if 0 <= spectral < len(_SPECTRAL_IDS) else f"unknown ({spectral})",
        "wavelength_min_nm": known(fields.wavelength_min_nm),
        "wavelength_max_nm": known(fields.wavelength_max_nm),
    }
    for index, name in enumerate(_TEXTS):
        at = _FIXED.size + index * _TEXT_BYTES
        content[name] = plain_text(image.part(at, at + _TEXT_BYTES), "utf-32-le")
    also_lm = ["luminous"] * bool(fields.flags["radiant"] and fields.flags["luminous"])
    content["unused_columns"] = [*_unused(fields), *also_lm]
    return {**content, "spectral_tables": tables, "extra_columns": labels, "extra_text": extra_text}


def _encode(rayfile: RayFile) -> Iterator[bytes]:
    if rayfile.single_wavelength is None:  # a shared one goes into the header, where it may accompany lumens
        require_watts_with_wavelengths(rayfile, BINARY.title)
    if rayfile.spectrum_numbers is not None and rayfile.flux_unit == "lm":
        raise InputError(f"{BINARY.title} holds a spectrum for each ray only with W, these rays are in lm; give W")
    header = rayfile.header
    tables = rayfile.spectral_tables
    per_ray = rayfile.wavelengths_nm is not None and rayfile.single_wavelength is None
    by_number = rayfile.spectrum_numbers is not None and bool(tables) and not per_ray
    yield _fixed_bytes(rayfile, len(tables), per_ray, by_number)
    for name in _TEXTS:
        yield _padded_text(str(header.get(name, "")))
    block = b"".join(_table_bytes(table) for table in tables)
    yield block.ljust(_padded(_TABLES_START + len(block)) - _TABLES_START, b"\0")
    for rays in rayfile.absolute_blocks():
        waves = rays.wavelengths_nm if per_ray else None
        numbers = rays.spectrum_numbers if by_number else None
        yield float_rows(rays.positions_mm, rays.directions, rays.flux, waves, numbers)


def _fixed_bytes(rayfile: RayFile, tables: int, per_ray: bool, by_number: bool) -> bytes:
    header = rayfile.header
    watts = rayfile.flux_unit == "W"
    single = rayfile.single_wavelength
    spectral_id = 2 if per_ray else 4 if by_number else 1 if single is not None else 3 if tables else 0
    flags = (1, 1, watts, per_ray, not watts, 0, 0, by_number)
    nan = float("nan")
    return _FIXED.pack(
        b"TM25", _VERSION, {"simulated": 0, "measured": 1}.get(str(header.get("creation_method")), -1),
        rayfile.flux_in("lm") or nan, rayfile.flux_in("W") or nan,
        len(rayfile), str(header.get("date", "")).encode("ascii", "replace"), header.get("start_position", 0),
        spectral_id, single or nan, header.get("wavelength_min_nm") or nan, header.get("wavelength_max_nm") or nan,
        tables, 0, 0, *flags,
    )  # fmt: skip


def _padded_text(text: str) -> bytes:
    raw = text.encode("utf-32-le")
    if len(raw) > _TEXT_BYTES - 4:
        raise InputError(f"TM-25 texts hold {_TEXT_BYTES // 4 - 1} characters, {text[:40]!r}… has {len(text)}")
    return raw.ljust(_TEXT_BYTES, b"\0")


def _table_bytes(table: SpectralTable) -> bytes:
    pairs = np.stack([table.wavelengths_nm, table.power_density], axis=1).astype("<f4")
    return _COUNT.pack(len(pairs)) + pairs.tobytes()


BINARY = register(Format("tm25", "TM-25-13", (".tm25ray",), _matches, _decode, _encode))
