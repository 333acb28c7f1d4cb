"""Place, size and rotation of the photographed light against the simulated one, and their likely causes."""

from collections.abc import Iterator

from lensforge.records import Metric, Record

_ERRORS = 3.0  # standard errors from which a cause is named


class Alignment(Record):
    """Similarity transform from the simulated light to the photographed one, about the centre of the target.

    ``scale``: above 1 where the photographed light is larger; ``rotation_deg``: counter-clockwise as the simulation is
    shown. None for what the light cannot tell: a round pattern has no rotation, even light no size. Standard errors are
    by the differences of the pictures, over blocks of the target, and by the corners.
    """

    displacement_x_mm: Metric | None
    displacement_y_mm: Metric | None
    scale: Metric | None
    rotation_deg: Metric | None

    def causes(self) -> Iterator[str]:
        """Likely cause of each figure that is beyond doubt, in words."""
        if _beyond_doubt(self.scale, 1.0):
            yield (
                f"scale {self.scale}: the target may stand {_farther(self.scale)} than in the spec, by that ratio, or "
                "the corners bound a target of another size than given"
            )
        if _beyond_doubt(self.rotation_deg, 0.0):
            yield (
                f"rotation {self.rotation_deg}: the lens and the target may be turned against each other about the "
                "axis, or the corners are not those of the target; a turned camera alone is undone by the corners"
            )
        for axis, shift in (("x", self.displacement_x_mm), ("y", self.displacement_y_mm)):
            if _beyond_doubt(shift, 0.0):
                yield (
                    f"displacement along {axis} {shift}: the target may be off the axis, the lens tilted, or the "
                    "LED off the centre of the lens"
                )


def _beyond_doubt(metric: Metric | None, expected: float) -> bool:
    if metric is None or metric.standard_error is None:
        return False
    return abs(metric.value - expected) > _ERRORS * metric.standard_error


def _farther(scale: Metric | None) -> str:
    return "farther away" if scale is not None and scale.value > 1.0 else "closer"
