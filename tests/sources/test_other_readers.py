"""Our photometric files as others read them: the same nodes, candela to the digits written, the same lumens."""

import numpy as np
import pytest
from far_fields import far_field, flux
from other_readers import by_element, by_photompy

from lensforge.sources.photometric import write_photometric

DIGITS = 5e-7  # relative: seven digits are written
VERSIONS = (2002, 2019)


@pytest.mark.parametrize("kind", ["revolution", "rectangle", "none"])
@pytest.mark.parametrize("lumens", [None, 417.25], ids=["absolute", "relative"])
@pytest.mark.parametrize("form", [*VERSIONS, "ldt", "iesxml"])
def test_another_reader_finds_the_nodes_the_candela_and_the_lumens(form, lumens, kind, tmp_path):
    file, version = far_field(kind, lumens), form if form in VERSIONS else None
    path, own = tmp_path / ("lens.ies" if version else f"lens.{form}"), file.intensity
    write_photometric(path, file, **({"ies_version": version} if version else {}))
    if form == "iesxml":
        c, gamma, candela, stated, luminaire = by_element(path)
        assert luminaire == pytest.approx(own.flux(), rel=DIGITS)
    else:
        c, gamma, candela, stated, read = by_photompy(path)
        (require_header_of_eulumdat if form == "ldt" else require_header_of_lm_63)(read, file, version)
    np.testing.assert_allclose(c, own.c_deg, rtol=DIGITS, atol=1e-9)
    np.testing.assert_allclose(gamma, own.gamma_deg, rtol=DIGITS, atol=1e-9)
    np.testing.assert_allclose(candela, own.values, rtol=DIGITS)
    assert flux(c, gamma, candela) == pytest.approx(own.flux(), rel=1e-6)
    absolute = own.flux() if form == "ldt" else -1.0  # EULUMDAT states the lumens of the luminaire in place of a lamp's
    assert stated == pytest.approx(lumens or absolute, rel=DIGITS)


def require_header_of_lm_63(read, file, version):
    assert read.header.version == f"LM-63-{version}"
    assert read.header.future_use == (1.0001 if version == 2019 else 1.0)
    assert (read.header.keywords["MANUFAC"], read.header.keywords["LUMCAT"]) == ("lensforge", "L 1")
    assert read.photometry.total_optical_power() == pytest.approx(file.intensity.flux(), rel=3e-3)  # by its own rule


def require_header_of_eulumdat(read, file, _):
    assert read.header.lamps[0].num_lamps == (-1 if file.lamp_lumens is None else 1)
    assert read.header.luminaire_type == (1 if len(file.intensity.c_deg) == 1 else 3)
    stated = read.header.lamps[0].total_flux
    assert stated * read.header.lorl / 100.0 == pytest.approx(file.intensity.flux(), rel=1e-5)
