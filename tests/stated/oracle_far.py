"""Oracles of the far field, its files and its roads, by docs/definitions.md alone.

The table of each sample is lensforge's own: it must hold the light of the very rays, by flux and moments; all figures
follow from these tables and from the rays, again.
"""

import xml.etree.ElementTree as ET
from dataclasses import replace
from itertools import pairwise

import numpy as np
import page_luminaire
import page_road
from crooked import Expected
from oracle_light import kinds_in
from page_colour import flux_and_efficacy
from page_figures import (
    EIGHTS,
    RAY,
    by_half_samples,
    jackknife,
    largest,
    least_parts,
    metric,
    plain,
    scaled,
    state_of,
    width_above,
)
from page_scene import by_fate, exits_of_each, faces_of, lamps_of

LOST = (
    "backward", "outside_cavity", "base", "total_reflection", "surfaces_intersect", "event_limit", "flange",
    "absorbed", "cover_glass",
)  # fmt: skip
KEPT = {}


def once(case, what):
    """The result of ``what`` for this case, made once."""
    if (case.name, what) not in KEPT:
        KEPT[case.name, what] = what(case)
    return KEPT[case.name, what]


# -- Light that leaves upwards -----------------------------------------------------------------------------------------


def together(case):
    """Lamps whose light is in the files: all."""
    lamps = case.lens["spec"]["lamps"]
    return 1 if lamps is None else len(lamps["places_mm"])


def leaving(case):
    """Of each of 16 samples: flux (W) upwards, directions and flux of these rays, and flux by fate.

    If lamps have aims, a ray is of a lamp that is drawn by chance; all lamps have as many rays.
    """
    lens = case.lens
    by_sample = []
    turns = lamps_of(case.lens["spec"])[1]
    aimed = bool((lens["spec"]["lamps"] or {}).get("aims_mm"))
    kinds = lamps_of(lens["spec"])[2]
    others = lens.get("others") or {}
    faces = {kind: faces_of(lens, others.get(kind, lens["faces"])) for kind in dict.fromkeys(kinds)}
    bundles = [(p, d, nm) for p, d, _, nm in case.rays["photometry"]]
    traced = {kind: list(exits_of_each(lens, kind_faces, bundles)) for kind, kind_faces in faces.items()}
    for number, (_, _, flux, _) in enumerate(case.rays["photometry"]):
        flux = flux * together(case)
        upward = 0.0
        on = []
        of_ray = []
        fates = {}
        for kind, samples in traced.items():
            share = kinds.count(kind) / len(kinds)
            behind = samples[number]
            if aimed:
                lamp = np.random.default_rng(len(flux)).permutation(len(flux)) % len(turns)
                behind = replace(behind, d=np.einsum("nij,nj->ni", turns[lamp], behind.d))
            rows = behind.left[behind.d[behind.left, 2] > 0]
            rest = np.setdiff1d(behind.left, rows)
            on.append(behind.d[rows])
            of_ray.append(share * (behind.flux * flux)[rows])
            upward += of_ray[-1].sum()
            lost = by_fate(behind, flux, LOST[:-2]) | {"missed_receiver": (behind.flux * flux)[rest].sum()}
            for name, amount in lost.items():
                fates[name] = fates.get(name, 0) + share * amount
        by_sample.append((upward, np.concatenate(on), np.concatenate(of_ray), fates))
    return by_sample


def lumens(case):
    """W and lm of the source, and whether the lumens are known."""
    spec = case.lens["spec"]
    watts, efficacy = flux_and_efficacy(spec["source"], case.files)
    count = together(case)
    return count * watts, count * watts * efficacy if efficacy else 1000.0, efficacy is not None


# -- Tables ------------------------------------------------------------------------------------------------------------


def solid_angles(c_deg, gamma_deg):
    """Integral of the bilinear function of one node of each cone, by Simpson's rule in fine steps."""
    gamma = np.radians(gamma_deg)
    angles = np.zeros(len(gamma))
    for k, (low, high) in enumerate(pairwise(gamma)):
        at = np.linspace(low, high, 201)
        part = (at - low) / (high - low)
        weights = np.array([1, *[4, 2] * 99, 4, 1]) * (high - low) / 600
        angles[k] += (weights * np.sin(at) * (1 - part)).sum()
        angles[k + 1] += (weights * np.sin(at) * part).sum()
    return angles * 2 * np.pi / len(c_deg)


