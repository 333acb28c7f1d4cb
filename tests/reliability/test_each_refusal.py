"""What a file lacks is said in one line, by its sentence, and a file beside it that lacks nothing is read."""

import gzip
import io
import re
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from picture_files import bmp, png
from scenes import small_spec

import lensforge as lf
from lensforge.cad.mesh import BodyMesh
from lensforge.cad.mesh_files import stl_bytes, threemf_bytes
from lensforge.cad.step import require_schema
from lensforge.errors import InputError
from lensforge.optics.glass_catalogue import _formula
from lensforge.optics.image_reading import read_light
from lensforge.report.compare import folder_names
from lensforge.report.variation import _value, variation_of
from lensforge.results.file_bounds import read_3mf, stl_corners
from lensforge.results.files import read_file
from lensforge.results.json_npz import arrays_in, parse_json
from lensforge.results.table_names import Column
from lensforge.results.text_table import TextTable
from lensforge.scene.target_light import read_table
from lensforge.sources import light_files
from lensforge.sources.photometric.photometric_io import read_photometric
from lensforge.sources.ray_bundle import RayBundle
from lensforge.sources.rayfiles.ray_file_io import read_rayfile, write_rayfile
from lensforge.spec.new_spec import target_in
from lensforge.spec.spec_files import read_toml
from lensforge.spec.tolerances_section import read_tolerances

EXAMPLES = Path(__file__).parents[2] / "examples"
RAYS = b"x_mm,y_mm,z_mm,kx,ky,kz,flux_w\n0,0,0.5,0,0,1,0.25\n"
SPEC = b'name = "lamp"\n'
TM25 = (EXAMPLES / "led.tm25ray").read_bytes()


def npz(*arrays: np.ndarray) -> bytes:
    content = io.BytesIO()
    np.savez(content, *arrays)
    return content.getvalue()


def eulumdat(lines: int | None = None, gamma: str = "0 45 90", candela: str = "300 200 10") -> bytes:
    """A lamp of revolution, or its first ``lines``."""
    count = len(gamma.split())
    head = ["maker", "3", "1", "1", "0", str(count), "45", "r", "lamp", "c", "f", "d", *["0"] * 9]
    head += ["100", "0", "1", "0", "1", "1", "LED", "1000", "", "", "10", *["0"] * 10]
    return "\n".join([*head, "0", *gamma.split(), *candela.split()][:lines]).encode()


def ies(c: str) -> bytes:
    rows = "\n".join(["300 200 10"] * len(c.split()))
    return f"IES:LM-63-2019\nTILT=NONE\n1 1000 1 3 {len(c.split())} 1 2 0 0 0\n1 1 10\n0 45 90\n{c}\n{rows}\n".encode()


def toml_of(path: Path) -> Any:
    return read_toml(path, missing="")


def bytes_of(path: Path) -> Any:
    return read_file(path, missing="", most_bytes=10**6)


def table_of(path: Path) -> Any:
    return TextTable.read(path, missing="", most_bytes=10**6).columns((Column(("x",)), Column(("y",))))


def srgb_light(path: Path) -> Any:
    return read_light(path, "srgb", missing="")


def mesh_of(path: Path) -> Any:
    return read_3mf(path, path.name, "export it again")


GREYS = np.arange(12, dtype=np.uint8).reshape(3, 4)


def run_lengths(plain: bytes) -> bytes:
    """The header of a BMP file whose pixels are packed by runs of equal ones."""
    return plain[:30] + (1).to_bytes(4, "little") + plain[34:]


def zipped(content: bytes, old: bytes, new: bytes) -> bytes:
    """A 3MF file with another text in its model."""
    changed = io.BytesIO()
    with zipfile.ZipFile(io.BytesIO(content)) as file, zipfile.ZipFile(changed, "w") as other:
        for name in file.namelist():
            other.writestr(name, file.read(name).replace(old, new))
    return changed.getvalue()


def pyramid() -> BodyMesh:
    vertices = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]])
    triangles = np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]])
    return BodyMesh(vertices, triangles, np.zeros(4, dtype=np.int64), ("BODY",), 1)


