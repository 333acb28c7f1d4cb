"""The keep-out of a part: distances in closed form, what to change, and files that hold none."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import cadquery as cq
import numpy as np
import pytest
from geometry_lenses import make_lens
from keep_outs import ball, box, step_file
from presets import COARSE_SPLINES

from lensforge.cad import body_export
from lensforge.cad.body_export import BuiltBody
from lensforge.cad.form_error import fit_lens
from lensforge.cad.keep_out import FACET_MM, keep_out_distance, mesh_error_mm, read_keep_out
from lensforge.cad.mesh import build_mesh
from lensforge.cad.part import Part, part_facts
from lensforge.cad.part_export import build_part
from lensforge.cad.part_limits import KeepOutDistance, keep_out_remedy, mass_g
from lensforge.cad.plan import make_plan
from lensforge.errors import InputError
from lensforge.scene.lens import Lens
from lensforge.spec import BaseSection

INNER_MM, OUTER_MM = 0.8, 2.45
PROVE, PROOFS = body_export.prove, {}
HERE = pytest.mark.usefixtures("cad_read_here")


def part_with(path: Path, margin_mm: float = 0.1, **base: object) -> Part:
    """Two hemispheres, and the keep-out of a file."""
    plain = make_lens(INNER_MM, OUTER_MM, 0.0, base=base or {"kind": "none"})
    limits = {"constraints.keep_out": str(path), "constraints.keep_out_margin_mm": margin_mm}
    return built(Lens.double(plain.inner, plain.outer, plain.spec.replace(limits), 0, COARSE_SPLINES))


def built(lens: Lens) -> Part:
    """The part of two hemispheres, whose files are proved once for each base: they do not depend on the keep-out."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(body_export, "prove", _proved_once)
        return build_part(lens, rings=24)


def _proved_once(body: BuiltBody, *files: Any) -> Any:
    base = body.plan.base.model_dump_json()
    if base not in PROOFS:
        PROOFS[base] = PROVE(body, *files)
    return PROOFS[base]


def missed(part: Part) -> list[str]:
    return [str(criterion) for criterion in part.criteria if not criterion.holds]


@HERE
@pytest.mark.parametrize(
    ("shape", "distance_mm"),
    [
        (ball(0.3, (0.2, 0.0, 0.1)), INNER_MM - 0.3 - np.hypot(0.2, 0.1)),
        (box((0.6, 0.4, 0.5), (0.0, 0.0, 0.0)), INNER_MM - np.hypot(0.3, np.hypot(0.2, 0.25))),
    ],
    ids=["ball", "box"],
)
def test_the_distance_to_a_spherical_cavity_is_that_of_geometry(
    tmp_path: Path, shape: object, distance_mm: float
) -> None:
    part = part_with(step_file(tmp_path / "led.step", shape))
    clearance = part.keep_out
    assert clearance is not None
    assert clearance.distance_mm == pytest.approx(distance_mm, abs=clearance.error_mm)
    assert clearance.error_mm < 5e-3
    apart = np.linalg.norm(np.subtract(clearance.body_point_mm, clearance.keep_out_point_mm))
    assert apart == pytest.approx(clearance.distance_mm, abs=1e-9)
    assert np.linalg.norm(clearance.body_point_mm) == pytest.approx(INNER_MM, abs=0.01)
    assert missed(part) == []


def test_the_error_of_a_coarse_mesh_is_that_of_the_polygon_of_its_base() -> None:
    """A hexagon about R has sides at R cos(pi/6)."""
    base, none = BaseSection(diameter_mm=30.0), BaseSection(kind="none")
    assert mesh_error_mm(base, 1, 1e-3) == pytest.approx(15.0 * (1.0 - np.sqrt(0.75)) + FACET_MM)
    flange = base.model_copy(update={"flange_diameter_mm": 40.0})
    assert mesh_error_mm(flange, 1, 1e-3) == pytest.approx(20.0 * (1.0 - np.sqrt(0.75)) + FACET_MM)
    assert mesh_error_mm(none, 1, 1e-3) == 1e-3 + FACET_MM


