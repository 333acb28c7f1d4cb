"""Light on the whole surface of a measured body of the scene, by patches."""

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Annotated

import numpy as np
from jaxtyping import Float

from lensforge.results import Group, Metric, Point, Positive, Record, Share, Text
from lensforge.results.chart import light_unit
from lensforge.results.estimates import debiased_minimum, jackknife_metric, scaled
from lensforge.results.figure import Figure, facts_in
from lensforge.results.numerals import number, percent
from lensforge.results.record import Array

if TYPE_CHECKING:
    from lensforge.scene.body_view import BodyView  # which loads the kernels


def _figure(field: str, note: "Callable[[IrradiatedBody], str]") -> Figure:
    """The figure of a ``field`` in W/m², told in the unit of a page."""
    return Figure(
        lambda body, unit: f"{field.capitalize()} on {body.name}",
        lambda body, unit: note(body),
        key=f"body_{field}",
        value=lambda body, unit: scaled(getattr(body, field), unit.per_watt, unit.symbol),
    )


class IrradiatedBody(Record):
    """Light on a body: the ``least`` of its patches and the ``mean`` over its surface, both in W/m².

    ``area_mm2``: of the surface. ``least_mm``: middle of the patch with the least light. ``dark``: share of the surface
    that no ray meets. ``irradiance``: of each patch (W/m²).
    """

    name: Text
    area_mm2: Positive
    mean: Annotated[Metric, _figure("mean", lambda body: f"over its surface{body.dark_phrase}")]
    least: Annotated[Metric, _figure("least", lambda body: f"at ({body.place_phrase}) mm")]
    least_mm: Point
    dark: Share
    irradiance: Annotated[Float[np.ndarray, " p"], Array("p", least=0.0)]

    @property
    def dark_phrase(self) -> str:
        """Phrase for the share of its surface that is dark; empty if all of it is lit."""
        return f"; {percent(self.dark)} of its surface is dark" if self.dark > 0.0 else ""

    @property
    def place_phrase(self) -> str:
        """Coordinates of the place with the least light."""
        return ", ".join(number(coordinate, 4) for coordinate in self.least_mm)

    @staticmethod
    def of(view: "BodyView", flux: Float[np.ndarray, "r p"]) -> "IrradiatedBody":
        """The light by the ``flux`` (W) on each patch, the mean of a lamp, of every replicate."""
        areas_m2 = view.patches.areas_m2
        readings = len(view.lamps) * flux / areas_m2
        irradiance = readings.mean(axis=0)
        means = readings @ areas_m2 / areas_m2.sum()
        x, y, z = view.centres_mm[irradiance.argmin()].tolist()
        return IrradiatedBody(
            name=view.name,
            area_mm2=float(view.patches.areas_mm2.sum()),
            least=debiased_minimum(readings).changed(unit="W/m²"),
            least_mm=(x, y, z),
            mean=jackknife_metric(means, float, "W/m²"),
            dark=float(areas_m2[irradiance <= 0.0].sum() / areas_m2.sum()),
            irradiance=irradiance,
        )


def body_groups(bodies: Sequence[IrradiatedBody], lumens_per_watt: float | None) -> list[Group]:
    """A group of the light on each body, in lux if the source's luminous efficacy is known, else in W/m²."""
    unit = light_unit(lumens_per_watt)
    return [Group("bodies", f"Light on {body.name}", tuple(facts_in(body, (), None, unit))) for body in bodies]
