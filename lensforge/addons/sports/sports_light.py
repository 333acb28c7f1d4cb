"""Light on playing fields: limits, judgement and facts, as the core asks every application for them."""

from collections.abc import Iterator, Mapping
from typing import ClassVar

from lensforge.addons.sports.glare_rating import GlareRating
from lensforge.addons.sports.sports_field import SportsReadings
from lensforge.addons.sports.sports_record import SportsJudgement
from lensforge.addons.sports.sports_section import SportsSection
from lensforge.results import Fact, Group
from lensforge.results.figure import facts_in
from lensforge.scene.application_light import ApplicationLight
from lensforge.scene.intensity_limit import Candela, IntensityLimit
from lensforge.spec.quantities import LeastOverMean, PlaceLight


class SportsLight(ApplicationLight[SportsSection, SportsJudgement]):
    """The light of floodlights on a playing field."""

    judgement = SportsJudgement
    remedies: ClassVar[Mapping[str, str]] = {
        PlaceLight.phrase: "more lumens, or floodlights that are aimed nearer; the mean is linear in the flux",
        LeastOverMean.phrase: "another pattern, or other aims; the flux does not change it",
        GlareRating.phrase: "higher masts, lower aims, or less light beside the beam; the flux changes it little",
    }

    def limits(self) -> Iterator[IntensityLimit]:
        """The numbers of its class."""
        required = self.entry.required
        readings = SportsReadings(self.entry)
        light = readings.illuminance.times(self.entry.maintenance_factor)
        yield IntensityLimit("mean illuminance", PlaceLight(), ">=", required.mean_lx, "lx", light.mean())
        yield IntensityLimit("uniformity U0", LeastOverMean(), ">=", required.uniformity, "", light)
        yield IntensityLimit("glare rating GR", GlareRating(), "<=", required.glare, "", readings.glare)

    def judged(self, candela: Candela, name: str) -> SportsJudgement:
        """The field by lamps of these intensities."""
        from lensforge.addons.sports.sports_judgement import judge_field

        return judge_field(self.entry, candela, self.limits(), name)

    def facts(self, judgement: SportsJudgement) -> Group:
        """Its class, and the least illuminance."""
        note = f"EN 12193; achieved: {judgement.reached}, by the intensities of the file"
        head = Fact("sports_class", "Class", judgement.lighting_class, note=note)
        return Group("sports", judgement.name, (head, *facts_in(judgement)))
