"""What does one trade need beside the core? A package each, which nothing of the core imports; ``addon.py`` finds them.

- ``escape``: escape routes of a spec in emergency lighting
- ``measure``: photographs and measured points of a machined part, and its second cut
- ``office``: offices of a spec, their classes of glare, and the file of a luminaire for planning
- ``recheck``: a folder by which another program checks the light of the exported part
- ``road``: roads of a spec and their classes, and any lamp judged on one
- ``sports``: playing fields of a spec and their classes
- ``studio``: a page on which a spec is written and its light is seen
"""

from typing import TYPE_CHECKING

if TYPE_CHECKING:  # for those who check the types of scripts
    from lensforge.addons.escape.route_section import RouteSection as RouteSection
    from lensforge.addons.measure.inference_result import Inference as Inference
    from lensforge.addons.measure.measure_verbs import compare as compare
    from lensforge.addons.measure.measure_verbs import correct as correct
    from lensforge.addons.measure.measure_verbs import infer as infer
    from lensforge.addons.measure.measurement_result import Correction as Correction
    from lensforge.addons.measure.measurement_result import PhotoComparison as PhotoComparison
    from lensforge.addons.measure.measurement_result import SurfaceComparison as SurfaceComparison
    from lensforge.addons.office.office_section import OfficeSection as OfficeSection
    from lensforge.addons.road.road_section import RoadSection as RoadSection
    from lensforge.addons.sports.sports_section import FloodlightSection as FloodlightSection
    from lensforge.addons.sports.sports_section import SportsSection as SportsSection
    from lensforge.addons.studio.studio import Studio as Studio
    from lensforge.addons.studio.studio import studio as studio
