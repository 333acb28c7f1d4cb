"""The clearance of the ball at the base, as a record."""

from lensforge.records import NotNegative, Record, Share, Text


class OuterRelief(Record):
    """The step that the base needs to clear the ball, and its wall's setback; None where nothing is reached.

    ``flange_clearance_mm``: how much lower the top of the flange must be, 0 where there is no flange.
    ``flush_fraction``: share of the face that the ball reaches with the base as it is.
    """

    smallest_step_mm: NotNegative | None
    step_clearance_mm: NotNegative | None
    flange_clearance_mm: NotNegative | None
    flush_fraction: Share


class InnerRelief(Record):
    """Radius that the bore needs beyond the cavity's, diameter of the pocket; 0 where clear, None: nothing is reached.

    ``flush_fraction``: share of the face that the ball reaches with the base as it is.
    """

    bore_clearance_mm: NotNegative | None
    pocket_diameter_mm: NotNegative | None
    flush_fraction: Share


class CustomBaseRelief(Record):
    """Largest depth of a custom base in the ball; None where nothing is reached.

    ``flush_fraction``: share of the face that the ball reaches with the base as it is.
    """

    retreat_mm: NotNegative | None
    flush_fraction: Share


class Relief(Record):
    """Clearance of the ball at the base; ``note`` says why there is nothing to clear."""

    outer: OuterRelief | CustomBaseRelief | None
    inner: InnerRelief | CustomBaseRelief | None
    note: Text | None = None

    def beyond_shop(self, largest_mm: float | None, shop_mm: float) -> str:
        """Words behind a face's largest ball where it is larger than the shop's, for which alone the base is checked.

        Empty where it is not larger, and without a base. ``largest_mm``: None where any ball reaches the face.
        """
        has_base = self.outer is not None or self.inner is not None
        larger = largest_mm is None or largest_mm > shop_mm
        return f"; the base is checked for {shop_mm:g} mm only" if has_base and larger else ""
