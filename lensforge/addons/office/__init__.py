"""Do the lamps of an office glare? Offices of a spec by their class of UGR, and the file of a lamp for their planning.

Of CIE 117 and CIE 190, EN 12464-1; the file is GLDF.

- ``office_section``: ``[[offices]]`` of a spec
- ``office_room``: lamps of a standard room and their background, as sums over the intensities of a lamp
- ``unified_glare``: the rating by these
- ``office_judgement``: the light in it, judged
- ``office_record``: the record of that
- ``office_light``: limits, judgement and facts, as the core asks for them
- ``product_figures``: luminance, cut-off angle and glare of a luminaire by its photometric file
- ``gldf_file``, ``gldf_command``: the file for DIALux and Relux, and the command that writes it
"""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

from lensforge.addon import Addon

if TYPE_CHECKING:
    import click


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


def _commands() -> "Sequence[click.Command]":
    from lensforge.addons.office.gldf_command import gldf

    return (gldf,)


ADDON = Addon("office", _names, _commands, "The shop and the machined part", applications=_applications, light=_light)
