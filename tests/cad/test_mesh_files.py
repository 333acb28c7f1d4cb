import io
import zipfile

import numpy as np
import pytest
from geometry_lenses import make_lens

from lensforge.cad.mesh import build_mesh, check_closed
from lensforge.cad.mesh_files import parse_3mf, threemf_bytes
from lensforge.cad.patch import fit_patch
from lensforge.cad.plan import make_plan
from lensforge.errors import InputError


@pytest.fixture(scope="module")
def mesh():
    lens = make_lens(6.0, 12.7, 0.02, seed=3)
    return build_mesh(make_plan(fit_patch(lens.inner), fit_patch(lens.outer), lens.spec.base), 24)


def test_the_mesh_comes_back_with_its_sharing_unit_and_names(mesh):
    content = threemf_bytes(mesh, "crossing")
    vertices, triangles = parse_3mf(content)
    np.testing.assert_array_equal(triangles, mesh.triangles)
    # single precision, and the decimal text of the format rounds once more
    np.testing.assert_allclose(vertices, mesh.vertices, rtol=0, atol=2e-6)
    closure = check_closed(vertices, triangles)
    assert closure.watertight
    assert closure.volume_mm3 == pytest.approx(mesh.volume(), rel=1e-6)
    model = zipfile.ZipFile(io.BytesIO(content)).read("3D/3dmodel.model").decode()
    assert 'unit="millimeter"' in model
    for name in mesh.names:
        assert f'name="{name}"' in model
    assert model.count("<t:ref ") + model.count("<t:refrange ") >= len(mesh.names)


@pytest.mark.parametrize("content", [b"", b"PK no zip"], ids=["empty", "noise"])
def test_a_damaged_3mf_is_one_line(content):
    with pytest.raises(InputError, match=r"^part\.3mf: ") as caught:
        parse_3mf(content, "part.3mf")
    assert "\n" not in str(caught.value)
