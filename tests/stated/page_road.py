"""Roads by section 11 of docs/definitions.md alone: sums over lamps in plain loops, by any intensities of a lamp."""

from math import ceil
from pathlib import Path

import numpy as np
from page_figures import scaled

# Tables of the CIE, as published.
SURFACES = Path(__file__).parents[2] / "lensforge" / "addons" / "road" / "road_surfaces"
Q0 = {"R3": 0.07, "W4": None}
M_CLASSES = {
    "M1": (2.0, 0.40, 0.70, 10.0, 0.35), "M2": (1.5, 0.40, 0.70, 10.0, 0.35), "M3": (1.0, 0.40, 0.60, 15.0, 0.30),
    "M4": (0.75, 0.40, 0.60, 15.0, 0.30), "M5": (0.50, 0.35, 0.40, 15.0, 0.30), "M6": (0.30, 0.35, 0.40, 20.0, 0.30),
}  # fmt: skip
P_CLASSES = {"P1": (15, 3), "P2": (10, 2), "P3": (7.5, 1.5), "P4": (5, 1), "P5": (3, 0.6), "P6": (2, 0.4)}
VEIL = 9.86 * (1 + (23 / 66.4) ** 4), 5 * (1 + (23 / 62.5) ** 4)


def surface(name):
    """beta (degrees), tan gamma, and r."""
    rows = [line.split(",") for line in (SURFACES / f"{name}.csv").read_text(encoding="utf-8").splitlines()]
    rows = [row for row in rows if not row[0].startswith("#")]
    beta = np.array([float(cell) for cell in rows[0][1:]])
    table = np.array([[float(cell or 0) for cell in row] + [0.0] * (len(beta) + 1 - len(row)) for row in rows[1:]])
    return beta, table[:, 0], 1e-4 * table[:, 1:]


def reduced(table, beta, tan_gamma):
    at, tans, r = table
    if tan_gamma > tans[-1]:
        return 0.0
    return float(np.interp(beta, at, [np.interp(tan_gamma, tans, column) for column in r.T]))


def lamps_along(road):
    """x, y and +1 where the street is towards +y, -1 elsewhere."""
    w = road["width_m"]
    over = road["overhang_m"]
    s = road["pole_spacing_m"]
    reach = 500 + 13 * road["pole_height_m"]
    near_right = road["driving_side"] == "right"
    rows = {
        "right": [(0, over, 1)], "left": [(0, w - over, -1)], "opposite": [(0, over, 1), (0, w - over, -1)],
        "staggered": [(0 if near_right else s / 2, over, 1), (s / 2 if near_right else 0, w - over, -1)],
    }[road["arrangement"]]  # fmt: skip
    count = int(reach / s) + 2
    return [(start + k * s, y, facing) for start, y, facing in rows for k in range(-count, count + 1)]