PYRAMID = pyramid()
THREEMF = threemf_bytes(PYRAMID, "pyramid")
ROWS: dict[str, tuple[Callable[[Path], Any], bytes, dict[bytes, str]]] = {
    "lamp.ldt": (read_photometric, eulumdat(), {
        eulumdat(29): "truncated: 29 lines, the header alone has 32",
        eulumdat(45): "truncated: 3 numbers.*, its header promises|truncated: .* its header promises",
        eulumdat() + b"\n7": "its header promises .*: 1 too many; export it again",
        eulumdat(gamma="0", candela="300"): "one gamma angle only; a far field needs two or more",
    }),
    "lamp.ies": (read_photometric, ies("0 90 180 270 360"), {
        ies("0 90 180 200"): "C angles from 0 to 200: from 0 to 0, 90, 180 or 360",
        ies("10 20 90"): "C angles from 10 to 90: from 0 to 0, 90, 180 or 360",
    }),
    "rays.csv": (read_rayfile, RAYS, {
        RAYS.replace(b",flux_w", b",run"): "columns .*: must have exactly one of flux_w and flux_lm",
        RAYS.replace(b"flux_w", b"flux_w,flux_lm").replace(b"0.25", b"0.25,60"): "must have exactly one of flux_w and",
        b"": "rays.csv: the file is empty; fetch it again",
    }),
    "rays.tm25ray": (read_rayfile, TM25, {TM25[:400]: "truncated: 400 bytes, a TM-25 header has"}),
    "lamp.toml": (toml_of, SPEC, {
        SPEC.decode().encode("utf-16"): "it is in UTF-16 or UTF-32; save it as UTF-8",
        SPEC.decode().encode("utf-32-le"): "it is in UTF-16 or UTF-32; save it as UTF-8",
    }),
    "packed.csv": (bytes_of, RAYS, {gzip.compress(RAYS): r"packed \(gzip\); unpack it"}),
    "lamp_by_name.ies": (light_files.read_photometric, ies("0 90 180 270 360"), {
        RAYS: r'a ray file \(.*\): use it as a source of kind "rayfile"$',
    }),
    "points.csv": (table_of, b"1.5, 2.5\n3.5, 4.5\n", {
        b"1, 2\n1,5, 2,5\n": "line 2: commas with blanks beside them and without; separate its numbers by semicolons$",
    }),
    "light.png": (srgb_light, png(GREYS), {
        png(GREYS, extra=[(b"gAMA", (100_000).to_bytes(4, "big"))]):
        r'its gAMA chunk states 1; for luminance = "srgb" convert it to sRGB, or leave that out$',
    }),
    "light.bmp": (srgb_light, bmp(GREYS), {
        run_lengths(bmp(GREYS)): "a compressed BMP file; save it as PNG$",
    }),
    "part.3mf": (mesh_of, THREEMF, {
        zipped(THREEMF, b'unit="millimeter"', b'unit="inch"'): "holds no mesh in mm; export it again$",
    }),
    "tolerances.toml": (read_tolerances, b"[tolerances]\nindex = 1e-3\n", {SPEC: r"has no \[tolerances\]; give "}),
    "light.npz": (read_table, npz(np.ones((2, 3))), {
        npz(np.ones((2, 3)), np.ones(2)): "holds 2 arrays, must hold one; save it with numpy.savez",
        npz(np.ones((2, 3), complex)): "must be numbers of 8 bytes at most; save it again with numpy.savez",
        npz(np.ones((2, 3)))[:-30]: "save it again with numpy.savez",
    }),
}  # fmt: skip
CASES = [(name, wrong) for name, (_, _, refused) in ROWS.items() for wrong in refused]


@pytest.mark.parametrize(("name", "wrong"), CASES, ids=[f"{name}-{k}" for k, (name, _) in enumerate(CASES)])
def test_a_file_is_refused_by_what_it_lacks_and_read_without_that(name: str, wrong: bytes, tmp_path: Path) -> None:
    read, right, sentences = ROWS[name]
    path = tmp_path / name
    path.write_bytes(right)
    named = str(path) if read is read_tolerances else path
    read(named)
    path.write_bytes(wrong)
    with pytest.raises(InputError, match=sentences[wrong]) as caught:
        read(named)
    assert "\n" not in str(caught.value) and name in str(caught.value)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"[NaN]", "NaN is not valid JSON"), (b"[-Infinity]", "-Infinity is not valid JSON"),
        (b"[" * 100_000 + b"]" * 100_000, "nested too deep"),
    ],
)  # fmt: skip
def test_json_that_no_record_has_is_refused(content: bytes, message: str) -> None:
    with pytest.raises(ValueError, match=f"^{message}$"):
        parse_json(content)
    assert parse_json(b"[[1.5, null]]") == [[1.5, None]]


