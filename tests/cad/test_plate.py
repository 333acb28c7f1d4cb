"""The plate with all lenses as one solid: closed forms, its files read back, and what breaks it."""

from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import cadquery as cq
import numpy as np
import pytest
from geometry_lenses import make_lens
from scipy.spatial import cKDTree

from lensforge.cad import plate_export
from lensforge.cad.face_tolerance import FINEST, FaceTolerance
from lensforge.cad.form_error import fit_lens
from lensforge.cad.mesh import check_closed
from lensforge.cad.mesh_files import parse_3mf, parse_stl
from lensforge.cad.part import Part, part_facts
from lensforge.cad.part_export import build_part
from lensforge.cad.plan import make_plan
from lensforge.cad.plate_export import BuiltPlate, LensOfPlate, build_plate, room_on_plate
from lensforge.cad.plate_layout import layout_of
from lensforge.cad.plate_result import Plate
from lensforge.cad.plate_solid import build_plate_solid
from lensforge.cad.solid import build_solid
from lensforge.cad.step import parse_step
from lensforge.errors import InputError
from lensforge.results import Fact, Record
from lensforge.results.figure import criteria_in
from lensforge.scene.lens import Lens
from lensforge.shop.check import _room_on_plate
from lensforge.shop.findings import plate_findings
from lensforge.spec import BaseSection
from lensforge.spec.lamps_section import Lamps
from lensforge.spec.plate_section import PlateSection
from lensforge.surfaces.step_file import parts_of

DRAFT_DEG = 1.7
SLOPE = np.tan(np.radians(DRAFT_DEG))
INNER = 0.8  # mm
OUTER = 2.45  # constraints.max_radius_mm is twice the outer
RING = {"kind": "ring", "count": 3, "diameter_mm": 14.0}
SCREW = {"place_mm": [0.0, 0.0], "diameter_mm": 1.0}
PIN = {"place_mm": [-3.0, 0.0], "diameter_mm": 1.2, "height_mm": 1.5}
BOSS = {"place_mm": [-9.5, 0.0], "diameter_mm": 2.4, "height_mm": 1.0, "bore_diameter_mm": 1.2, "bore_depth_mm": 2.2}


def on_plate(plate: dict[str, Any], lamps: dict[str, Any] | None = None, relative: float = 0.0) -> Lens:
    lens = make_lens(INNER, OUTER, relative, base={"kind": "none"})
    changes = {
        "plate": {"draft_deg": 0.0, **plate},
        "constraints.max_radius_mm": 4.0,
        **({} if lamps is None else {"lamps": lamps}),
    }
    return replace(lens, spec=lens.spec.replace(changes))


class OfPlate(Record):
    """A plate alone beside the tolerance of the faces, as a part has them."""

    face_tolerance: FaceTolerance
    plate: Plate


def criteria_of(made: Part | BuiltPlate) -> list[Fact]:
    part = made if isinstance(made, Part) else OfPlate(face_tolerance=FINEST, plate=made.figures)
    return list(criteria_in(part))


def failed(made: Part | BuiltPlate) -> list[str]:
    return [criterion.key for criterion in criteria_of(made) if not criterion.holds]


@cache
def fitted(relative: float = 0.0) -> Any:
    """The splines of the lens: the same on each plate."""
    return fit_lens(make_lens(INNER, OUTER, relative, base={"kind": "none"}))


def plate_alone(lens: Lens, relative: float = 0.0) -> BuiltPlate:
    """The plate of ``lens`` without the files of one lens, which take twice as long."""
    plan = make_plan(*fitted(relative), BaseSection(kind="none"))
    plate_lens = LensOfPlate(plan, 0.5, build_solid(plan).volume_mm3)
    plate = build_plate(lens, plate_lens, None, FINEST, "AP214", None)
    assert plate is not None
    return plate


def findings(lens: Lens) -> Any:
    return plate_findings(lens.spec, *room_on_plate(lens, fitted()))