class Road:
    """Each sum has a row for each place, of pairs of a weight and a direction in the lamp (lateral, gamma)."""

    def __init__(self, road):
        self.road = road
        self.lamps = lamps_along(road)
        self.high = road["pole_height_m"]
        self.s = road["pole_spacing_m"]
        self.lanes = road["lanes"]
        self.lane_m = road["width_m"] / road["lanes"]
        self.n = max(10, ceil(self.s / 3 - 1e-9))
        self.x = (np.arange(self.n) + 0.5) * self.s / self.n
        self.y = (np.arange(3 * self.lanes) + 0.5) * road["width_m"] / (3 * self.lanes)

    def toward(self, lamp, x, y, z):
        """Lateral angle and gamma (degrees) of a point in a lamp."""
        t = np.radians(self.road["tilt_deg"])
        facing = lamp[2]
        to = np.array([x - lamp[0], y - lamp[1], z - self.high])
        street = np.array([0, facing * np.cos(t), np.sin(t)])
        axis = np.array([0, facing * np.sin(t), -np.cos(t)])
        a = to @ street
        b = to @ np.cross(axis, street)
        c = to @ axis
        return np.degrees(np.arctan2(b, a)), np.degrees(np.arctan2(np.hypot(a, b), c))

    def from_right(self, lane):
        return lane if self.road["driving_side"] == "right" else self.lanes - 1 - lane

    def comes(self, lane):
        return -1 if lane >= self.lanes - self.road["oncoming_lanes"] else 1

    def luminance(self, lane, table):
        """Rows from the right edge, and along each."""
        heading = self.comes(lane)
        eye_y = (self.from_right(lane) + 0.5) * self.lane_m
        eye_x = -60.0 if heading > 0 else self.s + 60.0
        rows = []
        for y in self.y:
            for x in self.x:
                row = []
                for lamp in self.lamps:
                    ahead = heading * (lamp[0] - x)
                    aside = heading * (lamp[1] - y)
                    if not (-5 * self.high <= ahead <= 12 * self.high and abs(aside) <= 5 * self.high):
                        continue
                    sight = np.arctan2(heading * (y - eye_y), heading * (x - eye_x))
                    beta = abs(np.degrees((np.arctan2(aside, ahead) - sight + np.pi) % (2 * np.pi) - np.pi))
                    r = reduced(table, beta, np.hypot(ahead, aside) / self.high)
                    if r:
                        row.append((r / self.high**2, *self.toward(lamp, x, y, 0.0)))
                rows.append(row)
        return rows

    def veiling(self, lane):
        heading = self.comes(lane)
        y = (self.from_right(lane) + 0.5) * self.lane_m
        rows = []
        for k in range(self.n):
            ahead_of_start = k * self.s / self.n - 2.75 * (self.high - 1.5)
            x = ahead_of_start if heading > 0 else self.s - ahead_of_start
            row = []
            for lamp in self.lamps:
                to = np.array([heading * (lamp[0] - x), lamp[1] - y, self.high - 1.5])
                if not 0 < to[0] <= 500 or to[2] > np.tan(np.radians(20)) * to[0]:
                    continue
                cosine = to @ [np.cos(np.radians(1)), 0, -np.sin(np.radians(1))] / np.linalg.norm(to)
                theta = np.degrees(np.arccos(cosine))
                if 0.1 <= theta <= 60:
                    veil = VEIL[0] / theta**2 if theta >= 1.5 else 10 / theta**3 + VEIL[1] / theta**2
                    row.append((veil * cosine / (to @ to), *self.toward(lamp, x, y, 1.5)))
            rows.append(row)
        return rows

    def lux(self, low, high):
        across = max(3, ceil((high - low) / 1.5 - 1e-9))
        rows = []
        for y in low + (np.arange(across) + 0.5) * (high - low) / across:
            for x in self.x:
                row = []
                for lamp in self.lamps:
                    away = np.hypot(lamp[0] - x, lamp[1] - y)
                    if away <= 5 * self.high:
                        row.append((self.high / np.hypot(away, self.high) ** 3, *self.toward(lamp, x, y, 0.0)))
                rows.append(row)
        return rows

    def edges(self):
        """Outside and inside of the right and of the left edge."""
        w = self.road["width_m"]
        lane = self.lane_m
        return [(self.lux(-lane, 0), self.lux(0, lane)), (self.lux(w, w + lane), self.lux(w - lane, w))]


def light(rows, candela):
    """Values at places by each sample: ``candela(lateral, gamma)`` [sample, direction], none above 90 degrees."""
    lengths = [len(row) for row in rows]
    weights, lateral, gamma = np.array([entry for row in rows for entry in row]).T
    products = np.where(gamma <= 90, candela(lateral, gamma), 0) * weights
    places = np.repeat(np.arange(len(rows)), lengths)
    return np.array([np.bincount(places, weights=product, minlength=len(rows)) for product in products])


def figure(readings, read):
    """A figure by the table of the file, and its error by the tables with a sample left out, which follow it."""
    value, *left_out = (float(read(row)) for row in readings)
    count = len(left_out)
    return value, np.sqrt((count - 1) / count * ((np.array(left_out) - np.mean(left_out)) ** 2).sum())


def increment(row):
    """TI of the veiling luminance at places, and the mean luminance last."""
    k, p = (65, 0.8) if row[-1] <= 5 else (95, 1.05)
    return k * row[:-1].max() / row[-1] ** p


