"""Flux code, direct ratios and figures of a spectrum by section 11 of docs/definitions.md alone.

Scotopic lumens and the rendering of colours are those of colour-science. The melanopic action spectrum is that of a
pigment by the template of Govardovskii et al. (Vis. Neurosci. 17, 2000) behind the lens of an eye of 32 years (van de
Kraats & van Norren, J. Opt. Soc. Am. A 24, 2007), within 3 % of its table.
"""

from functools import cache

import numpy as np
from page_colour import colour_temperature, spectrum, tristimulus_at, uv

ROOMS = (0.6, 0.8, 1, 1.25, 1.5, 2, 2.5, 3, 4, 5)
CONES = np.degrees(np.arccos([0.75, 0.5, 0.25]))


def shares_of_nodes(c_deg, gamma_deg):
    """Flux by each node of a bilinear table [what, c, gamma]: in three cones, of all, and on ten working planes.

    By midpoints of small cells that end at the cones.
    """
    edges = np.unique(np.concatenate([np.arange(0, 90.01, 0.1), CONES]))
    gamma = (edges[1:] + edges[:-1]) / 2
    turn = np.arange(0.25, 360, 0.5)
    solid = np.outer(np.full(len(turn), np.radians(0.5)), np.sin(np.radians(gamma)) * np.radians(np.diff(edges)))
    x = np.outer(abs(np.cos(np.radians(turn))), np.tan(np.radians(gamma)))
    y = np.outer(abs(np.sin(np.radians(turn))), np.tan(np.radians(gamma)))
    seen = [solid * (gamma < cone) for cone in (*CONES, 91)]
    seen += [solid * np.clip(1 - x / (2 * k), 0, 1) * np.clip(1 - y / (2 * k), 0, 1) for k in ROOMS]
    step = 360 / len(c_deg)
    around = np.maximum(0, 1 - abs((turn[:, None] - np.asarray(c_deg) + 180) % 360 - 180) / step)
    down = np.stack([np.interp(gamma, gamma_deg, node) for node in np.eye(len(gamma_deg))])
    return np.array([around.T @ part @ down.T for part in seen])


def shares(c_deg, gamma_deg, values):
    """N1 to N4, and the ten direct ratios."""
    key = (tuple(c_deg), tuple(gamma_deg))
    flux = np.tensordot(_nodes(*key), values, axes=2)
    return np.concatenate([flux[:3] / flux[3], [1.0], flux[4:] / flux[3]])


@cache
def _nodes(c_deg, gamma_deg):
    return shares_of_nodes(c_deg, gamma_deg)


def melanopic(nm):
    """Action spectrum of melanopsin, 1 at its largest."""
    a = 0.8795 + 0.0459 * np.exp(-((480 - 300) ** 2) / 11940)
    x = 480 / nm
    pigment = 1 / (np.exp(69.7 * (a - x)) + np.exp(28 * (0.922 - x)) + np.exp(-14.9 * (1.104 - x)) + 0.674)
    pigment += 0.26 * np.exp(-(((nm - (189 + 0.315 * 480)) / (-40.5 + 0.195 * 480)) ** 2))
    old = 32**2
    bands = ((0.998 - 6.3e-5 * old) * 2.13, 0.029, 370), ((0.059 + 1.86e-4 * old) * 11.95, 0.021, 325)
    bands += (14.19 * 10.68, 0.057, 273), ((0.016 + 1.32e-4 * old) * 1.43, 0.008, 325)
    density = (0.30 + 3.1e-5 * old) * (400 / nm) ** 4
    density += sum(most * np.exp(-((narrow * (nm - at)) ** 2)) for most, narrow, at in bands)
    action = nm * pigment / 10**density
    return action / action.max()


def mixed(source):
    """Wavelengths (nm), every 0.1, and power density of all LEDs of a source together; None without a spectrum."""
    parts = [(source["spectrum"], 1.0)] if source.get("spectrum") else []
    if source["kind"] == "chips":
        parts = [(chip["spectrum"], chip["flux_lm"]) for chip in source["chips"]]
    nm = np.arange(360, 830.05, 0.1)
    density = 0 * nm
    for section, lumens in parts:
        at, power = spectrum(section)
        power = np.interp(nm, at, power, left=0, right=0)
        density += power * (lumens / (power @ tristimulus_at(nm)[:, 1]))
    return (nm, density) if parts else None


def spectral(source):
    """The figures of a spectrum; None without one."""
    from colour import SpectralDistribution
    from colour.colorimetry import SDS_LEFS_SCOTOPIC
    from colour.quality import colour_fidelity_index_ANSIIESTM3018, colour_rendering_index

    light = mixed(source)
    if light is None:
        return None
    nm, density = light
    power = density.sum()
    seen = density @ tristimulus_at(nm)
    rods = next(iter(SDS_LEFS_SCOTOPIC.values()))
    night = 1700.06 * density @ np.interp(nm, rods.wavelengths, rods.values, left=0, right=0)
    clock = density @ melanopic(nm) / 1.3262e-3
    photons = (density * nm)[(nm > 400) & (nm < 700)].sum() / 119.62656
    figures = {
        "scotopic_ratio": night / seen[1], "melanopic_der": clock / seen[1], "ppf_umol_per_j": photons / power,
        "ppfd_umol_per_m2_s_klx": 1000 * photons / seen[1], "ra": None, "rf": None, "rg": None,
    }  # fmt: skip
    if colour_temperature(uv(seen)) is not None:
        whole = np.arange(360, 831)
        table = SpectralDistribution(dict(zip(whole.tolist(), np.interp(whole, nm, density), strict=True)))
        many = colour_fidelity_index_ANSIIESTM3018(table, additional_data=True)
        figures |= {"ra": colour_rendering_index(table), "rf": many.R_f, "rg": many.R_g}
    return figures
