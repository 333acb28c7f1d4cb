"""What the tables of a preset leave, by section 10 of docs/definitions.md: rays through them and through the faces."""

import numpy as np
from crooked import HOT_C
from page_chain import Face, from_chart
from page_figures import jackknife
from page_scene import at_temperature, exits, faces_of, receivers_of
from page_tracer import Functions, unit
from scipy.interpolate import RectBivariateSpline

NEAR = 0.01  # of an error by tables, and of its standard error
# of the chart; nodes beyond it; rad: of any face, of two faces
HALF = 1.02
BEYOND = 24
WIDEST = 0.5
NARROWED = 0.4
NODES = {"design": "nodes_per_sigma", "evaluation": "evaluate_nodes_per_sigma"}
SCRAMBLES = 8


class Tabulated:
    """A face by a bicubic spline of its radius over the chart, with so many nodes on a side."""

    def __init__(self, face, nodes):
        self.name, self.before, self.behind = (getattr(face, key, "") for key in ("name", "before", "behind"))
        step = 2 * HALF / (nodes - 1)
        axis = -HALF + step * np.arange(-BEYOND, nodes + BEYOND)
        u = from_chart(*(coordinates.ravel() for coordinates in np.meshgrid(axis, axis, indexing="ij")))
        rho = face.exact(u)[0].reshape(len(axis), -1)
        self.spline = RectBivariateSpline(axis, axis, rho)
        self.largest = rho.max()
        self.reach = getattr(face, "reach", None)

    def at(self, u, dx=0, dy=0):
        x, y = u[:, :2].T / (1 + u[:, 2])
        return self.spline.ev(x, y, dx=dx, dy=dy)

    def radius(self, u):
        return self.at(u)

    def normal(self, u):
        """By the slopes along X = x/(1+z) and Y = y/(1+z)."""
        down = 1 / (1 + u[:, 2])
        by_x, by_y = self.at(u, dx=1) * down, self.at(u, dy=1) * down
        slope = np.column_stack([by_x, by_y, -(by_x * u[:, 0] + by_y * u[:, 1]) * down])
        slope -= (slope * u).sum(axis=1)[:, None] * u
        return unit(u - slope / self.radius(u)[:, None])

    def exact(self, u):
        return self.radius(u), self.normal(u)

    def room(self, u, far):
        return self.radius(u) - far


def width_rad(record):
    """Of the narrowest function; of other faces that of a Gaussian of the same swing and largest curvature."""
    if record["kind"] == "srbf":
        functions = Functions(record, record["weights_mm"])
        return functions.sigmas[functions.weights != 0].min()
    polar = np.linspace(0, np.arccos(-0.5), 721)[:, None]
    turn = 2 * np.pi * np.arange(24) / 24
    u = np.stack([np.sin(polar) * np.cos(turn), np.sin(polar) * np.sin(turn), np.cos(polar) + 0 * turn], axis=-1)
    rho = Face("exit", record).exact(u.reshape(-1, 3))[0].reshape(721, 24)
    bend = abs(np.diff(rho, 2, axis=0)).max() / polar[1, 0] ** 2
    width = min(WIDEST, np.sqrt(2 * np.ptp(rho) / bend)) if np.ptp(rho) > 1e-9 else WIDEST
    return min(width, Functions(record["functions"], [0]).sigmas.min()) if "functions" in record else width


def nodes_of(lens, stage):
    """Nodes on a side of the chart."""
    per_sigma = lens["accuracy"][NODES[stage]]
    width = min(map(width_rad, lens["faces"].values()))
    width = min(width, NARROWED) if lens["spec"]["lens"]["kind"] == "double" else width
    return max(24, int(np.ceil(4 * HALF * per_sigma / width)) + 1)


def largest_nm(lens, faces, tables):
    """The largest distance of each table from its face, at 4096 random directions in which the face bounds a medium."""
    rng = np.random.default_rng(0)
    z = rng.random(4096)
    turn = 2 * np.pi * rng.random(4096)
    u = np.column_stack([np.sqrt(1 - z**2) * np.cos(turn), np.sqrt(1 - z**2) * np.sin(turn), z])
    rho = [face.exact(u)[0] for face in faces]
    errors = {}
    for number, (name, face) in enumerate(zip(lens["faces"], faces, strict=True)):
        beside = [radius for radius, other in zip(rho, faces, strict=True) if other is face or together(face, other)]
        rows = rho[number] <= np.min(beside, axis=0)
        errors[name] = 1e6 * abs(tables[number].radius(u) - rho[number])[rows].max()
    return errors


