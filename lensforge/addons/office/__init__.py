"""Do the lamps of an office glare? Offices of a spec by their class of UGR: CIE 117 and CIE 190, EN 12464-1.

- ``office_section``: ``[[offices]]`` of a spec
- ``office_room``: lamps of a standard room and their background, as sums over the intensities of a lamp
- ``unified_glare``: the rating by these
- ``office_judgement``: the light in it, judged
- ``office_record``: the record of that
- ``office_light``: limits, judgement and facts, as the core asks for them
"""

from collections.abc import Mapping, Sequence

from lensforge.addon import Addon


def _names() -> Mapping[str, object]:
    from lensforge.addons.office.office_section import OfficeSection

    return {"OfficeSection": OfficeSection}


def _applications() -> Sequence[type]:
    from lensforge.addons.office.office_section import OfficeSection

    return (OfficeSection,)


def _light() -> Mapping[type, type]:
    from lensforge.addons.office.office_light import OfficeLight
    from lensforge.addons.office.office_section import OfficeSection

    return {OfficeSection: OfficeLight}


ADDON = Addon("office", _names, applications=_applications, light=_light)
