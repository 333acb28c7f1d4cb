"""Faces that are given in several ways, against one another and against the surfaces that were given."""

from pathlib import Path

import cadquery as cq
import numpy as np
import pytest
from cad_shapes import ball, in_inches, shell, write
from nightly import NIGHTLY, first_by_day
from scenes import hemisphere_directions, random_surface, small_spec
from tir_lenses import spot, spot_lens

import lensforge as lf
from lensforge.cad.form_error import fit_to_form, form_error
from lensforge.errors import InputError
from lensforge.scene.lens import Lens
from lensforge.spec import LensSection
from lensforge.spec.fixed_surface import FixedCadFace, FixedLensFace, FixedPoints, FixedSphere, GivenSurface
from lensforge.surfaces.asphere import sphere
from lensforge.surfaces.cad_sampling import FaceCast
from lensforge.surfaces.chart_spline import ChartSpline
from lensforge.surfaces.srbf import fibonacci_hemisphere
from lensforge.surfaces.surface import Surface, surface_record, to_chart

RADIUS = 3.0
CENTRE = 0.4
HERE = pytest.mark.usefixtures("cad_read_here")
U = np.concatenate([hemisphere_directions(3000), [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]])


def differences(copy: Surface, given: Surface) -> tuple[float, float]:
    """Largest distance (nm) and angle between normals (urad)."""
    distance = np.abs(copy.radius(U) - given.radius(U)).max() * 1e6
    return float(distance), float(np.linalg.norm(np.cross(copy.normal(U), given.normal(U)), axis=1).max() * 1e6)


@pytest.fixture(scope="module")
def step(tmp_path_factory: pytest.TempPathFactory) -> Path:
    made = shell(ball(RADIUS, CENTRE), ball(6.0))
    return write(made, tmp_path_factory.mktemp("cad") / "mould.step")


def test_a_sphere_given_in_three_ways_is_one_lens(step: Path, tmp_path: Path) -> None:
    exact = sphere(RADIUS, CENTRE)
    directions = 2.0 * fibonacci_hemisphere(20_000) - [0.0, 0.0, 0.6]  # down to 20 degrees below the rim
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    axial = CENTRE * directions[:, 2]
    distance = axial + np.sqrt(axial**2 + RADIUS**2 - CENTRE**2)
    np.savetxt(tmp_path / "cloud.txt", directions * distance[:, None], fmt="%.12g")
    ways = {
        "kind": FixedSphere(radius_mm=RADIUS, centre_z_mm=CENTRE),
        "points": FixedPoints(file=tmp_path / "cloud.txt").resolved(),
    }
    if NIGHTLY:  # five seconds; by day the moved sphere of another file
        ways["step"] = FixedCadFace(file=step, face="first").resolved()
    for name, way in ways.items():
        nm, urad = differences(way.surface, exact)
        assert nm < 1.0 and urad < 1.0, name


@pytest.mark.parametrize("coordinates", first_by_day(1, ["cartesian", "polar"]))
def test_points_are_moved_by_their_shift(coordinates: str, tmp_path: Path) -> None:
    """Points on a sphere whose centre is off in three directions, measured about another origin."""
    shift = np.array([0.3, -0.2, 0.5])
    u = 2.0 * fibonacci_hemisphere(8000) - [0.0, 0.0, 0.8]
    u /= np.linalg.norm(u, axis=1, keepdims=True)
    rows = RADIUS * u  # about the sphere's own centre
    if coordinates == "polar":
        turn = np.degrees([np.arccos(u[:, 2]), np.arctan2(u[:, 1], u[:, 0])])
        rows = np.column_stack([*turn, np.full(len(u), RADIUS)])
    np.savetxt(tmp_path / "cloud.txt", rows, fmt="%.12g")
    given = FixedPoints(file=tmp_path / "cloud.txt", coordinates=coordinates, shift_mm=tuple(shift)).resolved()
    points = U * given.surface.radius(U)[:, None]
    assert np.abs(np.linalg.norm(points - shift, axis=1) - RADIUS).max() < 1e-5