@pytest.fixture(scope="module")
def ring() -> Part:
    """Three turned freeform lenses around a screw, with a pin and a boss bored into the plate: nothing is symmetric."""
    marks = {"holes": [SCREW], "pins": [PIN], "bosses": [BOSS]}
    plate = {"thickness_mm": 2.0, "corner_radius_mm": 1.5, "draft_deg": DRAFT_DEG, **marks}
    return build_part(on_plate(plate, RING, 0.02), rings=16)


@pytest.mark.parametrize(("process", "has_gap"), [("milled", True), ("moulded", False)])
def test_a_plate_has_a_gap_for_the_cutter_where_one_cuts_it(process: str, has_gap: bool) -> None:
    lens = on_plate({"thickness_mm": 2.0}, RING)
    lens = replace(lens, spec=lens.spec.replace({"manufacture.process": process}))
    assert (_room_on_plate(lens, fitted())["plate_gap_mm"] is not None) == has_gap


def of_two_kinds(places: list[list[float]], turns: list[float], kinds: list[str], plate: dict[str, Any]) -> Lens:
    """Freeform lenses, of which no two faces are alike; the second kind is taller, and its cavity narrower."""
    lamps = {"kind": "table", "places_mm": places, "turns_deg": turns, "kinds": kinds}
    lens = on_plate({"thickness_mm": 1.0, **plate}, lamps, 0.05)
    other = lens.spec.all_lamps.kinds[1].name
    return replace(lens, others={other: make_lens(0.6, 3.1, 0.04, seed=7).surfaces})


def test_each_place_of_a_plate_has_the_lens_of_its_kind() -> None:
    """Faces read back from the STEP against the exact ones, and the volume against the sum by quadrature."""
    places = [[-8.0, 1.0], [0.5, -1.0], [6.0, 7.5]]
    turns = [20.0, 130.0, -75.0]
    kinds = ["tall", "wide", "tall"]
    lens = of_two_kinds(places, turns, kinds, {"width_mm": 25.0, "height_mm": 24.0})
    part = build_part(lens, rings=16)
    assert failed(part) == [] and part.plate is not None
    solid = parse_step(part.plate_step or b"")
    around = np.linspace(0.0, 2.0 * np.pi, 1024, endpoint=False)
    z, weights = np.polynomial.legendre.leggauss(200)
    across = np.sqrt(1.0 - (0.5 + 0.5 * z) ** 2)[:, None]
    u = np.stack([across * np.cos(around), across * np.sin(around), np.tile(0.5 + 0.5 * z[:, None], 1024)], axis=-1)
    some = u[::60, ::300].reshape(-1, 3)
    volume = 25.0 * 24.0
    for number, (place, turn, kind) in enumerate(zip(places, np.radians(turns), kinds, strict=True)):
        single = lens.of_kind(kind)
        cubes = [face.radius(u.reshape(-1, 3)).reshape(u.shape[:2]) ** 3 for face in (single.outer, single.inner)]
        volume += np.pi * weights @ (cubes[0] - cubes[1]).mean(axis=1) / 3.0
        volume -= np.pi * np.mean(
            single.inner.radius(np.stack([np.cos(around), np.sin(around), 0 * around], axis=1)) ** 2
        )
        turned = np.array([[np.cos(turn), np.sin(turn), 0.0], [-np.sin(turn), np.cos(turn), 0.0], [0.0, 0.0, 1.0]])
        for name, surface in single.surfaces.items():
            points = (surface.radius(some)[:, None] * some) @ turned + [*place, 0.0]
            face = cq.Face(solid.faces[f"OPTICAL_{name.upper()}_{number + 1}"])
            assert max(_away(face, point.tolist()) for point in points) < 1e-4, (name, number)
    assert [solid.volume_mm3, part.plate.volume_mm3] == pytest.approx([volume] * 2, rel=1e-6)
    other = lens.of_kind("tall")  # the plate is made once, with the first kind; another says where
    assert (other.lamps_on_plate, room_on_plate(other, fitted())) == (False, (None, None))
    facts = {fact.key: fact for group in part_facts(part.changed(lens=other, plate=None)) for fact in group.facts}
    assert facts["plate_files"].value == "in the folder of the lens wide, above this one"
    assert other.own_lamps_words == "of 2 lamps with the lens tall, each apart from its plate"


