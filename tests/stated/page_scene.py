"""Rays from the source to each receiver by sections 6 to 9 of docs/definitions.md alone: bodies, lamps, targets."""

from dataclasses import dataclass
from itertools import product

import numpy as np
import page_chain
import page_tracer
from page_light import blurred
from page_tracer import FATES, turn_of
from scipy import ndimage

# -- Section 7: rays behind the lens and the further bodies ------------------------------------------------------------


@dataclass
class Exits:
    """All rays behind lens and bodies; ``left``: numbers of those that leave. Flux and losses of a flux of 1."""

    left: np.ndarray
    p: np.ndarray
    d: np.ndarray
    fate: np.ndarray
    flux: np.ndarray
    absorbed: np.ndarray
    in_glass: np.ndarray
    in_bodies: dict
    ways: list


def faces_of(lens, faces):
    design = {"faces": faces, "spec": lens["spec"]}
    return page_tracer.surfaces(design) if lens["spec"]["lens"]["kind"] == "double" else page_chain.chain_faces(design)


def at_temperature(lens, celsius):
    """lens.json of a double lens at a temperature, and the height by which it is raised: section 5."""
    section = lens["spec"]["lens"]
    base = lens["spec"]["base"]
    warmer = celsius - section["reference_temperature_c"]
    larger = 1 + section["expansion_per_k"] * warmer
    warm = section | {"refractive_index": section["refractive_index"] + section["index_per_k"] * warmer}
    faces = {
        name: face | {"offset_mm": larger * face["offset_mm"], "weights_mm": [larger * w for w in face["weights_mm"]]}
        for name, face in lens["faces"].items()
    }
    return lens | {"faces": faces, "spec": lens["spec"] | {"lens": warm}}, base["height_mm"] * (larger - 1)


def exits(lens, faces, p, d, nm=None, raised=0.0):
    """``faces`` of :func:`faces_of`; ``raised``: height of the lens's origin above that of the source."""
    section = lens["spec"]["lens"]
    ways = None
    p = p - [0, 0, raised]
    if section["kind"] == "double":
        left, p, d, fate, flux, absorbed, nm, stokes = page_tracer.leave(lens, faces, p, d, nm)
    else:
        left, p, d, fate, flux, absorbed, nm, stokes, ways = page_chain.leave_chain(lens, faces, p, d, nm)
    p[:, 2] += raised
    lost = {}
    for body in lens["spec"]["bodies"] or []:
        left, stokes, lost[body["name"]] = through(body, section, left, p, d, flux, nm, stokes)
    behind = Exits(left, p, d, fate, flux, absorbed, np.zeros(len(p)), lost, ways)
    glass = section.get("cover_glass")
    if glass is not None:
        up = d[left, 2] > 0
        rows = left[up]
        at, share = page_tracer.behind_glass(section, p[rows], d[rows], nm[rows], [part[up] for part in stokes])
        behind.p[rows] = at
        behind.in_glass[rows] = flux[rows] * (1 - share)
        behind.flux[rows] = flux[rows] * share
    return behind


def exits_of_each(lens, faces, bundles, raised=0.0):
    """:func:`exits` of several bundles (positions, directions, wavelengths), traced at once."""
    sizes = [len(p) for p, _, _ in bundles]
    p, d = (np.concatenate([bundle[k] for bundle in bundles]) for k in (0, 1))
    nm = None if bundles[0][2] is None else np.concatenate([bundle[2] for bundle in bundles])
    every = exits(lens, faces, p, d, nm, raised)
    first = 0
    for size in sizes:
        rows = slice(first, first + size)
        left = every.left[(every.left >= first) & (every.left < first + size)] - first
        parts = (getattr(every, name)[rows] for name in ("p", "d", "fate", "flux", "absorbed", "in_glass"))
        lost = {name: share[rows] for name, share in every.in_bodies.items()}
        yield Exits(left, *parts, lost, every.ways and every.ways[rows])
        first += size


class Sphere:
    """A face of a body, |p - (0, 0, c)| = a."""

    def __init__(self, fixed):
        self.c = fixed.get("centre_z_mm") or 0.0
        self.a = fixed["radius_mm"]
        self.largest = self.a + abs(self.c)

    def radius(self, u):
        along = self.c * u[:, 2]
        return along + np.sqrt(along**2 + self.a**2 - self.c**2)

    def normal(self, u):
        return (u * self.radius(u)[:, None] - [0, 0, self.c]) / self.a


