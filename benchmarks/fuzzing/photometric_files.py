"""IES, EULUMDAT and TM-33 files, and text files of a spectrum or of measured points."""

import json
from collections.abc import Callable, Sequence
from functools import cache
from pathlib import Path

import numpy as np

from fuzzing.chance import Chance
from fuzzing.kind import Files, Kind
from fuzzing.lines import changed_text
from fuzzing.ray_files import require_finite
from lensforge.errors import InputError
from lensforge.sources.build_source import build_source, summarise
from lensforge.sources.intensity import TabulatedIntensity
from lensforge.sources.photometric import PhotometricFile
from lensforge.sources.photometric.photometric_io import _FORMATS, convert_photometric
from lensforge.sources.photometric.photometric_summary import inspect
from lensforge.spec.source_sections import DiscSource

_FAR_FIELD, _SPECTRUM, _CLOUD = "far_field.ies", "spectrum.txt", "points.csv"
_SAMPLED = 16
_IES_TYPE_B = b"""IESNA:LM-63-1995
[TEST] 1
[MANUFAC] nobody
TILT=INCLUDE
1
3
0 45 90
1 .9 .8
1 1000 1 5 3 2 1 .1 .1 0
1 1 10
-90 -45 0 45 90
-90 0 90
0 10 20 10 0
0 50 100 50 0
0 10 20 10 0
"""


@cache
def _photometric(suffix: str) -> list[bytes]:
    """Type C files of revolution and of eight half-planes, and for IES one of type B with tilt factors."""
    gamma, found = np.array([0.0, 30.0, 60.0, 90.0]), []
    for planes in ((0.0,), tuple(45.0 * k for k in range(9))):
        values = np.array([[100.0, 80.0, 30.0 + 10.0 * (k % 2), 0.0] for k in range(len(planes))])
        table = TabulatedIntensity(np.array(planes), gamma, values)
        for lumens in (None, 500.0):
            file = PhotometricFile(intensity=table, lamp_lumens=lumens, title="sample", maker="nobody", watts=5.0)
            found.append(_FORMATS[suffix].encode(file).encode("latin-1"))
    return [*found, _IES_TYPE_B] if suffix == ".ies" else found


def _read_photometric(folder: Path) -> object:
    path = folder / _FAR_FIELD
    found = inspect(path)
    json.loads(found.model_dump_json(), parse_constant=_refuse)
    for suffix in (".ies", ".ldt", ".iesxml"):
        try:
            convert_photometric(path, folder / f"converted{suffix}")
        except InputError as error:
            if "report this" in str(error):
                raise ValueError(str(error)) from None
    section = DiscSource(diameter_mm=2.0, intensity={"kind": "photometric", "file": str(path)})
    source = build_source(section)
    summarise(source, section).model_dump_json()
    bundle = source.sample(_SAMPLED, 1)
    require_finite(bundle.origins, bundle.directions, bundle.flux)
    return found


def _refuse(constant: str) -> None:
    raise ValueError(f"accepted, with {constant} in its record")


_SPECTRA = [
    b"# wavelength, power\nnm value\n" + b"".join(b"%d %.3f\n" % (400 + 20 * k, k % 5 + 0.25) for k in range(15)),
    b"400;0,5\n500;1,0\n600;0,25\n",
    b"OPTIS - Spectrum file v1.0\nan LED\n4\n400 10\n450 100\n500 50\n600 5\n",
    b"# LightTools\ndfat 1.0\ndataname: LED\ncontinuous\nradiometric\n400 0.1\n450 1\n500 0.5\n",
]


def _read_spectrum(folder: Path) -> object:
    section = DiscSource(diameter_mm=2.0, spectrum={"kind": "file", "file": str(folder / _SPECTRUM)})
    source = build_source(section)
    return summarise(source, section).model_dump_json()


@cache
def _clouds() -> list[bytes]:
    """Points on a sphere of 5 mm, with a header or without."""
    rows = [
        (5.0 * np.cos(k) * np.sin(k / 80.0), 5.0 * np.sin(k) * np.sin(k / 80.0), 5.0 * np.cos(k / 80.0))
        for k in range(120)
    ]
    lines = [tuple(round(float(value), 4) for value in row) for row in rows]
    plain = "".join(f"{x}, {y}, {z}\n" for x, y, z in lines)
    named = "# measured\nx;y;z;n\n" + "".join(f"{x};{y};{z};1\n" for x, y, z in lines)
    return [plain.encode(), named.encode()]


def _read_cloud(folder: Path) -> object:
    from lensforge.made.registration import over_surface
    from lensforge.surfaces.point_cloud import read_cloud

    cloud = read_cloud(folder / _CLOUD)
    require_finite(cloud)
    return over_surface(cloud)


def _kind(
    name: str, file: str, samples: Callable[[], Sequence[bytes]], read: Callable[[Path], object], share: float
) -> Kind:
    def make(chance: Chance) -> Files:
        return {file: changed_text(chance, samples())}

    return Kind(name, make, read, lambda: [{file: content} for content in samples()], share)


KINDS = [
    _kind("ies", _FAR_FIELD, lambda: _photometric(".ies"), _read_photometric, 2.0),
    _kind("ldt", _FAR_FIELD, lambda: _photometric(".ldt"), _read_photometric, 2.0),
    _kind("tm33", _FAR_FIELD, lambda: _photometric(".iesxml"), _read_photometric, 2.0),
    _kind("spectrum", _SPECTRUM, lambda: _SPECTRA, _read_spectrum, 1.0),
    _kind("points", _CLOUD, _clouds, _read_cloud, 1.0),
]
