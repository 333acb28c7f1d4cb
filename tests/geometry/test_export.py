import hashlib
import json
import re
import subprocess
import sys

import numpy as np
import pytest
from geometry_lenses import ALL_LEVELS, PAPER_SCALES, exact_volume, make_lens

from lensforge.errors import InputError
from lensforge.geometry import MeshTolerance, export_lens
from lensforge.geometry.form import face_points
from lensforge.geometry.step import read_surfaces
from lensforge.surfaces.chart import to_sphere

KEYS = {
    "form_error_nm",
    "normal_error_mrad",
    "volume_mm3",
    "volume_mesh_mm3",
    "watertight",
    "genus",
    "faces",
    "nodes",
    "step_schema",
    "untrimmed_surfaces",
    "mesh",
    "files",
    "seconds",
    "gates",
}


def failed(result):
    return [gate["name"] for gate in result["gates"] if not gate["passed"]]


@pytest.mark.parametrize(("inner", "outer"), PAPER_SCALES)
def test_a_lens_of_the_paper_passes_every_gate(tmp_path, inner, outer):
    lens = make_lens(inner, outer, 0.01, levels=ALL_LEVELS)
    result = export_lens(lens, tmp_path)
    assert set(result) == KEYS
    assert json.loads((tmp_path / "export.json").read_text(encoding="utf-8")) == result
    assert failed(result) == []
    assert result["form_error_nm"]["max"] <= 1.0
    assert result["normal_error_mrad"]["max"] <= 0.02
    assert (result["watertight"], result["genus"]) == (True, 0)
    assert result["volume_mm3"] == pytest.approx(exact_volume(lens.inner, lens.outer, lens.spec.base), rel=2e-9)
    assert result["volume_mesh_mm3"] == pytest.approx(result["volume_mm3"], rel=2e-4)
    assert {"OPTICAL_INNER", "OPTICAL_OUTER"} < set(result["faces"]["names"])
    for name, figures in result["files"].items():
        content = (tmp_path / name).read_bytes()
        assert figures == {"bytes": len(content), "sha256": hashlib.sha256(content).hexdigest()}
    assert result["files"]["lens.step"]["bytes"] <= 3_000_000


@pytest.mark.parametrize("seed", range(10))
def test_random_lenses_are_valid_closed_and_watertight(tmp_path, seed):
    inner, outer = PAPER_SCALES[seed % 2]
    base = [{"kind": "none"}, {"diameter_mm": 2.0 * outer}, {"diameter_mm": 2.02 * outer}][seed % 3]
    symmetry = ["none", "mirror_x", "square"][seed % 3]
    lens = make_lens(inner, outer, 0.02, seed, levels=(9, 25), symmetry=symmetry, base=base)
    result = export_lens(lens, tmp_path, rings=24)
    assert failed(result) == []
    assert result["genus"] == 0


def test_too_few_nodes_fail_the_form_gates_without_raising(tmp_path):
    result = export_lens(make_lens(0.8, 2.45, 0.02, levels=(9, 25, 81)), tmp_path, nodes=20, rings=16)
    assert {"form_error", "normal_error"} <= set(failed(result))
    for gate in result["gates"][:2]:
        assert re.search(r"at \(.+, .+, .+\) mm", gate["remedy"]), "it names the place"
    assert result["watertight"], "a wrong form is no hole: each gate must see its own fault"


def test_rings_and_tolerance_are_knobs(tmp_path):
    lens = make_lens(0.8, 2.45)
    assert export_lens(lens, tmp_path, rings=20)["mesh"]["rings"] == 20
    mesh = export_lens(lens, tmp_path, tolerance=MeshTolerance(chord_mm=1e-3, normal_rad=5e-3))["mesh"]
    assert mesh["rings"] >= 96
    assert mesh["normal_error_mrad"] <= 5.0


def test_bad_input_leaves_earlier_files_alone(tmp_path):
    export_lens(make_lens(0.8, 2.45), tmp_path, rings=16)
    before = {path.name: path.read_bytes() for path in tmp_path.iterdir()}
    with pytest.raises(InputError, match=r"base\.diameter_mm"):
        export_lens(make_lens(0.8, 2.45, base={"diameter_mm": 1.0}), tmp_path)
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == before


def test_the_same_lens_gives_the_same_bytes(tmp_path):
    lens = make_lens(0.8, 2.45, 0.01)
    first, second = (export_lens(lens, tmp_path / name, rings=16, runout_deg=5.0)["files"] for name in "ab")
    assert first == second
    assert set(first) == {"lens.step", "lens.stl", "lens.3mf", "lens_surfaces.step"}


def test_ap242_and_untrimmed_surfaces_on_request(tmp_path):
    lens = make_lens(0.8, 2.45, 0.01)
    result = export_lens(lens, tmp_path, rings=16, schema="AP242", runout_deg=8.0)
    assert failed(result) == []
    for name in ("lens.step", "lens_surfaces.step"):
        text = (tmp_path / name).read_text(encoding="utf-8")
        assert "FILE_SCHEMA((\n'AP242_MANAGED_MODEL_BASED_3D_ENGINEERING" in text
        assert "LENGTH_UNIT() NAMED_UNIT(*) SI_UNIT(.MILLI.,.METRE.)" in text
    assert result["untrimmed_surfaces"]["form_error_nm"] < 1.0
    for name, face in read_surfaces(tmp_path / "lens_surfaces.step").items():
        surface = lens.outer if name == "OPTICAL_OUTER" else lens.inner
        half = np.tan(np.deg2rad(98.0) / 2.0)
        edge = half * np.stack([[1.0, -1.0, 0.0, 0.0], [0.0, 0.0, 1.0, -1.0]], axis=-1)
        points, _ = face_points(face, edge)
        radius = np.linalg.norm(points, axis=1)
        np.testing.assert_allclose(np.degrees(np.arcsin(points[:, 2] / radius)), -8.0, atol=1e-9)
        np.testing.assert_allclose(radius, surface.radius(to_sphere(edge)), atol=1e-8)


@pytest.mark.parametrize("runout_deg", [0.0, -3.0, 45.0])
def test_a_runout_out_of_range_is_refused(tmp_path, runout_deg):
    with pytest.raises(InputError, match=f"run-out = {runout_deg:g} degrees"):
        export_lens(make_lens(0.8, 2.45), tmp_path, rings=16, runout_deg=runout_deg)


@pytest.mark.parametrize("knob", [{"rings": 0}, {"rings": 5000}, {"nodes": 3}, {"nodes": 10_000}])
def test_knobs_out_of_range_are_refused_by_name(tmp_path, knob):
    with pytest.raises(InputError, match=f"{next(iter(knob))} = {next(iter(knob.values()))}: from"):
        export_lens(make_lens(0.8, 2.45), tmp_path, **knob)


def test_importing_the_stage_loads_neither_torch_nor_cad():
    program = (
        "import pkgutil, sys, importlib, lensforge.geometry as g\n"
        "[importlib.import_module(m.name) for m in pkgutil.walk_packages(g.__path__, g.__name__ + '.')]\n"
        "print(sorted({'torch', 'cadquery', 'OCP', 'trimesh', 'manifold3d', 'lib3mf'} & set(sys.modules)))"
    )
    run = subprocess.run([sys.executable, "-c", program], capture_output=True, encoding="utf-8", check=True)
    assert run.stdout.strip() == "[]"
