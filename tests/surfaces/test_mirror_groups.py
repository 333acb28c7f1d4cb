"""Mirror groups: one of each set of mirror images, and the group that two surfaces share."""

import numpy as np
import pytest
from scenes import hemisphere_directions, random_surface, small_spec, sphere

from lensforge.scene.lens import Lens
from lensforge.surfaces.asphere import Asphere
from lensforge.surfaces.mirror_group import NAMES, first_images, group
from lensforge.surfaces.surface import Surface


@pytest.mark.parametrize("name", NAMES)
def test_of_mirror_images_one_comes_first(name: str) -> None:
    u = hemisphere_directions(300)
    first = np.sum([first_images(u @ image, name) for image in group(name)], axis=0)
    assert (first == 1).all()
    on_mirrors = np.array([[0.0, 0.0, 1.0], [0.6, 0.0, 0.8], [0.0, 0.6, 0.8], [0.48, 0.48, 0.7]])
    assert all(any(first_images(u[None] @ image, name)[0] for image in group(name)) for u in on_mirrors)


@pytest.mark.parametrize(
    ("inner", "outer", "common"),
    [
        (random_surface(1, 3.0, symmetry="square"), random_surface(2, 6.0, symmetry="square"), "square"),
        (random_surface(1, 3.0, symmetry="square"), random_surface(2, 6.0, symmetry="mirror_y"), "mirror_y"),
        (random_surface(1, 3.0, symmetry="mirror_x"), random_surface(2, 6.0, symmetry="mirror_y"), "none"),
        (Asphere(3.0, -3.0, 0.0, ()), random_surface(2, 6.0, symmetry="rectangle"), "rectangle"),
        (sphere(3.0), random_surface(2, 6.0, symmetry="square"), "none"),
    ],
)
def test_a_lens_has_the_mirrors_that_both_surfaces_have(inner: Surface, outer: Surface, common: str) -> None:
    assert Lens.double(inner, outer, small_spec(), 0, "draft").symmetry == common
