"""Colour and lumens by sections 6 and 10 of docs/definitions.md alone; the observer's tables are colour-science's."""

from functools import cache

import numpy as np
from page_figures import jackknife, largest, over_pairs, root

HC_OVER_K = 1.438776877e7  # nm K


@cache
def observer():
    from colour.colorimetry import MSDS_CMFS

    functions = MSDS_CMFS["CIE 1931 2 Degree Standard Observer"]
    return np.array(functions.wavelengths), np.array(functions.values)


def tristimulus_at(nm):
    """X, Y, Z (lm) of 1 W at each wavelength."""
    at, functions = observer()
    return 683.002 * np.column_stack([np.interp(nm, at, column, left=0, right=0) for column in functions.T])


def spectrum(section):
    """Wavelengths (nm) and power density of a spectrum, dense."""
    if section["kind"] == "gaussian":
        sigma = section["fwhm_nm"] / np.sqrt(8 * np.log(2))
        nm = section["peak_nm"] + np.linspace(-4, 4, 2001) * sigma
        return nm, np.exp(-0.5 * ((nm - section["peak_nm"]) / sigma) ** 2)
    nm = np.linspace(section["wavelength_nm"][0], section["wavelength_nm"][-1], 20_001)
    return nm, np.interp(nm, section["wavelength_nm"], section["weight"])


def efficacy(section):
    """lm/W of a spectrum."""
    nm, density = spectrum(section)
    return np.trapezoid(density * tristimulus_at(nm)[:, 1], nm) / np.trapezoid(density, nm)


def flux_and_efficacy(source, files):
    """W, and lm/W or None, of a source; ``files``: W and lm/W of each ray file by its stem."""
    if source["kind"] == "chips":
        pairs = [(chip["flux_lm"] / efficacy(chip["spectrum"]), chip["flux_lm"]) for chip in source["chips"]]
        watts, lumens = np.sum(pairs, axis=0)
        return watts, lumens / watts
    if source["kind"] == "rayfiles":
        stems = [part["file"].split("/")[-1].split(".")[0] for part in source["files"]]
        watts = [part["flux_w"] for part in source["files"]]
        return sum(watts), sum(w * files[s][1] for w, s in zip(watts, stems, strict=True)) / sum(watts)
    lumens_per_watt = source.get("luminous_efficacy_lm_per_w")
    if source.get("spectrum"):
        lumens_per_watt = efficacy(source["spectrum"])
    if source["kind"] == "rayfile":
        lumens_per_watt = files[source["file"].split("/")[-1].split(".")[0]][1]
    return source["flux_w"] or source["flux_lm"] / lumens_per_watt, lumens_per_watt


def denominator(xyz):
    return xyz[0] + 15 * xyz[1] + 3 * xyz[2]


def uv(xyz):
    return np.array([4 * xyz[0], 9 * xyz[1]]) / denominator(xyz)


@cache
def locus():
    """CIE 1960 u, v of black bodies."""
    nm, _ = observer()
    kelvin = np.geomspace(1000, 25_000, 6001)
    at = tristimulus_at(nm)
    power = nm**-5.0 / np.expm1(HC_OVER_K / (nm * kelvin[:, None]))
    places = np.array([uv(xyz) for xyz in (power / power.max(axis=1, keepdims=True)) @ at])
    return kelvin, places * [1, 2 / 3]


def colour_temperature(at):
    """CCT and Duv of u', v'; None beyond 0.05."""
    kelvin, line = locus()
    u, v = at[0], at[1] * 2 / 3
    away = np.hypot(*(line - [u, v]).T)
    k = int(np.argmin(away))
    if k in (0, len(kelvin) - 1) or away[k] > 0.05:
        return None
    left = line[k - 1]
    right = line[k + 1]
    along = (right - left) / np.hypot(*(right - left))
    part = np.dot(np.array([u, v]) - left, along) / np.hypot(*(right - left))
    foot = left + part * (right - left)
    return kelvin[k - 1] * (kelvin[k + 1] / kelvin[k - 1]) ** part, np.hypot(u - foot[0], v - foot[1]) * (
        1 if v > foot[1] else -1
    )


def beam_colour(pictures, level):
    """Figures of the beam of filtered pictures [replicate, X Y Z, row, column]."""
    light = np.array([picture[1].ravel() for picture in pictures])
    peak = largest(light)[0]
    inside = np.mean([picture[1] for picture in pictures], axis=0) >= level * peak
    lit = np.array([picture[:, inside] for picture in pictures])
    totals = lit.sum(axis=2)
    u0, v0 = uv(totals.mean(axis=0))
    mean = denominator(lit.mean(axis=0))
    away = []
    for sample in lit:
        d = denominator(sample)
        away.append(np.array([4 * sample[0] - u0 * d, 9 * sample[1] - v0 * d]) / mean)
    count = inside.sum()
    rms = root(*over_pairs([offset / np.sqrt(count) for offset in away], [1.0] * len(away)))
    turns = 2 * np.pi * np.arange(32) / 32
    along = [np.concatenate([offset[0] * np.cos(a) + offset[1] * np.sin(a) for a in turns]) for offset in away]
    known = colour_temperature((u0, v0))
    record = {
        "level": level, "pixels": int(count), "rms": rms, "worst": largest(along, rms[0]),
        "u": jackknife(totals, lambda m: uv(m)[0]), "v": jackknife(totals, lambda m: uv(m)[1]), "cct": None,
        "duv": None,
    }  # fmt: skip
    if known is not None:
        record["cct"], record["duv"] = (
            jackknife(totals, lambda m, k=k: (colour_temperature(uv(m)) or known)[k]) for k in (0, 1)
        )
    return record
