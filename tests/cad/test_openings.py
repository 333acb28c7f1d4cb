"""A body with an opening: its solid and mesh against integrals, its section, and its casts against the design."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from presets import FEW
from scipy.integrate import quad

import lensforge as lf
from lensforge.cad.body_export import BuiltBody, build_body, prove
from lensforge.cad.mesh_files import stl_bytes
from lensforge.cad.section import body_outlines
from lensforge.cad.wall import thinnest_of
from lensforge.optics.face_roles import BODY, CAVITY, OUTSIDE
from lensforge.proof.part_mesh import read_part_mesh
from lensforge.proof.proof_inputs import optical_of
from lensforge.report.headline import task
from lensforge.scene.body import Body, Face
from lensforge.scene.lens import Lens
from lensforge.search.profiles import ProfileParameters
from lensforge.shop.check import check_lens
from lensforge.shop.dimensions import dimensions
from lensforge.spec import parse_spec
from lensforge.spec.tolerances_section import factors_of
from lensforge.surfaces.asphere import sphere
from lensforge.surfaces.reciprocal import ConicFace, PlaneFace

FOCAL = 2.0
HEIGHT = 8.0
REACH = 20.0


def cup_lens(**lens: Any) -> Lens:
    content = {
        "source": {"kind": "square", "side_mm": 1.0},
        "lens": {"kind": "reflector", "profile": 8, **lens},
        "constraints": {"max_radius_mm": 11.0},
        "target": {"kind": "disc", "diameter_deg": 40.0, "half_angle_deg": 80.0},
        "base": {"kind": "none"},
        "optimise": {"aim": "share"},
    }
    spec = parse_spec(content, "cup")
    return Lens(ProfileParameters.of(spec, 2.5).start_surfaces, spec, 0, FEW)


@pytest.fixture(scope="module")
def lens() -> Lens:
    fixed = {"kind": "focal_conic", "vertex_mm": FOCAL}
    return cup_lens(cup={"fixed": fixed}, mouth={"offset_mm": HEIGHT})


@pytest.fixture(scope="module")
def built(lens: Lens) -> BuiltBody:
    return build_body(lens.body)


@pytest.fixture(scope="module")
def files(built: BuiltBody) -> tuple[bytes, bytes, bytes]:
    return built.files("cup")


def enclosed(lens: Lens, name: str) -> float:
    """Volume (mm^3) within a face of revolution up to the mouth: sectors to the crease, and the cone above."""
    radius = lens.surfaces[name].radius

    def at(polar: float) -> float:
        return float(radius(np.array([[np.sin(polar), 0.0, np.cos(polar)]]))[0])

    low = 0.1
    high = 0.5 * np.pi
    for _ in range(60):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if at(middle) * np.cos(middle) > HEIGHT else (low, middle)
    sectors = quad(lambda polar: 2.0 * np.pi / 3.0 * at(polar) ** 3 * np.sin(polar), low, 0.5 * np.pi, epsabs=1e-10)[0]
    return float(sectors + np.pi / 3.0 * HEIGHT * (HEIGHT * np.tan(low)) ** 2)


def test_the_solid_is_a_ring_of_the_volume_between_its_faces(
    lens: Lens, built: BuiltBody, files: tuple[bytes, bytes, bytes]
) -> None:
    proof = prove(built, *files)
    wanted = enclosed(lens, "back") - enclosed(lens, "cup")
    paraboloid = 2.0 * np.pi * FOCAL * ((HEIGHT + FOCAL) ** 2 - FOCAL**2)  # between the planes z = 0 and the mouth
    assert enclosed(lens, "cup") == pytest.approx(paraboloid, rel=1e-9)
    assert proof.solid.valid and proof.solid.genus == 1 == proof.stl.genus == proof.threemf.genus
    assert proof.solid.volume_mm3 == pytest.approx(wanted, rel=3e-7)
    assert built.mesh.volume() == pytest.approx(wanted, rel=2e-5)
    assert proof.stl.watertight and proof.threemf.watertight
    assert max(error.form_max_nm for error in proof.form.values()) < 1.0
    assert set(proof.solid.faces) == {"MOUTH_RIM", "OPTICAL_BACK", "OPTICAL_CUP", "RIM"}
    rim, cup = (np.unique(built.mesh.part(name)) for name in ("MOUTH_RIM", "OPTICAL_CUP"))
    shared = built.mesh.vertices[np.intersect1d(rim, cup)]
    assert len(shared) > 100 and shared[:, 2] == pytest.approx(HEIGHT, abs=1e-6)
    assert np.hypot(shared[:, 0], shared[:, 1]) == pytest.approx(2.0 * np.sqrt(FOCAL * (HEIGHT + FOCAL)), abs=5e-5)


def test_facets_at_the_mouth_of_a_long_cup_have_the_normals_of_its_paraboloid() -> None:
    """A mouth that is 30 focal lengths from the LED: rings at even angles from it were 700 mrad off there."""
    focal = 0.4
    fixed = {"kind": "focal_conic", "vertex_mm": focal}
    lens = cup_lens(cup={"fixed": fixed}, mouth={"offset_mm": 25.0})
    part = read_part_mesh(stl_bytes(build_body(lens.body, rings=80).mesh), optical_of(lens.body, lens.events))
    across, height = np.hypot(*part.mesh.triangles_center[:, :2].T), part.mesh.triangles_center[:, 2]
    on_cup = np.flatnonzero((np.abs(across - 2.0 * np.sqrt(focal * (height + focal))) < 0.05) & (height < 24.99))
    points, normals = part.curved(on_cup, np.full((len(on_cup), 3), 1.0 / 3.0))
    exact = points * [1.0, 1.0, 0.0] - [0.0, 0.0, 2.0 * focal]
    sines = np.linalg.norm(np.cross(normals, exact), axis=1) / np.linalg.norm(exact, axis=1)
    assert np.count_nonzero(points[:, 2] > 24.0) > 50 and sines.max() < 0.01
    assert np.sqrt(np.mean(sines[points[:, 2] < 22.0] ** 2)) < 1e-4


def test_the_section_has_an_outline_on_each_side(lens: Lens) -> None:
    right, left = body_outlines(lens, 0.0)
    assert right[:, 0].min() == pytest.approx(2.0 * FOCAL, abs=1e-9) and np.allclose(left, right * [-1.0, 1.0])
    x, z = np.vstack([right, right[:1]]).T
    turned = np.pi * np.sum((x[:-1] ** 2 + x[:-1] * x[1:] + x[1:] ** 2) / 3.0 * np.diff(z))  # Pappus, by trapezia
    assert abs(turned) == pytest.approx(enclosed(lens, "back") - enclosed(lens, "cup"), rel=1e-4)


def test_the_wall_is_that_of_cup_and_back_and_the_drawing_has_no_apex(lens: Lens) -> None:
    wall = thinnest_of(lens)
    assert lens.spec.constraints.min_thickness_mm < wall.thickness_mm < 1.6
    assert np.hypot(*wall.cavity_mm[:2]) ** 2 == pytest.approx(4.0 * FOCAL * (wall.cavity_mm[2] + FOCAL), rel=1e-6)
    names = {dimension.name for dimension in dimensions(lens)}
    assert "overall length" in names and not {name for name in names if "apex" in name or "on the axis" in name}
    check = check_lens(lens)
    assert set(check.faces) == {"cup", "back"}
    slope = np.degrees(np.arctan2(np.sqrt(HEIGHT + FOCAL), np.sqrt(FOCAL)))  # of the paraboloid at its rim
    assert {edge.faces: edge.angle_deg for edge in check.edges}[("mouth", "cup")] == pytest.approx(
        180.0 - slope, abs=0.1
    )


@pytest.mark.nightly("eight seconds")
def test_a_freeform_cup_is_exported_too() -> None:
    lens = cup_lens(levels=[9])
    parameters = ProfileParameters.of(lens.spec, 2.5)
    weights, offsets = parameters.start()
    weights[parameters.profile :, 0] += 0.02
    weights[parameters.profile, 0] += 0.1
    moved = parameters.lens(weights, offsets, lens.spec, 0, FEW)
    built = build_body(moved.body, nodes=dict.fromkeys(moved.surfaces, 120), rings=48)
    assert built.solid.valid and built.solid.genus == 1
    assert built.mesh.volume() == pytest.approx(built.solid.volume_mm3, rel=1e-3)
    assert moved.surfaces["cup"].symmetry == moved.surfaces["back"].symmetry == "none"


CUP = Face("cup", ConicFace(REACH, 4.0, 1.0), CAVITY, BODY)
BACK = Face("back", ConicFace(REACH, 7.0, 1.0), BODY, OUTSIDE)
MOUTH = Face("mouth", PlaneFace(REACH, 8.0), CAVITY, OUTSIDE)


@pytest.mark.parametrize(
    ("faces", "message"),
    [
        ((CUP, MOUTH), "none bounds the body; the body is not closed"),
        ((BACK, MOUTH), "none bounds the cavity; the body is not closed"),
        ((BACK, CUP, replace(MOUTH, surface=sphere(3.0))), "cup: nowhere the nearest"),
        ((replace(CUP, surface=BACK.surface), replace(BACK, surface=CUP.surface), MOUTH), "must lie outside of cup"),
        ((CUP, BACK, MOUTH, replace(MOUTH, name="hatch", surface=PlaneFace(REACH, 8.0, (0.4, 0.0, 1.0)))), "hatch"),
    ],
)
def test_faces_that_make_no_body_are_refused_in_one_line(faces: tuple[Face, ...], message: str) -> None:
    with pytest.raises(lf.InputError, match=message) as caught:
        build_body(Body(faces))
    assert "\n" not in str(caught.value)


def test_its_words_are_those_of_a_reflector(lens: Lens) -> None:
    text = task(lens.spec)
    assert "reflector, metallised plastic, cup face fixed (focal conic)" in text and "n =" not in text
    assert {factor.name for factor in factors_of(lens.spec.part_tolerances)}.isdisjoint({"index", "back_form_um"})