def above_zero(values, weights):
    """Values below 0 as 0: the others of their cone become less, then all, so that the flux stays."""
    flux = (values * weights).sum()
    positive = np.maximum(values, 0)
    for k in range(values.shape[1]):
        if positive[:, k].sum() > 0:
            positive[:, k] *= max(values[:, k].sum(), 0) / positive[:, k].sum()
    return positive * flux / (positive * weights).sum()


class Tables:
    """The tables (cd) of all samples at azimuths and gammas; ``whole`` without values below 0.

    ``rival``: those in steps that other rays might choose, and their doubt; None without any.
    """

    def __init__(self, case, given=None):
        azimuth, gamma, samples, rival = given or case.rays["tables"]
        self.rival = rival and (rival[0], Tables(case, rival[1]))
        watts, source_lm, _ = lumens(case)
        self.azimuth = azimuth
        self.gamma = gamma
        self.samples = samples * source_lm / watts
        weights = solid_angles(azimuth, gamma)
        self.weights = weights
        self.whole = above_zero(self.samples.mean(axis=0), weights)
        self.by_halves = [above_zero(self.samples[half].mean(axis=0), weights) for half in EIGHTS]

    def figure(self, read):
        value = read(self.azimuth, self.gamma, self.whole)
        by_half = [read(self.azimuth, self.gamma, table) for table in self.by_halves]
        return value, by_half_samples(np.reshape(by_half, (15, 2)))


def doubted(tables, read):
    """Figures with their errors, which count how the figures change in tables of other steps."""
    values = read(tables)
    if tables.rival is None:
        return values
    doubt, other = tables.rival
    pairs = zip(values, read(other), strict=True)
    return [(value, np.hypot(error, doubt * (value - changed))) for (value, error), (changed, _) in pairs]


def bilinear(azimuth, gamma, values, at, down):
    """Values [..., c, gamma] in directions (degrees)."""
    step = 360 / len(azimuth)
    i = np.floor(at / step).astype(int)
    a = at / step - i
    i = i % len(azimuth)
    k = np.clip(np.searchsorted(gamma, down, side="right") - 1, 0, len(gamma) - 2)
    j = (i + 1) % len(azimuth)
    b = (down - gamma[k]) / (gamma[k + 1] - gamma[k])
    low = values[..., i, k] * (1 - a) + values[..., j, k] * a
    return low * (1 - b) + (values[..., i, k + 1] * (1 - a) + values[..., j, k + 1] * a) * b


def profile(azimuth, gamma, values, c_deg):
    """Angles from one side of the plane to the other, and the values there."""
    near = bilinear(azimuth, gamma, values, np.full(len(gamma), -c_deg % 360), gamma)
    far = bilinear(azimuth, gamma, values, np.full(len(gamma), (180 - c_deg) % 360), gamma)
    return np.concatenate([-gamma[:0:-1], gamma]), np.concatenate([far[..., :0:-1], near], axis=-1)


def plane(tables, c_deg):
    """Peak, beam and field angle of the planes C and C + 180."""
    readings = profile(tables.azimuth, tables.gamma, tables.samples, c_deg)[1]
    peak = largest(readings)
    peaks = -least_parts(-readings)[1].ravel()
    figures = [peak]
    for share in (0.5, 0.1):

        def width(table, most, share=share):
            return width_above(*profile(tables.azimuth, tables.gamma, table, c_deg), share * most)

        by_half = [width(table, most) for table, most in zip(tables.by_halves, peaks, strict=True)]
        figures.append((width(tables.whole, peak[0]), by_half_samples(np.reshape(by_half, (15, 2)))))
    return figures


def plane_record(tables, c_deg):
    """The beam in one plane as the record has it."""
    peak, beam, field = doubted(tables, lambda given: plane(given, c_deg))
    angles = {"beam_angle_deg": metric(beam, "°", RAY), "field_angle_deg": metric(field, "°", RAY)}
    return {"c_deg": float(c_deg), "peak_cd": metric(peak, "cd", RAY), **angles}