def through(body, section, left, p, d, flux, nm, stokes):
    """Rays ``left`` through one body, in place; the numbers and Stokes numbers of those that leave it, and the loss."""
    turn = turn_of(body["tilt_deg"], body["rotate_z_deg"])
    origin = np.array(body["centre_mm"])
    outside = section["outside_index"]
    inner, outer = ({"coating": (body[face] or {}).get("coating")} for face in ("inner", "outer"))
    as_lens = {
        "refractive_index": body["refractive_index"], "abbe_number": body["abbe_number"], "material": "",
        "cavity_index": outside, "outside_index": outside, "absorption_per_mm": body["absorption_per_mm"],
        "design_wavelength_nm": section["design_wavelength_nm"], "inner": inner, "outer": outer,
    }  # fmt: skip
    pair = [Sphere(body[face]["fixed"]) for face in ("inner", "outer")]
    before = flux[left].copy()
    q, u, s = stokes
    known = (q, u, s @ turn)
    args = (p[left] - origin) @ turn, d[left] @ turn
    out, at, on, _, passed, _, _, behind = page_tracer.leave({"spec": {"lens": as_lens}}, pair, *args, nm[left], known)
    lost = np.zeros(len(flux))
    after = np.zeros(len(left))
    after[out] = before[out] * passed[out]
    lost[left] = before - after
    flux[left] = after
    rows = left[out]
    p[rows] = at[out] @ turn.T + origin
    d[rows] = on[out] @ turn.T
    gone = np.setdiff1d(left, rows)
    flux[gone] = 0.0
    q, u, s = behind
    return rows, (q, u, s @ turn.T), lost


# -- Section 8: lamps, receivers, pixels -------------------------------------------------------------------------------


def lamps_of(spec):
    """Places (mm), rotations and kinds of all lamps; one at the origin where there are none."""
    lamps = spec["lamps"]
    if lamps is None:
        return np.zeros((1, 3)), np.eye(3)[None], [""]
    places = np.array([[*place, 0.0][:3] for place in lamps["places_mm"]])
    turns = np.radians(lamps["turns_deg"] or [0.0] * len(places))
    rotations = []
    for number, (place, turn) in enumerate(zip(places, turns, strict=True)):
        axis = np.array([0.0, 0.0, 1.0])
        if lamps["aims_mm"]:
            axis = np.array(lamps["aims_mm"][number]) - place
            axis /= np.linalg.norm(axis)
        tilt = np.degrees(np.arccos(axis[2]))
        pan = np.degrees(np.arctan2(axis[1], axis[0]))
        pan = pan if tilt > 0 else 0.0
        rotations.append(turn_of([0, 0], pan) @ turn_of([0, tilt]) @ turn_of([0, 0], np.degrees(turn)))
    return places, np.array(rotations), list(lamps["kinds"] or [""] * len(places))


def axes_of(normal, rotation_deg):
    """Rows x, y, z of a receiver: the lens's own after the shortest turn of z to ``normal``, then turned about it."""
    n = np.array(normal) / np.linalg.norm(normal)
    cross = np.cross([0, 0, 1.0], n)
    cosine = n[2]
    skew = np.array([[0, -cross[2], cross[1]], [cross[2], 0, -cross[0]], [-cross[1], cross[0], 0]])
    shortest = np.eye(3) + skew + skew @ skew / (1 + cosine)
    x, y, z = shortest.T
    c = np.cos(np.radians(rotation_deg))
    s = np.sin(np.radians(rotation_deg))
    return np.array([c * x + s * y, c * y - s * x, z])