@HERE
def test_a_lens_that_is_not_closed_has_no_distance_and_is_no_fault_of_the_keep_out(tmp_path: Path) -> None:
    path = step_file(tmp_path / "led.step", ball(0.3, (0.0, 0.0, 0.1)))
    lens = make_lens(INNER_MM, OUTER_MM, 0.0, base={"kind": "none"})
    mesh = build_mesh(make_plan(*fit_lens(lens), lens.spec.base), 6)
    assert keep_out_distance(mesh, read_keep_out(path), 1e-3) is not None
    torn = replace(mesh, triangles=mesh.triangles[1:], face=mesh.face[1:])
    assert keep_out_distance(torn, read_keep_out(path), 1e-3) is None
    unmeasured = part_with(path).changed(keep_out=None)
    criterion = next(criterion for criterion in unmeasured.judge() if criterion.key == "keep_out_distance")
    assert criterion.value is None and not criterion.holds and "is not closed" in criterion.remedy


@HERE
def test_of_several_solids_the_nearest_is_named(tmp_path: Path) -> None:
    """Balls of 0.2 mm in a spherical cavity, the second 0.3 mm nearer to its wall."""
    places = [(0.2, 0.0, 0.1), (0.0, 0.55, 0.1)]
    clearance = part_with(step_file(tmp_path / "leds.step", *(ball(0.1, place) for place in places))).keep_out
    assert clearance is not None
    assert clearance.distance_mm == pytest.approx(INNER_MM - float(np.hypot(0.55, 0.1)) - 0.1, abs=clearance.error_mm)
    assert np.linalg.norm(np.subtract(clearance.keep_out_point_mm, places[1])) == pytest.approx(0.1, abs=0.01)


@HERE
def test_a_keep_out_in_the_body_is_at_less_than_no_distance(tmp_path: Path) -> None:
    """A box of 0.2 mm sides in the wall: 2 V/S = a/3."""
    part = part_with(step_file(tmp_path / "led.step", box((0.2, 0.2, 0.2), (1.6, 0.0, 0.3))), margin_mm=0.0)
    assert part.keep_out is not None
    assert part.keep_out.distance_mm == pytest.approx(-0.2 / 3.0, rel=1e-6)
    assert len(missed(part)) == 1


@HERE
def test_what_only_touches_is_free_without_a_margin(tmp_path: Path) -> None:
    """The board on which the base stands."""
    path = step_file(tmp_path / "board.step", box((8.0, 8.0, 1.0), (0.0, 0.0, -2.5)))
    part = part_with(path, margin_mm=0.0, diameter_mm=6.0, height_mm=2.0)
    assert part.keep_out is not None
    assert part.keep_out.distance_mm == pytest.approx(0.0, abs=1e-9)
    assert missed(part) == []
    assert "lower base.height_mm" in missed(part_with(path, diameter_mm=6.0, height_mm=2.0))[0]


@pytest.mark.parametrize(
    ("base", "distance_mm", "body", "keep_out", "phrase"),
    [
        ("cylinder", 0.05, (3.0, 0.0, 0.0), (3.05, 0.0, 0.0), "beside the base: lower base.diameter_mm"),
        ("square", 0.05, (3.0, 0.0, 0.0), (3.05, 0.0, 0.0), "beside the base: lower base.side_mm"),
        ("cylinder", -0.01, (2.9, 0.0, -1.0), (3.0, 0.0, -0.5), "beside the base: lower base.diameter_mm"),
        ("cylinder", -0.1, (1.0, 0.0, -2.0), (1.2, 0.0, -1.5), "depth_mm = 0.6 with pocket_diameter_mm = 2.6"),
        ("cylinder", -0.1, (3.0, 0.0, -2.0), (3.0, 0.0, -1.5), "lower base.height_mm, or move the keep-out"),
        ("cylinder", 0.05, (1.0, 0.0, -1.0), (0.95, 0.0, -1.0), "base.pocket_diameter_mm must be above 2.1"),
        ("cylinder", 0.05, (0.8125, -0.25, 0.0), (0.75, -0.25, 0.0), "raise lens.inner.offset_mm"),
        ("cylinder", -0.01, (0.8, 0.0, -0.1), (0.9, 0.0, 0.1), "raise lens.inner.offset_mm"),
    ],
)  # fmt: skip
def test_the_remedy_names_the_field_of_the_place(
    base: str, distance_mm: float, body: tuple[float, ...], keep_out: tuple[float, ...], phrase: str
) -> None:
    """Base 6 mm wide and 2 mm high; its side has vertices at z = 0 and at its bottom alone."""
    width = "side_mm" if base == "square" else "diameter_mm"
    plain = make_lens(INNER_MM, OUTER_MM, 0.0, base={"kind": base, width: 6.0, "height_mm": 2.0})
    spec = plain.spec.replace({"constraints.keep_out": "clamp.step", "constraints.keep_out_margin_mm": 0.1})
    clearance = KeepOutDistance(distance_mm=distance_mm, body_point_mm=body, keep_out_point_mm=keep_out, error_mm=1e-3)
    remedy = keep_out_remedy(spec, clearance)
    assert phrase in remedy
    assert remedy.endswith("; the body is closest at ({:g}, {:g}, {:g}) mm".format(*body))


