"""Kits: their files read back, light without polarisation by hand, and the programs that run here."""

import hashlib
import importlib.util
import io
import json
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path
from unittest.mock import MagicMock

import numpy as np
import pytest
import trimesh
from scenes import small_spec, sphere

from lensforge.addons.recheck.averaged_polarisation import less_polarisation, transmittance
from lensforge.addons.recheck.kit import kit_files
from lensforge.cad.mesh_files import parse_stl
from lensforge.errors import InputError
from lensforge.proof.receiver_screen import FarFieldScreen, PlaneScreen, Screen
from lensforge.report.results import Results
from lensforge.results import Metric
from lensforge.scene.lens import Lens
from lensforge.sources.ray_bundle import RayBundle
from lensforge.sources.rayfiles.ray_file_io import decode
from lensforge.sources.rayfiles.ray_file_rows import FileImage

RAYS = 2048
SCRIPTS = Path(sys.modules[kit_files.__module__].__file__).with_name("scripts")


@pytest.fixture(scope="module")
def files(small_run):
    return kit_files(small_run, RAYS)


def test_figures_are_those_of_the_record_and_files_are_hashed(small_run, files):
    kit = json.loads(files["kit.json"])
    lit = small_run.light.first
    for name in ("efficiency", "share_in_target", "nmse"):
        assert kit["expected"][name] == getattr(lit, name).model_dump(mode="json")
    for name, digest in kit["sha256"].items():
        assert hashlib.sha256(files[name]).hexdigest() == digest
    assert files["lens.step"] == small_run.part.step and kit["refractive_index"] == small_run.lens.refractive_index
    width, height = lit.width, lit.height
    landed_w = lit.raw_map.sum() * 1e-6 * width * height / lit.raw_map.size
    assert np.sum(kit["zone_shares"]) == pytest.approx(landed_w / kit["source_w"], rel=1e-12)
    rows, columns = np.array(kit["zone_shares"]).shape
    first = lit.raw_map[: len(lit.raw_map) // rows, : len(lit.raw_map[0]) // columns].sum() / lit.raw_map.sum()
    assert kit["zone_shares"][0][0] == pytest.approx(first * landed_w / kit["source_w"], rel=1e-12)


def test_ray_files_hold_the_rays_of_the_table(files):
    table = np.load(io.BytesIO(files["source.npy"]))
    assert table.shape == (RAYS, 6)
    for name in ("source.tm25ray", "source.dat", "source.ray"):
        read = decode(FileImage(Path(name), np.frombuffer(files[name], dtype=np.uint8)))
        np.testing.assert_allclose(read.positions_mm, table[:, :3], atol=1e-6)
        np.testing.assert_allclose(read.directions, table[:, 3:], atol=1e-6)
        assert np.ptp(read.flux) < 1e-6 * np.mean(read.flux)
        assert read.header_flux_w in (None, pytest.approx(json.loads(files["kit.json"])["source_w"], rel=1e-6))


def test_the_mesh_is_the_part_with_its_normals(small_run, files):
    read = trimesh.load_mesh(io.BytesIO(files["lens.obj"]), file_type="obj", process=False, maintain_order=True)
    body = trimesh.Trimesh(read.vertices, read.faces, process=False)
    body.merge_vertices(merge_norm=True)
    whole = trimesh.Trimesh(*parse_stl(small_run.part.stl), process=False)
    assert body.is_watertight and body.volume == pytest.approx(whole.volume, rel=1e-6)
    lines = [line.split() for line in files["lens.obj"].decode().splitlines()]
    places, normals = (np.array([row[1:] for row in lines if row[0] == kind], dtype=float) for kind in ("v", "vn"))
    radius = np.linalg.norm(places, axis=1)
    outer = small_run.lens.outer
    on_outer = (places[:, 2] > 0.5) & (np.abs(outer.radius(places / radius[:, None]) - radius) < 1e-4)
    exact = outer.normal(places[on_outer] / radius[on_outer, None])
    assert on_outer.sum() > 100 and np.median(np.linalg.norm(normals[on_outer] - exact, axis=1)) < 2e-3


def fresnel(index, cosine, cosine_behind):
    """Transmittance of both polarisations, from the air or, by symmetry, into it."""
    across = ((cosine - index * cosine_behind) / (cosine + index * cosine_behind)) ** 2
    along = ((index * cosine - cosine_behind) / (index * cosine + cosine_behind)) ** 2
    return 1.0 - across, 1.0 - along


@pytest.mark.parametrize("degrees", [0.0, 35.0, 56.3099325, 80.0])  # Brewster's angle of 1.5
def test_transmittance_is_that_of_fresnel(degrees):
    angle = np.radians(degrees)
    behind = np.arcsin(np.sin(angle) / 1.5)
    before = np.array([[np.sin(angle), 0.0, np.cos(angle)]])
    refracted = np.array([[np.sin(behind), 0.0, np.cos(behind)]])
    wanted = np.mean(fresnel(1.5, np.cos(angle), np.cos(behind)))
    assert transmittance(before, refracted, 1.0 / 1.5) == pytest.approx(wanted, rel=1e-12)
    assert transmittance(refracted, before, 1.5) == pytest.approx(wanted, rel=1e-12)


def test_light_without_polarisation_is_less_by_the_product_of_both_differences():
    """Rays in one plane through spheres: each loses half of (Ts - Tp) at one face times half of it at the other."""
    lens = Lens.double(sphere(3.0), sphere(6.0), small_spec(lens__refractive_index=1.5), 0, "draft")
    starts = np.array([[2.4, 0.0, 0.0], [-2.0, 0.0, 0.0], [2.6, 0.0, 0.0]])
    along = np.array([[0.6, 0.0, 0.8], [0.28, 0.0, 0.96], [-0.8, 0.0, 0.6]])
    change = 0.0
    for start, way in zip(starts, along, strict=True):
        differences = []
        for radius, index, inverted in ((3.0, 1.5, False), (6.0, 1.5, True)):
            ahead = start @ way
            point = start + (np.sqrt(ahead**2 + radius**2 - start @ start) - ahead) * way
            sine = np.linalg.norm(np.cross(way, point / radius))
            other = sine * index if inverted else sine / index
            outside, inside = (other, sine) if inverted else (sine, other)
            across, parallel = fresnel(index, np.sqrt(1.0 - outside**2), np.sqrt(1.0 - inside**2))
            differences.append(across - parallel)
            turn = np.arcsin(other) - np.arcsin(sine)
            sense = np.sign(np.cross(way, point)[1])
            cosine, sine_turn = np.cos(sense * turn), np.sin(sense * turn)
            turned = [cosine * way[0] - sine_turn * way[2], 0.0, sine_turn * way[0] + cosine * way[2]]
            start, way = point, np.array(turned)
        change -= differences[0] * differences[1] / 4.0 / len(starts)
    screen = Screen.square(100.0, 1e6, 16)
    share = less_polarisation(
        Metric(value=0.9, unit="", standard_error=0.003), lens, screen, RayBundle(starts, along, np.ones(3))
    )
    assert share.value - 0.9 == pytest.approx(change, rel=2e-3) and change < -1e-4
    assert share.standard_error > 0.003


def kit_figures_in(folder, screen, kind):
    """The module that the programs of a kit share, with the detector of ``screen``."""
    detector = {
        "kind": kind, "centre_mm": list(screen.centre_mm), "axes": screen.axes.tolist(), "width": screen.width,
        "height": screen.height, "window": list(screen.window),
    }  # fmt: skip
    (folder / "kit.json").write_text(json.dumps({"detector": detector, "zone_shares": np.zeros((4, 8)).tolist()}))
    (folder / "kit_figures.py").write_bytes((SCRIPTS / "kit_figures.py").read_bytes())
    spec = importlib.util.spec_from_file_location("kit_figures", folder / "kit_figures.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.mark.parametrize("kind", ["plane", "far_field"])
def test_rays_land_where_the_proof_has_them(kind, tmp_path):
    screens = {"plane": PlaneScreen, "far_field": FarFieldScreen}
    size = {"plane": (90.0, 60.0, (70.0, 50.0, 40.0)), "far_field": (1.4, 1.0, (None, None, 0.45))}[kind]
    where = ((12.0, -7.0, 80.0), (0.3, -0.2, 0.9), 25.0)
    screen = screens[kind](*where, size[0], size[1], 8, 4, size[2], 0.0)
    random = np.random.default_rng(5)
    points = random.normal(size=(4000, 3))
    along = random.normal(size=(4000, 3))
    along[:, 2] = np.abs(along[:, 2])
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    module = kit_figures_in(tmp_path, screen, kind)
    places = module.landings(points, along)
    wanted = screen.land(points, along)
    np.testing.assert_allclose(places, wanted, atol=1e-9)
    share, zones = module.shares(places, len(points))
    assert share == screen.in_window(wanted).mean() and 0.01 < share < 0.9
    np.testing.assert_allclose(zones, screen._sums(wanted, np.full(4000, 1.0 / 4000)), atol=1e-12)


@pytest.mark.parametrize(
    ("section", "phrase"),
    [
        ({"lens__outer": {"offset_mm": 6.0, "scatter": {"kind": "gaussian", "sigma_deg": 5.0}}}, "faces that scatter"),
        ({"lamps": {"kind": "grid", "columns": 2, "rows": 1, "pitch_mm": 40.0}}, "several lamps"),
        ({"lens__refractive_index": 1.49, "lens__abbe_number": 57.0}, "a material with dispersion"),
    ],
)
def test_what_the_programs_cannot_repeat_is_refused(section, phrase, small_run):
    spec = small_spec(**section)
    lens = Lens.double(sphere(3.0), sphere(6.0), spec, 0, "draft")
    with pytest.raises(InputError, match=f"has {phrase}; a kit is of one lens"):
        kit_files(Results(lens, small_run.found), 1024)


@pytest.mark.nightly("programs of their own trace 65536 rays: a minute")
@pytest.mark.parametrize(("program", "library"), [("mitsuba_check", "mitsuba"), ("radiance_check", "pyradiance")])
@pytest.mark.parametrize("index_error", [0.0, 0.03])
def test_another_program_finds_the_same_light_and_another_index_is_seen(
    small_run, program, library, index_error, tmp_path
):
    if find_spec(library) is None:
        pytest.skip(f"needs {library}")
    for name, content in kit_files(small_run, 2**16).items():
        (tmp_path / name).write_bytes(content)
    kit = json.loads((tmp_path / "kit.json").read_text())
    (tmp_path / "kit.json").write_text(json.dumps({**kit, "refractive_index": kit["refractive_index"] + index_error}))
    done = subprocess.run([sys.executable, f"{program}.py"], cwd=tmp_path, capture_output=True, text=True, timeout=600)
    assert done.returncode == (1 if index_error else 0), done.stdout + done.stderr


@pytest.mark.parametrize("name", ["opticstudio_check.py", "speos_check.py"])
def test_programs_that_nobody_ran_say_so_first(files, name):
    assert files[name].startswith(b"# Not run by us: ")
    compile(files[name], name, "exec")


KIT_OF_NUMBERS = {
    "name": "crooked", "refractive_index": 1.37, "absorption_per_mm": 0.02, "wavelength_nm": 620.0, "source_w": 1.7,
    "expected": {"efficiency": {"value": 0.8, "standard_error": 0.001}}, "zone_shares": [[0.0]],
}  # fmt: skip
TURNED = [[0.0, 1.0, 0.0], [-0.6, 0.0, 0.8], [0.8, 0.0, 0.6]]


def program(name, libraries, folder, monkeypatch, absorption=0.02, axes=TURNED):
    """A program of a kit, not yet run, with stand-ins for the ``libraries`` that are not here."""
    detector = {"kind": "plane", "centre_mm": [12.0, -7.0, 80.0], "axes": axes, "width": 90.0, "height": 60.0}
    kit = KIT_OF_NUMBERS | {"absorption_per_mm": absorption, "detector": {**detector, "window": [70.0, None, None]}}
    (folder / "kit.json").write_text(json.dumps(kit))
    (folder / "lens.obj").write_text("v 1 2 3\nv 4 5 6\nv 7 8 9\nvn 0 0 1\nf 1//1 3//1 2//1\n")
    np.save(folder / "source.npy", np.zeros((321, 6)))
    for library in libraries:
        monkeypatch.setitem(sys.modules, library, MagicMock())
    monkeypatch.delitem(sys.modules, "kit_figures", raising=False)
    for script in ("kit_figures.py", name):
        (folder / script).write_bytes((SCRIPTS / script).read_bytes())
    monkeypatch.syspath_prepend(folder)
    spec = importlib.util.spec_from_file_location(name.removesuffix(".py"), folder / name)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    monkeypatch.delitem(sys.modules, "kit_figures")
    return module


SPEOS = [f"ansys.speos.core{part}" for part in ("", ".launcher", ".sensor", ".simulation", ".source")]


def test_the_scene_of_speos_is_that_of_the_kit(tmp_path, monkeypatch, capsys):
    module = program("speos_check.py", ["ansys", "ansys.speos", *SPEOS], tmp_path, monkeypatch)
    module.Project.return_value.create_simulation.return_value.compute_CPU.return_value = ("done",)
    assert module.main() == 0
    project = module.Project.return_value
    optic = project.create_optical_property.return_value.set_volume_optic.return_value
    assert (optic.index, optic.absorption) == (1.37, 0.02)
    face = project.create_root_part.return_value.create_body.return_value.create_face.return_value
    assert (face.vertices, face.normals, face.facets) == ([*map(float, range(1, 10))], [0.0, 0.0, 1.0], [0, 2, 1])
    sensor = project.create_sensor.return_value
    assert sensor.axis_system == [12.0, -7.0, 80.0, *np.ravel(TURNED)]
    size = sensor.set_dimensions.return_value
    assert (size.x_start, size.x_end, size.y_start, size.y_end) == (-35.0, 35.0, -30.0, 30.0)
    assert project.create_simulation.return_value.stop_condition_rays_number == 321
    assert project.create_source.return_value.ray_file_uri == tmp_path / "source.ray"
    assert "0.80000 of 1.7 W, that is 1.36000 W on the sensor" in capsys.readouterr().out


def test_the_scene_of_opticstudio_is_that_of_the_kit(tmp_path, monkeypatch, capsys):
    module = program("opticstudio_check.py", ["zospy"], tmp_path, monkeypatch, 0.0, np.eye(3).tolist())
    system = module.zp.ZOS.return_value.connect.return_value
    module.zp.ZOS.return_value.Application.ObjectsDir = str(tmp_path)
    for folder, file in (("CAD Files", "lens.step"), ("Sources/Source Files", "source.dat")):
        (tmp_path / folder).mkdir(parents=True)
        (tmp_path / file).write_bytes(file.encode())
    objects = {number: MagicMock() for number in (1, 2, 3)}
    system.NCE.GetObjectAt.side_effect = objects.get
    system.NCE.GetDetectorData.return_value = (True, 1.36)
    assert module.main() == 0
    assert system.SystemData.Wavelengths.GetWavelength.return_value.Wavelength == pytest.approx(0.62)
    assert objects[1].ObjectData.NumberOfAnalysisRays == 321
    material = objects[2].MaterialCell.CreateSolveType.return_value
    assert material._S_MaterialModel.IndexNd == 1.37
    assert objects[2].MaterialCell.SetSolveData.call_args.args == (material,)
    detector = objects[3]
    assert (detector.XPosition, detector.YPosition, detector.ZPosition) == (12.0, -7.0, 80.0)
    assert (detector.ObjectData.XHalfWidth, detector.ObjectData.YHalfWidth) == (35.0, 30.0)
    assert (tmp_path / "CAD Files" / "lensforge_lens.step").read_bytes() == b"lens.step"
    assert (tmp_path / "Sources" / "Source Files" / "lensforge_source.dat").read_bytes() == b"source.dat"
    output = capsys.readouterr().out
    assert "share of the light: 0.80000; expected 0.80000" in output and f"{np.sqrt(0.16 / 321):.5f} of these" in output


@pytest.mark.parametrize(("absorption", "axes"), [(0.02, np.eye(3).tolist()), (0.0, TURNED)])
def test_what_the_program_of_opticstudio_cannot_repeat_ends_it(absorption, axes, tmp_path, monkeypatch):
    module = program("opticstudio_check.py", ["zospy"], tmp_path, monkeypatch, absorption, axes)
    with pytest.raises(SystemExit, match=r"level plane alone|absorbs"):
        module.main()
    module.zp.ZOS.assert_not_called()
