"""Every number of ``verify --stray`` by docs/definitions.md, section 14: light that splits at the exact faces."""

from collections import Counter
from dataclasses import dataclass, fields

import numpy as np
from crooked import Expected
from oracle_part import base_of, body_of, bore_scale, depth_mm, kept_of, placed, plate_sides, slope_of
from oracle_part import lamps_of as plate_lamps
from oracle_proof import arrays
from page_chain import fields_behind, room_in
from page_light import filtered
from page_scene import exits, faces_of, lamps_of, receivers_of, through
from page_tracer import behind_glass, coated, refractive_index, unit

CUT_OFF = 1e-4
DEPTH = 32
SKIN_MM = 1e-6
STEPS = 64
HALVINGS = 24
CAUSES = ("sequential", "inner_reflection", "outer_reflection", "total_reflection", "base", "met_again")
SEQUENTIAL, INNER, OUTER, TOTAL, BASE, MET_AGAIN = range(6)
NEAR = 0.03  # of a share
FEW = 3e-5  # of all light
PIXEL = 0.3  # of what single dim rays decide
LIMITS = {"stray_balance": 1e-9, "stray_leaked": 1e-3, "stray_too_dim": 1e-2}


class Solid:
    """The part as a function above 0 in the material: lenses above z = 0, below it their base or plate.

    ``lenses``: place and turn (degrees) of each lens in the coordinates of the first, which is lit.
    """

    def __init__(self, case):
        self.case = case
        self.spec = case.lens["spec"]
        self.faces = faces_of(case.lens, case.lens["faces"])
        self.body = body_of(case)
        self.lenses = [(np.zeros(2), 0.0)]
        self.to_plate = (np.zeros(2), 0.0)
        self.double = self.spec["lens"]["kind"] == "double"
        if self.spec["plate"]:
            places, turns = plate_lamps(case)
            lit = np.hypot(*places.T).argmin()
            self.to_plate = places[lit], turns[lit]
            seen = placed(np.column_stack([places - places[lit], 0 * turns]), (0, 0), -turns[lit])[:, :2]
            order = np.argsort(np.hypot(*seen.T))
            self.lenses = [(seen[k], turns[k] - turns[lit]) for k in order]
        self.low, self.high = self.ends()
        self.reach = 1.01 * np.hypot(max(np.hypot(*at) for at, _ in self.lenses) + self.wide(), self.high)

    def wide(self):
        plate = np.hypot(*plate_sides(self.case)) / 2 if self.spec["plate"] else self.spec["base"]["diameter_mm"] / 2
        return max(plate, self.spec["constraints"]["max_radius_mm"])

    def ends(self):
        top = max(part.extreme(lambda s, f, part=part: part.at(s, f)[0][..., 2]) for part in self.body.envelope)
        if not self.spec["plate"]:
            return -self.spec["base"]["height_mm"], top
        plate = self.spec["plate"]
        return -plate["thickness_mm"] - max((pin["height_mm"] for pin in plate["pins"]), default=0.0), top

    def to_local(self, p, number):
        """Points in the coordinates of a lens."""
        place, turn = self.lenses[number]
        return placed(p - [*place, 0], (0, 0), -turn)

    def nearest(self, p):
        return np.argmin([np.hypot(*(p[:, :2] - place).T) for place, _ in self.lenses], axis=0)

    def rooms(self, q):
        """Of a lens in its own coordinates: room within the envelope, and beyond the cavity."""
        if self.double:
            inner, outer = (face.radius(unit(q)) - np.linalg.norm(q, axis=1) for face in self.faces)
            return np.minimum(outer, -inner)
        return room_in(self.faces, "body", q)

    def rim(self, q):
        """Distance from the wall of the bore."""
        turn = np.arctan2(q[:, 1], q[:, 0]) % (2 * np.pi)
        at = 2 * np.pi * np.arange(721) / 720
        rim = np.interp(turn, at, [*self.body.rim, self.body.rim[0]])
        rim *= 1 - (bore_scale(self.case) - 1) * q[:, 2] / depth_mm(self.case)  # a cone about the axis
        return np.hypot(q[:, 0], q[:, 1]) - rim

    def below(self, p):
        bores = np.min([self.rim(self.to_local(p, number)) for number in range(len(self.lenses))], axis=0)
        if not self.spec["plate"]:
            base = base_of(self.case)
            assert not base["bore_setback_mm"] and not base["relief_step_mm"], "a plain base"
            side = base["diameter_mm"] / 2 + slope_of(self.case) * p[:, 2] - np.hypot(p[:, 0], p[:, 1])
            return np.min([p[:, 2] - self.low, side, bores], axis=0)
        plate = self.spec["plate"]
        (wide, high) = plate_sides(self.case)
        q = placed(p, *self.to_plate)
        corner = plate["corner_radius_mm"]
        beyond = np.maximum(abs(q[:, :2]) - [wide / 2 - corner, high / 2 - corner], 0)
        down = slope_of(self.case) * p[:, 2]
        root = -slope_of(self.case) * plate["thickness_mm"]
        holes = [np.hypot(*(q[:, :2] - hole["place_mm"]).T) - hole["diameter_mm"] / 2 + down for hole in plate["holes"]]
        slab = np.min([p[:, 2] + plate["thickness_mm"], corner + down - np.hypot(*beyond.T), bores, *holes], axis=0)
        pins = [
            pin["diameter_mm"] / 2 + down - root - np.hypot(*(q[:, :2] - pin["place_mm"]).T) for pin in plate["pins"]
        ]
        return np.where(p[:, 2] > -plate["thickness_mm"], slab, np.max(pins, axis=0))

    def inside(self, p):
        value = np.full(len(p), -1.0)
        up = p[:, 2] > 0
        value[~up] = self.below(p[~up])
        value[(p[:, 2] < self.low)] = -1.0
        for number in range(len(self.lenses)):
            q = self.to_local(p[up], number)
            near = np.hypot(q[:, 0], q[:, 1]) < self.spec["constraints"]["max_radius_mm"]
            rows = np.flatnonzero(up)[near]
            value[rows] = np.maximum(value[rows], self.rooms(q[near]))
        return value

    def normals(self, p):
        """Out of the material; and the number of the face of the lens, -1 at or below z = 0."""
        n = np.zeros_like(p)
        face = np.full(len(p), -1)
        near = self.nearest(p)
        for number, (_, turn) in enumerate(self.lenses):
            rows = np.flatnonzero((near == number) & (p[:, 2] > 1e-7))
            q = self.to_local(p[rows], number)
            off = [abs(part.exact(unit(q))[0] - np.linalg.norm(q, axis=1)) for part in self.faces]
            face[rows] = np.argmin(off, axis=0)
            for k, part in enumerate(self.faces):
                some = face[rows] == k
                normal = part.exact(unit(q[some]))[1] * (1 if self.is_envelope(k) else -1)
                n[rows[some]] = placed(normal, (0, 0), turn)
        flat = (face < 0) & (
            np.min([abs(p[:, 2]), abs(p[:, 2] - self.low), abs(p[:, 2] - self.floor())], axis=0) < 1e-6
        )
        n[flat] = np.where((p[flat, 2] > -1e-6)[:, None], [0, 0, 1.0], [0, 0, -1.0])
        rest = (face < 0) & ~flat
        slope = [self.below(p[rest] + h) - self.below(p[rest] - h) for h in 1e-5 * np.eye(3)]
        n[rest] = -unit(np.column_stack(slope))
        return n, face

    def floor(self):
        return -self.spec["plate"]["thickness_mm"] if self.spec["plate"] else self.low

    def is_envelope(self, k):
        return k == 1 if self.double else self.faces[k].before == "body"

    def name(self, k):
        return ("inner", "outer")[k] if self.double else self.faces[k].name

    def hit(self, p, d, inside):
        """Path to the next surface; nan where the ray leaves."""
        along = (p * d).sum(axis=1)
        sign = np.where(inside, 1.0, -1.0)
        end = np.sqrt(np.maximum(along**2 - (p**2).sum(axis=1) + self.reach**2, 0)) - along
        for level, way in ((self.high, d[:, 2] > 0), (self.low, d[:, 2] < 0)):
            end[way] = np.minimum(end[way], np.maximum((level - p[way, 2]) / d[way, 2], 0) + 1e-3)
        low = np.full(len(p), SKIN_MM)
        high = np.full(len(p), np.nan)
        for share in np.arange(1, STEPS + 1) / STEPS:
            rows = np.flatnonzero(np.isnan(high))
            t = SKIN_MM + share * end[rows]
            out = sign[rows] * self.inside(p[rows] + t[:, None] * d[rows]) < 0
            high[rows[out]] = t[out]
            low[rows[~out]] = t[~out]
        rows = np.flatnonzero(~np.isnan(high))
        for _ in range(HALVINGS):
            middle = (low[rows] + high[rows]) / 2
            out = sign[rows] * self.inside(p[rows] + middle[:, None] * d[rows]) < 0
            high[rows] = np.where(out, middle, high[rows])
            low[rows] = np.where(out, low[rows], middle)
        return high