def together(face, other):
    """True of two faces of one medium; the mouth of a reflector bounds all."""
    return hasattr(face, "name") and (other.before == face.before or other.name == "mouth")


def near(value):
    return value, NEAR * value + 1e-15


def figure(pair, unit=""):
    value, error = pair
    return {"value": (value, NEAR * (abs(value) + error) + 1e-15), "unit": unit, "standard_error": near(error)}


def shared(receiver, place, flux):
    """Each ray in the four nearest pixels, bilinearly; what is nearer to no pixel is lost."""
    rows, columns = receiver.shape
    image = np.zeros((rows + 2, columns + 2))
    x, y = np.clip((place / receiver.size + 0.5) * (columns, rows) + 0.5, 0, (columns + 1 - 1e-9, rows + 1 - 1e-9)).T
    j = x.astype(int)
    i = y.astype(int)
    for (di, dj), share in (((0, 0), (1 - x + j) * (1 - y + i)), ((0, 1), (x - j) * (1 - y + i)),
                            ((1, 0), (1 - x + j) * (y - i)), ((1, 1), (x - j) * (y - i))):  # fmt: skip
        np.add.at(image, (i + di, j + dj), share * flux)
    return image[1:-1, 1:-1]


def landings(case, lens, faces, raised, receiver):
    """Places, flux, and where it lands, of all rays of the scrambles."""
    p, d, flux, nm = case.rays["warm tables" if raised else "evaluate tables"][0]
    behind = exits(lens, faces, p, d, nm, raised)
    place = np.full((len(p), 2), np.nan)
    left = behind.left
    place[left] = receiver.land(behind.p[left], behind.d[left])
    return place, np.where(np.isnan(place[:, 0]), 0, behind.flux * flux)


def stage_error(both, receiver, watts):
    """Of landings by the tables and by the exact faces."""
    squares = []
    pictures = []
    lost = []
    most = 0.0
    for rows in np.split(np.arange(len(both[0][1])), SCRAMBLES):
        (by_table, flux), (exact, other) = ((place[rows], power[rows]) for place, power in both)
        on = (flux > 0) & (other > 0) & (abs(exact) <= np.array(receiver.size) / 2).all(axis=1)
        away = np.linalg.norm((by_table - exact)[on], axis=1)
        most = max(most, away.max())
        squares.append([(away**2).sum(), on.sum()])
        pair = (by_table, flux), (exact, other)
        pictures.append([shared(receiver, place[power > 0], power[power > 0]) for place, power in pair])
        seen = [power[receiver.in_window(*place.T)].sum() for place, power in pair]
        lost.append((seen[0] - seen[1]) / watts)
    unit = "" if receiver.kind == "far_field" else "mm"
    return {
        "hit_max_mm": near(most), "hit_mm": figure(jackknife(squares, lambda s: np.sqrt(s[0] / s[1])), unit),
        "irradiance_nmse": figure(jackknife(pictures, lambda s: ((s[0] - s[1]) ** 2).sum() / (s[1] ** 2).sum())),
        "efficiency": figure(jackknife(lost)),
    }  # fmt: skip


def tables_record(case, watts, warm):
    """What an evaluation says of its tables, and of those of the search."""
    lens, raised = at_temperature(case.lens, HOT_C) if warm else (case.lens, 0.0)
    spec = lens["spec"]
    faces = faces_of(lens, lens["faces"])
    pixels = {"evaluate": spec["evaluate"] | {"pixels": spec["optimise"]["pixels"]}}
    receiver = receivers_of(spec | pixels)[0]
    exact = landings(case, lens, faces, raised, receiver)
    stages = {}
    for stage in NODES:
        tables = [Tabulated(face, nodes_of(lens, stage)) for face in faces]
        off = largest_nm(lens, faces, tables)
        by_table = landings(case, lens, tables, raised, receiver)
        stages[stage] = {"table_error_nm": near(max(off.values())), **stage_error((by_table, exact), receiver, watts)}
    return {
        "table_nodes": nodes_of(lens, "evaluation"), "table_error_nm": {name: near(gap) for name, gap in off.items()},
        "preset_error": {"rays": len(exact[1]), "scrambles": SCRAMBLES, **stages},
    }  # fmt: skip
