"""Files of every format, changed at random: each is read, or refused in one printable line, and nothing warns.

Flipped bits, numbers at their bounds, pieces that are cut, repeated or moved. LENSFORGE_FUZZ=10: ten times as many.
"""

import io
import random
import re
import warnings
from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path

import numpy as np
import pytest
import trimesh
from made_once import copied
from nightly import scaled
from one_line import require_line
from picture_files import numbers, png, tiff
from PIL import Image
from rayfile_samples import CASES, encoded

import lensforge as lf
from lensforge.optics.image_reading import read_light
from lensforge.optics.material_files import read_material
from lensforge.proof.part_mesh import read_part_mesh
from lensforge.scene.target_light import read_table
from lensforge.search.checkpoint import CHECKPOINT
from lensforge.sources.build_source import build_source
from lensforge.sources.intensity import TabulatedIntensity
from lensforge.sources.photometric import PhotometricFile
from lensforge.sources.photometric.photometric_file import LampSet
from lensforge.sources.photometric.photometric_io import _FORMATS as PHOTOMETRIC
from lensforge.sources.photometric_summary import rays
from lensforge.sources.radiance_emitter import read_radiance
from lensforge.sources.rayfiles.ray_file_io import FORMATS, read_rayfile
from lensforge.sources.source_spectrum import read_spectrum_file
from lensforge.spec.coating_section import CoatingSection
from lensforge.spec.scatter_section import TableScatter
from lensforge.surfaces.point_files import read_cloud


@pytest.fixture(autouse=True)
def no_warnings() -> Iterator[None]:
    """A warning is an error, but for one that says how a file was read."""
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        warnings.simplefilter("ignore", lf.FileWarning)
        yield


Reader = Callable[[Path], object]
_WORDS = (
    b"0",
    b"-1",
    b"1e308",
    b"-1e308",
    b"1e-320",
    b"1e999",
    b"nan",
    b"inf",
    b"9" * 40,
    b"2147483648",
    b"",
    b"#",
    b"\0",
    b"\xff",
)
_NUMBER = re.compile(rb"-?\d+(?:\.\d+)?(?:[eE][-+]?\d+)?")
_BYTES = (b"\0" * 4, b"\xff" * 4, b"\x7f\xff\xff\xff", b"\xff\xff\xff\x7f", b"\1\0\0\0", b"\0\0\xc0\x7f")
_GLASS = b"""NM GLASS-A 2 517642.251 1.5168 64.17 0 1
CD 1.03961212 0.00600069867 0.231792344 0.0200179144 1.01046945 103.560653 0 0 0 0
LD 0.3 2.5
IT 0.40 0.998 10
"""
_INDEX = b"""DATA:
  - {type: tabulated nk, data: "0.4 1.52 1e-7\\n0.6 1.51 2e-7\\n0.7 1.50 0"}
"""


def changed(content: bytes, chance: random.Random) -> bytes:
    """``content`` with one to five changes; most of them in its first kilobyte, where formats have counts."""
    for _ in range(chance.randint(1, 5)):
        at = (
            chance.randrange(min(len(content), 1024) if chance.random() < 0.66 else max(len(content), 1))
            if content
            else 0
        )
        piece = content[at : at + chance.choice((1, 4, 30, 500))]
        kind, number = chance.randrange(6), _NUMBER.search(content, at)
        if kind == 0 and piece:
            content = content[:at] + bytes([content[at] ^ 1 << chance.randrange(8)]) + content[at + 1 :]
        elif kind == 1:
            content = content[:at] + chance.choice(_BYTES) + content[at + 4 :]
        elif kind in (2, 3) and number is not None:
            content = content[: number.start()] + chance.choice(_WORDS) + content[number.end() :]
        elif kind == 4:
            content = content[:at] + content[at + len(piece) :]
        else:
            content = content[:at] + piece * chance.choice((2, 2, 50)) + content[at + len(piece) :]
    return content


def picture(kind: str, mode: str = "L", **options: object) -> bytes:
    file = io.BytesIO()
    Image.fromarray(numbers("uint8", 3, (16, 16))).convert(mode).save(file, kind, **options)
    return file.getvalue()


def radiance() -> bytes:
    file = io.BytesIO()
    np.savez(
        file, x_mm=np.array([-0.5, 0.5]), y_mm=np.array([-0.5, 0.5]), c_deg=np.array([0.0]),
        gamma_deg=np.array([0.0, 90.0]), radiance=np.ones((1, 1, 1, 2)),
    )  # fmt: skip
    return file.getvalue()


def photometric(suffix: str) -> bytes:
    values = np.array([[100.0, 80.0, 30.0, 0.0]] * 3)
    table = TabulatedIntensity(np.array([0.0, 180.0, 360.0]), np.array([0.0, 30.0, 60.0, 90.0]), values)
    file = PhotometricFile(intensity=table, lamps=(LampSet(500.0, 5.0),), title="sample", maker="nobody")
    return PHOTOMETRIC[suffix].encode(file).encode("latin-1")