def photometry(case):
    """The record of the far field."""
    watts, source_lm, known = lumens(case)
    per_watt = source_lm / watts
    tables = once(case, Tables)
    samples = once(case, leaving)
    up = jackknife([sample[0] for sample in samples])
    # Lamps take rays by chance, as many each: of kinds that differ the flux is that of a mean ray within its noise.
    near = 4.0 if kinds_in(case) > 1 else 0.02
    count = sum(len(part[2]) for part in case.rays["photometry"])
    fates = {name: np.mean([sample[3][name] for sample in samples]) for name in samples[0][3]}
    lost = {name: plain(fates[name], floor=near * up[1]) for name in (*LOST, "missed_receiver")}
    lost |= {
        "not_converged": 0.0,
        "housing": 0.0,
        "second_wall": 0.0,
        "bodies": plain(sum(v for k, v in fates.items() if k.startswith("body"))),
    }
    c, gamma = np.unravel_index(np.argmax(tables.whole), tables.whole.shape)
    planes = {f"beam_c{c_deg}": plane_record(tables, c_deg) for c_deg in (0, 90)}
    (axis,) = doubted(tables, lambda given: [given.figure(lambda _c, _g, values: values[0, 0])])
    (peak,) = doubted(tables, lambda given: [largest(given.samples.reshape(16, -1))])
    exit_lm = scaled(up, per_watt)
    errors = tables.samples.std(axis=0, ddof=1) / 4
    bright = tables.samples.mean(axis=0) > 0.1 * tables.samples.mean(axis=0).max()
    relative = (errors / tables.samples.mean(axis=0))[bright]
    weights = (0 * errors + tables.weights)[bright]
    written = {"watts": None, "rays": None, "lumens": metric(exit_lm, near=near)["value"], "relative_error": ...}
    known_lm = written["lumens"] if known else None
    return {
        "conditions": ..., "rays": count, "source_w": plain(watts), "exit_w": metric(up, "W", near),
        "light_output_ratio": metric(scaled(up, 1 / watts), "", near), "lost_w": lost,
        "reflected_w": (watts - up[0] - sum(v for v in fates.values()), 4 * near * up[1] + 1e-4 * watts),
        "source_lm": plain(source_lm), "per_1000_lm": not known,
        "source_lm_from": "spec or source file" if known else "not known",
        "exit_lm": metric(exit_lm, "lm", near),
        "axis_cd": metric(axis, "cd", RAY), "peak_cd": metric(peak, "cd"),
        "peak_direction": {
            "c_deg": float(-tables.azimuth[c] % 360) if gamma else 0.0, "gamma_deg": tables.gamma[gamma]
        },
        **planes, "figures": luminaire(tables, metric(scaled(up, 1 / watts), "", near), peak if known else None),
        "spectrum": rounded(once(case, spectrum_of)), "road": area(case, exit_lm),
        "roads": [road_record(case, road) for road in case.lens["spec"].get("roads") or []],
        "node_error": {"max": plain(relative.max()), "rms": plain(np.sqrt((relative**2 @ weights) / weights.sum()))},
        "interpolation_error": ..., "warnings": ..., "criteria": ...,
        "files": {
            **dict.fromkeys(("ies", "ldt", "tm33"), written),
            "tm25ray": written | {
                "rays": (sum(len(sample[2]) for sample in samples) / kinds_in(case), near * 9), "lumens": known_lm,
                "watts": metric(up, "W", near)["value"],
            },
        },
    }  # fmt: skip


def luminaire(tables, light_output_ratio, peak):
    """Throw, flux code and direct ratios."""

    def shares(given):
        def share(number):
            return lambda *table: page_luminaire.shares(*table)[number]

        return [given.figure(share(number)) for number in range(14)]

    metrics = [metric(share, near=RAY) for share in doubted(tables, shares)]
    throw = None
    if peak is not None:
        throw = metric((np.sqrt(4 * peak[0]), peak[1] / np.sqrt(peak[0])), "m")
    return {"throw": throw, "flux_code": [*metrics[:4], light_output_ratio], "direct_ratios": metrics[4:]}


def spectrum_of(case):
    """Figures of the spectrum of the source."""
    return page_luminaire.spectral(case.lens["spec"]["source"])


def rounded(record):
    """Figures of a spectrum as a record has them."""
    within = {"melanopic_der": 0.03}
    return record and {name: v if v is None else plain(v, within.get(name, 1e-3)) for name, v in record.items()}


# -- A lamp for an area ------------------------------------------------------------------------------------------------

