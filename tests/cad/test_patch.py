import numpy as np
import pytest
from geometry_lenses import ALL_LEVELS, off_grid_chart, random_surface

from lensforge.cad.form_error import form_error
from lensforge.cad.patch import MAX_NODES, default_nodes, fit_patch, node_axis
from lensforge.errors import InputError
from lensforge.surfaces.srbf import SrbfBasis, SrbfSurface
from lensforge.surfaces.surface import HALF_WIDTH


def patch_error(surface, nodes=None, reach=1.0):
    patch, chart = fit_patch(surface, nodes), reach * off_grid_chart(3000)
    return form_error(surface, patch.points(chart), patch.normals(chart))


@pytest.mark.parametrize("offset", [0.8, 2.45, 6.0, 13.7])
@pytest.mark.parametrize("levels", [(9,), (9, 25, 81), ALL_LEVELS])
def test_default_nodes_reach_a_nanometre_and_20_microradians_off_the_grid(offset, levels):
    error = patch_error(random_surface(offset, 0.02, seed=3, levels=levels))
    assert error.form_max_nm <= 1.0
    assert error.normal_max_mrad <= 0.02


def test_form_converges_with_order_six_and_normals_with_order_five():
    surface = random_surface(2.45, 0.02, seed=1, levels=(9, 25))
    coarse, fine = (patch_error(surface, nodes, reach=0.9) for nodes in (81, 161))
    assert np.log2(coarse.form_max_nm / fine.form_max_nm) == pytest.approx(6.0, abs=0.3)
    assert np.log2(coarse.normal_max_mrad / fine.normal_max_mrad) == pytest.approx(5.0, abs=0.3)


def test_nodes_resolve_the_narrowest_function():
    basis = SrbfBasis(ALL_LEVELS, 1.75)
    axis = node_axis(default_nodes(float(basis.sigmas.min())))
    assert 2.0 * np.diff(np.arctan(axis)).max() <= basis.sigmas.min() / 5.0
    assert (axis[0], axis[-1]) == pytest.approx((-HALF_WIDTH, HALF_WIDTH), rel=1e-14)
    assert default_nodes(1e-3) == MAX_NODES


def test_a_surface_through_the_origin_is_refused_with_its_place():
    surface = random_surface(2.45, 0.0, seed=0)
    weights = surface.weights_mm.copy()
    weights[0] = -3.0
    with pytest.raises(InputError, match=r"radius = -\d.*degrees from the axis"):
        fit_patch(SrbfSurface(surface.basis, weights, 2.45))


@pytest.mark.parametrize("nodes", [0, 5, MAX_NODES + 1])
def test_node_counts_out_of_range_are_refused(nodes):
    with pytest.raises(InputError, match=f"nodes = {nodes}"):
        fit_patch(random_surface(2.45, 0.0, seed=0), nodes)