def test_arrays_have_numbers_of_eight_bytes_and_not_more_of_them_than_are_read() -> None:
    content = npz(np.ones(3), np.ones(4, dtype="S3"))
    assert arrays_in(content, ["arr_0"], 10**4)["arr_0"].tolist() == [1.0] * 3
    with pytest.raises(ValueError, match="array 'arr_1' must be numbers of 8 bytes at most"):
        arrays_in(content, None, 10**4)
    with pytest.raises(ValueError, match=r"\d+ bytes unpacked, at most 100 are read"):
        arrays_in(content, None, 100)


def test_the_last_seed_of_several_starts_has_a_bound() -> None:
    spec = lf.load_spec(EXAMPLES / "quickstart.toml")
    with pytest.raises(InputError, match=rf"seed = {2**32 - 1}: with 2 starts the last seed is above \d+"):
        lf.best_design(spec, starts=2, seed=2**32 - 1)


def test_a_field_that_varies_is_one_of_the_spec_and_not_scaled_by_itself() -> None:
    with pytest.raises(InputError, match=r"^source.side: no such field in this spec; there are: .*side_mm"):
        _value(lf.load_spec(EXAMPLES / "quickstart.toml"), "source.side")
    with pytest.raises(InputError, match=r"^source.side_mm: this is the field that varies; name others to be scaled$"):
        variation_of("source.side_mm", [1.0, 2.0], ["lens.inner.offset_mm", "source.side_mm"])
    assert variation_of("source.side_mm", [2.0, 1.0, 2.0]).values == (1.0, 2.0)


def glass_of(words: str) -> Any:
    return _formula(2, tuple(map(float, words.split())), Path("c.agf"), "GLASS-A")


WITHOUT_WAVES = RayBundle(np.zeros((2, 3)), np.tile([0.0, 0.0, 1.0], (2, 1)), np.ones(2))
REFUSED: dict[str, Callable[[], Any]] = {
    "schema = 'AP999': one of AP214, AP242": lambda: require_schema("AP999"),
    "report: the same folder is given twice; give each design once": (
        lambda: folder_names([EXAMPLES, EXAMPLES.parent / "docs", EXAMPLES / "."])
    ),
    "format 'zemax': one of ": lambda: write_rayfile(Path("rays.dat"), read_rayfile(EXAMPLES / "led.tm25ray"), "zemax"),
    'lens.levels = "auto": a search chooses them; ask its lens, or give numbers': lambda: lf.LensSection().basis,
    "optimise.rays goes with numbers in lens.levels; leave it out, or give levels": (
        lambda: small_spec(lens__levels="auto", optimise={"rays": 4096})
    ),
    "RaySource: rays is given twice, without its name and with it; leave out one": (
        lambda: lf.RaySource(np.ones((3, 7)), rays=np.ones((3, 7)))
    ),
    "--target heart:9x9@9: not understood; give ": lambda: target_in("heart:9x9@9"),
    "c.agf: GLASS-A has 7 coefficients in its line CD, formula 2 has 6: is one cut in two? Export the ": (
        lambda: glass_of("1 0.1 0.2 0.01 1 100 7")
    ),
    "wavelengths_nm: 1 of 2 bundles of rays have them; all must, or none": (
        lambda: RayBundle.joined([WITHOUT_WAVES, WITHOUT_WAVES.with_wavelengths(np.array([450.0, 620.0]))])
    ),
}  # fmt: skip


def test_as_many_triangles_are_read_as_may_be_and_not_one_more() -> None:
    content = stl_bytes(PYRAMID)
    assert len(stl_corners(content, "part.stl", "export it again", 4)) == 4
    with pytest.raises(InputError, match=r"^part.stl: 4 triangles, at most 3 are read; export it again$"):
        stl_corners(content, "part.stl", "export it again", 3)


@pytest.mark.parametrize("sentence", REFUSED)
def test_what_a_call_cannot_take_is_refused_by_its_sentence(sentence: str) -> None:
    with pytest.raises((InputError, ValueError), match=re.escape(sentence)) as caught:
        REFUSED[sentence]()
    assert "\n" not in str(caught.value)