@pytest.mark.parametrize(
    ("outline", "area"),
    [
        ({"width_mm": 12.0, "height_mm": 9.0, "corner_radius_mm": 2.0}, 12.0 * 9.0 - (4.0 - np.pi) * 2.0**2),
        ({"kind": "round", "diameter_mm": 12.0}, np.pi * 6.0**2),
        ({"kind": "rectangle", "margin_mm": 1.0}, 10.0**2),
    ],
    ids=["rectangle", "round", "margin"],
)
def test_a_plate_of_one_is_the_lens_and_the_plate(outline: dict[str, Any], area: float) -> None:
    plate = plate_alone(on_plate({"thickness_mm": 1.5, **outline}))
    assert failed(plate) == []
    volume = 2.0 / 3.0 * np.pi * (OUTER**3 - INNER**3) + 1.5 * (area - np.pi * INNER**2)
    assert plate.figures.volume_mm3 == pytest.approx(volume, rel=1e-8)
    assert (plate.figures.lenses, plate.figures.gap_mm, plate.figures.genus) == (1, None, 0)
    solid = parse_step(plate.files["plate.step"])
    assert solid.volume_mm3 == pytest.approx(volume, rel=1e-8)
    assert {"OPTICAL_INNER", "OPTICAL_OUTER", "PLATE_TOP", "PLATE_BOTTOM"} < set(solid.faces)


def frustum(radius: float, length: float, way: float = 1.0) -> float:
    """Volume of a wall that widens downwards by the draft, or narrows."""
    foot = radius + way * SLOPE * length
    return np.pi * length * (radius**2 + radius * foot + foot**2) / 3.0


def test_a_plate_of_turned_lenses_has_the_volume_of_its_parts(ring: Part) -> None:
    assert failed(ring) == [] and ring.plate is not None
    solid = parse_step(ring.plate_step or b"")
    layout = layout_of(ring.lens)
    assert layout is not None
    assert len(parts_of(solid.shape, "FACE")) == ring.plate.faces == len(solid.faces)
    assert (solid.valid, solid.genus, ring.plate.genus) == (True, 1, 1)
    holes = frustum(0.5, 2.0) - frustum(0.6, 1.5, -1.0) - frustum(1.2, 1.0, -1.0) + frustum(0.6, 2.2)
    assert cq.Face(solid.faces["BOSS_ROOF"]).Center().toTuple() == pytest.approx((-9.5, 0.0, -0.8))
    for name, roots in {
        "PLATE_HOLE": (0.5, 0.0, 1.0),
        "PIN_SIDE_1": (0.6, -2.0, -1.0),
        "BOSS_BORE": (0.6, -0.8, 1.0),
    }.items():
        radius, top, way = roots
        for circle in cq.Face(solid.faces[name]).Edges():
            if circle.geomType() == "CIRCLE":
                low = top - circle.Center().z
                assert circle.radius() == pytest.approx(radius + way * SLOPE * low, abs=1e-9), name
    rim = np.linspace(0.0, 2.0 * np.pi, 4096, endpoint=False)
    around = np.stack([np.cos(rim), np.sin(rim), 0.0 * rim], axis=1)
    radius = ring.lens.inner.radius(around)
    turned = np.gradient(np.unwrap(np.append(radius, radius[0])))[:-1] * 4096 / (2.0 * np.pi)
    nearest = (radius**2 / np.hypot(radius, turned)).min()  # of a tangent of the rim to the axis
    scale = 1.0 + 2.0 * SLOPE / nearest
    bores = 3.0 * np.pi * np.mean(radius**2) * 2.0 * (1.0 + scale + scale**2) / 3.0
    sizes = [[length - 2.0 * inset for length in (*layout.size_mm, 3.0)] for inset in (0.0, SLOPE, 2.0 * SLOPE)]
    areas = [x * y - (1.0 - np.pi / 4.0) * corner**2 for x, y, corner in sizes]
    sides = 2.0 * (areas[0] + 4.0 * areas[1] + areas[2]) / 6.0  # exact of a square of the depth
    expected = 3.0 * ring.volume_mm3 + sides - bores - holes
    assert solid.volume_mm3 == pytest.approx(expected, rel=1e-7)


