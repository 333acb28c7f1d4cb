"""The plate of a spec: its size, its lenses, its outline from a STEP file as drawn, and what is refused in one line."""

import json
import re
from math import cos, pi, sin, tan
from pathlib import Path
from typing import Any

import cadquery as cq
import numpy as np
import pytest
from scenes import small_spec

from lensforge.errors import InputError
from lensforge.spec import Spec, load_spec
from lensforge.spec.plate_section import DrawnOutline
from lensforge.surfaces.plane_loop import DRAWING, FOUND, JOB, area_mm2, box_of_loop
from lensforge.surfaces.step_outline import _write_loops

GRID = {"kind": "grid", "columns": 3, "rows": 2, "pitch_mm": [20.0, 30.0]}
ENDLESS = {"kind": "endless", "pitch_mm": 200.0}
MIDDLE = {"place_mm": [10.0, 0.0], "diameter_mm": 4.0}
BOSS = {**MIDDLE, "height_mm": 3.0, "bore_diameter_mm": 2.0, "bore_depth_mm": 4.0}
GATE = {"place_mm": [29.0, 0.0], "width_mm": 6.0}


def plated(plate: dict[str, Any], lamps: dict[str, Any] | None = None) -> Spec:
    changes = {} if lamps is None else {"lamps": lamps}
    return small_spec(plate={"thickness_mm": 2.0, **plate}, **changes)


def size(spec: Spec) -> tuple[float, float]:
    assert spec.plate is not None
    return spec.plate.size_mm(spec.plate.lenses(spec.lamps), spec.constraints.max_radius_mm)


def test_left_out_a_size_follows_from_the_lenses() -> None:
    assert size(plated({}, GRID)) == (2.0 * (20.0 + 7.0 + 2.0), 2.0 * (15.0 + 7.0 + 2.0))
    assert size(plated({"margin_mm": 0.0}, GRID)) == (54.0, 44.0)
    assert size(plated({"kind": "round"}, GRID)) == (2.0 * (25.0 + 9.0),) * 2
    assert size(plated({})) == (18.0, 18.0)


def test_the_plate_takes_the_place_of_the_bases() -> None:
    close = {**GRID, "pitch_mm": 15.0}  # the bases of 16 mm would overlap
    with pytest.raises(InputError, match=r"their rims of base\.kind"):
        small_spec(lamps=close)
    assert plated({}, close).plate is not None


def test_a_plate_of_a_lattice_has_its_rows_and_columns() -> None:
    spec = plated({"columns": 3, "rows": 2}, ENDLESS)
    assert spec.plate is not None
    places = spec.plate.lenses(spec.lamps).places_mm
    assert sorted(places) == [(x, y) for x in (-200.0, 0.0, 200.0) for y in (-100.0, 100.0)]
    staggered = small_spec(
        plate={"thickness_mm": 2.0, "columns": 4, "rows": 5},
        lamps={"kind": "endless", "lattice": "hexagon", "pitch_mm": 100.0},
        target=None,
        receivers=[
            {
                "kind": "plane",
                "centre_mm": [0.0, 0.0, 30.0],
                "width_mm": 100.0,
                "height_mm": 100.0 * 3.0**0.5,
                "targets": [{"kind": "disc", "diameter_mm": 9.0}],
            }
        ],
    )
    assert staggered.plate is not None
    lenses = np.array(staggered.plate.lenses(staggered.lamps).places_mm)
    away = np.sort(np.linalg.norm(lenses[:, None] - lenses, axis=2), axis=1)
    assert len(lenses) == 20
    np.testing.assert_allclose(lenses.mean(axis=0), [-5.0, 0.0], atol=1e-9)
    np.testing.assert_allclose(away[:, 1:3], 100.0)
    assert (np.isclose(away, 100.0).sum(axis=1) == 6).any(), "a lens inside has six neighbours"


