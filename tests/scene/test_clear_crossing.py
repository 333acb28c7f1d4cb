"""Light across clear bodies by closed forms: a plate, a rod, a ball of a file, corners in which it is trapped."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
from test_housing import TURNED, from_point, housing_of

from lensforge.cad.mesh import BodyMesh
from lensforge.cad.mesh_files import stl_bytes
from lensforge.optics.pose import Pose
from lensforge.proof.obstacles import Met, ObstacleBody, Obstacles
from lensforge.proof.proof_inputs import _obstacle
from lensforge.scene.exit_rays import ExitRays
from lensforge.scene.housing import Housing, Shadow
from lensforge.scene.housing_mesh import mesh_of
from lensforge.spec.housing_sections import HousingBox, HousingCylinder, HousingFile, HousingSection
from lensforge.surfaces.solid_file import SolidMesh

INDEX, PER_MM = 1.58, 0.02
CLEAR: dict[str, Any] = {"surface": "clear", "refractive_index": INDEX, "absorption_per_mm": PER_MM, **TURNED}
FRAME = Pose.of_tilts((1.0, 2.0, -3.0), (5.0, -8.0), 20.0)


def crossed(housing: Housing, rays: ExitRays) -> tuple[Shadow, np.ndarray, np.ndarray, np.ndarray]:
    """Shadow, rows, and the directions and flux of the rays that go on, by a housing that stands in a turned frame."""
    seen = housing.seen_from(FRAME)
    local = replace(
        rays, points=FRAME.to_local_points(rays.points), directions=FRAME.to_local_directions(rays.directions)
    )
    shadow = seen.shadow(local.points, local.directions, np.full(len(rays.flux), np.inf))
    rows, behind = seen.reflected(local, shadow)
    points = FRAME.points(behind.points)
    return shadow, rows, np.hstack([points, FRAME.directions(behind.directions)]), behind.flux


def at(body: HousingSection, points: np.ndarray, directions: np.ndarray) -> ExitRays:
    """Rays of 1 W each, given in the frame of a body."""
    count = len(points)
    ways = body.pose.points(points), body.pose.directions(directions)
    return ExitRays(*ways, np.ones(count), np.zeros(count), np.zeros(count, dtype=np.int8))


def transmitted(sine: np.ndarray, index: float = INDEX) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Shares across and in the plane of incidence that pass a face, by Fresnel; the cosine behind."""
    c = np.sqrt(1.0 - sine**2)
    behind = np.sqrt(1.0 - (sine / index) ** 2)
    across = 1.0 - ((c - index * behind) / (c + index * behind)) ** 2
    along = 1.0 - ((index * c - behind) / (index * c + behind)) ** 2
    return across, along, behind


def test_a_plate_moves_light_aside_and_loses_what_both_faces_reflect_and_the_way_absorbs() -> None:
    plate = HousingBox(name="plate", size_mm=(90.0, 90.0, 6.0), **CLEAR)
    rng = np.random.default_rng(1)
    directions = rng.normal(size=(500, 3)) * [0.6, 0.6, 0.0] + [0.0, 0.0, 1.0]
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    starts = np.hstack([rng.uniform(-8.0, 8.0, (500, 2)), np.full((500, 1), -9.0)])
    shadow, rows, ways, flux = crossed(housing_of(plate), at(plate, starts, directions))
    assert len(rows) == 500 and not shadow.again.any()
    sine = np.hypot(directions[:, 0], directions[:, 1])
    across, along, behind = transmitted(sine)
    wanted = 0.5 * (across**2 + along**2) * np.exp(-PER_MM * 6.0 / behind)
    assert shadow.onward == pytest.approx(wanted, rel=2e-6) and flux == pytest.approx(shadow.onward)
    assert wanted.min() < 0.8
    going = plate.pose.to_local_directions(ways[:, 3:])
    assert going == pytest.approx(directions, abs=1e-12)
    outside = directions[:, :2] / directions[:, 2:]
    inside = directions[:, :2] / (INDEX * behind[:, None])
    assert plate.pose.to_local_points(ways[:, :3])[:, :2] == pytest.approx(
        starts[:, :2] + 6.0 * outside + 6.0 * inside, abs=1e-5
    )


@pytest.mark.parametrize("kind", ["rod", "ball"])
def test_a_round_body_turns_light_as_its_circle_does(kind: str, tmp_path: Path) -> None:
    """By 2 (i - r), and from facet to facet by less than 0.3 degrees more or less, those of a file 0.9."""
    if kind == "rod":
        body: HousingSection = HousingCylinder(name="rod", radius_mm=8.0, length_mm=60.0, **CLEAR)
    else:
        ball = trimesh.creation.icosphere(subdivisions=6, radius=8.0)
        mesh = BodyMesh(ball.vertices, ball.faces, np.zeros(len(ball.faces), dtype=np.int64), ("ball",), 0)
        (tmp_path / "ball.stl").write_bytes(stl_bytes(mesh))
        body = HousingFile(name="ball", file=tmp_path / "ball.stl", **CLEAR)
    aside = np.linspace(-6.5, 6.5, 301)
    none = np.zeros_like(aside)
    directions = np.tile([1.0, 0.0, 0.0], (301, 1))
    shadow, rows, ways, _ = crossed(
        housing_of(body), at(body, np.stack([none - 30.0, aside, none], axis=1), directions)
    )
    assert len(rows) == 301
    going = body.pose.to_local_directions(ways[:, 3:])
    turned = np.arctan2(-going[:, 1], going[:, 0])
    sine = aside / 8.0
    wanted = 2.0 * (np.arcsin(sine) - np.arcsin(sine / INDEX))
    error = np.degrees(np.abs(turned - wanted)).max()
    assert 0.0 < error < {"rod": 0.3, "ball": 0.9}[kind] and np.degrees(wanted).max() > 40.0
    across, along, behind = transmitted(np.abs(sine))
    flux = 0.5 * (across**2 + along**2) * np.exp(-PER_MM * 16.0 * behind)
    assert shadow.onward == pytest.approx(flux, abs=0.01)


