"""Rows of playing fields in tables of the suite."""

from playing_field import FIELD

from lensforge.addons.sports.sports_light import SportsLight
from lensforge.addons.sports.sports_section import SportsSection

Case = tuple[object, object]  # found, and by hand
CLASSES = {
    "football I": (500.0, 0.7, 50.0), "football II": (200.0, 0.6, 50.0), "football III": (75.0, 0.5, 55.0),
    "tennis I": (500.0, 0.7, 50.0), "tennis II": (300.0, 0.7, 50.0), "tennis III": (200.0, 0.6, 55.0),
}  # fmt: skip


def lighting_class(name: str) -> Case:
    field = SportsSection(**FIELD | {"lighting_class": name})
    return tuple(limit.bound for limit in SportsLight(field).limits()), CLASSES[name]


CHOICES = {"SportsSection.lighting_class": lighting_class}
CACHES = {}
