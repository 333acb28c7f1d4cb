"""The materials that a spec may name: dispersion formulas with published coefficients."""

from collections.abc import Sequence

from lensforge.materials.formulas import Formula
from lensforge.materials.material import Material, by_abbe_number
from lensforge.materials.temperature import TemperatureLaw

_BEADIE = "G. Beadie, M. Brindza, R. A. Flynn, A. Rosenberg, J. S. Shirk, Appl. Opt. 54, F139 (2015)"
_SULTANOVA = "N. Sultanova, S. Kasarova, I. Nikolov, Acta Physica Polonica A 116, 585 (2009)"
_SCHOTT = "SCHOTT optical glass data sheets (2017)"
_MALITSON = "I. H. Malitson, J. Opt. Soc. Am. 55, 1205 (1965)"
_ZHANG = "X. Zhang, J. Qiu, X. Li, J. Zhao, L. Liu, Appl. Opt. 59, 2337 (2020), Sylgard 184 20:1, one term fitted"
_BOROFLOAT = "SCHOTT BOROFLOAT 33, Optical Properties (2021), fitted by M. Polyanskiy, refractiveindex.info"
_B270 = "SCHOTT B 270, Zemax catalogue"
_TOPAS = "G. Khanarian, Opt. Eng. 40, 1024 (2001): TOPAS 5013, n_d and V_d"
_OKP = "Osaka Gas Chemicals, OKP4 data sheet: n_d and V_d"


def _catalogue(materials: Sequence[Material]) -> dict[str, Material]:
    return {material.name: material for material in materials}


MATERIALS = _catalogue([
    Material(
        "PMMA",
        Formula("agf 13", (2.1778, 6.1209e-3, -1.5004e-3, 2.3678e-2, -4.2137e-3, 7.3417e-4, -4.5042e-5)),
        (420.0, 1620.0),
        _BEADIE,
        0.0011,
    ),
    Material("PC", Formula("sellmeier", (1.4182, 0.021304)), (436.8, 1052.0), _SULTANOVA, 0.0002),
    Material("PS", Formula("sellmeier", (1.4435, 0.020216)), (436.8, 1052.0), _SULTANOVA, 0.0002),
    Material(
        "N-BK7",
        Formula("sellmeier", (1.03961212, 0.00600069867, 0.231792344, 0.0200179144, 1.01046945, 103.560653)),
        (300.0, 2500.0),
        _SCHOTT,
        0.01,
        temperature=TemperatureLaw(
            schott=(1.86e-6, 1.31e-8, -1.37e-11, 4.34e-7, 6.27e-10, 0.170), expansion_per_k=7.1e-6
        ),
    ),
    Material(
        "fused silica",
        Formula("sellmeier", (0.6961663, 0.0684043**2, 0.4079426, 0.1162414**2, 0.8974794, 9.896161**2)),
        (210.0, 3710.0),
        _MALITSON,
        0.03,
    ),
    Material("COP", Formula("sellmeier", (1.2969, 0.011721)), (436.8, 1052.0), _SULTANOVA, 2.2e-5),
    by_abbe_number(1.533, 56.2, "COC", _TOPAS),
    by_abbe_number(1.607, 27.0, "polyester", _OKP),
    Material("silicone", Formula("sellmeier", (0.94857825, 0.01122108)), (400.0, 750.0), _ZHANG, 2.2e-5),
    Material(
        "B270",
        Formula("agf 1", (2.286575, -8.7334582e-3, 1.1742884e-2, 2.9041756e-4, -1.2506695e-5, 9.2646253e-7)),
        (330.0, 2100.0),
        _B270,
        0.0055,
    ),
    Material(
        "borosilicate 3.3",
        Formula("rii 1", (0.3542, 0.78657, 0.10856, 0.18285, 4.427)),
        (240.0, 1550.0),
        _BOROFLOAT,
        0.0043,
    ),
])  # fmt: skip