def _away(face: cq.Face, point: list[float]) -> float:
    return float(face.distance(cq.Vertex.makeVertex(*point)))


def test_the_meshes_of_a_plate_are_closed_and_have_its_size(ring: Part) -> None:
    plate = ring.plate
    assert plate is not None
    for vertices, triangles in (parse_stl(ring.plate_stl or b""), parse_3mf(ring.plate_threemf or b"")):
        closure = check_closed(vertices, triangles)
        assert (closure.watertight, closure.genus) == (True, 1)
        assert closure.volume_mm3 == pytest.approx(plate.volume_mm3, rel=1e-3)
        np.testing.assert_allclose(vertices[:, 2].min(), -3.5, atol=1e-6)
        assert len(triangles) == plate.triangles
    assert set(ring.files) >= {"plate.step", "plate.stl", "plate.3mf"}
    facts = {fact.key: fact for group in part_facts(ring) for fact in group.facts}
    assert facts["plate_lenses"].value == 3 and "plate.step" in str(facts["plate_files"].value)


def test_a_plate_is_kept_with_its_files_and_goes_with_them(ring: Part, tmp_path: Path) -> None:
    ring.write(tmp_path)
    assert Part.read(tmp_path, lens=ring.lens) == ring
    with (tmp_path / "plate.stl").open("ab") as file:
        file.write(b" ")
    assert Part.read(tmp_path, lens=ring.lens).altered == ("plate.stl",)
    build_part(replace(ring.lens, spec=ring.lens.spec.replace({"plate": None})), rings=16).write(tmp_path)
    assert not list(tmp_path.glob("plate.*")), "a plate of an earlier spec"


def test_the_least_gap_of_turned_freeform_lenses_is_that_of_their_points() -> None:
    """Of lenses of two kinds, each turned by hand; the nearest two of three decide, not the nearest axes."""
    places = np.array([[0.0, 0.0], [8.1, 1.0], [-1.5, 8.2]])
    turns = np.radians([20.0, 130.0, -75.0])
    lens = of_two_kinds(places.tolist(), np.degrees(turns).tolist(), ["wide", "wide", "tall"], {})
    gap_mm, _ = room_on_plate(lens, fitted(0.05))
    azimuth, polar = (
        coordinates.ravel()
        for coordinates in np.meshgrid(np.linspace(0.0, 2.0 * np.pi, 720), np.linspace(1.2, 1.5708, 40))
    )
    u = np.stack([np.sin(polar) * np.cos(azimuth), np.sin(polar) * np.sin(azimuth), np.cos(polar)], axis=1)
    kinds = [kind.outer.radius(u)[:, None] * u for kind in lens.kinds]
    stand = [
        outline @ np.array([[np.cos(t), np.sin(t), 0.0], [-np.sin(t), np.cos(t), 0.0], [0.0, 0.0, 1.0]]) + [*place, 0.0]
        for outline, place, t in zip((kinds[0], kinds[0], kinds[1]), places, turns, strict=True)
    ]
    apart = [float(cKDTree(stand[a]).query(stand[b])[0].min()) for a, b in ((0, 1), (0, 2), (1, 2))]
    assert gap_mm == pytest.approx(min(apart), abs=0.01) and apart[1] + 0.2 < apart[0]


def test_the_form_error_of_a_plate_is_that_of_its_worst_lens_also_of_the_second_kind() -> None:
    """With few nodes the second kind is off by more than its tolerance, the first one, by its record, by none."""
    lens = of_two_kinds([[6.0, 1.0], [-5.0, 2.0]], [], ["one", "two"], {})
    first, second = (LensOfPlate.fitted(kind, 20, FINEST) for kind in lens.kinds)
    plate = build_plate(lens, replace(first, form_error_nm=0.0), 20, FINEST, "AP214", None)
    assert plate is not None and second.form_error_nm > FINEST.form_nm
    assert plate.figures.form_error_nm == pytest.approx(second.form_error_nm, abs=1e-3)
    assert "plate_form_error" in failed(plate)