@dataclass
class Split:
    """Light on its way: ``beside``: it has met a neighbour; ``sides``: 0 in the cavity, 1 in the body, 2 behind."""

    p: np.ndarray
    d: np.ndarray
    e: np.ndarray
    flux: np.ndarray
    cause: np.ndarray
    inside: np.ndarray
    sides: np.ndarray
    events: np.ndarray
    beside: np.ndarray
    index: np.ndarray
    nm: np.ndarray

    def take(self, rows):
        return Split(*(getattr(self, field.name)[rows] for field in fields(self)))

    def but(self, **changes):
        return Split(**{field.name: changes.get(field.name, getattr(self, field.name)) for field in fields(self)})


def joined(parts):
    return Split(*(np.concatenate([getattr(part, field.name) for part in parts]) for field in fields(Split)))


def emitted(case, solid):
    p, d, flux, nm = case.rays["stray"][0]
    count = len(p)
    side = unit(np.cross(d, np.where(abs(d[:, :1]) < 0.9, [1.0, 0, 0], [0, 1.0, 0])))
    e = np.stack([side, np.cross(d, side)], axis=1).astype(complex)
    none = np.zeros(count, dtype=int)
    index = refractive_index(case.lens, nm, count)
    waves = np.full(count, solid.spec["lens"]["design_wavelength_nm"]) if nm is None else nm
    inside = solid.inside(p) > 0  # of a file, some rays may start in the material
    light = Split(p, d, e, flux.copy(), none, inside, none, none, none > 0, index, waves)
    t = solid.hit(p, d, light.inside)
    at = p + np.nan_to_num(t)[:, None] * d
    n, face = solid.normals(at)
    first = inside | (~np.isnan(t) & ((face >= 0) & ((at * n).sum(axis=1) > 0)))  # the outside of the lens
    return light.but(cause=np.where(first, BASE, SEQUENTIAL))


