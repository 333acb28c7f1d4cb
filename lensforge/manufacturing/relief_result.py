"""The clearance of the ball at the base, as a record."""

from math import floor
from typing import Literal

from lensforge.records import NotNegative, Record, Share, Text


class BaseBall(Record):
    """The largest ball that the base clears at a face, by its radius: one of ``within_mm`` more hits the base.

    ``radius_mm``: None where the base clears every ball that reaches all of the face.
    """

    radius_mm: NotNegative | None
    within_mm: NotNegative = 0.0


class OuterRelief(Record):
    """The step that the base needs to clear the ball, and its wall's setback; None where nothing is reached.

    ``flange_clearance_mm``: how much lower the top of the flange must be, 0 where there is no flange.
    ``flush_fraction``: share of the face that the ball reaches with the base as it is.
    """

    smallest_step_mm: NotNegative | None
    step_clearance_mm: NotNegative | None
    flange_clearance_mm: NotNegative | None
    flush_fraction: Share
    ball: BaseBall | None = None

    @property
    def clear(self) -> bool:
        """True where nothing of the base must give way to the ball."""
        return self.smallest_step_mm == self.step_clearance_mm == self.flange_clearance_mm == 0.0


class InnerRelief(Record):
    """Radius that the bore needs beyond the cavity's, diameter of the pocket; 0 where clear, None: nothing is reached.

    ``flush_fraction``: share of the face that the ball reaches with the base as it is.
    """

    bore_clearance_mm: NotNegative | None
    pocket_diameter_mm: NotNegative | None
    flush_fraction: Share
    ball: BaseBall | None = None

    @property
    def clear(self) -> bool:
        """True where nothing of the base must give way to the ball."""
        return self.bore_clearance_mm == self.pocket_diameter_mm == 0.0


class CustomBaseRelief(Record):
    """Largest depth of a custom base in the ball; None where nothing is reached.

    ``flush_fraction``: share of the face that the ball reaches with the base as it is.
    """

    retreat_mm: NotNegative | None
    flush_fraction: Share
    ball: BaseBall | None = None

    @property
    def clear(self) -> bool:
        """True where nothing of the base must give way to the ball."""
        return self.retreat_mm == 0.0


class Relief(Record):
    """Clearance of the shop's ball at the base, and each face's largest; ``note``: why there is nothing to clear."""

    outer: OuterRelief | CustomBaseRelief | None
    inner: InnerRelief | CustomBaseRelief | None
    note: Text | None = None

    def beyond_shop(
        self, largest_mm: float | None, shop_mm: float, surface: Literal["inner", "outer"] | None = None
    ) -> str:
        """Words behind a face's largest ball: the base's own, where the face's is larger than both it and the shop's.

        Empty where the face's is not larger, without a base, and where the base clears it. ``largest_mm``: None where
        any ball reaches the face. ``surface``: None for the base at both faces.
        """
        at = {"inner": self.inner, "outer": self.outer}
        found = [each for name, each in at.items() if each is not None and surface in (None, name)]
        larger = largest_mm is None or largest_mm > shop_mm
        if not found or not larger:
            return ""
        balls = [each.ball for each in found]
        if None in balls:
            return f"; the base is checked for {shop_mm:g} mm only"
        limits = [(ball.radius_mm, ball.within_mm) for ball in balls if ball is not None and ball.radius_mm is not None]
        radius_mm, within_mm = min(limits, default=(None, 0.0))
        if radius_mm is None or (largest_mm is not None and radius_mm >= largest_mm):
            return ""
        if radius_mm == 0.0:
            return "; the base clears no ball"
        fits = floor(1e3 * radius_mm) / 1e3  # it still fits
        return f"; the base clears up to {fits:g} mm, to within {within_mm:.1g} mm"
