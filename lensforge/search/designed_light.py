"""Light that drafts of each kind of lens have reached, by the beam and the size of the lens: more than a bound says.

``drafts.csv`` holds drafts of lenses of PMMA for even fields as ``lensforge new`` writes them, around a square
Lambertian LED (``benchmarks/advice.py``). Their efficiency over the bound of their kind, and the logarithm of their
pattern error, are interpolated over the logarithms of beam and size, on the triangles between the drafts. Beyond these
nothing is known.
"""

from collections import defaultdict
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from math import acos, degrees, log, pi, sqrt
from pathlib import Path

import numpy as np
from jaxtyping import Float
from scipy.interpolate import LinearNDInterpolator

from lensforge.optics.fundamental_limits import cell_solid_angles
from lensforge.results.text_table import shipped_rows
from lensforge.scene.possible_light import EtendueCurve
from lensforge.scene.receiver_shapes import receivers_of
from lensforge.scene.target_pattern import in_target, target_light
from lensforge.sources.ray_bundle import Source
from lensforge.spec import Spec

DRAFTS = Path(__file__).with_name("drafts.csv")
_TEXTS = ("kind", "source", "target", "radius_mm", "material", "cutter", "faces")  # the first six as `new` takes them
_NUMBERS = ("half_angle_deg", "size", "possible", "efficiency", "nmse")
COLUMNS = (*_TEXTS, *_NUMBERS)
_RAYS = 2**12
_SEED = 0
_LAMBERTIAN = 1.05  # radiance of the brightest light over the mean one: rounding
_EVEN = 0.5  # mean light of the target over its largest: fields with soft edges have 0.6 to 0.9, a Gaussian beam 0.4

Series = tuple[str, str]  # kind of lens, and shape of its faces


@dataclass(frozen=True)
class DraftPlace:
    """Place of a lens among drafts: ``half_angle_deg`` of its beam, and its ``size`` over that of the LED.

    The angle is that of a cone of the solid angle of the target, the size the lens's largest radius over that of a disc
    of the LED's étendue.
    """

    half_angle_deg: float
    size: float

    @staticmethod
    def of(spec: Spec, source: Source) -> "DraftPlace | None":
        """Place of a lens by ``spec``; None where drafts say nothing.

        That is for an LED that is not Lambertian, for a target that is not even, and for several states.
        """
        curve = EtendueCurve.of_source(source, source.sample(_RAYS, _SEED), _SEED)
        whole_mm2_sr = float(curve.etendue_mm2_sr[-1])
        if curve.estimated or len(spec.by_state) > 1 or not 0.0 < curve.brightest * whole_mm2_sr < _LAMBERTIAN:
            return None
        receiver = receivers_of(spec, spec.evaluate.pixels)[0]
        light = target_light(spec.all_receivers[0].targets, receiver)
        lit = in_target(light)
        if light[lit].mean() < _EVEN * light.max():
            return None
        solid_angle_sr = float(cell_solid_angles(receiver.corners())[lit].sum())
        half_angle_deg = degrees(acos(1.0 - solid_angle_sr / (2.0 * pi)))
        return DraftPlace(half_angle_deg, spec.constraints.max_radius_mm * pi / sqrt(whole_mm2_sr))


@dataclass(frozen=True)
class DesignedLight:
    """Light of drafts: ``of_possible``, their efficiency over the bound of their kind, and their ``nmse``."""

    of_possible: float
    nmse: float


def designed_light(series: Series, place: DraftPlace) -> DesignedLight | None:
    """Light that drafts of a ``series`` reached at that ``place``; None where there are none around it."""
    read = _drafts().get(series)
    values = np.full(2, np.nan) if read is None else read(log(place.half_angle_deg), log(place.size)).ravel()
    return None if np.isnan(values).any() else DesignedLight(float(values[0]), float(np.exp(values[1])))


def series_of(spec: Spec) -> Series:
    """Series of drafts of such lenses: of faces of revolution, or not.

    The process of making tells less than what drafts differ by from each other (docs/choosing.md, "Which lens").
    """
    return spec.lens.kind, "round" if all(map(spec.lens.is_revolved, spec.lens.names)) else "freeform"


@cache
def _drafts() -> Mapping[Series, LinearNDInterpolator]:
    """The interpolations of all drafts, by their series."""
    points = defaultdict(list)
    for row in shipped_rows(DRAFTS, _TEXTS, _NUMBERS):
        reached = (row["efficiency"] / row["possible"], log(row["nmse"]))
        points[row["kind"], row["faces"]].append((log(row["half_angle_deg"]), log(row["size"]), *reached))
    return {series: _interpolated(np.array(drafts)) for series, drafts in points.items()}


def _interpolated(drafts: Float[np.ndarray, "n 4"]) -> LinearNDInterpolator:
    """Light of ``drafts`` over their places: logarithms of beam and size in the first two columns."""
    return LinearNDInterpolator(drafts[:, :2], drafts[:, 2:])