def amplitudes(solid, light, face, n):
    """Of s and p: reflected, and passed; and directions of both."""
    c = abs((light.d * n).sum(axis=1))
    ahead = n * np.sign((light.d * n).sum(axis=1))[:, None]
    around = np.full(len(c), solid.spec["lens"]["outside_index"])
    before = np.where(light.inside, light.index, around)
    behind = np.where(light.inside, around, light.index)
    r = before / behind
    q2 = 1 - r**2 * (1 - c**2)
    total = q2 <= 0
    q = np.sqrt(q2 + 0j)
    back = np.array([(r * c - q) / (r * c + q), -(c - r * q) / (c + r * q)])
    for k in np.unique(face[face >= 0]):
        coating = (solid.spec["lens"].get(solid.name(k)) or {}).get("coating")
        rows = np.flatnonzero((face == k) & ~total)
        if coating is not None and len(rows):
            arguments = (column[rows] for column in (light.nm, before, behind, np.minimum(c, 1)))
            back[:, rows] = np.sqrt(1 - coated(coating, *arguments, solid.is_envelope(k)))
    passed = np.where(total, 0, np.sqrt(np.maximum(1 - abs(back) ** 2, 0)))
    bent = unit(r[:, None] * light.d + np.where(total, 0, q.real - r * c)[:, None] * ahead)
    return ahead, back, passed, bent, light.d - 2 * c[:, None] * ahead