def test_the_mass_is_that_of_the_volume(tmp_path: Path) -> None:
    plain = make_lens(INNER_MM, OUTER_MM, 0.0, base={"kind": "none"})
    spec = plain.spec.replace({"lens.density_g_per_cm3": 1.25})
    part, light = built(Lens.double(plain.inner, plain.outer, spec, 0, COARSE_SPLINES)), built(plain)
    assert light.keep_out is None and mass_g(spec.replace({"lens.density_g_per_cm3": None}), 2e3) == 2.38  # of PMMA
    assert mass_g(plain.spec.replace({"lens.material": "PMMA/PC", "lens.refractive_index": 1.5}), 2e3) is None, (
        "a material without a name here"
    )
    assert "keep_out_distance" not in {criterion.key for criterion in light.criteria}
    shell = 2.0 / 3.0 * np.pi * (OUTER_MM**3 - INNER_MM**3)
    assert (part.mass_g, light.mass_g) == pytest.approx((1.25e-3 * shell, 1.19e-3 * shell), rel=1e-8)
    stated = {fact.key: (fact.value, fact.note) for fact in part_facts(light)[0].facts}
    assert stated["density"][0] == 1.19 and "data sheet" in stated["density"][1]


@HERE
def test_an_inch_file_is_read_in_mm(tmp_path: Path) -> None:
    path = step_file(tmp_path / "led.step", box((1.0, 1.0, 1.0), (0.0, 0.0, 0.0)))
    text = path.read_text()
    metre = text.replace("SI_UNIT(.MILLI.,.METRE.)", "SI_UNIT($,.METRE.)")
    assert metre != text
    path.write_text(metre)
    (solid,) = read_keep_out(path).solids
    assert np.abs(solid.vertices).max() == pytest.approx(500.0)


@HERE
def test_a_file_without_solids_is_refused_in_one_line(tmp_path: Path) -> None:
    import cadquery as cq

    face = cq.Face.makePlane(1.0, 1.0)
    cases = {"surface.step": "holds no solid", "absent.step": "no such file", "text.step": "not readable as STEP"}
    step_file(tmp_path / "surface.step", face)
    (tmp_path / "text.step").write_text("ISO-10303-21; nothing")
    for name, message in cases.items():
        with pytest.raises(InputError, match=message) as refusal:
            read_keep_out(tmp_path / name)
        assert name in str(refusal.value) and "\n" not in str(refusal.value)


@HERE
@pytest.mark.parametrize("kind", ["closed shell", "open shell", "sheet"])
def test_what_is_no_solid_beside_one_is_named_and_two_solids_count(tmp_path: Path, kind: str) -> None:
    """A shell in which the lens stands would else be no keep-out at all."""
    solid, other = box((0.3, 0.3, 0.3), (0.0, 0.0, 0.0)), box((1.0, 1.0, 1.0), (3.0, 0.0, 0.0))
    faces = cq.Shape.cast(other.wrapped).Faces()
    loose, message = {
        "closed shell": (cq.Shell.makeShell(faces), "would not count: 6, in shells: 1, of which closed: 1"),
        "open shell": (cq.Shell.makeShell(faces[:5]), "would not count: 5, in shells: 1, of which closed: 0"),
        "sheet": (faces[0], "would not count: 1, in shells: "),
    }[kind]
    for number, shapes in enumerate(((solid, loose), (loose, solid))):
        path = step_file(tmp_path / f"led{number}.step", cq.Compound.makeCompound(shapes))
        with pytest.raises(InputError, match=message):
            read_keep_out(path)
    both = step_file(tmp_path / "both.step", cq.Compound.makeCompound((solid, other)))
    assert len(read_keep_out(both).solids) == 2