def test_every_face_of_a_lens_for_total_reflection_may_be_given(tmp_path: Path) -> None:
    lens = spot_lens()
    lens.save(tmp_path / "lens.json")
    for name, surface in lens.surfaces.items():
        spec = spot(**{name: {"fixed": {"kind": "lens", "file": str(tmp_path), "face": name}}})
        begun = spot_lens(spec)
        assert np.array_equal(begun.surfaces[name].radius(U), surface.radius(U)), "the search does not change it"
        begun.save(tmp_path / "again.json")
        assert lf.load_lens(tmp_path / "again.json").surfaces[name].radius(U) == pytest.approx(
            surface.radius(U), rel=0.0
        )
    with pytest.raises(
        InputError, match=r"lens\.exit\.fixed.*the faces of this lens are cap, side, wall, exit; give one"
    ):
        spot(exit={"fixed": {"kind": "lens", "file": str(tmp_path), "face": "outer"}})


def test_a_lens_file_that_was_changed_is_no_given_face(tmp_path: Path) -> None:
    lens = Lens.double(random_surface(1, 3.0), random_surface(2, 6.0), small_spec(), 0, "draft")
    lens.save(tmp_path / "lens.json")
    text = (tmp_path / "lens.json").read_text(encoding="utf-8")
    assert text.count('"cavity_height_mm": 0.5') == 1
    changed = text.replace('"cavity_height_mm": 0.5', '"cavity_height_mm": 0.6')
    (tmp_path / "lens.json").write_text(changed, encoding="utf-8")
    with pytest.raises(InputError, match=r"lens\.json: .*name the folder of a result, or its lens\.json"):
        FixedLensFace(file=tmp_path, face="inner").resolved()


@pytest.mark.parametrize(("nm", "urad"), [(1.0, 20.0), (1.2, 3.0), (0.2, 25.0)])
def test_a_face_that_is_met_worse_than_an_exported_one_says_so_by_either_error(nm: float, urad: float) -> None:
    face = GivenSurface(
        origin="cap.stp", face=surface_record(sphere(3.0)), unit="inches", form_error_nm=nm, normal_error_urad=urad
    )
    unit, *further = face.warnings
    assert unit == "cap.stp: in inches, converted to mm"
    assert len(further) == (nm > 1.0 or urad > 20.0)
    assert all(warning.startswith(f"cap.stp: met to {nm:g} nm and {urad:g} µrad; ") for warning in further)


@pytest.mark.nightly("five seconds; by day a base in inches")
@HERE
def test_a_file_in_inches_is_converted_and_says_so(step: Path, tmp_path: Path) -> None:
    given = FixedCadFace(file=in_inches(step, tmp_path / "inches.step")).resolved()
    assert given.unit == "inches" and "in inches, converted to mm" in given.warnings[0]
    nm, urad = differences(given.surface, sphere(25.4 * RADIUS, 25.4 * CENTRE))
    assert nm < 25.4 and urad < 1.0


@HERE
def test_a_face_of_a_file_is_moved_by_its_shift(tmp_path: Path) -> None:
    """A sphere whose file lies beside the lens's axes in all three directions."""
    beside = write(shell(ball(RADIUS, CENTRE), ball(6.0)).moved(cq.Location((0.1, -0.3, -7.0))), tmp_path / "low.step")
    nm, urad = differences(FixedCadFace(file=beside, shift_mm=(-0.1, 0.3, 7.0)).surface, sphere(RADIUS, CENTRE))
    assert nm < 1.0 and urad < 1.0


@HERE
@pytest.mark.nightly("another reader of the same kernel")
def test_iges(tmp_path: Path) -> None:
    iges = write(shell(ball(RADIUS, CENTRE), ball(6.0)), tmp_path / "mould.igs")
    nm, urad = differences(FixedCadFace(file=iges).surface, sphere(RADIUS, CENTRE))
    assert nm < 1.0 and urad < 1.0