def causes(solid, light, face, away, total):
    """What takes the transmitted and the reflected light off its path: section 14."""
    events = solid.spec["lens"]["events"] if not solid.double else 2
    goes_on = (events > 2) & (light.events + 1 < events)
    into = np.full(len(face), SEQUENTIAL)
    into[(light.sides == 0) & (light.events + 1 >= events)] = TOTAL
    into[(face < 0) | ((light.sides == 1) & ~away & ~goes_on)] = BASE
    into[light.sides == 2] = MET_AGAIN
    back = np.where(light.sides == 0, INNER, np.where(total, TOTAL, OUTER))
    back = np.where(total & goes_on, SEQUENTIAL, back)
    back = np.where(into == SEQUENTIAL, back, into)
    known = light.cause != SEQUENTIAL
    return np.where(known, light.cause, into), np.where(known, light.cause, back)


def step(solid, light, least, ends):
    """Light at the next surface, both ways from there; what leaves and what is lost goes to ``ends``."""
    t = solid.hit(light.p, light.d, light.inside)
    gone = np.isnan(t)
    ends["escaped"].append(light.take(gone & ~light.inside))
    ends["leaked"] += light.flux[gone & light.inside].sum()
    light = light.take(~gone)
    t = t[~gone]
    left = np.where(light.inside, np.exp(-solid.spec["lens"]["absorption_per_mm"] * t), 1.0)
    ends["absorbed"] += (light.flux * (1 - left)).sum()
    light = light.but(p=light.p + t[:, None] * light.d, flux=light.flux * left)
    n, face = solid.normals(light.p)
    beside = (solid.nearest(light.p) > 0) & (light.p[:, 2] > SKIN_MM)
    ends["neighbours"] += light.flux[beside & ~light.beside].sum()
    ahead, back, passed, bent, mirrored = amplitudes(solid, light, face, n)
    away = (light.p * n).sum(axis=1) > 0
    for number in range(1, len(solid.lenses)):
        here = beside & (solid.nearest(light.p) == number)
        away[here] = (solid.to_local(light.p[here], number) * placed(n[here], (0, 0), -solid.lenses[number][1])).sum(
            axis=1
        ) > 0
    total = (passed == 0).all(axis=0)
    into, returned = causes(solid, light, face, away, total)
    at = light.but(events=light.events + 1, beside=light.beside | beside)
    parts = []
    for amplitude, way, cause, reflected in ((passed, bent, into, False), (back, mirrored, returned, True)):
        e = fields_behind(light.e, light.d, way, ahead, *amplitude, np.full(len(face), reflected))
        share = (abs(e) ** 2).sum(axis=(1, 2)) / 2
        e = e / np.sqrt(np.where(share > 0, share, 1))[:, None, None]
        part = at.but(d=way, e=e, flux=light.flux * share, cause=cause)
        if not reflected:
            part = part.but(inside=~light.inside, sides=np.where(light.inside, np.where(away, 2, 0), 1))
        parts.append(part)
    both = joined(parts)
    bright = both.flux > least
    ends["too_dim"] += both.flux[~bright].sum()
    return both.take(bright)


def followed(case):
    """All light until it has left the part."""
    solid = Solid(case)
    light = emitted(case, solid)
    ends = {"escaped": [], **dict.fromkeys(("leaked", "absorbed", "neighbours", "too_dim"), 0.0)}
    least = CUT_OFF * light.flux.mean()
    watts = light.flux.sum()
    for _ in range(DEPTH):
        light = step(solid, light, least, ends)
        if not len(light.flux):
            break
    ends["too_dim"] += light.flux.sum()
    return solid, ends | {"escaped": joined(ends["escaped"]), "watts": watts}


