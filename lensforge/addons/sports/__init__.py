"""Do floodlights suit a playing field? Fields of a spec by their class: EN 12193, and glare by CIE 112.

- ``sports_section``: ``[[sports]]`` of a spec
- ``sports_field``: points and observers of a field, as sums over the intensities of the lamps
- ``glare_rating``: the rating by these
- ``sports_judgement``: the light in it, judged
- ``sports_record``: the record of that
- ``sports_light``: limits, judgement and facts, as the core asks for them
"""

from collections.abc import Mapping, Sequence

from lensforge.addon import Addon


def _names() -> Mapping[str, object]:
    from lensforge.addons.sports.sports_section import FloodlightSection, SportsSection

    return {"FloodlightSection": FloodlightSection, "SportsSection": SportsSection}


def _applications() -> Sequence[type]:
    from lensforge.addons.sports.sports_section import SportsSection

    return (SportsSection,)


def _light() -> Mapping[type, type]:
    from lensforge.addons.sports.sports_light import SportsLight
    from lensforge.addons.sports.sports_section import SportsSection

    return {SportsSection: SportsLight}


ADDON = Addon("sports", _names, applications=_applications, light=_light)