def test_a_lens_of_a_plate_told_apart_has_no_base_whatever_the_spec_says() -> None:
    lens = of_two_kinds([[6.0, 1.0], [-5.0, 2.0]], [], ["one", "two"], {})
    based = replace(lens, spec=lens.spec.replace({"base": {"kind": "cylinder", "diameter_mm": 12.0}}))
    for kind in ("one", "two"):
        apart = based.of_kind(kind).of_own_lamps.spec
        assert (apart.plate, apart.base.kind, apart.base_made.kind) == (None, "none", "none")
    assert based.spec.base.kind == "cylinder"


def test_the_volume_is_as_good_far_from_the_origin() -> None:
    """Of splines with few nodes, whose bores the kernel's plain formula gets wrong by so much times their distance."""
    lens = of_two_kinds([[60.0, 9.0], [-40.0, 25.0]], [], ["one", "two"], {"draft_deg": DRAFT_DEG})
    plate = build_plate(lens, LensOfPlate.fitted(lens, 20, FINEST), 20, FINEST, "AP214", None)
    errors = (
        []
        if plate is None
        else [criterion.value for criterion in criteria_of(plate) if criterion.key == "plate_volume_error"]
    )
    assert errors == pytest.approx([0.0], abs=1e-10)


def test_a_lens_beside_its_place_fails(ring: Part, monkeypatch: pytest.MonkeyPatch) -> None:
    def shifted(plans: Any, layout: Any) -> Any:
        (x, y), *others = layout.lenses.places_mm
        moved = Lamps.level([(x + 2e-6, y), *others])
        return build_plate_solid(plans, replace(layout, lenses=moved))

    monkeypatch.setattr(plate_export, "build_plate_solid", shifted)
    assert failed(plate_alone(ring.lens, 0.02)) == ["plate_form_error"]


def test_a_hole_that_the_solid_lacks_fails(ring: Part, monkeypatch: pytest.MonkeyPatch) -> None:
    def without(plans: Any, layout: Any) -> Any:
        return build_plate_solid(plans, replace(layout, plate=layout.plate.model_copy(update={"holes": ()})))

    monkeypatch.setattr(plate_export, "build_plate_solid", without)
    assert {"plate_volume_error", "plate_genus_difference"} <= set(failed(plate_alone(ring.lens, 0.02)))


def test_a_plate_without_a_lens_s_rim_is_not_closed(ring: Part, monkeypatch: pytest.MonkeyPatch) -> None:
    made = plate_export.build_plate_mesh

    def torn(*given: Any) -> Any:
        mesh = made(*given)
        kept = np.arange(len(mesh.triangles)) != 7
        return replace(mesh, triangles=mesh.triangles[kept], face=mesh.face[kept])

    monkeypatch.setattr(plate_export, "build_plate_mesh", torn)
    assert {"plate_watertight", "plate_watertight_3mf"} <= set(failed(plate_alone(ring.lens, 0.02)))


def test_lenses_that_overlap_and_pins_in_a_cavity_are_refused_in_one_line() -> None:
    lens = make_lens(INNER, OUTER, base={"kind": "none"})
    near = {"kind": "table", "places_mm": [[-2.0, 0.0], [2.0, 0.0]]}
    narrow = {"lamps": near, "plate": {"thickness_mm": 1.0}, "constraints.max_radius_mm": 2.0}
    narrow |= {"lens.outer.offset_mm": 1.9}  # of the search's start; the lens is wider than its spec allows
    with pytest.raises(InputError, match=r"^plate: two lenses, 4 mm apart, overlap; raise the pitch.*$"):
        build_part(replace(lens, spec=lens.spec.replace(narrow)), rings=16)
    pin = {"place_mm": [0.9, 0.0], "diameter_mm": 0.4, "height_mm": 1.0}
    message = r"^plate: the wall between plate\.pins\.0 and the cavity of a lens is -0\.1\d* mm; .* at least 0\.01;.*$"
    with pytest.raises(InputError, match=message):
        build_part(on_plate({"thickness_mm": 1.0, "pins": [pin]}), rings=16)