# -- Section 8: what lands ---------------------------------------------------------------------------------------------


def behind(case, solid, light):
    """Behind the further bodies and the cover glass: places, directions, and the shares that both let through."""
    section = solid.spec["lens"]
    count = len(light.flux)
    s = unit(np.cross(light.d, np.where(abs(light.d[:, :1]) < 0.9, [1.0, 0, 0], [0, 1.0, 0])))
    a_s, a_p = ((light.e * axis[:, None]).sum(axis=2) for axis in (s, np.cross(light.d, s)))
    whole = (abs(a_s) ** 2 + abs(a_p) ** 2).sum(axis=1)
    stokes = [
        (abs(a_s) ** 2 - abs(a_p) ** 2).sum(axis=1) / whole,
        2 * (a_s * a_p.conj()).real.sum(axis=1) / whole,
        s,
    ]
    left = np.arange(count)
    p = light.p.copy()
    d = light.d.copy()
    share = np.ones(count)
    for body in solid.spec["bodies"] or []:
        left, stokes, _ = through(body, section, left, p, d, share, light.nm, stokes)
    glass = np.ones(count)
    up = d[left, 2] > 0
    rows = left[up]
    p[rows], glass[rows] = behind_glass(section, p[rows], d[rows], light.nm[rows], [part[up] for part in stokes])
    return left, p, d, share, glass


def light_at(case):
    """Of each receiver: pictures (W) and shares of the light that is split, and of the light that is not; of all lamps.

    Each lamp has the same light, at its place and with its axes.
    """
    solid, ends = followed(case)
    light = ends["escaped"]
    spec = case.lens["spec"]
    left, p, d, share, glass = behind(case, solid, light)
    rays = case.rays["stray"][0]
    flux = light.flux * share * glass
    direct = exits(case.lens, solid.faces, *rays[:2], rays[3])
    lamps = list(zip(*lamps_of(spec)[:2], strict=True))
    watts = len(lamps) * ends["watts"]
    stray = light.cause != SEQUENTIAL
    rows = direct.left
    own_flux = (direct.flux * rays[2])[rows]
    variance = spec["evaluate"]["filter_variance"]
    lights = []
    for receiver in receivers_of(spec):
        sums = Counter()
        by_cause = Counter()
        images = [0, 0]
        plain = 0
        undivided = 0.0
        for place, turn in lamps:
            shift = 0 if receiver.kind == "far_field" else place
            at = np.full((len(flux), 2), np.nan)
            at[left] = receiver.land(p[left] @ turn.T + shift, d[left] @ turn.T)
            lands = ~np.isnan(at[:, 0])
            seen = lands & receiver.in_window(*np.nan_to_num(at, nan=np.inf).T)
            landed = receiver.land(direct.p[rows] @ turn.T + shift, direct.d[rows] @ turn.T)
            on = ~np.isnan(landed[:, 0])
            images = [image + filtered(receiver.bins(at[some], flux[some]), variance)
                      for image, some in zip(images, (lands & ~stray, lands & stray), strict=True)]  # fmt: skip
            plain = plain + filtered(receiver.bins(landed[on], own_flux[on]), variance)
            undivided += own_flux[on & receiver.in_window(*np.nan_to_num(landed, nan=np.inf).T)].sum() / watts
            sums.update({
                "detected_direct": flux[seen & ~stray].sum(), "detected_stray": flux[seen & stray].sum(),
                "outside_direct": flux[lands & ~seen & ~stray].sum(),
                "outside_stray": flux[lands & ~seen & stray].sum(),
                "backward": flux[left][~lands[left]].sum(), "absorbed": ends["absorbed"],
                "cover_glass": (light.flux * share * (1 - glass)).sum(), "bodies": (light.flux * (1 - share)).sum(),
                "housing": 0.0, "second_wall": 0.0, "base": 0.0, "too_dim": ends["too_dim"], "leaked": ends["leaked"],
            })  # fmt: skip
            by_cause.update({name: flux[seen & (light.cause == k)].sum() / watts for k, name in enumerate(CAUSES) if k})
        lights.append(
            (receiver, {name: value / watts for name, value in sums.items()}, by_cause, *images, plain, undivided)
        )
    return lights, ends["neighbours"] / ends["watts"]