@dataclass
class Receiver:
    """``size``: of its chart, ``shape``: rows and columns, ``window``: width and height, or the radius of a circle."""

    name: str
    kind: str
    centre: np.ndarray
    axes: np.ndarray
    size: tuple
    shape: tuple
    window: tuple
    radius: float
    targets: list
    level: bool

    @property
    def measure(self):
        """Of a pixel: m², in the far field sr."""
        area = self.size[0] * self.size[1] / (self.shape[0] * self.shape[1])
        return area if self.kind == "far_field" else area * 1e-6

    def centres(self, times=1):
        rows, columns = (times * count for count in self.shape)
        x = ((np.arange(columns) + 0.5) / columns - 0.5) * self.size[0]
        y = ((np.arange(rows) + 0.5) / rows - 0.5) * self.size[1]
        return np.meshgrid(x, y)

    def in_window(self, x, y):
        if len(self.window) == 1:
            return np.hypot(x, y) <= self.window[0]
        return (abs(x) <= self.window[0] / 2) & (abs(y) <= self.window[1] / 2)

    def to_target(self, x, y):
        """Coordinates of targets (mm, degrees) of places on the chart."""
        r = np.hypot(x, y)
        if self.kind != "far_field":
            return x, y
        gamma = np.degrees(2 * np.arcsin(np.minimum(r / 2, 1)))
        scale = np.where(r > 0, gamma / np.where(r > 0, r, 1), np.degrees(1))
        return x * scale, y * scale

    def to_chart(self, x, y):
        r = np.hypot(x, y)
        if self.kind != "far_field":
            return x, y
        scale = np.where(r > 0, 2 * np.sin(np.radians(r) / 2) / np.where(r > 0, r, 1), np.radians(1))
        return x * scale, y * scale

    def land(self, p, d):
        """Places on the chart; nan where a ray does not land."""
        p = (p - self.centre) @ self.axes.T
        d = d @ self.axes.T
        if self.kind == "plane":
            lands = d[:, 2] > 1e-12
            t = -p[:, 2] / np.where(d[:, 2] > 1e-12, d[:, 2], 1)
            place = p[:, :2] + t[:, None] * d[:, :2]
        elif self.kind == "far_field":
            lands = d[:, 2] > -1
            place = d[:, :2] * np.sqrt(2 / (1 + np.where(lands, d[:, 2], 0)))[:, None]
        else:
            use = [0, 2] if self.kind == "cylinder" else [0, 1, 2]
            a = (d[:, use] ** 2).sum(axis=1)
            b = (p[:, use] * d[:, use]).sum(axis=1)
            c = (p[:, use] ** 2).sum(axis=1) - self.radius**2
            root = b**2 - a * c
            t = (-b + np.sqrt(np.maximum(root, 0))) / a
            lands = (root >= 0) & (t > 0)
            q = p + t[:, None] * d
            if self.kind == "cylinder":
                place = np.column_stack([self.radius * np.arctan2(q[:, 0], q[:, 2]), q[:, 1]])
            else:
                u = q / self.radius
                place = self.radius * np.sqrt(2 / (1 + u[:, 2]))[:, None] * u[:, :2]
        return np.where(lands[:, None], place, np.nan)

    def bins(self, place, flux):
        rows, columns = self.shape
        j, i = np.floor((place / self.size + 0.5) * (columns, rows)).T
        on = (j >= 0) & (j < columns) & (i >= 0) & (i < rows)
        at = (i[on] * columns + j[on]).astype(int)
        return np.bincount(at, weights=flux[on], minlength=rows * columns).reshape(rows, columns)


def side_counts(size, pixels):
    """Rows and columns of nearly square pixels, so many along the longer side."""
    longest = max(size)
    columns, rows = (max(1, round(pixels * side / longest)) for side in size)
    return rows, columns


def read_at(receiver, image, x, y):
    """Bilinear between the centres of pixels; beyond the last as there."""
    rows, columns = receiver.shape
    column = np.clip((x / receiver.size[0] + 0.5) * columns - 0.5, 0, columns - 1)
    row = np.clip((y / receiver.size[1] + 0.5) * rows - 0.5, 0, rows - 1)
    j = np.minimum(column.astype(int), columns - 2)
    i = np.minimum(row.astype(int), rows - 2)
    a = column - j
    b = row - i
    low = image[i, j] * (1 - a) + image[i, j + 1] * a
    high = image[i + 1, j] * (1 - a) + image[i + 1, j + 1] * a
    return low * (1 - b) + high * b