@pytest.mark.parametrize(
    ("cutter", "process", "holds"), [(2.0, "milled", True), (2.1, "milled", False), (2.1, "moulded", None)]
)
def test_the_ball_must_fit_between_lenses_that_are_cut(cutter: float, process: str, holds: bool | None) -> None:
    """Spheres of 2.45 mm, 9 mm apart, leave 4.1 mm."""
    lens = on_plate({"thickness_mm": 1.0}, {"kind": "table", "places_mm": [[-4.5, 0.0], [4.5, 0.0]]})
    spec = lens.spec.replace({"manufacture.cutter_radius_mm": cutter, "manufacture.process": process})
    gaps = [finding for finding in findings(replace(lens, spec=spec)) if finding.key == "gap"]
    assert [finding.holds for finding in gaps] == ([] if holds is None else [holds])
    for gap in gaps:
        assert gap.limit == pytest.approx(4.1, abs=2e-3)
        assert ("manufacture.cutter_radius_mm = 2.0" in gap.remedy) == (not gap.holds)


@pytest.mark.parametrize(
    ("place", "wall", "between"),
    [
        ([1.2, 0.0], 1.2 - 0.2 - INNER, "the cavity of a lens"),
        ([0.0, -3.0], 3.5 - 3.0 - 0.2, "the edge"),
        ([2.4, 2.8], 0.4 - 0.2 - 0.1, "plate.holes.0"),
    ],
)
def test_the_thinnest_wall_of_a_plate_is_found(place: list[float], wall: float, between: str) -> None:
    """A plate of 7 x 7 mm about one lens, a hole in its corner, and a pin of 0.4 mm somewhere."""
    hole = {"place_mm": [2.8, 2.8], "diameter_mm": 0.2}
    pin = {"place_mm": place, "diameter_mm": 0.4, "height_mm": 1.0}
    plate = {"thickness_mm": 1.0, "width_mm": 7.0, "height_mm": 7.0, "holes": [hole], "pins": [pin], "draft_deg": 0.0}
    lens = make_lens(INNER, OUTER, base={"kind": "none"})
    spec = lens.spec.replace({"constraints.max_radius_mm": 2.5, "plate": plate})
    (plate_finding,) = [finding for finding in findings(replace(lens, spec=spec)) if finding.key == "plate"]
    assert (
        plate_finding.value == pytest.approx(wall, abs=1e-6)
        and f"between plate.pins.0 and {between}" in plate_finding.note
    )


@pytest.mark.parametrize(
    ("place", "wall", "between"),
    [
        ([10.0, 3.0], 3.0 - 2.3 - 0.2, "the cavity of a lens"),
        ([-10.0, 1.7], 1.7 - 0.8 - 0.2, "the cavity of a lens"),
        ([0.0, 14.2], 15.0 - 14.2 - 0.2, "the edge"),
        ([-19.1, 5.0], 20.0 - 19.1 - 0.2, "the edge"),
    ],
)
def test_walls_are_those_at_turned_cavities_and_at_the_nearer_edge(
    place: list[float], wall: float, between: str
) -> None:
    """Openings of 4 x 1.6 mm, and of the other kind, turned by a right angle, 4.6 x 1 mm, on a plate of 40 x 30 mm."""
    lamps = {"kind": "table", "places_mm": [[-10, 0], [10, 0]], "turns_deg": [0.0, 90.0], "kinds": ["one", "two"]}
    pin = {"place_mm": place, "diameter_mm": 0.4, "height_mm": 1.0}
    layout = layout_of(on_plate({"thickness_mm": 1.0, "width_mm": 40.0, "height_mm": 30.0, "pins": [pin]}, lamps))
    turn = np.linspace(0.0, 2.0 * np.pi, 3601)
    assert layout is not None
    sizes = (2.0, 0.8), (2.3, 0.5)
    thinnest = layout.thinnest_wall([np.column_stack([x * np.cos(turn), y * np.sin(turn)]) for x, y in sizes])
    assert thinnest is not None and thinnest.thickness_mm == pytest.approx(wall, abs=1e-6)
    assert thinnest.between == f"plate.pins.0 and {between}"


