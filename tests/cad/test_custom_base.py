from pathlib import Path

import numpy as np
import pytest
from geometry_lenses import exact_volume, make_lens, plan_of
from nightly import first_by_day

from lensforge.cad.custom_base import join_base, join_mesh, read_custom_base
from lensforge.cad.mesh import build_mesh, check_closed
from lensforge.cad.mesh_files import parse_3mf
from lensforge.cad.part_export import build_part
from lensforge.cad.plan import INNER, OUTER
from lensforge.cad.solid import Solid, build_solid
from lensforge.cad.step import parse_step, step_bytes
from lensforge.errors import InputError
from lensforge.spec import BaseSection, load_spec
from lensforge.surfaces.step_file import parts_of

INNER_MM = 0.8
OUTER_MM = 2.45
HERE = pytest.mark.usefixtures("cad_read_here")
NIGHTLY_TOO = pytest.mark.nightly("a case like another one")


def plate(bore, size=8.0, top=0.0, x=0.0, holes=0, floor=False):
    """A square plate, 2 mm thick, bored along the axis, with screw holes near its corners."""
    import cadquery as cq

    body = cq.Workplane("XY").rect(size, size).extrude(-2.0)
    body = body.cut(cq.Workplane("XY").circle(bore / 2.0).extrude(-1.0 if floor else -2.0))
    for k in range(holes):
        place = 0.38 * size * np.array([(1, 1), (-1, 1), (-1, -1), (1, -1)])[k]
        body = body.cut(cq.Workplane("XY").center(*place).circle(0.4).extrude(-2.0))
    return body.translate((x, 0.0, top)).val()


def written(shape, path):
    import cadquery as cq

    cq.exporters.export(cq.Workplane(shape), str(path))
    return path


def bare(relative=0.01):
    lens = make_lens(INNER_MM, OUTER_MM, relative)
    return lens, plan_of(lens.inner, lens.outer, BaseSection(kind="none"))


@pytest.fixture(scope="module")
def bare_solid():
    return build_solid(bare()[1])


@HERE
@pytest.mark.parametrize(
    ("bore", "size", "holes"),
    first_by_day(1, [(3.0, 8.0, 3), (1.9, 4.5, 0), (1.9, 20.0, 0)]),
    ids=["screwed", "crossing", "ledge"],
)
def test_a_base_from_a_file_is_joined_to_one_solid_and_one_mesh(tmp_path, bore, size, holes):
    path = written(plate(bore, size, holes=holes), tmp_path / "clamp.step")
    lens = make_lens(INNER_MM, OUTER_MM, 0.01, base={"kind": "step", "file": str(path)})
    part = build_part(lens, rings=24)
    assert [str(criterion) for criterion in part.criteria if not criterion.holds] == []
    below = 2.0 * (size**2 - np.pi * bore**2 / 4.0 - holes * np.pi * 0.4**2)
    volume = exact_volume(lens.inner, lens.outer, BaseSection(kind="none")) + below
    assert part.volume_mm3 == pytest.approx(volume, rel=2e-9)
    assert part.genus == holes
    again = parse_step(part.step)
    assert again.valid
    assert {"OPTICAL_INNER", "OPTICAL_OUTER", "RIM"} < {name.split("_1")[0] for name in again.faces}
    for name in ("OPTICAL_INNER", "OPTICAL_OUTER"):
        assert len(parts_of(again.faces[name], "WIRE")) == 1
    closure = check_closed(*parse_3mf(part.threemf))
    assert (closure.watertight, closure.genus) == (True, holes)


@HERE
def test_the_union_keeps_every_vertex_of_the_optical_faces(tmp_path):
    _, plan = bare()
    mesh = build_mesh(plan, 24)
    joined = join_mesh(mesh, read_custom_base(written(plate(1.9, 4.5), tmp_path / "clamp.step")), 1e-3)
    for name in (INNER, OUTER):
        before, after = ({tuple(v) for v in m.vertices[m.part(name)].reshape(-1, 3)} for m in (mesh, joined))
        assert before <= after
        assert all(z == 0.0 for _, _, z in after - before), "what is new lies where the base crosses the rim"


