"""The lens as an eye sees it: the picture of its luminance, and the mean over its outline."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Annotated

import numpy as np
from jaxtyping import Float

from lensforge.results import Fact, Group, Irradiance, Metric, Positive, Record, Text
from lensforge.results.chart import LightUnit
from lensforge.results.estimates import jackknife_metric, scaled
from lensforge.results.numerals import quantity
from lensforge.results.record import Array
from lensforge.scene.exit_rays import ExitRays

if TYPE_CHECKING:
    from lensforge.scene.eye_view import EyeView  # which loads the kernels


class SeenLens(Record):
    """The lens as the eye of a limit sees it: x is to the right, and the axis up where it does not point at the eye.

    ``label``: of the limit. ``side_mm``: of the square picture, at the lens; ``spot_mm``: diameter of a spot. ``map``:
    radiance (W/(m² sr)), [row y, column x], averaged over a spot about each pixel. ``outline``: corners (mm) of the
    convex hull of all points that light leaves, and ``mean`` the radiance over it; None if no light leaves.
    """

    label: Text
    side_mm: Positive
    spot_mm: Positive
    outline: Annotated[Float[np.ndarray, "k 2"], Array("k", 2)]
    mean: Metric | None
    map: Irradiance

    @staticmethod
    def of(view: "EyeView", pictures: Float[np.ndarray, "r h w"], exits: ExitRays) -> "SeenLens":
        """The lens by ``pictures`` of flux times the kernel (W/sr) of every replicate; ``exits`` give its outline.

        Of several eyes the one that sees the brightest spot.
        """
        if len(view.members) > 1:
            view, pictures = _brightest(view, pictures)
        outline = view.outline(exits)
        radiance = pictures.mean(axis=0) / view.pixel_measure
        spots = (view.spots() @ radiance.ravel()).reshape(radiance.shape)
        means = pictures.sum(axis=(1, 2)) / (1e-6 * _area(outline) or np.inf)
        return SeenLens(
            label=view.label,
            side_mm=view.grid.width,
            spot_mm=view.spot_mm,
            outline=outline,
            mean=jackknife_metric(means, float, "W/(m² sr)") if len(outline) else None,
            map=spots,
        )

    @property
    def outline_mm2(self) -> float:
        """Area of the outline."""
        return _area(self.outline)

    @property
    def name(self) -> str:
        """Name of the eye, after the label of its limit."""
        return self.label.rpartition(", seen ")[2].capitalize()


def _brightest(view: "EyeView", pictures: Float[np.ndarray, "r h w"]) -> tuple["EyeView", Float[np.ndarray, "r k w"]]:
    """The eye that sees the brightest spot, and its pictures."""
    parts = np.split(pictures, len(view.members), axis=1)
    spots = view.members[0].spots()
    number = int(np.argmax([(spots @ part.mean(axis=0).ravel()).max() for part in parts]))
    return view.members[number], parts[number]


def _area(corners: Float[np.ndarray, "k 2"]) -> float:
    """Area of a polygon."""
    x, y = corners.T
    return 0.5 * abs(float(x @ np.roll(y, -1) - y @ np.roll(x, -1)))


def radiance_unit(lumens_per_watt: float | None) -> LightUnit:
    """Candela per m² if the source's luminous efficacy is known, else W/(m² sr)."""
    if lumens_per_watt is None:
        return LightUnit("radiance", "W/(m² sr)", 1.0)
    return LightUnit("luminance", "cd/m²", lumens_per_watt)


def seen_groups(seen: Sequence[SeenLens], lumens_per_watt: float | None) -> list[Group]:
    """The group of the mean luminance for every eye; empty without eyes."""
    unit = radiance_unit(lumens_per_watt)
    facts = tuple(
        Fact.measured(
            "mean_luminance",
            f"{view.name}, mean",
            scaled(view.mean, unit.per_watt, unit.symbol),
            f"{unit.quantity} over the {quantity(view.outline_mm2, 'mm²', digits=4)} of its outline",
        )
        for view in seen
        if view.mean is not None
    )
    return [Group("seen", "The lens as seen", facts)] if facts else []