def figures(road, candela):
    """All figures of a road, each a value and its error; of each lane, and of the whole."""
    field = Road(road)
    m = road["maintenance_factor"]
    lux = m * light(field.lux(0, road["width_m"]), candela)
    table = surface("R3")
    lanes = []
    for lane in range(field.lanes):
        seen = light(field.luminance(lane, table), candela)
        veil = light(field.veiling(lane), candela)
        middle = 3 * field.from_right(lane) + 1
        mean = seen.mean(axis=1)[:, None]
        record = {
            "mean": figure(m * mean, np.mean), "uniformity": figure(seen, lambda row: row.min() / row.mean()),
            "along": figure(seen[:, middle * field.n : (middle + 1) * field.n], lambda row: row.min() / row.max()),
            "glare": figure(np.hstack([veil, mean]), increment),
            "q": figure(np.hstack([mean, lux.mean(axis=1)[:, None] / m]), lambda row: row[0] / row[1]),
        }  # fmt: skip
        if road["wet_surface"]:
            wet = light(field.luminance(lane, surface(road["wet_surface"])), candela)
            record["wet"] = figure(wet, lambda row: row.min() / row.mean())
        lanes.append(record)
    edges = []
    for outside, inside in field.edges():
        both = [light(rows, candela).mean(axis=1) for rows in (outside, inside)]
        edges.append(figure(np.stack(both, axis=1), lambda row: row[0] / row[1]))
    mean_lx = figure(lux, np.mean)
    shared = road["width_m"] * field.s / (2 if road["arrangement"] in ("opposite", "staggered") else 1)
    record = {
        "lanes": lanes, "edges": edges, "mean_lx": mean_lx, "least_lx": figure(lux, np.min),
        "u_lx": figure(lux, lambda row: row.min() / row.mean()),
    }  # fmt: skip
    if road["lamp_w"]:
        record["power"] = scaled(mean_lx, road["lamp_w"] / mean_lx[0] ** 2 / shared)
        record["energy"] = (road["lamp_w"] * road["hours"] / 1000 / shared, 0.0)
    return record


def reached(road, record):
    """The best class of the kind that is asked for."""
    if road["lighting_class"] in P_CLASSES:
        mean = record["mean_lx"][0]
        lowest = record["least_lx"][0]
        met = (name for name, (a, b) in P_CLASSES.items() if a <= mean <= 1.5 * a and lowest >= b)
        return next(met, "none")
    for name, (mean, uniformity, along_lane, glare, edge) in M_CLASSES.items():
        lanes = all(
            lane["mean"][0] >= mean and lane["uniformity"][0] >= uniformity and lane["along"][0] >= along_lane
            and lane["glare"][0] <= glare for lane in record["lanes"]
        )  # fmt: skip
        if lanes and all(side[0] >= edge for side in record["edges"]):
            return name
    return "none"


def asked(road, record):
    """Name, quantity, value, unit, sense and bound of all that the class asks for."""
    name = road["lighting_class"]
    if name in P_CLASSES:
        mean, lowest = P_CLASSES[name]
        yield "mean illuminance", "light", record["mean_lx"], "lx", ">=", mean
        yield "maximum mean illuminance", "light", record["mean_lx"], "lx", "<=", 1.5 * mean
        yield "minimum illuminance", "light", record["least_lx"], "lx", ">=", lowest
        return
    mean, uniformity, along_lane, glare, edge = M_CLASSES[name]
    for number, lane in enumerate(record["lanes"]):
        of = f"lane {number + 1}: "
        yield f"{of}mean luminance", "light", lane["mean"], "cd/m²", ">=", mean
        yield f"{of}uniformity U0", "min/mean of the light", lane["uniformity"], "", ">=", uniformity
        if road["wet_surface"]:
            yield f"{of}uniformity U0, wet", "min/mean of the light", lane["wet"], "", ">=", 0.15
        yield f"{of}uniformity Ul", "min/max of the light", lane["along"], "", ">=", along_lane
        yield f"{of}glare TI", "threshold increment", lane["glare"], "%", "<=", glare
    for side, value in zip(("right", "left"), record["edges"], strict=True):
        yield f"{side} edge ratio", "ratio of means", value, "", ">=", edge


def worst_on(roads, limits):
    """Of each figure that classes ask for, and each side of its limit, the road, lane or edge nearest to that."""
    names = tuple(f"{road['name']}: " for road in roads)
    worst = {}
    for entry in limits:
        if entry["name"].startswith(names):
            figure = "edge ratio" if entry["name"].endswith("edge ratio") else entry["name"].rpartition(": ")[2]
            part = entry["value"]["value"][0] / entry["bound"]
            worst.setdefault((figure, entry["sense"]), []).append((part if entry["sense"] == "<=" else 1 / part, entry))
    return [max(candidates, key=lambda candidate: candidate[0])[1] for candidates in worst.values()]


def traffic_of(road):
    lanes = f"{road['lanes']} lane{'s' * (road['lanes'] > 1)}"
    if road["lighting_class"].startswith("P"):
        return lanes
    one_way = {1: "one way", 2: "both one way"}.get(road["lanes"], "all one way")
    return f"{lanes}, " + (f"{road['oncoming_lanes']} oncoming" if road["oncoming_lanes"] else one_way)