def test_the_face_of_a_lens_is_that_face(tmp_path: Path) -> None:
    lens = Lens.double(random_surface(1, 3.0, levels=(9, 25)), sphere(6.0), small_spec(), 0, "draft")
    lens.save(tmp_path / "lens.json")
    given = FixedLensFace(file=tmp_path, face="inner").resolved()
    assert np.array_equal(given.surface.radius(U), lens.inner.radius(U))
    assert FixedLensFace(file=tmp_path / "lens.json", face="outer").surface == lens.outer
    assert given.title == f"inner face of {tmp_path.name}/lens.json"
    with pytest.raises(InputError, match=r"face = 'exit': the faces of this lens are inner, outer; give one of them"):
        FixedLensFace(file=tmp_path, face="exit").resolved()
    face = {"kind": "lens", "file": str(tmp_path), "face": "inner"}
    spec = small_spec(lens={"levels": [9, 25], "inner": {"fixed": face}, "outer": {"offset_mm": 6.0}})
    changed = spec.replace(name="other")
    changed.save(tmp_path / "spec.toml")
    assert lf.load_spec(tmp_path / "spec.toml") == changed and changed.lens == spec.lens
    assert isinstance(changed.lens.inner.fixed, GivenSurface)
    assert np.array_equal(changed.lens.inner.fixed.surface.radius(U), lens.inner.radius(U))


def test_a_wave_has_the_same_detail_along_both_axes() -> None:
    axis = np.linspace(-1.2, 1.2, 41)
    wave = np.broadcast_to(3.0 + 0.1 * np.sin(9.0 * axis), (41, 41))
    along_y, along_x = (ChartSpline.through(axis, grid).detail for grid in (wave, wave.T))
    assert along_x == pytest.approx(along_y, rel=1e-6) and 0.2 < along_x < 0.4


@HERE
def test_a_spec_needs_the_file_no_more(step: Path, tmp_path: Path) -> None:
    section = LensSection(levels=(9, 25), inner={"fixed": {"kind": "cad", "file": step}}, outer={"offset_mm": 6.0})
    assert isinstance(section.inner.fixed, GivenSurface)
    away = step.rename(tmp_path / "elsewhere")  # and back, for the other tests, which have sampled it already
    again = LensSection.model_validate_json(section.model_dump_json())
    away.rename(step)
    assert again == section and again.start_mm == pytest.approx({"inner": 3.4, "outer": 6.0}, abs=1e-9)
    assert "of mould.step, to" in section.inner.fixed.title


@pytest.mark.nightly("ten seconds; by day a sphere of a file to a nanometre")
@HERE
def test_the_exported_face_is_the_given_one_to_a_nanometre(tmp_path: Path) -> None:
    """A freeform face written as STEP, given back, and exported again."""
    from lensforge.cad.solid import untrimmed_faces

    surface = random_surface(4, 3.0, levels=(9, 25))
    face = untrimmed_faces({"OPTICAL_INNER": fit_to_form(surface)})["OPTICAL_INNER"]
    given = FixedCadFace(file=write(cq.Face(face), tmp_path / "face.step")).resolved()
    patch = fit_to_form(given.surface)
    chart = to_chart(U)
    error = form_error(surface, patch.points(chart), patch.normals(chart))
    assert error.form_max_nm < 1.0 and error.normal_max_mrad < 0.02
    assert given.form_error_nm < 1.0


def pierced() -> cq.Shape:
    hole = cq.Workplane("XZ").center(0.0, 2.0).circle(0.3).extrude(-10.0).val()
    return shell(ball(RADIUS, CENTRE), ball(6.0)).cut(hole)


def test_steps_from_a_ray_beside_find_no_point_in_a_hole() -> None:
    """Rays near the axis have met the face; those through the hole, 0.3 mm about (0, 2) in x and z, meet none."""
    sphere_alone = cq.Workplane(pierced()).faces("%SPHERE").vals()
    cast = FaceCast([min(sphere_alone, key=lambda face: face.Area()).wrapped], np.zeros(3))
    cast.begin_at(np.array([[0.0, 0.5, 0.87], [0.0, 0.9, 0.1]]))
    distances, _ = cast.points(np.array([[0.0, 2.2, 2.0], [0.6, 2.2, 2.0]]))
    assert np.isnan(distances[0]) and distances[1] > 2.9


