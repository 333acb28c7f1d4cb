"""The beam of a far field in one plane: its angles, and what the spec wants of them."""

from collections.abc import Iterator

from lensforge.results import Metric, Number, Record
from lensforge.results.estimates import in_doubt
from lensforge.results.numerals import quantity
from lensforge.sources.intensity import BEAM_SHARE
from lensforge.spec import Spec
from lensforge.spec.far_field_targets import BeamTarget
from lensforge.spec.light_limits import BeamAngleLimit

_OF_WANTED = 0.1  # of a wanted beam angle: a beam that differs by more deserves a look


class PlaneFigures(Record):
    """Beam in the plane of the half-planes ``c_deg`` and ``c_deg`` + 180.

    ``beam_angle_deg`` and ``field_angle_deg``: between the outermost directions with a half and a tenth of the largest
    intensity of this plane, ``peak_cd`` (CIE S 017, ANSI/IES LS-1); None if it has no light.
    """

    c_deg: Number
    peak_cd: Metric
    beam_angle_deg: Metric | None
    field_angle_deg: Metric | None

    @property
    def plane(self) -> str:
        """Name of the plane."""
        return f"C {self.c_deg:.0f}"

    def beam_note(self, spec: Spec) -> str:
        """Definition of the beam angle, and the angle that the target of ``spec`` wants."""
        wanted = self._wanted(spec)
        level = "full width at 50 % of the peak in this plane"
        return f"{wanted}; {level}" if wanted else level

    def beam_notice(self, spec: Spec) -> str:
        """Warning if the beam angle is far from the target's; "" otherwise."""
        angle = self.beam_angle_deg
        wanted_deg = _target_beam_deg(spec).get(self.c_deg)
        if angle is None or wanted_deg is None:
            return ""
        far_deg = max(_OF_WANTED * wanted_deg, 3.0 * (angle.standard_error or 0.0))
        return self._wanted(spec) if abs(angle.value - wanted_deg) > far_deg else ""

    def is_judged(self, spec: Spec) -> bool:
        """True if a limit judges the beam angle, and reports it."""
        return self.c_deg in _judged_planes(spec)

    def in_doubt(self, other: "PlaneFigures", doubt: float) -> "PlaneFigures":
        """These figures with the doubt that other rays would choose ``other``."""
        names = ("peak_cd", "beam_angle_deg", "field_angle_deg")
        pairs = {name: (getattr(self, name), getattr(other, name)) for name in names}
        known = {name: pair for name, pair in pairs.items() if None not in pair}
        return self.changed(**{name: in_doubt(*pair, doubt) for name, pair in known.items()})

    def _wanted(self, spec: Spec) -> str:
        wanted_deg = _target_beam_deg(spec).get(self.c_deg)
        known = wanted_deg is not None and self.beam_angle_deg is not None
        return f"the target wants {quantity(wanted_deg, '°', digits=3)}" if known else ""


def _judged_planes(spec: Spec) -> Iterator[float]:
    """Planes C (deg) whose beam angle a limit judges and reports."""
    by_name = {receiver.name: receiver for receiver in spec.all_receivers}
    for limit in spec.limits:
        if isinstance(limit, BeamAngleLimit) and limit.level == BEAM_SHARE:
            receiver = by_name[limit.receiver or next(iter(by_name))]
            if receiver.facing == (0.0, 0.0, 1.0) and receiver.rotation_deg == 0.0:
                yield limit.azimuth_deg % 180.0


def _target_beam_deg(spec: Spec) -> dict[float, float]:
    """Beam angle (deg) of the target of one lamp in a plane C (deg); empty for any other target."""
    receiver = spec.all_receivers[0]
    match receiver.facing, receiver.rotation_deg, len(spec.all_lamps), receiver.targets:
        case (0.0, 0.0, 1.0), 0.0, 1, [BeamTarget(centre=(0.0, 0.0), rotation_deg=0.0) as target]:
            return dict(zip((0.0, 90.0), target.sides("fwhm"), strict=True))
    return {}
