"""Linear lenses with walls for tests: of no symmetry, as their target lies beside the axis."""

import numpy as np
from scenes import small_spec
from scipy.interpolate import BSpline

import lensforge as lf
from lensforge.search.start_faces import start_faces

ASIDE = {"kind": "rectangle", "width_mm": 60.0, "height_mm": 60.0, "centre_mm": [25.0, 10.0], "distance_mm": 90.0,
         "receiver_mm": 200.0}  # fmt: skip
KIND = {"kind": "extruded_tir", "length_mm": 40.0, "symmetry": "none", "profile": 24}
LIMITS = {"cavity_height_mm": 0.6, "cavity_radius_mm": 1.0, "min_thickness_mm": 1.0, "max_radius_mm": 12.0}


def walled_spec(**changes: object) -> lf.Spec:
    """A spec of such a lens."""
    scene = {"lens": KIND, "base": {"kind": "none"}, "target": ASIDE, "constraints": LIMITS}
    return small_spec(**scene | {"optimise__steps_per_level": [1]} | changes)


def walled_lens(**changes: object) -> lf.Lens:
    """The lens from which its search begins."""
    spec = walled_spec(**changes)
    return lf.Lens(start_faces(spec), spec, 0, "draft")


def section_of(lens: lf.Lens, faces: tuple[str, ...], count: int = 40_001) -> np.ndarray:
    """Points (x, z) of the nearest of some faces from foot to foot, by the formula of docs/definitions.md."""
    angles = np.linspace(-0.5 * np.pi, 0.5 * np.pi, count)
    values = []
    for name in faces:
        coefficients = lens.surfaces[name].coefficients
        high = 0.5 + 0.15 / np.pi
        knots = -high + 2.0 * high / (len(coefficients) - 5) * np.arange(-5.0, len(coefficients) + 1.0)
        values.append(BSpline(knots, coefficients, 5)(angles / np.pi))
    return np.column_stack([np.sin(angles), np.cos(angles)]) / np.max(values, axis=0)[:, None]
