"""The four-face body as a part: its files, and the referees against the design's tracer, ray by ray."""

from functools import cache
from types import SimpleNamespace

import numpy as np
import pytest
from chains import clear, collimator, mirrors, tables_of, upwards
from scenes import small_spec
from tir_lenses import spot_lens

from lensforge.cad.body_export import build_body
from lensforge.cad.mesh_files import stl_bytes
from lensforge.cad.step import step_bytes
from lensforge.kernels.fate import Fate
from lensforge.light.table_trace import Scene, TracedBundle
from lensforge.optics.face_roles import OUTSIDE
from lensforge.proof.casts import expected_of, traced_exactly
from lensforge.proof.facet_casting import Grid
from lensforge.proof.part_mesh import read_part_mesh
from lensforge.proof.proof_inputs import optical_at_work, optical_of
from lensforge.proof.sequential_cast import CastBody, CastFate, MeshBody, send_through_body
from lensforge.proof.step_body import StepBody
from lensforge.scene.body import Body
from lensforge.scene.lens import Lens
from lensforge.scene.rough_faces import with_facets
from lensforge.sources.build_source import build_source
from lensforge.spec import BaseSection
from lensforge.surfaces.asphere import sphere
from lensforge.surfaces.bicubic_table import TableGrid

BODY = collimator(0.05)
EVENTS = 4
MEDIA = {"totally reflecting": clear(absorption=0.01), "silvered": clear(coatings=mirrors(0.9, wall=OUTSIDE))}
RAYS = upwards(250, 11, 0.5)
GRID = TableGrid(601)
TABLES = tables_of(BODY, GRID)
# By the STEP file to the error of the design's tables, by the mesh to that of its facets, 0.9 um: point (mm),
# direction, flux (W).
LIMITS = {"step": (1e-4, 4e-4, 1e-4), "stl": (2e-4, 1e-4, 5e-4)}


@cache
def files() -> dict[str, bytes]:
    built = build_body(BODY, BaseSection(kind="cylinder", diameter_mm=16.0, height_mm=2.0))
    return {"step": step_bytes(built.solid, "collimator"), "stl": stl_bytes(built.mesh)}


@cache
def cast_body(file: str) -> CastBody:
    """The body in a file, read once."""
    optical = optical_of(BODY, EVENTS)
    if file == "step":
        return StepBody(files()["step"], optical)
    part = read_part_mesh(files()["stl"], optical)
    return MeshBody(part, Grid(part.mesh))


@cache
def design_of(kind: str) -> TracedBundle:
    return TracedBundle.of(TABLES, Scene(MEDIA[kind], GRID, True, None, BODY.chain(EVENTS)), RAYS)


@pytest.mark.parametrize("file", ["step", "stl"])
@pytest.mark.parametrize("kind", MEDIA)
def test_the_exported_body_sends_every_ray_where_the_design_does(kind: str, file: str) -> None:
    design = design_of(kind)
    passage = send_through_body(cast_body(file), RAYS, MEDIA[kind])
    left = design.exits.fates == Fate.LEFT_LENS
    assert left.sum() > 220 and np.array_equal(passage.fates == CastFate.LANDED, left)
    assert (design.met[left, 2] >= 0).mean() > 0.1, "three events and more"
    point, direction, flux = LIMITS[file]
    assert np.linalg.norm(passage.points - design.exits.points, axis=1)[left].max() < point
    assert np.abs(passage.directions - design.exits.directions)[left].max() < direction
    assert np.abs(passage.flux - design.exits.flux)[left].max() < flux
    assert np.array_equal(passage.met[left], design.exits.met[left])


def test_the_way_of_the_design_is_told_by_the_faces_of_the_part() -> None:
    """Light that lands has passed cap and exit, or the side, the wall, which reflects it, and the exit."""
    lens = spot_lens()
    light = SimpleNamespace(pixels=8, receivers=[SimpleNamespace(map=np.ones((8, 8)))])
    optical = optical_of(Body(lens.body.faces[::-1]), lens.events)  # in another order than the design has them
    rays = build_source(lens.spec.source, None).sample(1000, 3)
    (expected,) = expected_of(lens, light, rays, optical)  # type: ignore[arg-type]  # of which no more is asked
    landed = ~np.isnan(expected.landings[:, 0])
    ways = [tuple(optical.names[face] for face in row if face >= 0) for row in expected.met[landed]]
    count = {way: ways.count(way) for way in set(ways)}
    usual = {way: count[way] for way in (("cap", "exit"), ("side", "wall", "exit"))}
    assert min(usual.values()) > 100 and sum(usual.values()) > 0.99 * landed.sum() > 900


def test_the_landings_of_the_design_are_by_the_faces_that_are_asked_for() -> None:
    """Of a frosted lens with its facets, or where it is polished, and with tables of another lens."""
    frosted, plain, wider = (
        Lens.double(sphere(2.0), sphere(radius), small_spec(**changes), 0, "draft")
        for radius, changes in (
            (6.0, {"lens__outer__scatter": {"kind": "gaussian", "sigma_deg": 5.0}}), (6.0, {}), (6.3, {})
        )
    )  # fmt: skip
    rays = with_facets(upwards(200, 5, 0.5), 1)
    optical = optical_at_work(plain)

    def hits(lens: Lens, **asked: object) -> np.ndarray:
        (expected,) = expected_of(lens, None, rays, optical, **asked)
        return expected.landings

    polished = hits(plain)
    np.testing.assert_array_equal(hits(frosted, polished=True), polished)
    np.testing.assert_array_equal(hits(plain, traced=traced_exactly(wider)), hits(wider))
    for other in (hits(frosted), hits(wider)):
        assert np.nanmedian(np.linalg.norm(other - polished, axis=1)) > 0.1
