"""Ray files of every format: described, converted, and taken as a source."""

import json
import zlib
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np

from fuzzing.chance import Chance
from fuzzing.fields import Layout, changed_fields
from fuzzing.kind import Files, Kind
from fuzzing.lines import changed_text
from lensforge.errors import InputError
from lensforge.sources.build_source import build_source, summarise
from lensforge.sources.photometric.photometric_summary import inspect
from lensforge.sources.rayfiles import FORMATS, RayFile, read_rayfile, write_rayfile
from lensforge.spec.source_sections import RayfileSource

FILE = "rays.bin"
_RAYS = 12
_SAMPLED = 16
# struct codes of each header, the index of the field that counts the rays, bytes of a ray, bytes after the rays.
_LAYOUTS = {
    "tm25": Layout.of("4s2i2fQ28s2i3f3i168x8i", 4, 28),
    "zemax_binary": Layout.of("iI100s7fI13f4i", 1, 28),
    "lighttools_binary": Layout.of("4s6I4f", None, 28, tail=7),
    "speos": Layout.of("7f", None, 32),
    "asap": Layout.of("i24x24s4x28x24xi28x", 1, 28),
}
_TM25_TABLES = 36_288  # where the spectral tables begin: their counts are fields, too


def sample_rays(unit: str, wavelengths: bool) -> RayFile:
    """Twelve rays upwards from a square of 1 mm; plain decimals, so that they are the same on any machine."""
    steps = np.arange(_RAYS)
    positions = np.stack([0.1 * (steps % 4) - 0.15, 0.1 * (steps // 4) - 0.1, 0.0 * steps], axis=1)
    directions = np.array([[0.6, 0.0, 0.8], [0.0, -0.6, 0.8], [0.0, 0.0, 1.0], [-0.48, 0.64, 0.6]])[steps % 4]
    flux = (1.0 + 0.125 * (steps % 3)).astype(np.float32)
    total = float(flux.sum())
    return RayFile(
        positions_mm=positions.astype(np.float32),
        directions=directions.astype(np.float32),
        flux=flux,
        flux_unit="W" if unit == "W" else "lm",
        wavelengths_nm=(450.0 + 10.0 * steps).astype(np.float32) if wavelengths else None,
        header_flux_w=total if unit == "W" else None,
        header_flux_lm=total if unit == "lm" else None,
    )


@cache
def _originals(name: str) -> list[bytes]:
    """Files of this format: W and lm, with and without wavelengths, as far as it can hold them."""
    table = {"wavelength_nm": [430.0, 450.0, 470.0], "weight": [0.25, 1.0, 0.5]}
    found = [sample_rays(unit, waves) for unit in ("W", "lm") for waves in (False, True)]
    found.append(replace(found[0], header={"name": "tables", "date": "2024-02-29", "spectral_tables": [table, table]}))
    contents: list[bytes] = []
    for rayfile in found:
        try:
            content = b"".join(FORMATS[name].encode(rayfile))
        except InputError:
            continue
        contents += [content] * (content not in contents)
    return contents


def _make(name: str) -> Callable[[Chance], Files]:
    layout = _LAYOUTS.get(name)
    if name == "tm25" and layout is not None:
        layout = replace(layout, fields=(*layout.fields, (_TM25_TABLES, "i"), (_TM25_TABLES + 4, "f")))

    def make(chance: Chance) -> Files:
        if layout is None:
            return {FILE: changed_text(chance, _originals(name))}
        return {FILE: changed_fields(chance, _originals(name), layout)}

    return make


def read(folder: Path) -> object:
    """Describe the file, convert it to another format, and draw rays from it as a source."""
    path = folder / FILE
    found = inspect(path)
    json.loads(found.model_dump_json(), parse_constant=_refuse)
    rayfile = read_rayfile(path)
    _convert(rayfile, folder, list(FORMATS)[zlib.crc32(path.read_bytes()) % len(FORMATS)])  # any, for its content
    section = RayfileSource(file=path)
    source = build_source(section)
    summarise(source, section).model_dump_json()
    bundle = source.sample(_SAMPLED, 1)
    require_finite(bundle.origins, bundle.directions, bundle.flux)
    return found


def _convert(rayfile: RayFile, folder: Path, name: str) -> None:
    path = folder / f"converted{FORMATS[name].suffixes[0]}"
    try:
        write_rayfile(path, rayfile, name)
        read_rayfile(path)
    except InputError:
        pass  # a format that cannot hold these rays


def require_finite(*arrays: np.ndarray) -> None:
    """Raise :class:`ValueError` where light that was accepted holds what is no number."""
    if not all(np.isfinite(array).all() for array in arrays):
        raise ValueError("accepted, with numbers that are not finite")


def _refuse(constant: str) -> None:
    raise ValueError(f"accepted, with {constant} in its record")


KINDS = [
    Kind(name, _make(name), read, lambda name=name: [{FILE: content} for content in _originals(name)])  # type: ignore[misc]
    for name in FORMATS
]