def drawn(path: Path) -> None:
    """The rays as a source has them."""
    rays(path)
    read_rayfile(path)
    bundle = build_source(lf.RayfileSource(file=path)).sample(16, 1)
    assert np.isfinite(bundle.origins).all() and np.isfinite(bundle.flux).all()


@cache
def formats() -> dict[str, tuple[str, bytes, Reader]]:
    """By name: the name of a file, its content, and what reads it."""
    example = Path(__file__).parents[2] / "examples" / "quickstart.toml"
    sphere = trimesh.creation.icosphere(1, 5.0)
    pictures = {
        "png": png(numbers("uint16", 3), "rgb", 16), "tiff": tiff(numbers("uint16", 3), compression="zlib"),
        "lzw": picture("TIFF", compression="tiff_lzw"), "jpeg": picture("JPEG", "RGB"), "bmp": picture("BMP", "RGB"),
    }  # fmt: skip
    return {
        "spec": ("spec.toml", example.read_bytes(), lf.load_spec),
        **{name: ("rays.bin", encoded(name, CASES[name][0]), drawn) for name in FORMATS},
        **{suffix[1:]: (f"light{suffix}", photometric(suffix), rays) for suffix in PHOTOMETRIC},
        "spectrum": ("spectrum.txt", b"nm value\n400 0.5\n500 1.0\n600 0.25\n", read_spectrum_file),
        "coating": ("coating.csv", b"angle_deg;reflectance;nm\n0;0,05;500\n60;0,1;500\n", CoatingSection.read),
        "scatter": ("film.csv", b"incidence_deg,scattering_deg,bsdf\n0,0,1\n0,9,0\n", TableScatter.read),
        "target": ("light.csv", b"1,0.5,0\n2.5,3,4\n", read_table),
        "table": (
            "glass.csv",
            "n\tWavelength [µm]\r1,52\t0,4\r1,5\t0,7\r".encode("utf-16"),
            lambda path: read_material(path, "g"),
        ),
        "rays of a spreadsheet": (
            "rays.csv",
            b"x_mm;y_mm;z_mm;kx;ky;kz;flux_w\r\n" + b"0,5;1;0;0;0,6;0,8;0,1\r\n" * 9,
            drawn,
        ),
        "points": ("points.csv", b"x;y;z\n" + b"0.1;0.25;5\n" * 120, read_cloud),
        "radiance": ("radiance.npz", radiance(), read_radiance),
        "catalogue": ("glass.agf", _GLASS, lambda path: read_material(path, "GLASS-A")),
        "index": ("glass.yml", _INDEX, lambda path: read_material(path, "glass")),
        "stl": ("lens.stl", sphere.export(file_type="stl"), lambda path: read_part_mesh(path.read_bytes())),
        "stl as text": (
            "lens.stl",
            sphere.export(file_type="stl_ascii").encode(),
            lambda path: read_part_mesh(path.read_bytes()),
        ),
        **{
            name: ("picture", content, lambda path: read_light(path, "srgb", missing="give one"))
            for name, content in pictures.items()
        },
    }


@pytest.mark.parametrize("name", formats())
def test_a_changed_file_is_read_or_refused_in_one_line(name: str, tmp_path: Path) -> None:
    file, content, read = formats()[name]
    path = tmp_path / file
    path.write_bytes(content)
    read(path)
    for number in range(scaled(40, by_day=20)):
        path.write_bytes(changed(content, random.Random(f"{name} {number}")))
        require_line(lambda: read(path), f"{name} {number}")


def test_a_changed_result_is_read_or_refused_in_one_line(whole_run: lf.Run, tmp_path: Path) -> None:
    """Records, arrays and parts of a whole folder; what is accepted is what was written."""
    folder = copied(whole_run.folder, tmp_path / "run")
    before = lf.load(folder)
    for path in sorted(path for path in folder.iterdir() if path.suffix in (".json", ".npz", ".step", ".stl", ".3mf")):
        content = path.read_bytes()
        for number in range(scaled(4, by_day=1)):
            path.write_bytes(changed(content, random.Random(f"{path.name} {number}")))
            if require_line(lambda: lf.load(folder), f"{path.name} {number}") and path.name != "run.json":
                assert lf.load(folder).found == before.found, (path.name, number)
        path.write_bytes(content)


def test_a_changed_checkpoint_is_resumed_or_refused_in_one_line(small_run: lf.Run, tmp_path: Path) -> None:
    path = tmp_path / CHECKPOINT
    with pytest.raises(lf.Cancelled):
        lf.design(small_run.spec, accuracy="draft", checkpoint=path, progress=lambda step: step.steps_done < 3)
    content = path.read_bytes()
    for number in range(scaled(5, by_day=2)):
        path.write_bytes(changed(content, random.Random(number)))
        with pytest.raises((lf.Cancelled, lf.InputError)) as caught:
            lf.design(small_run.spec, accuracy="draft", checkpoint=path, resume=True, progress=lambda _: False)
        assert str(caught.value).isprintable(), number
