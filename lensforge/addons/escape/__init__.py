"""Do luminaires light an escape route? Routes of a spec by emergency lighting of EN 1838.

- ``route_section``: ``[[routes]]`` of a spec
- ``route_light``: the light of a row of lamps on a route, its limits and its record, as the core asks for them
"""

from collections.abc import Mapping, Sequence

from lensforge.addon import Addon


def _names() -> Mapping[str, object]:
    from lensforge.addons.escape.route_section import RouteSection

    return {"RouteSection": RouteSection}


def _applications() -> Sequence[type]:
    from lensforge.addons.escape.route_section import RouteSection

    return (RouteSection,)


def _light() -> Mapping[type, type]:
    from lensforge.addons.escape.route_light import RouteLight
    from lensforge.addons.escape.route_section import RouteSection

    return {RouteSection: RouteLight}


ADDON = Addon("escape", _names, applications=_applications, light=_light)