def test_a_plate_is_read_as_it_was_written(tmp_path: Any) -> None:
    pin = {"place_mm": [0.0, 0.0], "diameter_mm": 2.0, "height_mm": 1.0}
    boss = {**BOSS, "place_mm": [-10.0, 0.0]}
    spec = plated({"corner_radius_mm": 3.0, "holes": [MIDDLE], "pins": [pin], "bosses": [boss], "gate": GATE}, GRID)
    spec.save(tmp_path / "plate.toml")
    assert Spec.model_validate({**spec.model_dump(exclude_unset=True)}).plate == spec.plate
    assert "[plate]" in (tmp_path / "plate.toml").read_text(encoding="utf-8")


@pytest.mark.parametrize(
    ("plate", "lamps", "message"),
    [
        ({}, ENDLESS, "plate.columns and plate.rows: an infinite lattice needs them; give both"),
        ({"columns": 3, "rows": 3}, GRID, 'they go with lamps of kind = "endless"; leave them out'),
        ({"columns": 3}, ENDLESS, "columns and rows go together"),
        ({"columns": 30, "rows": 30}, ENDLESS, "plate: 900 lenses, at most 400"),
        ({}, {**GRID, "pitch_mm": 13.0}, "13 mm apart, lenses of constraints.max_radius_mm = 7 overlap"),
        ({"width_mm": 50.0, "height_mm": 44.0}, GRID, r"50 x 44: smaller than its lenses, .* 2 mm outside; .* add 4$"),
        ({"kind": "round", "diameter_mm": 60.0}, GRID, "plate.diameter_mm = 60: smaller than its lenses, .* 2 mm outs"),
        ({"margin_mm": 0.0, "corner_radius_mm": 12.0}, GRID, "54 x 44: smaller than its lenses, .* 2.071 mm outside"),
        ({"corner_radius_mm": 25.0}, GRID, "plate.corner_radius_mm = 25: at most 24"),
        ({"kind": "round", "corner_radius_mm": 1.0}, GRID, 'corner_radius_mm = 1 does not go with kind = "round"'),
        ({"diameter_mm": 90.0}, GRID, 'diameter_mm = 90 does not go with kind = "rectangle"'),
        ({"width_mm": 90.0}, GRID, "width_mm and height_mm go together"),
        ({"width_mm": 90.0, "height_mm": 90.0, "margin_mm": 2.0}, GRID, "margin_mm = 2: the size says where"),
        ({"holes": [{**MIDDLE, "place_mm": [28.0, 0.0]}]}, GRID, r"holes.0: .* at \(28, 0\) mm crosses the edge"),
        ({"holes": [{**MIDDLE, "place_mm": [14.0, 12.0]}]}, GRID, r"holes.0: .* a lens of 7 mm .*, 6.708 mm away"),
        ({"pins": [{**MIDDLE, "height_mm": 1.0, "place_mm": [20, 12]}]}, GRID, "pins.0: .* meets a cavity of .* 3 mm"),
        ({"holes": [MIDDLE, {**MIDDLE, "place_mm": [12.0, 0.0]}]}, GRID, "holes.1: .* meets plate.holes.0; move one"),
        ({"thickness_mm": 0.0}, GRID, "plate.thickness_mm = 0"),
        ({"bosses": [{**BOSS, "bore_diameter_mm": 4.0}]}, GRID, "bore_diameter_mm = 4: must be below diameter_mm = 4"),
        ({"bosses": [{**BOSS, "bore_depth_mm": 5.0}]}, GRID, "bore_depth_mm = 5: goes through the plate; .* 5,"),
        ({"bosses": [{**BOSS, "place_mm": [20.0, 8.0]}]}, GRID, "bosses.0: .* meets a lens of 7 mm radius, 7 mm away"),
        ({"gate": {"place_mm": [25.0, 0.0], "width_mm": 6.0}}, GRID, r"place_mm = \(25, 0\): 4 mm inside the outline"),
        ({"gate": {"place_mm": [31.5, 0.0], "width_mm": 6.0}}, GRID, r"\(31.5, 0\): 2.5 mm outside of the outline"),
        ({"gate": {"place_mm": [29.0, 14.0], "width_mm": 6.0}}, GRID, "gate: 2.055 mm from a lens, but clear_mm = 3;"),
        ({"gate": GATE, "holes": [{**MIDDLE, "place_mm": [25, 0]}]}, GRID, "gate: 2 mm from plate.holes.0, but"),
    ],
)  # fmt: skip
def test_a_plate_that_cannot_be_is_refused_in_one_line(
    plate: dict[str, Any], lamps: dict[str, Any], message: str
) -> None:
    with pytest.raises(InputError, match=message) as caught:
        plated(plate, lamps)
    assert "\n" not in str(caught.value)


