"""Figures of light by its spectrum: for colours, for eyes by night, for the inner clock, and for plants."""

from typing import Annotated

from lensforge.results import NotNegative, Number, Record
from lensforge.results.figure import Figure


class SpectralFigures(Record):
    """Figures of the spectrum of a source, which the light keeps behind the lens; None where they have no meaning.

    ``ra``, ``rf``, ``rg``: colour rendering; of light that has a colour temperature. ``scotopic_ratio``: lumens of the
    eye by night over those by day, S/P. ``melanopic_der``: melanopic daylight (D65) efficacy ratio, by which lux are
    multiplied for melanopic EDI. ``ppf_umol_per_j``: photons from 400 to 700 nm of a joule of light;
    ``ppfd_umol_per_m2_s_klx``: of them with 1000 lx.
    """

    ra: Annotated[Number | None, Figure("Colour rendering Ra", "CIE 13.3", key="ra", digits=3)]
    rf: Annotated[Number | None, Figure("Colour fidelity Rf", "ANSI/IES TM-30", key="rf", digits=3)]
    rg: Annotated[Number | None, Figure("Gamut index Rg", "ANSI/IES TM-30", key="rg", digits=3)]
    scotopic_ratio: Annotated[NotNegative | None, Figure("S/P ratio", "scotopic over photopic lumens", digits=3)]
    melanopic_der: Annotated[NotNegative | None, Figure("Melanopic DER", "melanopic EDI per lx, CIE S 026", digits=3)]
    ppf_umol_per_j: Annotated[
        NotNegative, Figure("Photons", "400 to 700 nm, of the light’s power", key="ppf", unit="µmol/J", digits=3)
    ]
    ppfd_umol_per_m2_s_klx: Annotated[
        NotNegative | None, Figure("PPFD", "with 1000 lx", key="ppfd", unit="µmol/(m² s)", digits=3)
    ]
