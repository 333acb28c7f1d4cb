"""Faults of a file are named: unit, place, turn, mirror image, sense of the facets, another lens."""

from dataclasses import replace

import numpy as np
import pytest
import trimesh
from lens_meshes import Quadric, lambertian, lens_mesh, oracle

from lensforge.optics.media import Media
from lensforge.proof.part_comparison import Expected
from lensforge.proof.part_mesh import mesh_size
from lensforge.proof.pose_diagnosis import candidates
from lensforge.proof.receiver_screen import Screen
from lensforge.proof.verification import verify_part

INDEX, DISTANCE = 1.4936, 150.0
SCREEN = Screen.square(DISTANCE, 300.0, 16)
INNER = Quadric((0.3, -0.2, 0.1), (6.0, 6.5, 5.5))
OUTER = Quadric((-0.4, 0.3, -0.5), (13.7, 13.0, 14.0))
RAYS = lambertian(1500, 2.0, seed=1)
HITS, FLUX, _ = oracle(INNER, OUTER, RAYS, INDEX, DISTANCE)
EXPECTED = Expected(SCREEN, SCREEN.irradiance(HITS, FLUX), HITS, FLUX)


def mesh(outer=OUTER, rings=24):
    return lens_mesh(INNER.radius, outer.radius, rings, (16.0, 2.0))


def remedies(part):
    result = verify_part(
        part.export(file_type="stl"),
        rays=RAYS,
        media=Media(INDEX),
        expected=[EXPECTED],
        plain_rays=1,
        exported=mesh_size(mesh()),
        chord_mm=0.01,
    )
    return {each.name: each.remedy for each in result.criteria if not each.passed}


def scaled(by):
    return mesh().apply_scale(by)


def turned(degrees, axis):
    return mesh().apply_transform(trimesh.transformations.rotation_matrix(np.radians(degrees), axis))


def mirrored(axis):
    return mesh().apply_transform(np.diag([*(1.0 - 2.0 * np.eye(3)[axis]), 1.0]))  # trimesh flips the facets, too


def inverted(part):
    part.invert()
    return part


FAULTS = {
    "inside out": (lambda: inverted(mesh()), "facets face inwards"),
    "inches": (lambda: scaled(1.0 / 25.4), "the file is in inches: lensforge reads mm"),
    "as if inches": (lambda: scaled(25.4), "as if its mm were inches"),
    "cm": (lambda: scaled(0.1), "the file is in cm"),
    "metres": (lambda: scaled(0.001), "the file is in metres"),
    "as if cm": (lambda: scaled(10.0), "as if its mm were cm"),
    "1.01": (lambda: scaled(1.01), "scaled by 1.01"),
    "mirrored": (lambda: mirrored(0), "mirrored: x is -x"),
    "mirrored in y": (lambda: mirrored(1), "mirrored: y is -y"),
    "upside down": (lambda: turned(180.0, [1.0, 0.0, 0.0]), "turned by 180 degrees about (1, 0, 0)"),
    "y up": (lambda: turned(-90.0, [1.0, 0.0, 0.0]), "turned by 90 degrees about (-1, 0, 0)"),
    "turned": (lambda: turned(37.0, [0.0, 0.0, 1.0]), "turned by 37 degrees about (0, 0, 1)"),
    "shifted": (lambda: mesh().apply_translation([0.5, 0.0, -3.0]), "shifted by (0.5, 0, -3) mm"),
    "inches, upside down": (
        lambda: turned(180.0, [0.0, 1.0, 0.0]).apply_scale(1.0 / 25.4),
        "the file is in inches and turned by 180 degrees about (0, 1, 0)",
    ),
}


@pytest.mark.parametrize("name", FAULTS)
def test_a_fault_is_named(name):
    make, says = FAULTS[name]
    found = remedies(make())
    assert says in found["deviation_rms"], found
    assert says in found["fate_disagreement_flux"] if "fate_disagreement_flux" in found else True
    assert "finer mesh" not in "".join(found.values())


def test_another_lens_is_told_from_this_one():
    found = remedies(mesh(replace(OUTER, semi_axes=(12.0, 13.0, 14.5))))
    assert "lens.stl is another body than the one exported: volume" in found["deviation_rms"]
    assert "finer mesh" not in "".join(found.values())


def test_a_thick_base_is_no_matter_of_the_light():
    found = remedies(lens_mesh(INNER.radius, OUTER.radius, 24, (16.0, 3.0)))
    assert set(found) == {"volume_change", "area_change", "box_change"}
    assert "least z -3 mm, exported -2" in found["box_change"]


def test_a_coarse_mesh_is_told_to_be_finer():
    found = remedies(mesh(rings=8))
    assert "finer mesh" in found["deviation_rms"] and "another" not in found["deviation_rms"]


@pytest.mark.parametrize("unit", [1.0, 0.001, 25.4])
def test_the_least_shift_is_a_length_of_the_lens_whatever_the_unit_of_the_file(unit):
    """A shift of 1 mm counts in metres too; one of 1 um in no unit."""
    exported = mesh_size(mesh())
    for shift_mm, expected in ((1.0, unit), (1e-3, 0.0)):
        bounds = unit * (np.array(exported.bounds_mm) + np.array([shift_mm, 0.0, 0.0]))
        first = candidates(exported.model_copy(update={"bounds_mm": tuple(map(tuple, bounds.tolist()))}), exported)[0]
        assert first.scale == unit
        np.testing.assert_allclose(first.shift_mm, [expected, 0.0, 0.0], atol=1e-9)
