"""How far the index of a lens material can be trusted beyond the wavelengths at which it was measured.

Other formulas are fitted to the published one at either end of its range, to 2.5 times the wavelength at the blue end,
0.4 times at the red end; printed is by how much they differ from it 10 % beyond that end, where it is still used. The
last lines compare the formula of n_d and V_d alone with each of the materials.
"""

from collections.abc import Iterator

import numpy as np
from scipy.optimize import curve_fit

from lensforge.optics.material import D_LINE_NM, MATERIALS, Material, by_abbe_number

FORMULAS = {
    "Sellmeier, one term": (lambda um, b, c: np.sqrt(1.0 + b * um**2 / (um**2 - c)), (1.2, 0.01)),
    "Cauchy, three terms": (lambda um, a, b, c: a + b / um**2 + c / um**4, (1.5, 0.005, 0.0)),
    "Schott, four terms": (
        lambda um, a, b, c, d: np.sqrt(a + b * um**2 + c / um**2 + d / um**4),
        (2.2, 0.0, 0.01, 0.0),
    ),
}
REACH = 2.5  # of the wavelengths fitted


def differences(material: Material) -> Iterator[tuple[float, float, float, str]]:
    """Yield for both ends: end and wavelength to which the formula is used (nm), largest difference there, by which."""
    (low, high), (least, most) = material.range_nm, material.trusted_nm
    for end, limit, other in ((low, least, min(high, REACH * low)), (high, most, max(low, high / REACH))):
        microns = np.linspace(end, other, 200) * 1e-3
        published = material.dispersion.index(microns * 1e3)
        there = float(material.nearest_index(np.array([limit]))[0])
        found = {}
        for title, (formula, start) in FORMULAS.items():
            fitted, _ = curve_fit(formula, microns, published, p0=start, maxfev=20_000)
            found[title] = abs(float(formula(limit * 1e-3, *fitted)) - there)
        worst = max(found, key=lambda title: found[title])
        yield end, limit, found[worst], worst


def difference_by_abbe_number(material: Material) -> float:
    """Largest difference of the formula of n_d and V_d from that of ``material`` over the range of the former."""
    simple = by_abbe_number(material.index_at(D_LINE_NM), material.abbe_number)
    waves = np.linspace(*simple.trusted_nm, 200)
    return float(np.abs(simple.nearest_index(waves) - material.dispersion.index(waves)).max())


if __name__ == "__main__":
    print("material\tend nm\tused to nm\tlargest difference\tby")
    for name, material in MATERIALS.items():
        for end, limit, difference, title in differences(material):
            print(f"{name}\t{end:g}\t{limit:g}\t{difference:.1e}\t{title}")
    for name, material in MATERIALS.items():
        print(f"{name}\tn_d and V_d alone\t\t{difference_by_abbe_number(material):.1e}")
