"""Does the light suit a road? Roads of a spec, what their drivers see, and any lamp judged on one: EN 13201, RP-8.

- ``road_section``: ``[[roads]]`` of a spec
- ``road_field``: points of a road and its observers, as sums over the intensities of the lamps
- ``road_surface``: tables of light that a road sends to a driver
- ``road_classes``: what a class requires
- ``road_light``: what the core asks of a road
- ``road_judgement``: the light on it, judged
- ``road_record``: the record of that
- ``road_facts``: what screen and page say of it
- ``road_figures``: pictures of it
- ``road_command``: the command ``road``
"""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

from lensforge.addon import Addon

if TYPE_CHECKING:
    import click


def _names() -> Mapping[str, object]:
    from lensforge.addons.road.road_section import RoadSection

    return {"RoadSection": RoadSection}


def _commands() -> "Sequence[click.Command]":
    from lensforge.addons.road.road_command import road

    return (road,)


def _pages() -> object:
    from lensforge.addons.road import road_figures

    return road_figures


def _applications() -> Sequence[type]:
    from lensforge.addons.road.road_section import RoadSection

    return (RoadSection,)


def _light() -> Mapping[type, type]:
    from lensforge.addons.road.road_light import RoadLight
    from lensforge.addons.road.road_section import RoadSection

    return {RoadSection: RoadLight}


ADDON = Addon("road", _names, _commands, pages=_pages, applications=_applications, light=_light)
