"""A ray tracer written from docs/definitions.md alone. It shares no code with lensforge, and imports none of it.

The radius and its gradient are exact sums. For many rays they are interpolated by splines of degree 5, with an error
that a test holds far below the ray noise.
"""

import numpy as np
from scipy import interpolate, ndimage
from scipy.stats import qmc

# nodes of the chart (X, Y) along each axis, and the largest |X|: the horizon is at 1
NODES = 129
REACH = 1.2
FATES = [
    "landed", "backward", "outside_cavity", "surfaces_intersect", "base", "total_reflection", "missed_receiver",
    "event_limit", "flange",
]  # fmt: skip
LANDED, BACKWARD, OUTSIDE_CAVITY, INTERSECT, BASE, TOTAL, MISSED, EVENT_LIMIT, FLANGE = range(9)


def unit(vectors):
    lengths = np.linalg.norm(vectors, axis=1, keepdims=True)
    return np.where(lengths > 0, vectors / np.where(lengths > 0, lengths, 1.0), [0.0, 0.0, 1.0])


# -- Section 3: freeform surfaces --------------------------------------------------------------------------------------


def mirror_images(symmetry):
    along_x = (1, -1) if symmetry in ("mirror_x", "rectangle", "square") else (1,)
    along_y = (1, -1) if symmetry in ("mirror_y", "rectangle", "square") else (1,)
    group = [np.diag([a, b, 1]) for a in along_x for b in along_y]
    return group + [m[:, [1, 0, 2]] for m in group] if symmetry in ("diagonal", "square") else group