QUARTER = tan(pi / 8.0)
LAMPS = {"kind": "table", "places_mm": [[0.0, 0.0], [24.0, -1.0], [-1.0, 17.0]]}


def l_shape(height_mm: float = 5.0) -> cq.Workplane:
    """A flat L off the origin, an arc in its inner corner and on an outer one, with a round hole and a slot."""
    inner, outer = 4.0 * (1.0 - 0.5**0.5), 6.0 * (1.0 - 0.5**0.5)
    around = cq.Workplane("XY").workplane(offset=height_mm).moveTo(-12, -10).lineTo(40, -10).lineTo(40, 8).lineTo(14, 8)
    around = around.threePointArc((10 + inner, 8 + inner), (10, 12)).lineTo(10, 36).lineTo(-6, 36)
    flat = around.threePointArc((-12 + outer, 36 - outer), (-12, 30)).close().extrude(-2.0)
    above = flat.faces(">Z").workplane(origin=(0, 0, height_mm))
    drilled = above.pushPoints([(34, 4)]).hole(4.0).faces(">Z").workplane(origin=(0, 0, height_mm))
    return drilled.pushPoints([(-2, 29)]).slot2D(8, 3, 30).cutThruAll()


AREA = 52.0 * 18.0 + 22.0 * 28.0 + (4.0**2 - 6.0**2) * (1.0 - pi / 4.0) - 4.0 * pi - (5.0 * 3.0 + pi * 1.5**2)


def step(shape: Any, path: Path) -> Path:
    cq.exporters.export(shape if isinstance(shape, cq.Workplane) else cq.Workplane(obj=shape), str(path))
    return path


def read_here(shape: Any, folder: Path) -> DrawnOutline:
    """The outline as the child finds it, here."""
    step(shape, folder / DRAWING)
    (folder / JOB).write_text(json.dumps({"origin": "plate.step", "remedy": "export it again"}))
    _write_loops(folder)
    return DrawnOutline(loops_mm=json.loads((folder / FOUND).read_text()))


def wires_of(flat: cq.Workplane) -> cq.Compound:
    return cq.Compound.makeCompound(flat.faces(">Z").val().Wires())


@pytest.mark.parametrize("kind", ["solid", "face", "wires", "from below", "mirrored"])
def test_an_outline_is_read_as_it_is_drawn(kind: str, tmp_path: Path) -> None:
    flat, mirror = l_shape(), 1.0
    shape: Any = {"solid": flat, "face": flat.faces(">Z"), "wires": wires_of(flat)}.get(kind, flat)
    if kind == "from below":
        shape = flat.faces("<Z")
    if kind == "mirrored":
        shape, mirror = flat.mirror("YZ"), -1.0
    outline = read_here(shape, tmp_path)
    assert [len(corners) for corners in outline.loops_mm] == [8, 4, 2] and len(outline.slots) == 1
    openings = sum(pi * radius**2 for _, radius in outline.circles) + sum(map(area_mm2, outline.slots))
    assert area_mm2(outline.outer) - openings == pytest.approx(AREA, rel=1e-12)
    ((centre, radius),) = outline.circles
    assert (*centre, radius) == pytest.approx((mirror * 34.0, 4.0, 2.0), abs=1e-9)
    (low, high), x = box_of_loop(outline.outer), sorted((mirror * -12.0, mirror * 40.0))
    assert (*low, *high) == pytest.approx((x[0], -10.0, x[1], 36.0), abs=1e-9)