ZONES = ("low", "mid", "high", "very_high")
BUG = {
    "backlight": {"back_high": (110, 500, 1000, 2500, 5000), "back_mid": (220, 1000, 2500, 5000, 8500),
                  "back_low": (110, 500, 1000, 2500, 5000)},
    "glare": {"forward_very_high": (10, 100, 225, 500, 750), "back_very_high": (10, 100, 225, 500, 750),
              "forward_high": (660, 1800, 5000, 7500, 12000), "back_high": (110, 500, 1000, 2500, 5000)},
}  # fmt: skip
GLARE = {
    "G*6": (350, 100),
    "G*5": (350, 100),
    "G*4": (500, 100),
    "G*3": (np.inf, 100),
    "G*2": (np.inf, 150),
    "G*1": (np.inf, 200),
}
ALONG = {"very short": 1.0, "short": 2.25, "medium": 3.75, "long": 6.0, "very long": np.inf}
ACROSS = {"I": 1.0, "II": 1.75, "III": 2.75, "IV": np.inf}


def area(case, exit_lm):
    """Zones by the rays, distribution and glare by the tables; none for general lighting."""
    section = case.lens["spec"]["photometry"]
    if section["use"] == "general":
        return None
    watts, source_lm, _ = lumens(case)
    tables = once(case, Tables)
    zones = {}
    side = np.radians(section["street_side_deg"])
    street = np.array([np.cos(side), np.sin(side)])
    for row, name in enumerate(("forward", "back")):
        for low, high, zone in zip((0, 30, 60, 80), (30, 60, 80, 90.001), ZONES, strict=True):
            samples = []
            for _, d, flux, _ in once(case, leaving):
                gamma = np.degrees(np.arccos(d[:, 2]))
                ahead = d[:, :2] @ street > 0
                samples.append(flux[(gamma >= low) & (gamma < high) & (ahead == (row == 0))].sum() * source_lm / watts)
            zones[f"{name}_{zone}"] = metric(jackknife(samples), "lm")
    ratings = {
        name: max(sum(zones[zone]["value"][0] > most for most in bounds) for zone, bounds in table.items())
        for name, table in BUG.items()
    }
    none = {"value": 0.0, "unit": "lm", "standard_error": 0.0}
    zones |= {"up_low": none, "up_high": none}
    return {
        "lumens": metric(exit_lm, "lm"), "distribution": distribution(tables, section["street_side_deg"]),
        "bug": {"uplight": 0, **ratings, "zones": zones}, "glare": near_horizon(tables, exit_lm[0]),
    }  # fmt: skip


def distribution(tables, street_deg):
    turns = np.arange(360.0)
    gammas = np.arange(0, 89, 0.1)
    lateral, gamma = (coordinates.ravel() for coordinates in np.meshgrid(turns, gammas, indexing="ij"))
    far = np.tan(np.radians(gamma))
    along = abs(far * np.sin(np.radians(lateral)))
    across = far * np.cos(np.radians(lateral))

    def read(azimuth, gammas, values):
        return bilinear(azimuth, gammas, values, lateral + street_deg, gamma)

    def reaches(light):
        return np.where((light >= light.max() / 2).reshape(360, -1), far.reshape(360, -1), 0).max(axis=1)

    samples = read(tables.azimuth, tables.gamma, tables.samples)
    roundness = jackknife(samples, lambda light: reaches(light).min() / reaches(light).max())
    everywhere = roundness[0] >= 2 / 3
    peak = samples.mean(axis=0).argmax()
    at = far[peak] if everywhere else along[peak]
    longitudinal = next(name for name, end in ALONG.items() if at < end)
    ends = [0.0, *ALONG.values()]
    low = ends[list(ALONG).index(longitudinal)]
    high = ALONG[longitudinal]

    def reach(sign):
        def of(light):
            there = (light >= light.max() / 2) & (along >= low) & (along <= high)
            return max((sign * across[there]).max(), 0)

        value, error = jackknife(samples, of)
        return value, np.hypot(error, np.radians(0.05) * (1 + value**2))

    street = reach(1)
    house = reach(-1)
    lateral_type = "V" if everywhere else next(name for name, end in ACROSS.items() if street[0] <= end)
    return {
        "lateral": lateral_type, "longitudinal": longitudinal, "along_mh": plain(at),
        "street_mh": metric(street, near=RAY),
        "house_mh": metric(house, near=RAY), "roundness": metric(roundness, near=RAY),
    }  # fmt: skip