class Functions:
    def __init__(self, record, weights):
        self.weights = np.array(weights)
        self.group = mirror_images(record["symmetry"])
        centres = []
        sigmas = []
        for m in record["levels"]:
            j = np.arange(m)
            z = 1 - (j + 0.5) / m
            phi = j * np.pi * (3 - np.sqrt(5))
            ring = np.sqrt(1 - z**2)
            centres.append(np.column_stack([ring * np.cos(phi), ring * np.sin(phi), z]))
            sigmas.append(np.full(m, record["sigma_c"] * np.arccos(1 - 1 / m)))
        self.centres = np.concatenate(centres)
        self.sigmas = np.concatenate(sigmas)

    def one_sum(self, u):
        """Sum over the functions without mirror images, and its tangential gradient."""
        values = np.empty(len(u))
        gradients = np.empty((len(u), 3))
        for block in np.array_split(np.arange(len(u)), len(u) // 512 + 1):
            cosine = np.clip(u[block] @ self.centres.T, -1, 1)
            chord = np.sqrt(2 - 2 * cosine)
            g = 2 * np.arcsin(chord / 2)
            terms = self.weights * np.exp(-((g / self.sigmas) ** 2))
            sine = chord * np.sqrt(1 - chord**2 / 4)
            pull = 2 * terms / self.sigmas**2 * np.where(sine > 0, g / np.where(sine > 0, sine, 1), 1)
            values[block] = terms.sum(axis=1)
            gradients[block] = pull @ self.centres - (pull * cosine).sum(axis=1)[:, None] * u[block]
        return values, gradients

    def mean(self, u):
        """Mean of the sums over the mirror images."""
        sums = [self.one_sum(u @ m.T) for m in self.group]
        return np.mean([value for value, _ in sums], axis=0), np.mean(
            [gradient @ m for (_, gradient), m in zip(sums, self.group, strict=True)], axis=0
        )


class Freeform:
    def __init__(self, record):
        self.offset = record["offset_mm"]
        self.functions = Functions(record, record["weights_mm"])
        group = self.functions.group
        axis = np.linspace(-REACH, REACH, NODES)
        x, y = (a.ravel() for a in np.meshgrid(axis, axis, indexing="ij"))
        u = np.column_stack([2 * x, 2 * y, 1 - x**2 - y**2]) / (1 + x**2 + y**2)[:, None]
        # One sum, then its mirror images by flips.
        plain = np.column_stack(self.functions.one_sum(u)).T.reshape(4, NODES, NODES)
        total = np.zeros_like(plain)
        for m in group:
            turned = plain[:, :: m[0, 0], :: m[1, 1]] if m[0, 0] else plain[:, :: m[0, 1], :: m[1, 0]].swapaxes(1, 2)
            total[0] += turned[0]
            total[1:] += np.einsum("ji,jxy->ixy", m, turned[1:])
        total /= len(group)
        total[0] += self.offset
        self.largest = total[0].max()
        self.tables = [ndimage.spline_filter(table, order=5, mode="mirror") for table in total]

    def exact(self, u):
        """Radius (mm) and normal of the directions, by the sums of the page."""
        value, grad = self.functions.mean(u)
        rho = self.offset + value
        return rho, unit(u - grad / rho[:, None])

    def chart(self, u):
        return (u[:, :2].T / (1 + u[:, 2]) + REACH) * (NODES - 1) / (2 * REACH)

    def radius(self, u):
        return ndimage.map_coordinates(self.tables[0], self.chart(u), order=5, prefilter=False)

    def normal(self, u):
        where = self.chart(u)
        rho, *grad = (ndimage.map_coordinates(table, where, order=5, prefilter=False) for table in self.tables)
        return unit(u - np.column_stack(grad) / rho[:, None])


# -- Section 4: fixed surfaces -----------------------------------------------------------------------------------------


class Asphere:
    def __init__(self, record):
        self.vertex = record["vertex_mm"]
        self.curvature = 1 / record["radius_mm"]
        self.k = record["conic"]
        self.terms = [(4 + 2 * i, a) for i, a in enumerate(record["coefficients"])]
        self.theta = np.linspace(0, np.pi / 2 + 0.3, 2001)
        self.sheet = [self.vertex]
        for theta in self.theta[1:]:  # continued from the axis
            self.sheet.append(self.newton(np.array([[np.sin(theta), 0, np.cos(theta)]]), self.sheet[-1], 8)[0])
        self.largest = np.max(self.sheet)

    def implicit(self, p):
        """F and its gradient."""
        r2 = p[:, 0] ** 2 + p[:, 1] ** 2
        s = p[:, 2] - self.vertex - sum(a * r2 ** (n // 2) for n, a in self.terms)
        along = 2 * (1 + self.k) * s * self.curvature - 2
        aside = 2 * self.curvature - along * sum(n * a * r2 ** (n // 2 - 1) for n, a in self.terms)
        value = ((1 + self.k) * s**2 + r2) * self.curvature - 2 * s
        return value, np.column_stack([aside * p[:, 0], aside * p[:, 1], along])

    def newton(self, u, rho, steps):
        for _ in range(steps):
            value, gradient = self.implicit(u * np.reshape(rho, (-1, 1)))
            rho = rho - value / (gradient * u).sum(axis=1)
        return rho

    def radius(self, u):
        return self.newton(u, np.interp(np.arccos(np.clip(u[:, 2], -1, 1)), self.theta, self.sheet), 3)

    def normal(self, u):
        return unit(-self.implicit(u * self.radius(u)[:, None])[1])

    def exact(self, u):
        return self.radius(u), self.normal(u)


def biconic(r, x, y, z):
    b = x**2 / r["radius_x_mm"] + y**2 / r["radius_y_mm"]
    a = (1 + r["conic_x"]) * (x / r["radius_x_mm"]) ** 2 + (1 + r["conic_y"]) * (y / r["radius_y_mm"]) ** 2
    s = z - r["vertex_mm"]
    return b + a / b * s**2 - 2 * s


class ByEquation:
    """The first root of F from the origin, by bisection; normals by differences."""

    def __init__(self, record):
        self.f = lambda p: biconic(record, *p.T)
        self.reach = 3 * record["vertex_mm"]

    def exact(self, u):
        steps = np.linspace(0.01, 1, 400) * self.reach
        inside = np.array([self.f(step * u) > 0 for step in steps])
        first = np.argmin(inside, axis=0)
        low = steps[first - 1]
        high = steps[first]
        for _ in range(60):
            middle = (low + high) / 2
            before = self.f(middle[:, None] * u) > 0
            low = np.where(before, middle, low)
            high = np.where(before, high, middle)
        p = low[:, None] * u
        h = 1e-6
        slope = [self.f(p + h * e) - self.f(p - h * e) for e in np.eye(3)]
        return low, unit(-np.column_stack(slope))


class ChartSpline:
    def __init__(self, record):
        knots = np.array(record["knots"])
        side = len(knots) - 6
        rows = np.array(record["control_mm"]).reshape(side, side)
        self.spline = lambda at: np.array(
            [interpolate.BSpline(knots, interpolate.BSpline(knots, rows.T, 5)(y), 5)(x) for x, y in at]
        )

    def exact(self, u):
        rho = self.spline(u[:, :2] / (1 + u[:, 2:]))
        h = 1e-5
        grad = np.zeros_like(u)
        for e in np.eye(3):
            t = e - (u @ e)[:, None] * u  # along the sphere
            ends = [unit(u + sign * h * t) for sign in (1, -1)]
            slope = np.subtract(*(self.spline(v[:, :2] / (1 + v[:, 2:])) for v in ends)) / (2 * h)
            grad += slope[:, None] * e
        return rho, unit(u - (grad - np.sum(grad * u, axis=1)[:, None] * u) / rho[:, None])


FIXED = {"asphere": Asphere, "chart_spline": ChartSpline}


def surface(record):
    return Freeform(record) if record["kind"] == "srbf" else FIXED.get(record["kind"], ByEquation)(record)


def surfaces(lens):
    return [surface(lens.get("faces", lens)[f]) for f in ("inner", "outer")]


# -- Section 5: refractive index ---------------------------------------------------------------------------------------

SELLMEIER = {
    "PC": ([(1.4182, 0.021304)], 436.8, 1052), "PS": ([(1.4435, 0.020216)], 436.8, 1052),
    "N-BK7": ([(1.03961212, 0.00600069867), (0.231792344, 0.0200179144), (1.01046945, 103.560653)], 300, 2500),
    "fused silica": ([(0.6961663, 0.0684043**2), (0.4079426, 0.1162414**2), (0.8974794, 9.896161**2)], 210, 3710),
}  # fmt: skip
PMMA = {0: 2.1778, 2: 6.1209e-3, 4: -1.5004e-3, -2: 2.3678e-2, -4: -4.2137e-3, -6: 7.3417e-4, -8: -4.5042e-5}


def refractive_index(lens, nm, rays):
    """Index of every ray; nm: its wavelengths, or None."""
    section = lens["spec"]["lens"]
    n_d = section["refractive_index"]
    abbe = section["abbe_number"]
    name = section["material"]
    if nm is None or (abbe is None and name != "PMMA" and name not in SELLMEIER):
        return np.full(rays, n_d)
    low, high = (400, 1000) if abbe else (420, 1620) if name == "PMMA" else SELLMEIER[name][1:]
    um = np.clip(nm, 0.9 * low, 1.1 * high) / 1000
    if abbe:
        b = (n_d - 1) / abbe / (0.4861327**-2 - 0.6562725**-2)
        return n_d + b * (um**-2 - 0.5875618**-2)
    if name == "PMMA":
        return np.sqrt(sum(c * um**power for power, c in PMMA.items()))
    return np.sqrt(1 + sum(b * um**2 / (um**2 - c) for b, c in SELLMEIER[name][0]))


# -- Section 6: rays of a source ---------------------------------------------------------------------------------------


def inverse_share(x, density, u):
    """Points below which the share u of a density lies that is given densely."""
    total = np.concatenate([[0], np.cumsum((density[1:] + density[:-1]) / 2 * np.diff(x))])
    return np.interp(u * total[-1], total, x)


def emitted(source, rays, seed):
    """Start points (mm), directions, wavelengths (nm, or None) of rays of equal flux, about the source's own origin."""
    u = qmc.Sobol(6, seed=seed).random(rays)
    a = u[:, 0] - 0.5
    b = u[:, 1] - 0.5
    kind = source["kind"]
    if kind == "square":
        x, y = a * source["side_mm"], b * source["side_mm"]
    elif kind == "rectangle":
        x, y = a * source["width_mm"], b * source["height_mm"]
    elif kind == "disc":
        r = np.sqrt(u[:, 0]) * source["diameter_mm"] / 2
        turn = 2 * np.pi * u[:, 1]
        x, y = r * np.cos(turn), r * np.sin(turn)
    elif kind == "chip_array":
        column = np.floor(u[:, 4] * source["columns"])
        row = np.floor(u[:, 5] * source["rows"])
        x = (column - (source["columns"] - 1) / 2) * source["pitch_mm"][0] + a * source["width_mm"]
        y = (row - (source["rows"] - 1) / 2) * source["pitch_mm"][1] + b * source["height_mm"]
    else:
        chips = source["chips"]
        shares = np.cumsum([chip["flux_w"] for chip in chips])
        chosen = np.searchsorted(shares, u[:, 4] * shares[-1], side="right")
        field = {name: np.array([chip[name] for chip in chips])[chosen] for name in chips[0] if name.endswith("_mm")}
        x, y = field["x_mm"] + a * field["width_mm"], field["y_mm"] + b * field["height_mm"]
    profile = source.get("intensity") or {"kind": "cosine", "power": 1.0}
    if profile["kind"] == "cosine":
        gamma = np.arccos((1 - u[:, 2]) ** (1 / (profile["power"] + 1)))
    else:
        dense = np.radians(np.linspace(profile["gamma_deg"][0], profile["gamma_deg"][-1], 100_001))
        intensity = np.interp(dense, np.radians(profile["gamma_deg"]), profile["intensity"])
        gamma = inverse_share(dense, intensity * np.sin(dense), u[:, 2])
    phi = 2 * np.pi * u[:, 3]
    nm = None
    spectrum = source.get("spectrum")
    if spectrum and spectrum["kind"] == "line":
        nm = np.full(rays, spectrum["wavelength_nm"])
    elif spectrum:
        dense = np.linspace(spectrum["wavelength_nm"][0], spectrum["wavelength_nm"][-1], 100_001)
        density = np.interp(dense, spectrum["wavelength_nm"], spectrum["weight"])
        nm = inverse_share(dense, density, np.random.default_rng(seed).permutation(rays) / rays + 0.5 / rays)
    directions = np.column_stack([np.sin(gamma) * np.cos(phi), np.sin(gamma) * np.sin(phi), np.cos(gamma)])
    return np.column_stack([x, y, 0 * x]), directions, nm


FILE_AXES = {"+z": "+x+y+z", "-z": "+x-y-z", "+x": "+y+z+x", "-x": "+y-z-x", "+y": "+z+x+y", "-y": "+z-x-y"}


def into_own_frame(source, p, d):
    """Rays of a file in the coordinates of the source: origin, scale, axis, mirror."""
    origin = source["origin"]
    if origin == "virtual_focus":  # rays of equal flux
        across = np.eye(3) - d[:, :, None] * d[:, None, :]
        origin = np.linalg.solve(across.sum(axis=0), np.einsum("nij,nj->i", across, p))
    elif origin == "file":
        origin = (0, 0, 0)
    signs = FILE_AXES[source["axis"]]
    turn = np.array([np.eye(3)["xyz".index(signs[i + 1])] * (1 if signs[i] == "+" else -1) for i in (0, 2, 4)])
    turn = np.diag([-1 if source["mirror"] == "x" else 1, -1 if source["mirror"] == "y" else 1, 1]) @ turn
    return source["scale"] * (p - np.array(origin)) @ turn.T, d @ turn.T


def turn_of(tilt_deg, rotate_z_deg=0.0):
    a, b, c = np.radians([*tilt_deg, rotate_z_deg])
    about_x = np.array([[1, 0, 0], [0, np.cos(a), -np.sin(a)], [0, np.sin(a), np.cos(a)]])
    about_y = np.array([[np.cos(b), 0, np.sin(b)], [0, 1, 0], [-np.sin(b), 0, np.cos(b)]])
    about_z = np.array([[np.cos(c), -np.sin(c), 0], [np.sin(c), np.cos(c), 0], [0, 0, 1]])
    return about_y @ about_x @ about_z


def placed(source, p, d):
    turn = turn_of(source["tilt_deg"], source["rotate_z_deg"])
    return p @ turn.T + np.array(source["position_mm"]), d @ turn.T


# -- Section 7: a ray through the lens ---------------------------------------------------------------------------------


def first_crossing(surface, p, d):
    """Distance to the surface along each ray; nan where the ray falls to z = 0 before it."""
    along = (p * d).sum(axis=1)
    beyond = np.sqrt(along**2 - (p**2).sum(axis=1) + (1.001 * surface.largest) ** 2) - along
    floor = np.divide(-p[:, 2], d[:, 2], out=np.full(len(p), np.inf), where=d[:, 2] < 0)
    end = np.minimum(beyond, floor)

    def inside(t, rows=slice(None)):
        q = p[rows] + t[:, None] * d[rows]
        return surface.radius(unit(q)) - np.linalg.norm(q, axis=1)

    return first_root(inside, end, 24)


AT_ONCE = 20_000  # places: fewer cost as many calls of small arrays, more are looked at beyond the root in vain


def first_root(inside, end, steps):
    """Where inside(t, rows) first falls below 0, at t up to ``end``, of which so many steps are looked at; else nan."""
    count = len(end)
    low = np.zeros(count)
    f_low = inside(np.zeros(count))
    high = np.full(count, np.nan)
    f_high = np.full(count, np.nan)
    done = 0
    while done < steps:
        rows = np.flatnonzero(np.isnan(high))
        shares = np.arange(done + 1, min(steps, done + max(1, AT_ONCE // max(1, len(rows)))) + 1) / steps
        done += len(shares)
        t = np.vstack([low[rows], shares[:, None] * end[rows]])
        f = np.vstack([f_low[rows], inside(t[1:].ravel(), np.tile(rows, len(shares))).reshape(len(shares), -1)])
        out = f[1:] < 0
        falls = out.any(axis=0)
        last = np.where(falls, out.argmax(axis=0), len(shares))  # before it falls, or at all
        ray = np.arange(len(rows))
        low[rows] = t[last, ray]
        f_low[rows] = f[last, ray]
        high[rows[falls]] = t[1:][last[falls], ray[falls]]
        f_high[rows[falls]] = f[1:][last[falls], ray[falls]]
    rows = np.flatnonzero(~np.isnan(high))
    distance = np.full(count, np.nan)
    distance[rows] = regula_falsi(inside, rows, low[rows], high[rows], f_low[rows], f_high[rows])
    return distance


def regula_falsi(inside, rows, low, high, f_low, f_high):
    """Roots of inside(t, rows) between ``low`` and ``high``, by the Illinois algorithm."""
    root = high.copy()
    side = np.zeros(len(rows))
    going = np.arange(len(rows))
    for _ in range(20):
        root[going] = t = (low * f_high - high * f_low) / (f_high - f_low)
        f = inside(t, rows[going])
        now = np.where(f < 0, -1, 1)
        weight = np.where(side == now, 0.5, 1.0)
        low = np.where(now > 0, t, low)
        high = np.where(now < 0, t, high)
        f_low = np.where(now > 0, f, f_low * weight)
        f_high = np.where(now < 0, f, f_high * weight)
        rough = np.abs(f) >= 1e-11
        if not rough.any():
            break
        going = going[rough]
        low, high, f_low, f_high, side = (values[rough] for values in (low, high, f_low, f_high, now))
    return root


def layers_reflect(layers, nm, before, behind, c):
    """R_s and R_p of a stack, a matrix for each ray and layer; ``layers`` as the light meets them."""
    along = before * np.sqrt(1 - c**2)
    reflectances = []
    for p in (0, 2):
        whole = np.tile(np.eye(2, dtype=complex), (len(c), 1, 1))
        for layer in layers:
            index = layer["refractive_index"]
            normal = np.sqrt(index**2 - along**2 + 0j)
            eta = normal / index**p
            phase = 2 * np.pi * layer["thickness_nm"] * normal / nm
            matrix = [[np.cos(phase), -1j * np.sin(phase) / eta], [-1j * np.sin(phase) * eta, np.cos(phase)]]
            whole = whole @ np.moveaxis(np.array(matrix), 2, 0)
        first, last = (np.sqrt(index**2 - along**2) / index**p for index in (before, behind))
        (a, b), (e, g) = np.moveaxis(whole, 0, 2)
        into = (a + b * last) * first
        out = e + g * last
        reflectances.append(abs((into - out) / (into + out)) ** 2)
    return np.array(reflectances)


def coated(coating, nm, before, behind, c, outwards=False):
    """T_s and T_p of a coated face, for each ray below total reflection."""
    if coating["layers"]:
        return 1 - layers_reflect(coating["layers"][:: -1 if outwards else 1], nm, before, behind, c)
    low = np.minimum(before, behind)
    mu = np.sqrt(np.maximum(1 - (before / low) ** 2 * (1 - c**2), 0))
    angles = coating["angle_deg"] or [0, 90]
    rows = coating["reflectance"]
    rows = rows if coating["angle_deg"] else [row * 2 for row in rows]
    if angles[-1] < 90:
        angles = [*angles, 90]
        rows = [[*row, 1] for row in rows]
    places = np.cos(np.radians(angles))[::-1]
    at_angle = np.array([interpolate.PchipInterpolator(places, row[::-1])(mu) for row in rows])
    waves = coating["wavelength_nm"] or [0]
    passed = 1 - np.array([np.interp(w, waves, column) for w, column in zip(nm, at_angle.T, strict=True)])
    return np.array([passed, passed])


def fresnel(c, q, ratio):
    """T_s and T_p of a bare face."""
    r_s = (ratio * c - q) / (ratio * c + q)
    r_p = (c - ratio * q) / (c + ratio * q)
    return 1 - np.array([r_s, r_p]) ** 2


def stokes_behind(stokes, d, n, t):
    """Share I that passes a face with T_s and T_p; Q/I, U/I and the direction s to which they refer, behind it."""
    q, u, s = stokes
    s_face = np.cross(n, d)
    flat = np.linalg.norm(s_face, axis=1) < 1e-9  # at normal incidence s and p are alike
    s_face = unit(np.where(flat[:, None], s, s_face))
    x, y = (s_face * s).sum(axis=1), (s_face * np.cross(d, s)).sum(axis=1)  # cosine and sine from s to s_face
    q, u = q * (x * x - y * y) + u * 2 * x * y, u * (x * x - y * y) - q * 2 * x * y
    mean = (t[0] + t[1]) / 2
    half = (t[0] - t[1]) / 2
    i = mean + half * q
    return i, ((half + mean * q) / i, np.sqrt(t[0] * t[1]) * u / i, s_face)


def refracted(surface, p, d, before, behind, coating, nm, outwards, stokes):
    """Directions behind a surface, the share that passes and Stokes numbers; nan where it is reflected totally."""
    ratio = before / behind
    n = surface.seen(unit(p), d) if hasattr(surface, "seen") else surface.normal(unit(p))
    c = (d * n).sum(axis=1)
    q2 = np.where(c > 0, 1 - ratio**2 * (1 - c**2), -1)
    q = np.sqrt(np.where(q2 > 0, q2, np.nan))
    t = fresnel(c, q, ratio)
    if coating is not None:
        passes = q2 > 0
        t[:, passes] = coated(coating, *(a[passes] for a in (nm, before, behind, np.minimum(c, 1))), outwards)
    return ratio[:, None] * d + (q - ratio * c)[:, None] * n, *stokes_behind(stokes, d, n, t)


def behind_glass(section, p, d, nm, stokes):
    """Where rays leave the plate, walked through it, and the share that it lets through; at the far face."""
    glass = section.get("cover_glass")
    if glass is None:
        return p, np.ones(len(p))
    ratio = section["outside_index"] / glass["refractive_index"]
    p = p + ((glass["distance_mm"] - p[:, 2]) / d[:, 2])[:, None] * d
    inside = np.column_stack([ratio * d[:, :2], np.sqrt(1 - ratio**2 * (1 - d[:, 2] ** 2))])
    path = glass["thickness_mm"] / inside[:, 2]
    c = d[:, 2]
    q = inside[:, 2]
    t = fresnel(c, q, ratio)
    if glass.get("coating") is not None:
        before, behind = (np.full(len(p), index) for index in (section["outside_index"], glass["refractive_index"]))
        t = coated(glass["coating"], nm, before, behind, c)
    passed, _ = stokes_behind(stokes, d, np.tile([0.0, 0.0, 1.0], (len(p), 1)), t**2)
    return p + path[:, None] * inside, passed * np.exp(-glass["absorption_per_mm"] * path)


def enter(p, d, inside):
    """Fates of rays that do not come into the cavity, and where the others start."""
    fate = np.full(len(p), LANDED)
    p = p.copy()
    fate[(d[:, 2] <= 0) & (p[:, 2] <= 0)] = BACKWARD
    below = (p[:, 2] < 0) & (fate == LANDED)
    p[below] -= (p[below, 2] / d[below, 2])[:, None] * d[below]
    live = np.flatnonzero(fate == LANDED)
    fate[live[~inside(p[live])]] = OUTSIDE_CAVITY
    return fate, p


def to_receiver(lens, left, p, d, fate, flux, nm, stokes):
    """Flux, places on the receiver's plane (mm), and flux that the glass took, of rays ``left`` behind the lens."""
    in_glass = np.zeros(len(p))
    place = np.full((len(p), 2), np.nan)
    up = d[left, 2] > 1e-12
    fate[left[~up]] = MISSED
    rows = left[up]
    p = p.copy()
    stokes = [part[up] for part in stokes]
    p[rows], share = behind_glass(lens["spec"]["lens"], p[rows], d[rows], nm[rows], stokes)
    in_glass[rows] = flux[rows] * (1 - share)
    flux[rows] = flux[rows] * share
    to_plane = (lens["spec"]["target"]["distance_mm"] - p[rows, 2]) / d[rows, 2]
    place[rows] = p[rows, :2] + to_plane[:, None] * d[rows, :2]
    return flux, place, in_glass


def trace(lens, pair, p, d, nm=None):
    """Fate (index in FATES), place on the receiver's plane (mm); flux at the end, absorbed, and in the glass, of 1."""
    left, p, d, fate, flux, absorbed, nm, stokes = leave(lens, pair, p, d, nm)
    flux, place, in_glass = to_receiver(lens, left, p, d, fate, flux, nm, stokes)
    return fate, place, flux, absorbed, in_glass


def leave(lens, pair, p, d, nm=None, polarised=None):
    """Numbers of the rays that leave the lens; all rays behind it, their fate, flux, what was absorbed, wavelengths;
    and Q, U and their direction of those that leave."""
    inner, outer = pair
    n = refractive_index(lens, nm, len(p))
    d = unit(d)
    section = lens["spec"]["lens"]
    nm = np.full(len(p), section["design_wavelength_nm"]) if nm is None else nm
    cavity, outside = (np.full(len(p), section[name]) for name in ("cavity_index", "outside_index"))
    flux = np.ones(len(p))
    absorbed = np.zeros(len(p))
    fate, p = enter(p, d, lambda points: np.linalg.norm(points, axis=1) < inner.radius(unit(points)))

    live = np.flatnonzero(fate == LANDED)
    t = first_crossing(inner, p[live], d[live])
    fate[live[np.isnan(t)]] = BACKWARD
    live = live[~np.isnan(t)]
    t = t[~np.isnan(t)]
    p[live] += t[:, None] * d[live]
    sideways = unit(np.cross(d, np.where(abs(d[:, :1]) < 0.9, [1.0, 0.0, 0.0], [0.0, 1.0, 0.0])))
    stokes = [np.array(part) for part in polarised or (np.zeros(len(p)), np.zeros(len(p)), sideways)]
    rest = section.get("inner", {}).get("coating"), nm[live], False, [part[live] for part in stokes]
    d[live], flux[live], behind = refracted(inner, p[live], d[live], cavity[live], n[live], *rest)
    for whole, part in zip(stokes, behind, strict=True):
        whole[live] = part
    fate[live[np.isnan(flux[live])]] = TOTAL  # a tangent
    live = live[fate[live] == LANDED]
    fate[live[np.linalg.norm(p[live], axis=1) >= outer.radius(unit(p[live]))]] = INTERSECT

    live = live[fate[live] == LANDED]
    t = first_crossing(outer, p[live], d[live])
    fate[live[np.isnan(t)]] = BASE
    live = live[~np.isnan(t)]
    t = t[~np.isnan(t)]
    p[live] += t[:, None] * d[live]
    left = flux[live] * np.exp(-section["absorption_per_mm"] * t)
    absorbed[live] = flux[live] - left
    flux[live] = left
    rest = section.get("outer", {}).get("coating"), nm[live], True, [part[live] for part in stokes]
    d[live], passed, behind = refracted(outer, p[live], d[live], n[live], outside[live], *rest)
    for whole, part in zip(stokes, behind, strict=True):
        whole[live] = part
    fate[live[np.isnan(passed)]] = TOTAL
    live = live[~np.isnan(passed)]
    passed = passed[~np.isnan(passed)]
    flux[live] *= passed
    return live, p, d, fate, flux, absorbed, nm, [part[live] for part in stokes]
