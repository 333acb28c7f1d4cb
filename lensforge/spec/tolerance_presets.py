"""Amounts of the tolerance presets: what shops and assembly lines keep without being asked for more.

Sources. Injection moulding and diamond turning: Apollo Optical Systems, "Typical manufacturing tolerances"
(apollooptical.com/manufacturing-tolerances, seen in 2026): concentricity 0.025 mm moulded, 0.005 mm turned; centre
thickness 0.025 and 0.015 mm moulded, 0.02 and 0.005 mm turned; irregularity of 6, 3 and 2 fringes (632.8 nm) over
25 mm, moulded commercial and precision, turned precision: 1.9, 0.9 and 0.6 um peak to valley, about a fifth of which is
its rms; power of 10 fringes besides. Index: +-0.001 of plastics (Baeumer, Handbook of Plastic Optics, 2nd ed., 2010),
+-0.0005 of catalogue glass (ISO 12123, grade NP050). The place of a chip in its package and of a package on its board
(data sheets state 0.05 to 0.1 mm), its tilt, flux within a bin, waviness, ripple and roughness are our estimates: give
your own where you know them.
"""

from typing import Literal

TolerancePreset = Literal["precision", "standard", "moulded"]

# name of the field: amount in precision, standard, moulded
_AMOUNTS: dict[str, tuple[float, float, float]] = {
    "source_shift_mm": (0.02, 0.05, 0.05),
    "source_height_mm": (0.02, 0.05, 0.05),
    "source_tilt_deg": (0.2, 0.5, 0.5),
    "source_flux": (0.05, 0.05, 0.05),
    "source_size": (0.01, 0.02, 0.02),
    "outer_shift_mm": (0.005, 0.02, 0.025),
    "gap_mm": (0.005, 0.02, 0.025),
    "outer_tilt_deg": (0.02, 0.05, 0.05),
    "lens_shift_mm": (0.02, 0.05, 0.05),
    "lens_height_mm": (0.01, 0.03, 0.05),
    "lens_tilt_deg": (0.05, 0.1, 0.2),
    "inner_form_um": (0.3, 1.0, 2.0),
    "outer_form_um": (0.3, 1.0, 2.0),
    "inner_waviness_um": (0.03, 0.1, 0.2),
    "outer_waviness_um": (0.03, 0.1, 0.2),
    "inner_ripple_um": (0.01, 0.02, 0.0),
    "outer_ripple_um": (0.01, 0.02, 0.0),
    "inner_roughness_mrad": (0.2, 0.5, 0.5),
    "outer_roughness_mrad": (0.2, 0.5, 0.5),
    "index": (0.0005, 0.001, 0.001),
    "shrinkage": (0.0, 0.0, 0.001),
}
PRESET_AMOUNTS: dict[TolerancePreset, dict[str, float]] = {
    "precision": {name: amounts[0] for name, amounts in _AMOUNTS.items()},
    "standard": {name: amounts[1] for name, amounts in _AMOUNTS.items()},
    "moulded": {name: amounts[2] for name, amounts in _AMOUNTS.items()},
}