def near_horizon(tables, exit_lm):
    levels = {}
    for name, least in (("above_70", 70.0), ("above_80", 80.0)):
        nodes = np.array([least, *tables.gamma[tables.gamma > least]])
        at, down = (coordinates.ravel() for coordinates in np.meshgrid(tables.azimuth, nodes, indexing="ij"))
        levels[name] = metric(
            scaled(largest(bilinear(tables.azimuth, tables.gamma, tables.samples, at, down)), 1000 / exit_lm), "cd/klm"
        )
    values = [levels[name]["value"][0] for name in ("above_70", "above_80")]
    keeps = (name for name, bounds in GLARE.items() if values[0] <= bounds[0] and values[1] <= bounds[1])
    return levels | {"glare_class": next(keeps, "none")}


# -- Roads -------------------------------------------------------------------------------------------------------------


def road_record(case, road):
    """Figures and limits of one road by the table of the files."""
    spec = case.lens["spec"]
    tables = once(case, Tables)
    source_lm = lumens(case)[1]
    side = spec["photometry"]["street_side_deg"]
    factor = road["lamp_lm"] / source_lm if road["lamp_lm"] else spec["photometry"]["lenses"]

    left_out = [np.delete(tables.samples, k, axis=0).mean(axis=0) for k in range(16)]
    in_file = np.array([tables.whole, *(above_zero(table, tables.weights) for table in left_out)])

    def candela(lateral, gamma):
        return factor * bilinear(tables.azimuth, tables.gamma, in_file, lateral + side, np.minimum(gamma, 90))

    judgement = page_road.figures(road, candela)
    drivers = [
        {
            "lane": number + 1, "mean_cd_per_m2": metric(lane["mean"], "cd/m²"),
            "uniformity": metric(lane["uniformity"]), "uniformity_along": metric(lane["along"]),
            "glare_percent": metric(lane["glare"], "%"),
            "luminance_per_lux": metric(lane["q"], "cd/m²/lx"), "veiling_ratio": None,
        }
        for number, lane in enumerate(judgement["lanes"])
    ]  # fmt: skip
    limits = []
    for name, quantity, value, unit, sense, bound in page_road.asked(road, judgement):
        stated = metric(value, unit)
        limits.append({
            "name": name, "receiver": road["name"], "quantity": quantity, "value": stated, "sense": sense,
            "bound": bound, "unit": unit, "state": state_of(stated, sense, bound),
        })  # fmt: skip
    _, tans, r = page_road.surface(road["surface"])
    s1 = np.interp(2, tans, r[:, 0]) / r[0, 0]
    return {
        "name": road["name"], "lighting_class": road["lighting_class"], "reached": page_road.reached(road, judgement),
        "surface": road["surface"], "q0": 0.07, "s1": plain(s1), "drivers": drivers,
        "edges": [metric(edge) for edge in judgement["edges"]], "mean_lx": metric(judgement["mean_lx"], "lx"),
        "least_lx": metric(judgement["least_lx"], "lx"), "uniformity_lx": metric(judgement["u_lx"]),
        "power_density": metric(judgement["power"], "W/lx/m²"), "yearly_energy": metric(judgement["energy"], "kWh/m²"),
        "limits": limits, "standard": "EN 13201",
    }  # fmt: skip


# -- Files -------------------------------------------------------------------------------------------------------------


def ies(text):
    """C, gamma and candela of an IES file by its numbers alone."""
    numbers = [float(number) for number in text.split("TILT=NONE")[1].split()]
    gammas = int(numbers[3])
    planes = int(numbers[4])
    factor = numbers[2] * numbers[10]
    at = 13
    gamma = numbers[at : at + gammas]
    c = numbers[at + gammas : at + gammas + planes]
    values = np.array(numbers[at + gammas + planes :][: gammas * planes]).reshape(planes, gammas)
    return (
        np.array(c),
        np.array(gamma),
        values * factor,
        {"lamps": numbers[0], "lumens": numbers[1], "size": numbers[7:10]},
    )


def ldt(text):
    """C, gamma and candela (cd per 1000 lm in the file) of an EULUMDAT file."""
    lines = text.splitlines()
    planes = int(lines[3])
    gammas = int(lines[5])
    sets = int(lines[25])
    at = 26 + 6 * sets + 10
    c = np.array([float(line) for line in lines[at : at + planes]])
    gamma = np.array([float(line) for line in lines[at + planes : at + planes + gammas]])
    values = np.array([float(line) for line in lines[at + planes + gammas :]]).reshape(-1, gammas)
    return (
        c,
        gamma,
        values * float(lines[28]) / 1000,
        {"symmetry": lines[2], "lor": float(lines[22]), "lumens": lines[28]},
    )


