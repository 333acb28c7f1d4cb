"""Orientation of a luminaire against its photometric file.

LM-63 (type C) and EULUMDAT count C counterclockwise as seen from above on a luminaire that shines down (ANSI/IESNA
LM-63-02, section 3; Radiance's ies2rad aims it along -z with C = 0 at +x and C = 90 at +y). A lens here shines up,
along +z. Turned over about its x axis it shines down: so C = 0 is its x axis and C = 90 its -y axis. With +y instead,
every pattern without mirror symmetry would appear mirrored in a lighting program.
"""

import numpy as np

from lensforge.sources.intensity import TabulatedIntensity


def turned_over(table: TabulatedIntensity) -> TabulatedIntensity:
    """Table with C counted the other way: from a file's frame to the lens's, where C runs from +x to +y, or back."""
    if len(table.c_deg) == 1:
        return table
    return TabulatedIntensity(np.ascontiguousarray(360.0 - table.c_deg[::-1]), table.gamma_deg, table.values[::-1])
