"""Rows of escape routes in tables of the suite."""

from lensforge.addons.escape.route_light import RouteLight
from lensforge.addons.escape.route_section import RouteSection

Case = tuple[object, object]  # found, and by hand


def lighting_class(name: str) -> Case:
    route = RouteSection(lighting_class=name, lamp_height_m=2.8, spacing_m=9.0)
    return tuple(limit.bound for limit in RouteLight(route).limits()), (1.0, 0.5, 40.0, 900.0)


CHOICES = {"RouteSection.lighting_class": lighting_class}
CACHES = {}