def test_the_index_of_a_material_is_that_at_the_d_line_in_the_light_and_in_the_proof() -> None:
    pane = HousingBox(name="pane", size_mm=(9.0, 9.0, 1.0), surface="clear", material="PMMA")
    wall = HousingBox(name="wall", size_mm=(9.0, 9.0, 1.0), centre_mm=(0.0, 0.0, 9.0))
    assert housing_of(wall, pane).finishes.indices == pytest.approx([0.0, 1.4925], abs=1e-4)
    mesh = SolidMesh(np.zeros((0, 3)), np.zeros((0, 3), dtype=np.int64))
    assert [_obstacle(body, mesh).refractive_index for body in (wall, pane)] == pytest.approx([0.0, 1.4925], abs=1e-4)


def test_light_that_a_corner_reflects_totally_stays_in_it() -> None:
    """Behind a face it is within 39.3 degrees of the normal, and meets the side at more than 50.7."""
    bar = HousingBox(name="bar", size_mm=(4.0, 4.0, 200.0), **CLEAR)
    steep = np.array([[0.0, 0.0, 1.0], [0.3, 0.0, 0.95], [0.0, 0.7, 0.71]])
    steep /= np.linalg.norm(steep, axis=1, keepdims=True)
    shadow, rows, _, _ = crossed(housing_of(bar), at(bar, np.tile([0.2, 0.1, -101.0], (3, 1)), steep))
    assert shadow.met.all() and (shadow.onward[1:] == 0.0).all() and rows.tolist() == [0]


def test_what_leaves_a_body_and_meets_another_is_lost_and_so_is_what_bodies_share() -> None:
    plate, wall = (
        HousingBox(name=name, size_mm=(60.0, 60.0, 4.0), centre_mm=(0.0, 0.0, z), **more)
        for name, z, more in (
            ("plate", 20.0, {"surface": "clear", "refractive_index": 1.5}),
            ("wall", 23.0, {}),
        )
    )
    rays = at(HousingBox(name="it", size_mm=(1.0, 1.0, 1.0)), np.zeros((1, 3)), np.array([[0.0, 0.0, 1.0]]))
    shadow, rows, _, _ = crossed(housing_of(plate, wall), rays)
    assert shadow.bodies.tolist() == [0] and shadow.onward.tolist() == [0.0] and not len(rows)
    behind = wall.changed(centre_mm=(0.0, 0.0, 30.0))
    shadow, rows, _, flux = crossed(housing_of(plate, behind), rays)
    assert flux == pytest.approx([0.96**2]) and len(rows) == 1


def test_a_search_takes_clear_bodies_for_air() -> None:
    plate = HousingBox(name="plate", size_mm=(90.0, 90.0, 6.0), **CLEAR)
    post = HousingBox(name="post", size_mm=(6.0, 9.0, 60.0), centre_mm=(9.0, -12.0, 45.0))
    rays = from_point(3000)
    reach = np.full(3000, np.inf)
    both, alone = (housing_of(*bodies) for bodies in ((plate, post), (post,)))
    assert housing_of(plate).opaque is None and housing_of(plate).black is None
    assert alone.opaque is alone and both.opaque is both.opaque
    opaque = both.opaque
    assert opaque is not None
    seen = opaque.faded(2.0).shadow(rays.points, rays.directions, reach)
    wanted = alone.faded(2.0).shadow(rays.points, rays.directions, reach)
    assert (seen.weights == wanted.weights).all() and (seen.bodies == np.where(wanted.met, 1, -1)).all()
    assert wanted.met.any()


def test_the_proof_takes_the_same_way_by_a_law_of_its_own() -> None:
    """Through a rod, a plate and a bar of which much is trapped; at right angles, too."""
    bodies = (
        HousingCylinder(name="rod", radius_mm=8.0, length_mm=60.0, **CLEAR),
        HousingBox(name="bar", size_mm=(9.0, 9.0, 70.0), **CLEAR | {"centre_mm": (40.0, 0.0, 60.0)}),
    )
    obstacles = Obstacles.of(
        [
            ObstacleBody(
                *mesh_of(body),
                body.rotate_z_deg,
                body.tilt_deg,
                body.centre_mm,
                refractive_index=INDEX,
                absorption_per_mm=PER_MM,
            )
            for body in bodies
        ]
    )
    assert obstacles is not None
    rays = from_point(6000, 4)
    housing = housing_of(*bodies)
    shadow = housing.shadow(rays.points, rays.directions, np.full(6000, np.inf))
    rows, behind = housing.reflected(rays, shadow)
    met = obstacles.met(rays.points, rays.directions, np.full(6000, np.inf))
    assert ((met.triangles >= 0) == shadow.met).all() and met.onward == pytest.approx(shadow.onward, abs=1e-9)
    assert 100 < len(rows) < shadow.met.sum()
    ways = obstacles.reflect(rays.points[rows], rays.directions[rows], met.take(rows), np.zeros((len(rows), 2)))
    assert ways[0] == pytest.approx(behind.points, abs=1e-6) and ways[1] == pytest.approx(behind.directions, abs=1e-8)
    assert isinstance(met, Met)
