"""Scallops: the cusps between neighbouring passes of a ball cutter.

Exact for a face of constant normal curvature ``kappa`` (1/mm, convex positive) across the passes, a ball of radius R
and passes whose contact points are ``s`` apart along the face. With ``w`` the squared half chord
``(s/2 sinc(kappa s/4))^2``, the cusp height h solves ``h^2 - 2 R h + (1 + kappa R)(1 + kappa h) w = 0``; on a plane
this is ``h = R - sqrt(R^2 - s^2/4)``, and for small steps ``(s^2/8)(1/R + kappa)``.

For the light the slope matters more than the height: a cusp of 50 nm from a ball of 1 mm radius has 10 mrad.
"""

import numpy as np

from lensforge.manufacturing.result import Scallop


def scallop(cutter_radius_mm: float, stepover_mm: float, slope_limit_rad: float, curvature: float) -> Scallop:
    """Height and slope of the cusps at ``stepover_mm``, and the stepover at which their slope is the limit."""
    height = scallop_height_mm(cutter_radius_mm, stepover_mm, curvature)
    slope = scallop_slope_rad(cutter_radius_mm, stepover_mm, curvature)
    limit = stepover_for_slope_mm(cutter_radius_mm, slope_limit_rad, curvature)
    return Scallop(
        height_nm=1e6 * height if np.isfinite(height) else None,
        slope_mrad=1e3 * slope if np.isfinite(slope) else None,
        stepover_for_slope_limit_mm=limit if np.isfinite(limit) else None,
    )


def scallop_height_mm(cutter_radius_mm: float, stepover_mm: float, curvature: float = 0.0) -> float:
    """Height (mm) of the cusps above the face; NaN where the passes do not overlap or the ball does not fit."""
    excess = 1.0 + curvature * cutter_radius_mm
    if excess < 0.0:
        return float("nan")
    half_chord = stepover_mm / 2.0 * float(np.sinc(curvature * stepover_mm / (4.0 * np.pi)))
    product = excess * half_chord**2
    half_sum = cutter_radius_mm - curvature * product / 2.0
    discriminant = half_sum**2 - product
    return product / (half_sum + float(np.sqrt(discriminant))) if discriminant >= 0.0 else float("nan")


def scallop_slope_rad(cutter_radius_mm: float, stepover_mm: float, curvature: float = 0.0) -> float:
    """Slope (rad) of the cusps against the face at their crest, ``asin(s/2R)`` on a plane; NaN as for the height."""
    half = stepover_mm / 2.0 * float(np.sinc(curvature * stepover_mm / (2.0 * np.pi)))
    sine = (1.0 / cutter_radius_mm + curvature) * half
    return float(np.arcsin(sine)) if 0.0 <= sine <= 1.0 else float("nan")


def stepover_for_slope_mm(cutter_radius_mm: float, slope_rad: float, curvature: float = 0.0) -> float:
    """The stepover (mm) whose cusps have the given slope; infinite where the face is as concave as the ball."""
    excess = 1.0 / cutter_radius_mm + curvature
    if excess <= 0.0:
        return float("inf")
    half = float(np.sin(slope_rad)) / excess
    if curvature == 0.0:
        return 2.0 * half
    return 2.0 * float(np.arcsin(np.clip(curvature * half, -1.0, 1.0))) / curvature
