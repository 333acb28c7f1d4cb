"""Rays of our own for the tests: one sample for each format, and variants that formats store differently."""

from dataclasses import replace
from pathlib import Path

import numpy as np

from lensforge.sources.rayfiles.ray_file import RayFile
from lensforge.sources.rayfiles.ray_file_io import FORMATS
from lensforge.sources.rayfiles.ray_file_rows import FileImage

SHARED = Path(__file__).parents[1] / ".." / "shared" / "rayfiles"


def rays(count=12, unit="W", wavelengths="none", seed=1) -> RayFile:
    """Seeded rays in float32; ``wavelengths``: none, one for all rays, or one for each ray."""
    random = np.random.default_rng(seed)
    directions = random.normal(size=(count, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    flux = random.uniform(0.5, 1.5, count).astype(np.float32)
    total = float(flux.sum(dtype=np.float64))
    waves = {
        "none": None,
        "one": np.broadcast_to(np.float32(450.0), (count,)),
        "each": random.uniform(400.0, 700.0, count).astype(np.float32),
    }[wavelengths]
    return RayFile(
        positions_mm=random.uniform(-1.0, 1.0, (count, 3)).astype(np.float32),
        directions=directions.astype(np.float32),
        flux=flux,
        flux_unit=unit,
        wavelengths_nm=waves,
        header_flux_w=total if unit == "W" else None,
        header_flux_lm=total if unit == "lm" else None,
    )


def with_tables(rayfile: RayFile) -> RayFile:
    table = {"wavelength_nm": [430.0, 450.0, 470.0], "weight": [0.25, 1.0, 0.5]}
    return replace(rayfile, header={"name": "tables", "date": "2024-02-29", "spectral_tables": [table]})


# The conformance cases: what each format must be able to hold. A format without an entry fails the suite.
CASES = {
    "tm25": [rays(), rays(unit="lm"), rays(wavelengths="one"), rays(wavelengths="each"), with_tables(rays())],
    "zemax_binary": [rays(), rays(unit="lm"), rays(wavelengths="one"), rays(wavelengths="each")],
    "zemax_text": [rays(), rays(unit="lm"), rays(wavelengths="each")],
    "lighttools_binary": [rays(), rays(unit="lm"), rays(wavelengths="each"), rays(unit="lm", wavelengths="each")],
    "lighttools_text": [rays(), rays(unit="lm"), rays(wavelengths="each"), rays(unit="lm", wavelengths="each")],
    "speos": [rays(wavelengths="each")],
    "speos_text": [rays(wavelengths="each")],
    "csv": [rays(), rays(unit="lm"), rays(wavelengths="each"), rays(unit="lm", wavelengths="each")],
}


def encoded(name: str, rayfile: RayFile) -> bytes:
    return b"".join(FORMATS[name].encode(rayfile))


def with_spectrum_numbers(numbers):
    """A TM-25 file of two tables whose rays say by a number which is theirs (spectral identifier 4)."""
    tables = [{"wavelength_nm": [c - 1.0, c, c + 1.0], "weight": [0.0, 1.0, 0.0]} for c in (450.0, 600.0)]
    content = bytearray(encoded("tm25", replace(rays(len(numbers)), header={"spectral_tables": tables})))
    content[60:64] = (4).to_bytes(4, "little")
    content[256 + 28 : 256 + 32] = (1).to_bytes(4, "little")
    start = len(content) - len(numbers) * 28
    rows = np.frombuffer(bytes(content[start:]), "<f4").reshape(-1, 7)
    return bytes(content[:start]) + np.column_stack([rows, np.array(numbers, dtype="<f4")]).astype("<f4").tobytes()


def image(content: bytes, name: str = "rays.bin") -> FileImage:
    return FileImage(Path(name), np.frombuffer(content, dtype=np.uint8))
