"""Receivers of a spec as verification sees them: plain numbers, of which it makes its own frames and charts."""

from dataclasses import astuple
from math import isfinite

from lensforge.receivers.build import receivers_of
from lensforge.spec import Spec
from lensforge.verification.screen import Screen


def screens_of(spec: Spec, pixels: int | None = None) -> list[Screen]:
    """Screens with as many pixels as the evaluation's images, by default those of the spec."""
    screens = []
    receivers = receivers_of(spec, pixels or spec.evaluate.pixels)
    for section, receiver in zip(spec.all_receivers, receivers, strict=True):
        width, height, radius = (side if isfinite(side) else None for side in astuple(receiver.window))
        grid = receiver.grid
        screens.append(
            Screen(
                kind=section.kind,
                centre_mm=getattr(section, "centre_mm", (0.0, 0.0, 0.0)),
                facing=section.facing,
                rotation_deg=section.rotation_deg,
                radius_mm=getattr(section, "radius_mm", 0.0),
                width=grid.width,
                height=grid.height,
                columns=grid.columns,
                rows=grid.rows,
                window=(width, height, radius),
                filter_variance=spec.evaluate.filter_variance,
            )
        )
    return screens