def cone() -> cq.Shape:
    """A cavity with an edge all around, halfway up."""
    cavity = cq.Workplane("XZ").polyline([(0.0, 0.0), (3.0, 0.0), (2.8, 1.5), (0.0, 3.0)]).close().revolve(360.0).val()
    above = cq.Workplane("XY").box(200.0, 200.0, 100.0, centered=(True, True, False)).val()
    return ball(6.0).intersect(above).cut(cavity.rotate((0, 0, 0), (1, 0, 0), 0.0))


@HERE
@pytest.mark.parametrize(
    ("shape", "face", "message"),
    [
        (lambda: shell(ball(RADIUS, CENTRE), ball(6.0)), "OPTICAL", "no such face; its faces have no names; give a nu"),
        (lambda: shell(ball(RADIUS, CENTRE), ball(6.0)), 9, "face = 9: it has faces 1 to 3"),
        (pierced, "first", r"degrees from the axis at azimuth (8|9)\d degrees, does not meet it: a hole"),
        (lambda: ball(2.0, 5.0), "first", "meets it 2 times|does not meet it"),
        (cone, "first", "does not meet it: a hole, or its edge"),
        (lambda: ball(2.0, -5.0), "first", "the axis meets no face above z = 0"),
    ],
)
def test_a_cad_face_that_is_none_is_one_line(shape, face, message: str, tmp_path: Path) -> None:
    path = write(shape(), tmp_path / "part.step")
    with pytest.raises(InputError, match=message) as caught:
        FixedCadFace(file=path, face=face).resolved()
    assert "\n" not in str(caught.value) and "part.step" in str(caught.value)


@pytest.mark.nightly("two seconds; by day a cone")
@HERE
def test_several_faces_with_a_kink_between_them_are_refused_with_the_place(tmp_path: Path) -> None:
    path = write(cone(), tmp_path / "cone.step")
    faces = [k for k in range(1, 6) if _is_of_cavity(path, k)]
    with pytest.raises(InputError, match=r"not smooth \d+\.\d degrees from the axis .* misses it by"):
        FixedCadFace(file=path, face=tuple(faces)).resolved()


def _is_of_cavity(path: Path, number: int) -> bool:
    faces = cq.importers.importStep(str(path)).faces().vals()
    return number <= len(faces) and faces[number - 1].geomType() == "CONE"


@pytest.mark.parametrize(
    ("content", "message"),
    first_by_day(
        1,
        [(b"ISO-10303-21;\nnothing", "not readable as STEP"), (b"", "not readable as STEP|is empty")],
        "another process",
    ),
)
def test_what_is_no_step_file_is_one_line(content: bytes, message: str, tmp_path: Path) -> None:
    (tmp_path / "a.step").write_bytes(content)
    with pytest.raises(InputError, match=message):
        FixedCadFace(file=tmp_path / "a.step").resolved()


def test_other_files_and_open_clouds_are_one_line(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"must be one of .step, .stp, .iges, .igs"):
        FixedCadFace(file=tmp_path / "a.sldprt").resolved()
    u = fibonacci_hemisphere(3000)
    np.savetxt(tmp_path / "cap.txt", 3.0 * u[u[:, 2] > 0.3])
    with pytest.raises(InputError, match=r"no point within .* of the direction .* down to z = 0"):
        FixedPoints(file=tmp_path / "cap.txt").resolved()
    (tmp_path / "lens.json").write_text("{}")
    with pytest.raises(InputError, match="not a lens file"):
        FixedLensFace(file=tmp_path, face="inner").resolved()
    with pytest.raises(InputError, match=r"inner.fixed.*cap.txt"):
        LensSection(levels=(9,), inner={"fixed": {"kind": "points", "file": tmp_path / "cap.txt"}})
