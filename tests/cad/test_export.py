import re

import numpy as np
import pytest
from geometry_lenses import ALL_LEVELS, PAPER_SCALES, exact_volume, make_lens
from nightly import first_by_day

from lensforge.cad.face_tolerance import FaceTolerance
from lensforge.cad.form_error import face_points
from lensforge.cad.part_export import build_part
from lensforge.cad.step import parse_surfaces
from lensforge.errors import InputError
from lensforge.surfaces.surface import to_sphere
from lensforge.version import __version__


def failed(part):
    return [criterion.key for criterion in part.criteria if not criterion.holds]


@pytest.mark.parametrize(
    ("inner", "outer"), first_by_day(0, PAPER_SCALES[::-1], "five seconds; by day random lenses of fewer functions")
)
def test_a_lens_of_the_paper_passes_every_criterion(inner, outer):
    lens = make_lens(inner, outer, 0.01, levels=ALL_LEVELS)
    part = build_part(lens)
    assert part.lens is lens
    assert (part.version, part.inputs) == (__version__, {"lens": lens.sha256})
    assert failed(part) == []
    assert len(part.criteria) == 8
    assert part.form_error_nm.max <= 1.0
    assert part.normal_error_mrad.max <= 0.02
    assert (part.watertight, part.genus) == (True, 0)
    assert part.volume_mm3 == pytest.approx(exact_volume(lens.inner, lens.outer, lens.spec.base), rel=2e-9)
    assert part.volume_mesh_mm3 == pytest.approx(part.volume_mm3, rel=2e-4)
    assert part.size.area_mm2 == pytest.approx(part.mesh.area, rel=2e-4)
    assert {"OPTICAL_INNER", "OPTICAL_OUTER"} < set(part.faces.names)
    assert set(part.files) == {"lens.step", "lens.stl", "lens.3mf"}
    assert len(part.step) <= 3_000_000


# By day bases of two widths, and two symmetries.
@pytest.mark.parametrize("seed", first_by_day(2, [1, 2, 0, *range(3, 10)]))
def test_random_lenses_are_valid_closed_and_watertight(seed):
    inner, outer = PAPER_SCALES[seed % 2]
    base = [{"kind": "none"}, {"diameter_mm": 2.0 * outer}, {"diameter_mm": 2.02 * outer}][seed % 3]
    symmetry = ["none", "mirror_x", "square"][seed % 3]
    part = build_part(make_lens(inner, outer, 0.02, seed, levels=(9, 25), symmetry=symmetry, base=base), rings=24)
    assert failed(part) == []
    assert part.genus == 0


def test_too_few_nodes_fail_the_form_criteria_without_raising():
    part = build_part(make_lens(0.8, 2.45, 0.02, levels=(9, 25, 81)), nodes=20, rings=16)
    assert {"form_error", "normal_error"} <= set(failed(part))
    assert part.watertight, "a wrong form is no hole: each criterion must see its own fault"


@pytest.fixture(scope="module")
def twice(tmp_path_factory):
    """One lens built twice, and the second time's folder, the current one and that of temporary files."""
    lens, folder = make_lens(0.8, 2.45, 0.01), tmp_path_factory.mktemp("empty")
    first = build_part(lens, rings=16, extension_deg=8.0)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("tempfile.tempdir", str(folder))
        patch.chdir(folder)
        return first, build_part(lens, rings=16, extension_deg=8.0), folder


def test_a_full_or_missing_temporary_folder_is_one_line(tmp_path, monkeypatch):
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path / "gone"))
    with pytest.raises(InputError, match=rf"^lens\.step: the temporary folder {re.escape(str(tmp_path))}.* TMPDIR"):
        build_part(make_lens(0.8, 2.45), rings=16)


def test_the_same_lens_gives_the_same_bytes_and_leaves_no_file(twice):
    first, second, folder = twice
    assert first.files == second.files
    assert set(first.files) == {"lens.step", "lens.stl", "lens.3mf", "lens_surfaces.step"}
    assert first.sha256 == second.sha256
    assert first == second.model_copy(update={"seconds": first.seconds})
    assert list(folder.iterdir()) == [], "no file is left behind"


def test_ap242_and_untrimmed_surfaces_on_request():
    lens = make_lens(0.8, 2.45, 0.01)
    part = build_part(lens, rings=16, schema="AP242", extension_deg=8.0)
    assert failed(part) == []
    for content in (part.step, part.surfaces_step):
        text = content.decode()
        assert "FILE_SCHEMA((\n'AP242_MANAGED_MODEL_BASED_3D_ENGINEERING" in text
        assert "LENGTH_UNIT() NAMED_UNIT(*) SI_UNIT(.MILLI.,.METRE.)" in text
    assert part.untrimmed_surfaces.form_error_nm < 1.0
    for name, face in parse_surfaces(part.surfaces_step).items():
        surface = lens.outer if name == "OPTICAL_OUTER" else lens.inner
        half = np.tan(np.deg2rad(98.0) / 2.0)
        edge = half * np.stack([[1.0, -1.0, 0.0, 0.0], [0.0, 0.0, 1.0, -1.0]], axis=-1)
        points, _ = face_points(face, edge)
        radius = np.linalg.norm(points, axis=1)
        np.testing.assert_allclose(np.degrees(np.arcsin(points[:, 2] / radius)), -8.0, atol=1e-5)
        np.testing.assert_allclose(radius, surface.radius(to_sphere(edge)), atol=1e-4)


def test_untrimmed_faces_are_judged_as_those_of_the_part(twice):
    part = twice[0]
    judged = {criterion.key: criterion for criterion in part.criteria}
    assert judged["surfaces_form_error"].value == part.untrimmed_surfaces.form_error_nm
    assert judged["surfaces_normal_error"].value == part.untrimmed_surfaces.normal_error_mrad
    coarse = build_part(part.lens, rings=16, extension_deg=8.0, nodes=24, tolerance=FaceTolerance(form_nm=1e-4))
    assert {"form_error", "surfaces_form_error"} <= set(failed(coarse))


def test_a_mesh_has_at_least_the_rings_that_light_asks_for():
    parts = [build_part(make_lens(0.8, 2.45), least_rings=least) for least in (5, 97)]
    assert parts[0].triangulation.rings < 97 == parts[1].triangulation.rings
    assert len(parts[1].stl) > len(parts[0].stl)


@pytest.mark.parametrize("extension_deg", [0.0, -3.0, 45.0])
def test_an_extension_out_of_range_is_refused(extension_deg):
    with pytest.raises(InputError, match=f"extension = {extension_deg:g} degrees"):
        build_part(make_lens(0.8, 2.45), rings=16, extension_deg=extension_deg)


@pytest.mark.parametrize("knob", [{"rings": 0}, {"rings": 5000}, {"nodes": 3}, {"nodes": 10_000}])
def test_knobs_out_of_range_are_refused_by_name(knob):
    with pytest.raises(InputError, match=f"{next(iter(knob))} = {next(iter(knob.values()))}: from"):
        build_part(make_lens(0.8, 2.45), **knob)