def tm33(text):
    """C, gamma and candela of a TM-33 file."""
    candela = {}
    for element in ET.fromstring(text).iter():
        if element.tag.split("}")[-1] == "IntData":
            candela[float(element.get("h")), float(element.get("v"))] = float(element.text)
    c = sorted({h for h, _ in candela})
    gamma = sorted({v for _, v in candela})
    return np.array(c), np.array(gamma), np.array([[candela[h, v] for v in gamma] for h in c])


# -- Facts -------------------------------------------------------------------------------------------------------------


def recorded(case):
    return once(case, photometry)


def stated(entry, **more):
    (value, within) = entry["value"]
    (error, near) = entry["standard_error"]
    return Expected(value, within, entry["unit"], error, near, **more)


def fact(*path):
    def oracle(case, place):
        entry = recorded(case)
        for key in path:
            entry = entry[key]
        if isinstance(entry, dict):
            return stated(entry)
        return Expected(*entry) if isinstance(entry, tuple) else Expected(entry)

    return oracle


def plane_fact(key):
    return lambda case, place: stated(recorded(case)[f"beam_c{place.key.split()[1]}"][key])


def flux_code(case, place):
    shares = [share["value"][0] for share in recorded(case)["figures"]["flux_code"]]
    return Expected(" ".join(f"{100 * share:.0f}" for share in shares))


def spectral_fact(key, unit=""):
    def oracle(case, place):
        return Expected(*recorded(case)["spectrum"][key], unit)

    return oracle


def road_of(case, place):
    return recorded(case)["roads"][place.group]


def road_fact(key):
    def oracle(case, place):
        entry = road_of(case, place)[key]
        return stated(entry) if isinstance(entry, dict) else Expected(entry)

    return oracle


def road_q(case, place):
    return stated(road_of(case, place)["drivers"][int(place.key.split("_")[-1]) - 1]["luminance_per_lux"])


def above(case, place):
    return fact("road", "glare", place.key)(case, place)


def kind_of_light(case, place):
    road_type = recorded(case)["road"]["distribution"]
    return Expected(f"{road_type['lateral']} {road_type['longitudinal']}")


def bug(case, place):
    rating = recorded(case)["road"]["bug"]
    return Expected(f"B{rating['backlight']} U{rating['uplight']} G{rating['glare']}")


ORACLES = {
    "exit_lm": fact("exit_lm"), "peak_cd": fact("peak_cd"), "axis_cd": fact("axis_cd"),
    "throw": fact("figures", "throw"), "flux_code": flux_code, "ra": spectral_fact("ra"), "rf": spectral_fact("rf"),
    "rg": spectral_fact("rg"), "scotopic_ratio": spectral_fact("scotopic_ratio"),
    "melanopic_der": spectral_fact("melanopic_der"), "ppf": spectral_fact("ppf_umol_per_j", "µmol/J"),
    "ppfd": spectral_fact("ppfd_umol_per_m2_s_klx", "µmol/(m² s)"),
    "beam_C": plane_fact("beam_angle_deg"), "field_C": plane_fact("field_angle_deg"), "photometry_rays": fact("rays"),
    "road_class": road_fact("lighting_class"),
    "lanes": lambda case, place: Expected(page_road.traffic_of(case.lens["spec"]["roads"][place.group])),
    "road_q": road_q, "road_lx": road_fact("mean_lx"),
    "road_least_lx": road_fact("least_lx"), "surface": road_fact("surface"),
    "power_density": road_fact("power_density"), "yearly_energy": road_fact("yearly_energy"),
    "lenses": lambda case, place: Expected(case.lens["spec"]["photometry"]["lenses"]),
    "lamp_lm": fact("road", "lumens"), "distribution": kind_of_light, "bug": bug,
    "street_mh": fact("road", "distribution", "street_mh"), "glare_class": fact("road", "glare", "glare_class"),
    "above": above,
    **{name: fact("road", "bug", "zones", name) for name in (f"{a}_{b}" for a in ("forward", "back") for b in ZONES)},
}  # fmt: skip
ORACLES = {f"photometry.{key}": oracle for key, oracle in ORACLES.items()}
RECORDS = {"photometry": recorded}