def test_a_spec_has_the_outline_itself_and_needs_the_file_no_more(tmp_path: Path) -> None:
    """Read in the child process; its name counts from the folder of the spec."""
    file = step(l_shape(), tmp_path / "plate.step")
    spec = small_spec(lamps=LAMPS, plate={"kind": "step", "outline": str(file), "thickness_mm": 2.0})
    spec.save(tmp_path / "kept.toml")
    file.unlink()
    again = load_spec(tmp_path / "kept.toml")
    assert again.plate == spec.plate
    assert spec.plate is not None and isinstance(spec.plate.outline, DrawnOutline)
    assert (spec.plate.outline.origin, len(spec.plate.outline.sha256)) == ("plate.step", 64)
    ((name, hole),) = spec.plate.marks
    assert name == "hole 1 of plate.outline" and spec.plate.all_holes == (hole,)
    assert (*hole.place_mm, hole.diameter_mm) == pytest.approx((34.0, 4.0, 4.0), abs=1e-9)
    assert spec.plate.size_mm(spec.all_lamps, 7.0) == (52.0, 46.0)


def _tilted() -> cq.Workplane:
    return l_shape().rotate((0, 0, 0), (1, 0, 0), 10.0)


def circle_at(x: float) -> cq.Wire:
    return cq.Wire.makeCircle(4.0, cq.Vector(x, 0.0, 0.0), cq.Vector(0.0, 0.0, 1.0))


REFUSED: dict[str, tuple[Any, str]] = {
    "tilted": (_tilted, "none of its .* faces is a plane of one z; draw the outline in the x-y plane, and export"),
    "bodies": (lambda: cq.Workplane().pushPoints([(0, 0), (20, 0)]).rect(9, 9).extrude(1), "2 bodies, an outline is"),
    "steps": (
        lambda: cq.Workplane().rect(30, 9).extrude(2).faces(">Z").workplane().rect(5, 9).cutBlind(-1),
        "2 plane faces at its top, z = 2 mm, an outline is one",
    ),
    "faces": (lambda: l_shape().faces("|Z"), "2 plane faces of one z, an outline is one"),
    "spline": (
        lambda: cq.Workplane().spline([(0, 0), (9, 2), (8, 9)], periodic=True).close().extrude(1),
        "a curve that is no line or arc .BSplineCurve. from .* draw it by lines and arcs",
    ),
    "open": (
        lambda: cq.Workplane().polyline([(0, 0), (9, 0), (9, 9), (0, 8)]).wire(),
        r"its outline is not closed: it ends 8 mm .* at \(.*, 8\) mm; close it",
    ),
    "wires": (
        lambda: cq.Compound.makeCompound([circle_at(0.0), circle_at(9.0)]),
        "holds several outlines, one of them at",
    ),
    "crossing": (lambda: cq.Workplane().polyline([(0, 0), (9, 9), (9, 0), (0, 7)]).close(), "crosses itself"),
    "star": (  # around its middle twice: its area counts there twice
        lambda: cq.Workplane().polyline([(9 * cos(0.8 * pi * k), 9 * sin(0.8 * pi * k)) for k in range(5)]).close(),
        "crosses itself",
    ),
    "upright": (lambda: cq.Workplane("XZ").rect(9, 9), "between z = -4.5 and 4.5 mm, must have one z"),
    "there and back": (lambda: cq.Workplane().polyline([(0, 0), (9, 0), (0, 0)]).wire(), r"\(0, 0\) mm has no area"),
    "tiny": (lambda: cq.Wire.makeCircle(1e-6, cq.Vector(), cq.Vector(0, 0, 1)), "has 0 edges of more than 1e-05 mm"),
    "far": (lambda: cq.Wire.makeCircle(2e4, cq.Vector(), cq.Vector(0, 0, 1)), "outline reaches beyond 10000 mm"),
    "point": (lambda: cq.Vertex.makeVertex(1, 2, 3), "holds no face and no wire"),
}  # fmt: skip


