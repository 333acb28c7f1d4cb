"""Light of one lamp through a whole plate: what meets a neighbour, against closed forms and other placements."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from jaxtyping import Float
from lens_meshes import lambertian
from presets import FEW
from scenes import small_spec

from lensforge import seeds
from lensforge.cad.form_error import fit_lens
from lensforge.cad.mesh import build_mesh
from lensforge.cad.mesh_files import stl_bytes
from lensforge.cad.plan import lay_out
from lensforge.cad.plate_layout import PlateLayout, layout_of
from lensforge.cad.plate_mesh import build_plate_mesh, lens_meshes
from lensforge.light.lens_light import evaluate
from lensforge.optics.media import Media, Medium
from lensforge.proof.facet_casting import Grid
from lensforge.proof.nonsequential_trace import Base, trace_stray
from lensforge.proof.optical_faces import NO_FACE, OpticalFaces
from lensforge.proof.part_comparison import LampsApart, LampsOnPlate, light_of_lamps
from lensforge.proof.part_mesh import PartMesh, read_part_mesh
from lensforge.proof.proof_facts import stray_facts
from lensforge.proof.proof_inputs import lamps_together, plate_of, screens_of, stands_of
from lensforge.proof.proof_result import StrayLight
from lensforge.proof.receiver_screen import Screen
from lensforge.proof.sequential_cast import send_through
from lensforge.scene.lens import Lens
from lensforge.sources.build_source import build_source
from lensforge.sources.ray_bundle import RayBundle
from lensforge.spec import BaseSection
from lensforge.spec.lamps_section import Lamps
from lensforge.surfaces.srbf import SrbfBasis, SrbfSurface

Floats = Float[np.ndarray, "..."]
INNER = 1.0
OUTER = 3.0
APART = 8.0
INDEX = 1.5
RAYS = lambertian(2000, 0.01, seed=3)
SCREEN = Screen.square(100.0, 400.0, 16, 0.0)


def lens_on(
    plate: dict[str, Any], places: list[list[float]], turns: list[float], relative: float = 0.0, kinds: Any = ()
) -> Lens:
    """Lenses on a plate; those of a second kind are smaller and otherwise rough."""
    lamps = {"kind": "table", "places_mm": places, "turns_deg": turns, "kinds": kinds}
    spec = small_spec(lamps=lamps, base={"kind": "none"}, plate={"thickness_mm": 2.0, **plate}, **WIDE)
    basis = SrbfBasis((9, 25), 1.75, "none")
    noise = np.random.default_rng(1).normal(size=basis.size) * basis.sigmas / basis.sigmas.max()
    first = Lens.double(*(SrbfSurface(basis, h * relative * noise, h) for h in (INNER, OUTER)), spec, 0, FEW)
    faces = {"inner": SrbfSurface(basis, -relative * noise, 1.2), "outer": SrbfSurface(basis, -relative * noise, 2.6)}
    return replace(first, others={kind.name: faces for kind in spec.all_lamps.kinds[1:]})


WIDE = {"constraints__max_radius_mm": 4.0, "lens__inner__offset_mm": 1.5, "lens__outer__offset_mm": 3.0}


def stl_of(lens: Lens, layout: PlateLayout) -> bytes:
    plans = tuple(lay_out(*fit_lens(kind), BaseSection(kind="none")) for kind in lens.kinds)
    return stl_bytes(build_plate_mesh(plans, layout, *lens_meshes(plans, layout.lenses.kind_of_each)))


def cast(lens: Lens, rays: RayBundle = RAYS, base: Base = "polished") -> StrayLight:
    layout = layout_of(lens)
    assert layout is not None
    optical = OpticalFaces(plate=plate_of(layout.lenses))
    stl = stl_of(lens, layout)
    return trace_stray(stl, rays=rays, media=Media(Medium(INDEX)), screens=[SCREEN], optical=optical, base=base)


def test_a_neighbour_meets_what_its_solid_angle_asks_for() -> None:
    """Light of a point leaves a sphere about it unrefracted: half of a sphere beside it, by its view factor.

    Howell, A Catalog of Radiation Heat Transfer Configuration Factors, B-41: a plane element and a sphere whose centre
    is in its plane.
    """
    # rad: the neighbour is seen under 0.384
    half = 0.45
    count = 90
    up, beside = np.meshgrid((np.arange(count) + 0.5) / count, (np.arange(2 * count) + 0.5) / count - 1.0)
    up = half * up.ravel()
    beside = half * beside.ravel()
    ways = np.stack([np.cos(up) * np.cos(beside), np.cos(up) * np.sin(beside), np.sin(up)], axis=1)
    flux = np.sin(up) * np.cos(up) * (half / count) ** 2 / np.pi
    rays = RayBundle(np.zeros_like(ways), ways, flux)
    light = cast(lens_on({"margin_mm": 0.0}, [[0.0, 0.0], [APART, 0.0]], []), rays, "black")
    h = APART / OUTER
    factor = (np.arctan(1.0 / np.sqrt(h**2 - 1.0)) - np.sqrt(h**2 - 1.0) / h**2) / np.pi
    through = (1.0 - ((INDEX - 1.0) / (INDEX + 1.0)) ** 2) ** 2
    assert light.lenses == 2 and light.flux.leaked < 1e-4
    assert light.neighbours * flux.sum() == pytest.approx(factor * through, rel=5e-3)


def test_a_plate_of_one_sends_the_light_of_the_lens_on_a_base_of_its_shape() -> None:
    plate = lens_on({"kind": "round", "diameter_mm": 10.0, "draft_deg": 0.0}, [[0.0, 0.0]], [], 0.02)
    one = cast(plate)
    base = BaseSection(diameter_mm=10.0, height_mm=2.0, relief_step_mm=0.0, relief_setback_mm=0.0, bore_setback_mm=0.0)
    stl = stl_bytes(build_mesh(lay_out(*fit_lens(plate), base), 96, 2e-3))
    other = trace_stray(stl, rays=RAYS, media=Media(Medium(INDEX)), screens=[SCREEN])
    assert (one.lenses, one.neighbours) == (1, 0.0)
    for name, share in other.flux.model_dump().items():
        assert getattr(one.flux, name) == pytest.approx(share, abs=3e-4), name


def leaning_walls(part: PartMesh, slope: float) -> tuple[Floats, Floats, Floats]:
    """Breadths of the facets of walls, curved points over them, and their normals, whose z is that of the draft."""
    rows = np.flatnonzero((part.faces == NO_FACE) & (np.abs(part.mesh.face_normals[:, 2]) < 0.5))
    points, normals = part.curved(rows, np.random.default_rng(4).dirichlet([1.0, 1.0, 1.0], len(rows)))
    np.testing.assert_allclose(normals[:, 2], -slope / np.hypot(1.0, slope), atol=1e-4)
    return np.ptp(part.mesh.triangles[rows, :, :2], axis=1).max(axis=1), points, normals


def test_walls_with_draft_have_the_normals_of_cones_and_planes() -> None:
    """Facets of the bore lean by 0.02 from it; they sent its stray light to other pixels."""
    plate = lens_on({"kind": "rectangle", "corner_radius_mm": 3.0, "draft_deg": 2.0}, [[0.0, 0.0]], [])
    layout = layout_of(plate)
    assert layout is not None
    optical = OpticalFaces(plate=plate_of(layout.lenses))
    slope = float(np.tan(np.radians(2.0)))
    broad, points, normals = leaning_walls(read_part_mesh(stl_of(plate, layout), optical), slope)
    bore = np.hypot(*points.T[:2]) < 2.0 * INNER
    assert bore.sum() > 100 and (broad > 3.0).sum() == 8
    np.testing.assert_allclose(-normals[bore, :2] / np.cos(np.arctan(slope)), radial(points[bore]), atol=1e-3)
    np.testing.assert_allclose(np.abs(normals[broad > 3.0, :2]).max(axis=1), np.cos(np.arctan(slope)), atol=1e-5)
    base = BaseSection(diameter_mm=10.0, height_mm=2.0, draft_deg=2.0, relief_step_mm=0.0, bore_setback_mm=0.0)
    part = read_part_mesh(stl_bytes(build_mesh(lay_out(*fit_lens(plate), base), 24, 2e-3)))
    _, points, normals = leaning_walls(part, slope)
    outwards = np.where(np.hypot(*points.T[:2]) < 4.0, -1.0, 1.0)[:, None]
    np.testing.assert_allclose(outwards * normals[:, :2] / np.cos(np.arctan(slope)), radial(points), atol=1e-3)


def radial(points: Floats) -> Floats:
    return points[:, :2] / np.hypot(*points.T[:2])[:, None]


@pytest.mark.nightly("twelve seconds")
def test_a_plate_may_be_turned_and_any_of_its_lenses_lit() -> None:
    """The same plate turned by 90 degrees with its lenses: the lit one sees the same."""
    apart = 9.0
    lying = cast(lens_on({}, [[0.0, 0.0], [apart, 0.0], [0.0, apart]], [0.0, 30.0, 75.0], 0.03))
    turned = cast(lens_on({}, [[apart, 0.0], [0.0, 0.0], [0.0, -apart]], [-15.0, -90.0, -60.0], 0.03))
    assert lying.neighbours > 0.01
    assert turned.neighbours == pytest.approx(lying.neighbours, rel=2e-3)
    assert turned.efficiency == pytest.approx(lying.efficiency, abs=2e-5)


def test_a_point_of_any_lens_is_found_in_its_own_coordinates() -> None:
    turns = np.array([0.3, -1.1, 2.0])
    plate = plate_of(Lamps.level([(4.0, 1.0), (-3.0, 2.0), (3.0, -8.0)], np.degrees(turns).tolist()))
    point = np.array([[1.0, -0.5, 0.7]])
    normal = np.array([[0.6, 0.0, 0.8]])
    for place, turn in zip(plate.places, turns, strict=True):
        there, ahead = (
            np.array([[np.cos(turn) * x - np.sin(turn) * y, np.sin(turn) * x + np.cos(turn) * y, z]])
            for ((x, y, z),) in (point, normal)
        )
        seen = plate.from_lit(there + np.array([*place, 0.0]))
        turned = plate.from_lit(ahead + np.array([*plate.places[1], 0.0]))
        local = plate.to_local(seen, turned)
        np.testing.assert_allclose(np.concatenate(local), np.concatenate([point, normal]), atol=1e-12)
        assert (plate.nearest(seen)[0] == 1) == (turn == turns[1])


def test_the_light_of_all_lamps_is_the_sum_of_each_moved_by_hand() -> None:
    """The same rays through the lens of each kind, its light turned and moved with its lamp, on a tilted plane."""
    places = [[-5.0, 1.0], [4.0, -2.0], [3.0, 7.0]]
    turns = [0.0, 70.0, 200.0]
    lens = lens_on({}, places, turns, 0.03, ["small", "large", "small"])
    layout = layout_of(lens)
    light = evaluate(lens, rays=1024)
    rays = lambertian(6000, 1.0, seed=5)
    assert layout is not None
    lamps = lamps_together(stl_of(lens, layout), (lens, light), rays)
    assert isinstance(lamps, LampsOnPlate)
    screen = replace(SCREEN, facing=(0.3, 0.0, 1.0))
    plans = tuple(lay_out(*fit_lens(kind), BaseSection(kind="none")) for kind in lens.kinds)
    parts = [read_part_mesh(stl_bytes(mesh)) for mesh in lens_meshes(plans, (1, 0, 1))[0]]
    passages = [send_through(part, Grid(part.mesh), rays, Media(Medium(INDEX))) for part in parts]
    drawn = np.random.default_rng(seeds.of_verification(0)).permutation(len(rays)) % 3
    total = np.zeros((16, 16))
    for number, ((x, y), turn) in enumerate(zip(places, np.radians(turns), strict=True)):
        around = np.array([[np.cos(turn), np.sin(turn), 0], [-np.sin(turn), np.cos(turn), 0], [0, 0, 1]])
        passage = passages[number % 2 == 0]
        points = passage.points @ around + [x, y, 0.0]
        ways = passage.directions @ around
        moved = replace(passage, points=points, directions=ways)
        landed = moved.landed(screen)
        total += screen.irradiance(landed.landings, np.where(drawn == number, 3.0, 0.0) * landed.flux)
    lamps = replace(lamps, designed=[("light", screen, total)])
    (judgement,) = light_of_lamps(lamps, passages[0], rays, Media(Medium(INDEX)), 1)
    assert (judgement.lamps, judgement.rays) == (3, 6000) and judgement.nmse_vs_sum < 1e-4 < judgement.noise_floor_nmse
    assert judgement.efficiency == pytest.approx(total.sum() * screen.pixel_measure / 3.0, rel=1e-3)


def test_the_faces_of_a_place_are_sorted_by_those_of_its_kind() -> None:
    """Two faces outwards, of a lens at 3 and 5 mm from its origin, and of the other kind at 5 and 3 mm."""
    tables = [np.tile(1.0 / np.reshape(radii, (3, 1, 1)), (1, 9, 9)) for radii in ((1.0, 3.0, 5.0), (1.0, 5.0, 3.0))]
    kinds = tuple(OpticalFaces(("inner", "lower", "upper"), (False, True, True), 3, table) for table in tables)
    plate = replace(plate_of(Lamps.level([(0.0, 0.0), (20.0, 0.0)], (0.0, 40.0))), kinds=(0, 1))
    points = np.array([[0.0, 3.0, 0.1], [20.0, 3.0, 0.1], [0.0, 0.5, 0.8]])
    numbers, apart = replace(kinds[0], plate=plate, of_kinds=kinds).sorted(
        points, points - [[0, 0, 0], [20, 0, 0], [0, 3, 3]]
    )
    assert numbers.tolist() == [1, 2, 0] and apart.max() < 1e-2


def test_the_distance_from_a_face_is_measured_across_it() -> None:
    """Half of what it is along the ray from the origin where the normal is 60 degrees from that."""
    radii = np.reshape((1.0, 3.0, 5.0), (3, 1, 1))
    faces = OpticalFaces(("inner", "lower", "upper"), (False, True, True), 3, np.tile(1.0 / radii, (1, 9, 9)))
    points = np.array([[0.0, 0.0, 3.2], [0.0, 0.0, 4.5]])
    normals = np.tile([0.0, np.sin(np.pi / 3.0), np.cos(np.pi / 3.0)], (2, 1))
    numbers, apart = faces.sorted(points, normals)
    assert numbers.tolist() == [1, 2] and apart == pytest.approx([0.1, 0.25], rel=1e-9)


def test_the_part_makes_the_light_of_an_endless_lattice() -> None:
    """Two lamps in a period, against the design's sum; one lamp alone makes another pattern."""
    period = (20.0, 20.0 * 3.0**0.5)
    plane = {"kind": "plane", "centre_mm": [0.0, 0.0, 14.0], "width_mm": period[0], "height_mm": period[1]}
    lamps = {"kind": "endless", "lattice": "hexagon", "pitch_mm": 20.0}
    receivers = [plane | {"targets": [{"kind": "disc", "diameter_mm": 12.0}]}]
    spec = small_spec(lamps=lamps, target=None, receivers=receivers, base={"kind": "none"}, **WIDE)
    alone = lens_on({}, [[0.0, 0.0]], [], 0.03)
    lens = Lens(alone.surfaces, spec, 0, FEW)
    light = evaluate(lens, rays=2**15)
    rays = build_source(spec.source).sample(2**12, 5)
    plan = lay_out(*fit_lens(alone), BaseSection(kind="none"))
    stl = stl_bytes(*lens_meshes((plan,), (0,))[0])
    part = read_part_mesh(stl)
    passage = send_through(part, Grid(part.mesh), rays, lens.media)
    together = lamps_together(None, (lens, light), rays)
    assert isinstance(together, LampsApart) and together.count == 2
    (judgement,) = light_of_lamps(together, passage, rays, lens.media, 1)
    assert judgement.nmse_vs_sum < 1.5 * judgement.noise_floor_nmse
    assert judgement.efficiency == pytest.approx(light.efficiency.value, abs=0.01)
    single = replace(together, numbers=0 * together.numbers)
    assert light_of_lamps(single, passage, rays, lens.media, 1)[0].nmse_vs_sum > 5.0 * judgement.nmse_vs_sum
    given = {"rays": rays, "media": lens.media, "screens": screens_of(spec), "lamps": stands_of(spec.all_lamps)}
    stray = trace_stray(stl, **given)
    assert stray.efficiency_sequential == pytest.approx(light.efficiency.value, abs=0.01)
    assert stray.flux.outside_direct == stray.flux.outside_stray == 0.0 < stray.flux.detected_stray
    off = np.sum((stray.first.sequential - light.map) ** 2) / np.sum(light.map**2)
    assert off < 1.5 * judgement.noise_floor_nmse
    assert stray_facts(stray, lens.own_lamps_words)[0].note == "of all lamps of the endless lattice"
