"""Dispersed light through a lens of two concentric spheres, against Bouguer's invariant: n r sin(i) of a ray stays."""

from dataclasses import replace

import numpy as np
import pytest
from landed import exactly
from own_media import with_own
from scenes import small_spec, sphere

from lensforge.light.received_flux import ReceivedFlux
from lensforge.light.table_trace import Scene, trace_tables
from lensforge.optics.material import MATERIALS
from lensforge.optics.media import Media, Medium
from lensforge.optics.pose import Pose
from lensforge.scene.pixel_grid import PixelGrid
from lensforge.scene.receiver_shapes import Plane
from lensforge.sources.build_source import build_source
from lensforge.sources.ray_colours import coloured_by_wavelength
from lensforge.surfaces.bicubic_table import TableGrid, tabulate

INNER, OUTER, Z = 3.0, 6.0, 100.0
RECEIVER = Plane(Pose.facing((0.0, 0.0, 1.0), (0.0, 0.0, Z)), PixelGrid.square(200.0, 16))
SHIFT = (1.2, -0.5, 0.0)


def dispersed_rays(material="PC", count=256):
    """A point source off the centre, blue to red; its rays, and the body that they pass."""
    spectrum = {"kind": "table", "wavelength_nm": [440.0, 460.0, 550.0, 680.0], "weight": [0.0, 1.0, 0.6, 0.0]}
    spec = small_spec(source={"kind": "square", "side_mm": 0.0, "spectrum": spectrum}, lens__material=material)
    rays = build_source(spec.source, spec.lens.dispersion).sample(count, 1)
    rays = replace(rays, origins=rays.origins + np.array(SHIFT))
    return rays.take(rays.directions[:, 2] > 0.3), spec.lens.media.body


def bouguer(rays, index):
    """Where each ray meets z = Z: its foot, seen from the centre, keeps its length h, and turns with the ray."""
    along = np.sum(rays.origins * rays.directions, axis=1, keepdims=True)
    foot = rays.origins - along * rays.directions
    h = np.linalg.norm(foot, axis=1)
    turn = np.arcsin(h / INNER) - np.arcsin(h / INNER / index) + np.arcsin(h / OUTER / index) - np.arcsin(h / OUTER)
    cosine, sine = np.cos(turn)[:, None], np.sin(turn)[:, None]
    outward = foot / h[:, None]
    direction, foot = (
        cosine * rays.directions + sine * outward,
        h[:, None] * (cosine * outward - sine * rays.directions),
    )
    return (foot + ((Z - foot[:, 2]) / direction[:, 2])[:, None] * direction)[:, :2]


def exact(rays, body):
    surfaces = {"inner": sphere(INNER), "outer": sphere(OUTER)}
    return RECEIVER.land(exactly(surfaces, Scene(Media(body), TableGrid(32)), rays))


def fused(rays, body):
    grid = TableGrid(32)
    tables = (tabulate(grid, sphere(radius)) for radius in (INNER, OUTER))
    return RECEIVER.land(trace_tables(tables, Scene(Media(body), grid), rays))


@pytest.mark.parametrize("trace", [exact, fused])
def test_every_colour_lands_where_bouguer_says(trace):
    rays, body = dispersed_rays()
    landings = trace(rays, body)
    assert landings.arrived.all()
    landed = bouguer(rays, body.indices(rays.waves, len(rays)))
    np.testing.assert_allclose(landings.hits, landed, atol=1e-8)
    assert np.linalg.norm(landed - bouguer(rays, body.refractive_index), axis=1).max() > 0.05, (
        "colours must part, or nothing is shown"
    )


@pytest.mark.parametrize("trace", [exact, fused])
def test_equal_indices_for_all_rays_are_the_scene_of_that_index(trace):
    rays, _ = dispersed_rays()
    index = MATERIALS["PC"].index_at(450.0)
    alike = trace(*with_own(rays, Medium(1.1), np.full(len(rays), index)))
    plain = trace(rays, Medium(index))
    np.testing.assert_allclose(alike.hits, plain.hits, atol=1e-10)
    np.testing.assert_allclose(alike.flux, plain.flux, rtol=1e-12)


CIE_1931 = {  # X, Y, Z of 1 W over 683.002 lm, from the tables of CIE 15
    450.0: (0.336200, 0.038000, 1.772110),
    550.0: (0.433450, 0.994950, 0.008750),
    650.0: (0.283500, 0.107000, 0.0),
}


def test_colours_on_a_receiver_are_those_of_three_lines_by_hand():
    """A line of each primary through the spheres: pictures of X, Y, Z against rays placed and weighed by hand."""
    rays, body = dispersed_rays(count=512)
    waves = np.resize(list(CIE_1931), len(rays))
    rays = coloured_by_wavelength(rays.with_wavelengths(waves))
    grid = TableGrid(32)
    exits = trace_tables(tuple(tabulate(grid, sphere(r)) for r in (INNER, OUTER)), Scene(Media(body), grid), rays)
    landings = RECEIVER.land(exits)
    received = ReceivedFlux.none_yet(RECEIVER, 1, (), coloured=True)
    received.add(0, 1.0, RECEIVER, exits, landings, rays.tristimulus)
    x, y = bouguer(rays, body.indices(rays.waves, len(rays))).T
    edges = np.linspace(-100.0, 100.0, RECEIVER.grid.columns + 1)
    for k, picture in enumerate(received.colours):
        weight = landings.flux * [683.002 * CIE_1931[wave][k] for wave in waves]
        by_hand, _, _ = np.histogram2d(y, x, bins=(edges, edges), weights=weight)
        np.testing.assert_allclose(picture[0], by_hand, atol=1e-4 * by_hand.max())
