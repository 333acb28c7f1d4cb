"""Glare in offices: limits, judgement and facts, as the core asks every application for them."""

from collections.abc import Iterator, Mapping
from typing import ClassVar

from lensforge.addons.office.office_record import OfficeJudgement
from lensforge.addons.office.office_room import OfficeReadings
from lensforge.addons.office.office_section import OfficeSection
from lensforge.addons.office.unified_glare import UnifiedGlare
from lensforge.results import Fact, Group
from lensforge.results.figure import facts_in
from lensforge.scene.application_light import ApplicationLight
from lensforge.scene.intensity_limit import Candela, IntensityLimit
from lensforge.spec.quantities import LeastOverMean, PlaceLight


class OfficeLight(ApplicationLight[OfficeSection, OfficeJudgement]):
    """The light of lamps in the ceiling of an office."""

    judgement = OfficeJudgement
    remedies: ClassVar[Mapping[str, str]] = {
        UnifiedGlare.phrase: "less light above 60 degrees, or a larger luminous_m; the flux changes it little",
        PlaceLight.phrase: "more lumens, or lamps nearer to each other; the mean is linear in the flux",
        LeastOverMean.phrase: "a wider beam, or lamps nearer to each other; the flux does not change it",
    }

    def limits(self) -> Iterator[IntensityLimit]:
        """The rating of its class, seen along both axes of the lamps, and the bounds of its working plane."""
        readings = OfficeReadings(self.entry)
        for name, turn_deg in (("UGR crosswise", 0.0), ("UGR endwise", 90.0)):
            yield IntensityLimit(name, UnifiedGlare(), "<=", self.entry.most, "", readings.glare(turn_deg))
        if self.entry.pitch_m is None:
            return
        light = readings.plane(self.entry.pitch_m)
        if self.entry.mean_lx is not None:
            yield IntensityLimit("mean illuminance", PlaceLight(), ">=", self.entry.mean_lx, "lx", light.mean())
        if self.entry.uniformity is not None:
            yield IntensityLimit("uniformity U0", LeastOverMean(), ">=", self.entry.uniformity, "", light)

    def judged(self, candela: Candela, name: str) -> OfficeJudgement:
        """The office by lamps of these intensities."""
        from lensforge.addons.office.office_judgement import judge_office

        return judge_office(self.entry, candela, self.limits(), name)

    def facts(self, judgement: OfficeJudgement) -> Group:
        """Its class, its background, and the light of its working plane."""
        room = f"room {self.entry.room}, reflectances {self.entry.reflectances}"
        note = f"EN 12464-1; achieved: {judgement.reached}, {room}, by the intensities of the file"
        head = Fact("office_class", "Class", judgement.lighting_class, note=note)
        return Group("office", judgement.name, (head, *facts_in(judgement)))
