"""Light on roads: limits, judgement and facts, as the core asks every application for them."""

from collections.abc import Iterator, Sequence

from lensforge.addons.road.road_classes import requirements_of
from lensforge.addons.road.road_facts import road_facts, with_edge, with_remedies
from lensforge.addons.road.road_field import RoadReadings
from lensforge.addons.road.road_record import RoadJudgement
from lensforge.addons.road.road_section import RoadSection
from lensforge.results import Fact, Group
from lensforge.scene.application_light import ApplicationLight
from lensforge.scene.intensity_limit import Candela, IntensityLimit


class RoadLight(ApplicationLight[RoadSection, RoadJudgement]):
    """The light of rows of lamps on a road."""

    judgement = RoadJudgement

    def limits(self) -> Iterator[IntensityLimit]:
        """Requirements of its class, for every observer."""
        return requirements_of(RoadReadings.of(self.entry))

    def judged(self, candela: Candela, name: str) -> RoadJudgement:
        """The road by lamps of these intensities."""
        from lensforge.addons.road.road_judgement import judge_road

        return judge_road(self.entry, candela, name)

    def with_remedies(self, limits: Sequence[Fact]) -> Iterator[Fact]:
        """Its limits, missed ones with a remedy as far as it follows from the flux."""
        return with_remedies(limits)

    def facts(self, judgement: RoadJudgement) -> Group:
        """Its class, its traffic, and figures that the class does not require."""
        return road_facts(judgement, self.entry, with_limits=False)

    @staticmethod
    def with_place(label: str) -> str:
        """The ``label`` of a limit, with the edge of a ratio as its place."""
        return with_edge(label)