@pytest.mark.parametrize(
    ("bore", "wall", "between"),
    [
        ({"bore_diameter_mm": 1.8, "bore_depth_mm": 1.0}, 0.1, "plate.bosses.0 and its bore"),
        ({"bore_diameter_mm": 1.0, "bore_depth_mm": 1.95}, 0.05, "the bore of plate.bosses.0 and the top of the plate"),
    ],
)
def test_the_walls_of_a_boss_are_judged(bore: dict[str, float], wall: float, between: str) -> None:
    boss = {"place_mm": [5.5, 0.0], "diameter_mm": 2.0, "height_mm": 1.0, **bore}
    lens = on_plate({"thickness_mm": 1.0, "width_mm": 16.0, "height_mm": 16.0, "bosses": [boss]})
    (plate_finding,) = [finding for finding in findings(lens) if finding.key == "plate"]
    assert plate_finding.value == pytest.approx(wall, abs=1e-9) and between in plate_finding.note
    drafted = lens.spec.replace({"plate.draft_deg": DRAFT_DEG})
    (less,) = [finding for finding in findings(replace(lens, spec=drafted)) if finding.key == "plate"]
    lost = SLOPE * (1.0 + bore["bore_depth_mm"]) if "its bore" in between else 0.0
    assert less.value == pytest.approx(wall - lost, abs=1e-9)


def test_walls_are_judged_at_the_bottom_where_drafts_have_widened_bores_and_holes() -> None:
    """A hole of 0.2 mm radius beside a cavity of 0.8 mm, and one beside the edge, both in a plate 3 mm thick."""
    for place, gap, widened in (([1.5, 0.0], 0.5, 2.0), ([4.5, 0.0], 0.3, 2.0)):
        hole = {"place_mm": place, "diameter_mm": 0.4}
        plate = {"thickness_mm": 3.0, "width_mm": 10.0, "height_mm": 10.0, "holes": [hole], "draft_deg": DRAFT_DEG}
        layout = layout_of(on_plate({"thickness_mm": 3.0, "width_mm": 10.0, "height_mm": 10.0}))
        assert layout is not None
        layout = replace(layout, plate=layout.plate.model_validate(plate))
        turn = np.linspace(0.0, 2.0 * np.pi, 3600, endpoint=False)
        thinnest = layout.thinnest_wall([INNER * np.column_stack([np.cos(turn), np.sin(turn)])])
        assert thinnest is not None
        assert thinnest.thickness_mm == pytest.approx(gap - 3.0 * widened * SLOPE, abs=1e-6)


def test_a_pin_or_a_boss_that_its_draft_leaves_nothing_of_is_refused() -> None:
    pin = {"place_mm": [-9.5, 0.0], "diameter_mm": 1.0, "height_mm": 0.5 / SLOPE}
    for height, holds in ((0.999, True), (1.001, False)):
        plate = {"thickness_mm": 1.0, "draft_deg": DRAFT_DEG, "pins": [{**pin, "height_mm": height * pin["height_mm"]}]}
        if holds:
            PlateSection(**plate)
        else:
            with pytest.raises(InputError, match=r"draft_deg = 1\.7: plate\.pins\.0 has no wall at its end"):
                PlateSection(**plate)
    deep = {"thickness_mm": 3.0, "draft_deg": 5.0, "bosses": [{**BOSS, "bore_diameter_mm": 2.0, "bore_depth_mm": 2.9}]}
    with pytest.raises(InputError, match=r"plate\.bosses\.0 has no wall at its end"):
        PlateSection(**deep)