@pytest.mark.parametrize("name", REFUSED)
def test_what_is_no_outline_is_refused_in_one_line(name: str, tmp_path: Path) -> None:
    make, message = REFUSED[name]
    with pytest.raises(InputError, match=message) as caught:
        read_here(make(), tmp_path)
    assert "\n" not in str(caught.value) and str(caught.value).startswith("plate.step: ")


def test_a_face_whose_edges_cannot_be_read_is_refused_in_one_line(tmp_path: Path) -> None:
    content = step(l_shape().faces(">Z"), tmp_path / "face.step").read_bytes()
    (tmp_path / JOB).write_text(json.dumps({"origin": "plate.step", "remedy": "export it again"}))
    (tmp_path / DRAWING).write_bytes(re.sub(rb"ADVANCED_FACE\('',\([^)]*\)", b"ADVANCED_FACE('',()", content))
    with pytest.raises(
        InputError, match=r"^plate.step: its plane face has no edges that can be read; export it again$"
    ):
        _write_loops(tmp_path)


def drawn(loops: list[Any], **plate: Any) -> Spec:
    outline = {"origin": "plate.step", "loops_mm": loops}
    return small_spec(lamps=LAMPS, plate={"kind": "step", "outline": outline, "thickness_mm": 2.0, **plate})


L_LOOP = [
    [-12, -10, 0], [40, -10, 0], [40, 8, 0], [14, 8, -QUARTER], [10, 12, 0],
    [10, 36, 0], [-6, 36, QUARTER], [-12, 30, 0],
]  # fmt: skip
PIN = {"diameter_mm": 3.0, "height_mm": 1.0}
HOLE = [[36, 4, 1], [32, 4, 1]]
SLOT = [[10, -9, 0], [14, -9, 0], [14, 7, 0], [10, 7, 0]]  # between two lenses


@pytest.mark.parametrize(
    ("loops", "plate", "message"),
    [
        ([L_LOOP], {"kind": "round"}, 'kind = "step" and outline go together'),
        ([L_LOOP], {"outline": None}, 'kind = "step" and outline go together'),
        ([L_LOOP], {"margin_mm": 2.0}, 'margin_mm = 2 does not go with kind = "step"'),
        ([L_LOOP], {"width_mm": 9.0}, 'width_mm = 9 does not go with kind = "step"'),
        ([L_LOOP[::-1]], {}, "loops_mm.0: has no area, or runs clockwise"),
        ([[*L_LOOP[:4], [3, 12, 0], [3, 36, 0], *L_LOOP[6:]]], {}, r"\(-1, 17\) mm ends 3 mm outside that"),
        ([L_LOOP, [[x - 5, y, b] for x, y, b in SLOT]], {}, r"\(0, 0\) mm ends 2 mm outside that of plate.step"),
        ([L_LOOP, [[x - 12, y, b] for x, y, b in HOLE]], {}, r"hole 1 of plate.outline: .* meets a lens of 7 mm"),
        ([L_LOOP], {"pins": [{**PIN, "place_mm": [12, 10]}]}, r"pins.0: .* crosses the edge"),
        ([L_LOOP, SLOT], {"pins": [{**PIN, "place_mm": [9, 0]}]}, r"pins.0: .* crosses the edge"),
        ([L_LOOP], {"gate": {"place_mm": [20, 7], "width_mm": 3}}, r"gate.place_mm = \(20, 7\): 1 mm inside"),
    ],
)  # fmt: skip
def test_what_does_not_go_with_an_outline_is_refused(loops: list[Any], plate: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=message) as caught:
        drawn(loops, **plate)
    assert "\n" not in str(caught.value)


def test_distances_from_a_drawn_edge_are_those_by_hand() -> None:
    spec = drawn([L_LOOP, HOLE, SLOT])
    assert spec.plate is not None
    distances = [
        spec.plate.to_edge_mm(place, (0.0, 0.0)) for place in [(9.0, 7.0), (24.0, -1.0), (0.0, 0.0), (-13.0, 0.0)]
    ]
    np.testing.assert_allclose(distances, [1.0, 9.0, 10.0, -1.0], atol=1e-12)