def of_case(case):
    return kept_of(case, "stray light", lambda: light_at(case))


def near(value, part=NEAR):
    return value, part * abs(value) + FEW


def receiver_record(case, number):
    receiver, flux, by_cause, direct, stray, plain, sequential = of_case(case)[0][number]
    watts = len(lamps_of(case.lens["spec"])[0]) * case.rays["stray"][0][2].sum()
    whole = direct + stray
    area = np.prod(receiver.size) / direct.size * (1 if receiver.kind == "far_field" else 1e-6)
    for name, image in (("direct", direct), ("stray", stray), ("sequential", plain)):
        stored = arrays(case, "stray")[f"receivers.{number}.{name}"] * area
        assert abs(stored - image).sum() < 0.1 * image.sum() + FEW * watts, name
    return {
        "name": receiver.name, "width": receiver.size[0], "height": receiver.size[1],
        "far_field": receiver.kind == "far_field", "balance_error": (0.0, 1e-9),
        "flux": {name: near(value, PIXEL if name == "too_dim" else NEAR) for name, value in flux.items()},
        "detected_stray_by_cause": {name: near(value) for name, value in by_cause.items()},
        "misplaced_flux": near(abs(whole - plain).sum() / watts),
        "nmse_vs_sequential": near(((whole - plain) ** 2).sum() / (plain**2).sum(), PIXEL),
        "peak_of_mean": near(stray.max() / plain.mean(), PIXEL),
        "efficiency": near(flux["detected_direct"] + flux["detected_stray"]), "efficiency_sequential": near(sequential),
    }  # fmt: skip


def stray_record(case):
    spec = case.lens["spec"]
    receivers = [receiver_record(case, k) for k in range(len(of_case(case)[0]))]
    values = [0.0, *(receivers[0]["flux"][name] for name in ("leaked", "too_dim"))]
    criteria = [
        {"name": name, "value": (0.0, 1e-9) if name == "stray_balance" else value, "sense": "<=", "limit": limit,
         "unit": "of the flux", "tolerance": 0.0, "remedy": ..., "passed": True}
        for (name, limit), value in zip(LIMITS.items(), values, strict=True)
    ]  # fmt: skip
    return {
        "conditions": None, "receivers": receivers, "rays": len(case.rays["stray"][0][2]), "base": "polished",
        "lenses": len(spec["lamps"]["places_mm"]) if spec["plate"] else 1, "neighbours": near(of_case(case)[1]),
        "absorption_per_mm": spec["lens"]["absorption_per_mm"], "cut_off": CUT_OFF, "depth": DEPTH,
        "criteria": criteria, **{key: receivers[0][key] for key in ("flux", "efficiency", "efficiency_sequential")},
    }  # fmt: skip


def in_percent(*path):
    """A share of a receiver's record as a fact."""

    def oracle(case, place):
        entry = kept_of(case, "stray record", lambda: stray_record(case))["receivers"][place.group]
        for key in path:
            entry = entry[key]
        return Expected(100 * entry[0], 100 * entry[1], "%")

    return oracle


OF_RECEIVER = {
    "detected_stray": ("flux", "detected_stray"), "stray_absorbed": ("flux", "absorbed"),
    "stray_efficiency": ("efficiency",), "misplaced": ("misplaced_flux",), "stray_peak": ("peak_of_mean",),
}  # fmt: skip
ORACLES = {f"stray.{key}": in_percent(*path) for key, path in OF_RECEIVER.items()} | {
    "stray.stray_rays": lambda case, place: Expected(len(case.rays["stray"][0][2])),
    "stray.neighbours": lambda case, place: Expected(*(100 * number for number in near(of_case(case)[1])), "%"),
}
RECORDS = {"stray": stray_record}