@HERE
def test_the_names_of_the_file_s_faces_are_kept(tmp_path, bare_solid):
    shape = plate(3.0)
    faces = {"SEAT": shape.Faces()[0].wrapped, "HOLD": shape.Faces()[-1].wrapped}
    (tmp_path / "clamp.step").write_bytes(step_bytes(Solid(shape.wrapped, faces), "clamp"))
    joined = join_base(bare_solid, read_custom_base(tmp_path / "clamp.step"))
    assert {"SEAT", "HOLD"} <= set(joined.faces)
    assert len(joined.faces) == len(parts_of(joined.shape, "FACE"))


@HERE
@pytest.mark.parametrize(
    ("shape", "word"),
    [
        (plate(3.0, top=0.5), r"its top is at z = 0\.5 mm, .* move it by -0\.5 mm"),
        (plate(3.0, top=-0.5), r"its top is at z = -0\.5 mm, .* move it by 0\.5 mm"),
        (plate(1.0), r"covers 6\d\.\d % of the cavity's opening.*circle of 1\.6"),
        (plate(6.0), r"does not meet the lens, whose rim lies in z = 0 between 0\.8\d* and 2\.4"),
        (plate(3.0, floor=True), r"closes the cavity"),
        (plate(3.0).fuse(plate(3.0, x=30.0)), r"holds 2 solids"),
        pytest.param(plate(3.0, x=1.2), r"covers .* of the cavity's opening", marks=NIGHTLY_TOO),
        pytest.param(plate(3.0).Faces()[0], r"holds 0 solids", marks=NIGHTLY_TOO),
    ],
    ids=["high", "low", "narrow", "wide", "floor", "two", "aside", "none"],
)
def test_a_base_that_is_not_under_the_lens_is_refused_in_one_line(tmp_path, bare_solid, shape, word):
    path = written(shape, tmp_path / "clamp.step")
    with pytest.raises(InputError, match=rf"clamp\.step: {word}") as caught:
        join_base(bare_solid, read_custom_base(path))
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("content", [None, "solid nothing"], ids=["missing", "no STEP"])
def test_a_file_that_is_no_step_is_refused_in_one_line(tmp_path, content):
    path = tmp_path / "clamp.step"
    if content:
        path.write_text(content, encoding="utf-8")
    with pytest.raises(InputError, match=r"clamp\.step: (no such file; base\.file|not readable as STEP \(it)"):
        read_custom_base(path)


def test_the_file_is_found_beside_the_spec(tmp_path, examples):
    text = (examples / "cross.toml").read_text(encoding="utf-8")
    (tmp_path / "own.toml").write_text(text + '[base]\nkind = "step"\nfile = "clamp.step"\n', encoding="utf-8")
    (tmp_path / "clamp.step").touch()
    assert load_spec(tmp_path / "own.toml").base.file == (tmp_path / "clamp.step").resolve()
    assert isinstance(load_spec(tmp_path / "own.toml").base.file, Path)


def test_the_genus_of_a_solid_counts_its_holes():
    import cadquery as cq

    box = cq.Workplane("XY").box(4.0, 4.0, 1.0)
    shapes = {
        0: box,
        2: box.faces(">Z").workplane().pushPoints([(-1.0, 0.0), (1.0, 0.0)]).hole(0.8),
        1: cq.Workplane(cq.Solid.makeTorus(3.0, 1.0)),
    }
    for holes, shape in shapes.items():
        assert Solid(shape.val().wrapped, {}).genus == holes
    assert Solid(cq.Solid.makeSphere(1.0, angleDegrees1=-90.0).wrapped, {}).genus == 0