def receivers_of(spec):
    pixels = spec["evaluate"]["pixels"]
    receivers = []
    sections = spec["receivers"] or [spec["target"]]
    for section in sections:
        kind = section["kind"]
        targets = section.get("targets") or [section]
        centre = np.zeros(3)
        rotation = section.get("rotation_deg", 0.0)
        radius = 0.0
        level = False
        if not spec["receivers"]:
            kind = "plane" if section["distance_mm"] else "far_field"
            rotation = 0.0
        if kind == "plane":
            if not spec["receivers"]:
                centre = np.array([0, 0, section["distance_mm"]])
                normal = [0, 0, 1]
                size = [section["receiver_mm"]] * 2
            else:
                centre = np.array(section["centre_mm"])
                size = [section["width_mm"], section["height_mm"]]
                normal = section["normal"] or turn_of(section["tilt_deg"] or [0, 0])[:, 2]
                normal = np.array(normal) * np.sign(np.dot(normal, centre))
            level = abs(np.array(normal)[:2]).max() == 0
            side = spec["evaluate"]["window_mm"] if not spec["receivers"] else None
            window = (side, side) if side else tuple(section.get("window_mm") or size)
        elif kind == "far_field":
            radius = 2 * np.sin(np.radians(section["half_angle_deg"]) / 2)
            normal = section.get("axis") or [0, 0, 1]
            size = [2 * radius] * 2
            window = (radius,)
        else:
            centre = np.array(section["centre_mm"])
            normal = section["facing"]
            radius = section["radius_mm"]
            if kind == "cylinder":
                size = [section["width_mm"], section["height_mm"]]
                window = tuple(size)
            else:
                chart = 2 * radius * np.sin(np.radians(section["half_angle_deg"]) / 2)
                size = [2 * chart] * 2
                window = (chart,)
        shape = side_counts(size, pixels)
        axes = axes_of(normal, rotation)
        if level and spec["lamps"]:
            shape = even_pixels(size, shape, lamps_of(spec)[0] @ axes.T)
        name = (section.get("name") or kind) if spec["receivers"] else "light"
        receivers.append(Receiver(name, kind, centre, axes, tuple(size), shape, window, radius, targets, level))
    return receivers


def even_pixels(size, shape, places):
    """Of 0.75 to 1.3 of the pixels those with the fewest different parts of one, then the nearest number."""
    counts = []
    for side, count, along in zip(size, shape[::-1], places.T[:2], strict=True):
        least = None
        for tried in range(int(np.ceil(0.75 * count)), int(1.3 * count) + 1):
            parts = along * tried / side
            different = len({round(part % 1, 6) % 1 for part in parts - np.round(parts)})
            rank = (different, abs(tried - count), tried)
            least = rank if least is None or rank < least else least
        counts.append(least[2])
    return counts[1], counts[0]


# -- Section 9: targets ------------------------------------------------------------------------------------------------


def own_place(target, x, y):
    """Places about the centre of a target, turned into its axes."""
    cx, cy = target.get("centre_mm") or target.get("centre_deg") or (0.0, 0.0)
    c = np.cos(np.radians(target["rotation_deg"]))
    s = np.sin(np.radians(target["rotation_deg"]))
    x, y = x - cx, y - cy
    return c * x + s * y, c * y - s * x


def length(target, name):
    return target.get(f"{name}_mm") or target.get(f"{name}_deg") or 0.0


def in_shape(target, x, y):
    x, y = own_place(target, x, y)
    if target["kind"] == "disc":
        return np.hypot(x, y) <= length(target, "diameter") / 2
    w = length(target, "width") / 2
    h = length(target, "height") / 2
    if target["kind"] == "rectangle":
        return (abs(x) <= w) & (abs(y) <= h)
    assert target["kind"] == "ellipse"
    return (x / w) ** 2 + (y / h) ** 2 <= 1


DRAWN = {}


def target_light(receiver, shape=None):
    """T, whose pixels add up to 1, and the sub-pixels in which it is above a tenth of its largest pixel."""
    key = repr((receiver.targets, receiver.size, receiver.window, receiver.shape, shape))
    if key not in DRAWN:
        DRAWN[key] = drawn(receiver, shape)
    return DRAWN[key]


def drawn(receiver, shape):
    n = max(receiver.shape)
    k = max(1, min(max(8, 512 // n), 4096 // n))
    rows, columns = shape or receiver.shape
    raster = Receiver(**{**receiver.__dict__, "shape": (rows, columns)})
    x, y = raster.to_target(*raster.centres(k))
    within = raster.in_window(*raster.centres(k)) if receiver.kind == "far_field" else np.full(x.shape, True)
    total = np.zeros((rows, columns))
    fine_total = np.zeros(x.shape)
    for target in receiver.targets:
        edge = length(target, "edge")
        if receiver.kind == "far_field" and edge:
            reach = np.hypot(x, y)[within].max() + 4 * edge
            at = ((np.arange(1024) + 0.5) / 1024 - 0.5) * 2 * reach
            canvas = blurred(in_shape(target, *np.meshgrid(at, at)).astype(float), [512 * edge / reach] * 2)
            places = (np.stack([y, x]) / (2 * reach) + 0.5) * 1024 - 0.5
            fine = ndimage.map_coordinates(canvas, places, order=1, mode="constant")
        else:
            fine = in_shape(target, x, y).astype(float)
            pitch = raster.size[1] / (rows * k), raster.size[0] / (columns * k)
            fine = blurred(fine, [edge / pitch[0], edge / pitch[1]]) if edge else fine
        fine = np.where(within, fine, 0)
        image = fine.reshape(rows, k, columns, k).mean(axis=(1, 3))
        scale = target["level"] / image.max() if len(receiver.targets) > 1 else 1.0
        total += scale * image
        fine_total += scale * fine
    return total / total.sum(), fine_total > 0.1 * total.max()


def mask_of(receiver):
    x, y = receiver.to_target(*receiver.centres())
    mask = None
    for target in receiver.targets:
        sides = target.get("uniform_mm") or target.get("uniform_deg")
        if sides:
            u, v = sides if isinstance(sides, list) else (sides, sides)
            local = own_place(target, x, y)
            inside = (abs(local[0]) <= u / 2) & (abs(local[1]) <= v / 2)
            mask = inside if mask is None else mask | inside
    return mask


def rebinned(image, shape):
    """The image on other pixels of the same chart: those that several share are divided by area."""
    for axis, count in enumerate(shape):
        old = image.shape[axis]
        edges = np.arange(count + 1) * old / count
        cells = np.zeros((count, old))
        for i, j in product(range(count), range(old)):
            cells[i, j] = max(0.0, min(edges[i + 1], j + 1) - max(edges[i], j))
        image = np.moveaxis(np.tensordot(cells, image, axes=(1, axis)), 0, axis)
    return image


# -- Section 8: what lands --------------------------------------------------------------------------------------------


@dataclass
class Received:
    """Means over the lamps of one replicate: pictures (W) of the light and of X, Y, Z, and shares of the flux (W)."""

    image: np.ndarray
    colours: np.ndarray
    window: float
    outside: float
    missed: float
    in_target: float


def contains(inside, receiver, place):
    rows, columns = inside.shape
    j, i = np.floor((place / receiver.size + 0.5) * (columns, rows)).T
    on = (j >= 0) & (j < columns) & (i >= 0) & (i < rows)
    mask = np.full(len(place), False)
    mask[on] = inside[i[on].astype(int), j[on].astype(int)]
    return mask


def receive(receiver, target, lamps, behind, flux_w, tristimulus=None):
    """Light of the rays of one kind of lens: ``lamps``, pairs of place and rotation, see them all.

    ``target``: sub-pixels in it. ``flux_w``: of each ray as emitted.
    """
    rows = behind.left
    flux = behind.flux[rows] * flux_w[rows]
    total = Received(np.zeros(receiver.shape), np.zeros((3, *receiver.shape)), 0, 0, 0, 0)
    for place, turn in lamps:
        shift = 0 if receiver.kind == "far_field" else place
        at = receiver.land(behind.p[rows] @ turn.T + shift, behind.d[rows] @ turn.T)
        lands = ~np.isnan(at[:, 0])
        if receiver.kind == "plane" and len(lamps) > 1:
            ahead = behind.p[rows] @ turn.T + place - receiver.centre
            lands &= ahead @ receiver.axes[2] < 0
        at = at[lands]
        power = flux[lands]
        inside = receiver.in_window(*at.T)
        total.image += receiver.bins(at, power)
        total.window += power[inside].sum()
        total.outside += power[~inside].sum()
        total.missed += flux[~lands].sum()
        total.in_target += power[contains(target, receiver, at)].sum()
        if tristimulus is not None:
            for k in range(3):
                total.colours[k] += receiver.bins(at, power * tristimulus[rows][lands, k])
    for name, amount in total.__dict__.items():
        setattr(total, name, amount / len(lamps))
    return total


def by_fate(behind, flux_w, names):
    """Flux (W) of each fate of rays that do not leave the lens, and of the losses."""
    gone = np.full(len(flux_w), True)
    gone[behind.left] = False
    lost_in = np.sum([*behind.in_bodies.values(), np.zeros(len(flux_w))], axis=0) > 0
    losses = {
        name: (behind.flux * flux_w)[gone & ~lost_in & (behind.fate == FATES.index(name))].sum() for name in names
    }
    losses["absorbed"] = (behind.absorbed * flux_w).sum()
    losses["cover_glass"] = (behind.in_glass * flux_w).sum()
    return losses | {f"body {name}": (lost * flux_w).sum() for name, lost in behind.in_bodies.items()}
