"""Oracles of the light on every receiver, by docs/definitions.md alone, for the very rays that the evaluation drew."""

import numpy as np
from crooked import HOT_C, Expected
from oracle_tables import tables_record
from page_colour import beam_colour, flux_and_efficacy, tristimulus_at
from page_figures import (
    NEAR,
    RAY,
    jackknife,
    largest,
    least,
    least_over_mean,
    metric,
    nmse,
    plain,
    ratio,
    rsd,
    scaled,
    state_of,
    width_above,
)
from page_light import filtered, raw_nmse
from page_road import traffic_of, worst_on
from page_scene import (
    at_temperature,
    by_fate,
    exits_of_each,
    faces_of,
    in_shape,
    lamps_of,
    mask_of,
    read_at,
    rebinned,
    receive,
    receivers_of,
    target_light,
)

NOT_LEFT = (
    "backward", "outside_cavity", "base", "surfaces_intersect", "event_limit", "flange", "total_reflection",
)  # fmt: skip
MISSED = ("backward", "outside_cavity", "base", "missed_receiver", "surfaces_intersect", "event_limit", "flange")


def traced(case, calls, warm):
    """Receivers, their light by replicate and kind of lens, and flux (W) by the faces that it met."""
    (lens, raised) = at_temperature(case.lens, HOT_C) if warm else (case.lens, 0.0)
    spec = case.lens["spec"]
    places, turns, kinds = lamps_of(spec)
    others = lens.get("others") or {}
    own_kinds = [*(kind for kind in dict.fromkeys(kinds) if kind not in others), *others]
    receivers = receivers_of(spec)
    targets = [target_light(receiver)[1] for receiver in receivers]
    parts = {}
    for kind, call in zip(own_kinds, calls, strict=True):
        faces = faces_of(lens, others.get(kind, lens["faces"]))
        share = kinds.count(kind) / len(kinds)
        lamps = [(p, r) for p, r, k in zip(places, turns, kinds, strict=True) if k == kind]
        traced_at_once = exits_of_each(lens, faces, [(p, d, nm) for _, _, p, d, _, nm in call], raised)
        for (replicate, factor, _, _, flux, nm), behind in zip(call, traced_at_once, strict=True):
            colours = tristimulus_at(nm) if spec["colour"] else None
            fates = by_fate(behind, factor * flux, NOT_LEFT)
            for number, receiver in enumerate(receivers):
                got = receive(receiver, targets[number], lamps, behind, factor * flux, colours)
                parts.setdefault((number, replicate), []).append((share, got, fates))
                if number == 0 and behind.ways is not None:
                    ways = parts.setdefault(("ways", replicate), {})
                    for row in behind.left:
                        ways[behind.ways[row]] = ways.get(behind.ways[row], 0) + behind.flux[row] * factor * flux[row]
    return receivers, parts


def mean_of(parts):
    """Of lamps of several kinds: means by their shares."""
    names = parts[0][1].__dict__
    got = {name: sum(share * getattr(received, name) for share, received, _ in parts) for name in names}
    return got, {name: sum(share * fates[name] for share, _, fates in parts) for name in parts[0][2]}


def light_of(case, calls, source, warm):
    """The record of the light with one LED: receivers, ways, limits; and pictures of each receiver."""
    spec = case.lens["spec"]
    watts, efficacy = flux_and_efficacy(source, case.files)
    receivers, parts = traced(case, calls, warm)
    count = len(calls[0])
    lit = []
    images = []
    raw = []
    for number, receiver in enumerate(receivers):
        means = [mean_of(parts[number, k]) for k in range(count)]
        record, pictures = receiver_record(spec, receiver, means, watts, number)
        lit.append(record)
        images.append(pictures)
        raw.append([got["image"] for got, _ in means])
    record = {"receivers": lit, "limits": limits_of(case, receivers, images, raw, efficacy, watts, lit)}
    if figures := figures_of(case, receivers, images, efficacy):
        record["figures"] = figures
    ways = [parts[key] for key in sorted(key for key in parts if key[0] == "ways")]
    if ways:
        record["ways"] = ways_of(case.lens, ways, watts)
    record |= {
        "rays": sum(len(part[2]) for call in calls for part in call),
        "lumens_per_watt": (efficacy, 1e-4 * efficacy) if efficacy else None,
    }
    return record, images


def receiver_record(spec, receiver, means, watts, number):
    variance = spec["evaluate"]["filter_variance"]
    images = [filtered(got["image"], variance) for got, _ in means]
    target, inside = target_light(receiver)
    mean = np.mean(images, axis=0)
    mask = mask_of(receiver)
    lamps = len(lamps_of(spec)[0]) > 1 or spec["lamps"]
    efficiency = [got["window"] / watts for got, _ in means]
    half = tuple(max(1, n // 2) for n in receiver.shape)
    coarse_target = target_light(receiver, half)[0]
    in_target = jackknife([got["in_target"] / watts for got, _ in means])
    raw = [got["image"] for got, _ in means]
    if lamps:  # by the share of each pixel that is in the target
        in_target = jackknife([(i * covered(inside, receiver.shape)).sum() / watts for i in raw])
    unit = "W/sr" if receiver.kind == "far_field" else "W/m²"
    halved = [filtered(rebinned(got["image"], half), variance) for got, _ in means]
    noise = np.var(images, axis=0, ddof=1).sum() / len(images) / (mean**2).sum()
    pattern = nmse(images, target)
    radius = receiver.window[0] if len(receiver.window) == 1 else None
    fates = {name: np.mean([lost[name] for _, lost in means]) / watts for name in means[0][1]}
    landed = np.mean([got["window"] + got["outside"] for got, _ in means]) / watts
    missed = {name: plain(fates[name]) for name in MISSED if name in fates}
    missed["missed_receiver"] = plain(np.mean([got["missed"] for got, _ in means]) / watts)
    bodies = {name.removeprefix("body "): share for name, share in fates.items() if name.startswith("body ")}
    flux = {
        "detected": np.mean(efficiency), "outside": landed - np.mean(efficiency),
        "missed": sum(value for value, _ in missed.values()), "total_reflection": fates["total_reflection"],
        "not_converged": 0.0, "absorbed": fates["absorbed"], "cover_glass": fates["cover_glass"],
        "bodies": sum(bodies.values()), "housing": 0.0, "second_wall": 0.0,
    }  # fmt: skip
    flux["reflected"] = 1 - sum(flux.values())
    record = {
        "name": receiver.name, "kind": receiver.kind, "place": ..., "width": receiver.size[0],
        "height": receiver.size[1],
        "window": {"width": None if radius else receiver.window[0], "height": None if radius else receiver.window[1],
                   "radius": radius},
        "nmse": metric(pattern), "efficiency": metric(jackknife(efficiency)), "share_in_target": metric(in_target),
        "uniformity": None, "rsd": None,
        "in_region": region_of(images, target, mask, receiver.measure / len(lamps_of(spec)[0]), unit),
        "raw": {"nmse": plain(raw_nmse(mean, target)), "uniformity": None, "rsd": None},
        "nmse_of_noise": plain(noise, 1e-3),
        "nmse_of_raster": (pattern[0] - nmse(halved, coarse_target)[0], 1e-4 + 2 * NEAR * pattern[1]),
        "possible": dict.fromkeys(("efficiency", "share_in_target", "nmse", "law", "estimate"), ...),
        "flux": {name: plain(share) for name, share in flux.items()}, "missed_by_cause": missed,
        "lost_in_bodies": {name: plain(share) for name, share in bodies.items()}, "colour": None,
    }  # fmt: skip
    if mask is not None:
        values = [image[mask] for image in images]
        record["uniformity"] = metric(least_over_mean(values), near=RAY)
        record["rsd"] = metric(rsd(values), near=RAY)
        lit = mean[mask]
        record["raw"] |= {"uniformity": plain(lit.min() / lit.mean(), 1e-3), "rsd": plain(lit.std() / lit.mean(), 1e-3)}
    if spec["colour"]:
        pictures = [np.array([filtered(colour, variance) for colour in got["colours"]]) for got, _ in means]
        record["colour"] = beam_record(beam_colour(pictures, {"fwhm": 0.5, "tenth": 0.1}[spec["colour"]["within"]]))
    return record, np.array(images)


def covered(inside, shape):
    """Share of each pixel that is in the target."""
    k = inside.shape[0] // shape[0]
    return inside.reshape(shape[0], k, shape[1], k).mean(axis=(1, 3))


def beam_record(beam):
    units = {"u": "", "v": "", "cct": "K", "duv": "", "rms": "", "worst": ""}
    record = {"level": beam["level"], "pixels": beam["pixels"]}
    return record | {name: beam[name] and metric(beam[name], unit) for name, unit in units.items()}


def region_of(images, target, mask, measure, unit):
    inside = target > 0.5 * (1 + 1e-9) * target.max() if mask is None else mask
    values = np.array([image[inside] for image in images])
    whole = np.array([image.ravel() / image.sum() * target.sum() / target.max() for image in images])
    return {
        "region": "bright" if mask is None else "uniform",
        "mean": metric(scaled(jackknife(values.mean(axis=1)), 1 / measure), unit),
        "u0": metric(least_over_mean(values), near=RAY),
        "u1": metric(ratio(least(values), largest(values)), near=RAY),
        "peak": metric(largest(whole), near=RAY),
    }


def ways_of(lens, replicates, watts):
    """The brightest six ways of at most four faces to the exit; other faces to the outside; the rest."""
    names = list(lens["faces"])
    order = {"reflector": ["cup", "back", "mouth"]}.get(lens["spec"]["lens"]["kind"], names)
    shares = {}
    for k, ways in enumerate(replicates):
        for way, flux in ways.items():
            last = way[-1]
            key = way if last == order[-1] and len(way) <= 4 else () if last == order[-1] else (last,)
            shares.setdefault(key, np.zeros(len(replicates)))[k] += flux / watts
    to_exit = sorted((way for way in shares if way and way[-1] == order[-1]), key=lambda way: -shares[way].sum())
    for way in to_exit[6:]:
        shares[()] = shares.get((), np.zeros(len(replicates))) + shares[way]
    shown = to_exit[:6]
    if lens["spec"]["lens"]["kind"] == "tir":
        shown += [("wall",)]
    shown += [()] if () in shares else []
    none = np.zeros(len(replicates))
    return [{"faces": list(way), "share": metric(jackknife(shares.get(way, none)))} for way in shown]


# -- Section 10: limits ------------------------------------------------------------------------------------------------


def limits_of(case, receivers, images, raw, efficacy, watts, lit):
    spec = case.lens["spec"]
    limits = []
    named = [receiver.name for receiver in receivers]
    for limit in spec["limits"] or []:
        number = named.index(limit["receiver"]) if limit["receiver"] else 0
        pictures = images[number], raw[number]
        limits += own_limits(limit, receivers[number], *pictures, efficacy, watts, len(lamps_of(spec)[0]))
    limits += road_limits(case, receivers)
    if spec["colour"]:
        for receiver, record in zip(receivers, lit, strict=True):
            for statistic, field in (("rms", "max_rms_delta_uv"), ("worst", "max_delta_uv")):
                value = record["colour"][statistic]
                beam = {"fwhm": "half", "tenth": "a tenth"}[spec["colour"]["within"]]
                limits.append({
                    "name": f"Δu′v′ {statistic} within {beam} of the peak", "receiver": receiver.name,
                    "quantity": "distance from the mean colour", "value": value, "sense": "<=",
                    "bound": spec["colour"][field], "unit": "", "state": state_of(value, "<=", spec["colour"][field]),
                })  # fmt: skip
    return limits


def road_limits(case, receivers):
    """What the classes ask for, by the table of the files."""
    from oracle_far import road_record  # which takes from here

    for road in case.lens["spec"].get("roads") or []:
        for limit in road_record(case, road)["limits"]:
            sky = next(receiver.name for receiver in receivers if receiver.kind == "far_field")
            yield limit | {"name": f"{road['name']}: {limit['name']}", "receiver": sky}


def figures_of(case, receivers, images, efficacy):
    """Those of machine vision: how even the mask of uniform light of the first target is, and its mean illuminance."""
    if case.lens["spec"].get("application") is None:
        return []
    assert case.lens["spec"]["application"] == "machine vision"
    receiver = receivers[0]
    target = receiver.targets[0]
    width, height = target["uniform_mm"]
    zone = target | {"kind": "rectangle", "width_mm": width, "height_mm": height}
    inside = in_shape(zone, *receiver.to_target(*receiver.centres())) & receiver.in_window(*receiver.centres())
    read = [image[inside] * efficacy / receiver.measure for image in images[0]]
    values = {
        "Min/max": ("min/max of the light", ratio(least(read), largest(read)), ""),
        "Min/mean": ("min/mean of the light", least_over_mean(read), ""),
        "Mean light": ("mean light", jackknife([light.mean() for light in read]), "lx"),
    }
    return [
        {"name": name, "receiver": receiver.name, "quantity": quantity, "value": metric(value, unit, RAY), "unit": unit}
        for name, (quantity, value, unit) in values.items()
    ]


def share_of(limit, receiver, raw, watts):
    """Of several lamps, by the part of each pixel that is in the zone."""
    x, y = receiver.centres(8)
    inside = receiver.in_window(x, y) & (in_shape(limit["zone"], *receiver.to_target(x, y)) if limit["zone"] else True)
    return jackknife([(image * covered(inside, receiver.shape)).sum() / watts for image in raw])


def own_limits(limit, receiver, images, raw, efficacy, watts, lamps):
    """One entry for each bound of a limit."""
    photometric = efficacy if limit.get("unit") in ("lx", "cd") else 1.0
    per_flux = photometric * lamps / receiver.measure
    unit = {"lx": "lx", "cd": "cd"}.get(limit.get("unit"), "")
    x, y = receiver.to_target(*receiver.centres())
    if limit["kind"] == "points":
        places = np.array(limit["at_mm"] or limit["at_deg"]).T
    elif limit["kind"] == "line":
        ends = np.array([limit["from_mm"] or limit["from_deg"], limit["to_mm"] or limit["to_deg"]])
        (x0, y0), (x1, y1) = (receiver.to_chart(*end) for end in ends)
        pixel = receiver.size[0] / receiver.shape[1], receiver.size[1] / receiver.shape[0]
        steps = max(2, int(np.ceil(2 * np.hypot((x1 - x0) / pixel[0], (y1 - y0) / pixel[1]))) + 1)
        places = (ends[0] + np.linspace(0, 1, steps)[:, None] * (ends[1] - ends[0])).T
    elif limit["kind"] == "beam_angle":
        half = np.degrees(2 * np.arcsin(receiver.window[0] / 2))
        angles = np.linspace(-half, half, 2 * max(receiver.shape) + 1)
        turn = np.radians(limit["azimuth_deg"])
        places = np.array([angles * np.cos(turn), angles * np.sin(turn)])
    else:
        inside = receiver.in_window(*receiver.centres())
        if limit["kind"] == "glare":
            inside &= np.hypot(x, y) >= limit["from_deg"]
        elif limit["zone"]:
            inside &= in_shape(limit["zone"], x, y)
        places = None
    read = [
        per_flux * (image[inside] if places is None else read_at(receiver, image, *receiver.to_chart(*places)))
        for image in images
    ]
    if limit["kind"] == "beam_angle":
        value = jackknife(read, lambda mean: width_above(angles, mean, limit["level"] * mean.max()))
        bounds = [
            ("beam angle", value, "°", ">=", limit["at_least_deg"]),
            ("beam angle", value, "°", "<=", limit["at_most_deg"]),
        ]
    else:
        bounds = [("light", None, unit, ">=", limit["at_least"]), ("light", None, unit, "<=", limit["at_most"])]
    if limit["kind"] == "zone":
        share = share_of(limit, receiver, raw, watts)
        bounds += [
            ("min/mean of the light", None, "", ">=", limit["at_least_min_over_mean"]),
            ("min/max of the light", None, "", ">=", limit["at_least_min_over_max"]),
            ("share of the flux", share, "", ">=", limit["at_least_share"]),
            ("share of the flux", share, "", "<=", limit["at_most_share"]),
        ]
    for quantity, value, own_unit, sense, bound in bounds:
        if bound is None:
            continue
        if value is None and quantity == "light":
            value = least(read) if sense == ">=" else largest(read)
        elif quantity.startswith("min/mean"):
            value = least_over_mean(read)
        elif quantity.startswith("min/max"):
            value = ratio(least(read), largest(read))
        stated = metric(value, own_unit, RAY)
        yield {
            "name": limit["name"], "receiver": receiver.name, "quantity": quantity, "value": stated, "sense": sense,
            "bound": bound, "unit": own_unit, "state": state_of(stated, sense, bound),
        }  # fmt: skip


# -- The record of an evaluation ---------------------------------------------------------------------------------------


def kinds_in(case):
    return len(dict.fromkeys(lamps_of(case.lens["spec"])[2]))


def evaluation(case, stage="evaluate"):
    """The record of an evaluation, and the pictures of the first LED; made once for a case."""
    if (case.name, stage) not in KEPT:
        KEPT[case.name, stage] = evaluated(case, stage)
    return KEPT[case.name, stage]


KEPT = {}


OF_THE_FIRST = ("nmse", "efficiency", "share_in_target", "uniformity", "rsd", "possible", "flux")


def evaluated(case, stage):
    spec = case.lens["spec"]
    calls = list(case.rays[stage])
    kinds = kinds_in(case)
    leds = [(led["name"], led["source"]) for led in spec["sources"] or []] or [("", spec["source"])]
    records = []
    pictures = None
    for name, source in leds:
        light, images = light_of(case, calls[:kinds], source, stage == "warm")
        calls = calls[kinds:]
        pictures = images if pictures is None else pictures
        if source["kind"] in ("rayfile", "rayfiles"):
            fitted, _ = light_of(case, [calls.pop(0)], source, stage == "warm")
            light["fitted"] = {
                "rays": fitted["rays"], **{key: fitted["receivers"][0][key] for key in ("nmse", "efficiency")}
            }  # fmt: skip
        records.append((name, light))
    tables = tables_record(case, flux_and_efficacy(leds[0][1], case.files)[0], stage == "warm")
    told = [
        of_led | ({"place": place} if (place := where_led_stands(source)) else {}) | tables | {
            "conditions": ..., "led": name, "replicates": 16, "pixels": spec["evaluate"]["pixels"],
            "filter": f"3x3 Gaussian, variance {spec['evaluate']['filter_variance']:g} pixel^2, hard bins", "seed": 3,
            "fitted": None, "by_file": None, "others": [], "criteria": [...],
            **{key: of_led["receivers"][0][key] for key in OF_THE_FIRST},
        }
        for (name, of_led), (_, source) in zip(records, leds, strict=True)
    ]  # fmt: skip
    others = [other | {"preset_error": None} for other in told[1:]]
    record = told[0] | {"fitted": records[0][1].get("fitted"), "others": others}
    return record, pictures, [of_led for _, of_led in records]


def where_led_stands(source):
    """Its place, as far as the spec states it; of a ray file with the point that is put at the origin."""
    pose = {key: source[key] for key in ("rotate_z_deg", "tilt_deg", "position_mm")}
    if source["kind"] not in ("rayfile", "rayfiles"):
        moved = pose["rotate_z_deg"] or any((*pose["tilt_deg"], *pose["position_mm"]))
        return {"file": None, **pose} if moved else None
    at = source["origin"]
    named = isinstance(at, str)
    origin = {"found": at if named else "point", "at_mm": [0.0] * 3 if named else at}
    return {"file": origin | {key: source[key] for key in ("axis", "scale", "mirror")}, **pose}


def led_place(*path):
    """A text of coordinates."""

    def oracle(case, place):
        spec = case.lens["spec"]
        sources = [led["source"] for led in spec["sources"]] or [spec["source"]]
        value = where_led_stands(sources[place.group])
        for key in path:
            value = value[key]
        text = ", ".join(f"{coordinate:g}".replace("-", "−") for coordinate in value)
        return Expected(f"({text})°" if "tilt_deg" in path else f"({text}) mm")

    return oracle


def place_of(case, place):
    """The record of an LED, and that of its receiver, for a group of the light."""
    leds = evaluation(case, place.stage)[2]
    count = len(leds[0]["receivers"])
    light = leds[place.group // count]
    return light, light["receivers"][place.group % count]


def stated(entry, factor=1.0, unit=None, **more):
    """A figure of a record as a fact."""
    (value, within) = entry["value"]
    (error, error_within) = entry["standard_error"]
    unit = entry["unit"] if unit is None else unit
    return Expected(value * factor, within * factor, unit, error * factor, error_within * factor, **more)


def judged(entry, sense, bound):
    verdicts = {"held": "pass", "missed": "fail", "undecided": "undecided"}
    return {"limit": (sense, bound), "state": verdicts[state_of(entry, sense, bound)]}


def least_share(case, place):
    """Of the light where the spec sets no limits: section 19."""
    spec = case.lens["spec"]
    record = case.json("evaluate")
    if spec["limits"] or spec.get("roads") or (spec["colour"] or {}).get("max_delta_uv"):
        return None
    led, number = divmod(place.group, len(receivers_of(spec)))
    target = target_light(receivers_of(spec)[number])[0]
    light = record["others"][led - 1] if led else record
    possible = light["receivers"][number]["possible"]["share_in_target"]
    return 0.7 * min(transmitted(spec) * target[target > 0.1 * target.max()].sum(), possible)


def transmitted(spec):
    """What all faces transmit at normal incidence, those of further bodies, too; light of a reflector may meet none."""
    share = 1.0
    for body in (spec["lens"], *(spec["bodies"] or [])):
        if body.get("kind") == "reflector":
            continue
        ways = (("cap", "side"), ("wall", "exit")) if body.get("kind") == "tir" else (("inner",), ("outer",))
        for faces, beside in zip(ways, ("cavity_index", "outside_index"), strict=True):
            coatings = [(body.get(name) or {}).get("coating") for name in faces if not mirrored(body.get(name))]
            n = body["refractive_index"]
            around = body.get(beside, spec["lens"]["outside_index"])
            bare = ((n - around) / (n + around)) ** 2
            share *= 1 - min(np.min(coating["reflectance"]) if coating else bare for coating in coatings)
    return share


def mirrored(face):
    return bool(face) and face.get("mirror") is not None


def nmse_fact(case, place):
    entry = place_of(case, place)[1]["nmse"]
    bound = least_share(case, place)
    return stated(entry, possible=..., **({} if bound is None else judged(entry, "<=", 0.1)))


def share_fact(case, place):
    entry = place_of(case, place)[1]["share_in_target"]
    bound = least_share(case, place)
    more = {} if bound is None else judged(entry, ">=", bound) | {"limit": (">=", 100 * bound)}
    return stated(entry, 100, "%", possible=..., **more)


def from_receiver(*path, factor=1.0, unit=None, **more):
    def oracle(case, place):
        entry = place_of(case, place)[1]
        for key in path:
            entry = entry[key]
        return stated(entry, factor, unit, **more)

    return oracle


def level_fact(case, place):
    light, receiver = place_of(case, place)
    entry = receiver["in_region"]["mean"]
    efficacy = light["lumens_per_watt"]
    if efficacy is None:
        return stated(entry)
    unit = {"W/m²": "lx", "W/sr": "cd"}[entry["unit"]]
    figure = stated(entry, efficacy[0], unit)
    return Expected(
        figure.value,
        figure.within + 1e-4 * figure.value,
        unit,
        figure.standard_error,
        0.1 * figure.error_within + 0.1 * figure.standard_error,
    )


def evenness_fact(case, place):
    return from_receiver("in_region", place.key)(case, place)


def colour_fact(key):
    def oracle(case, place):
        entry = place_of(case, place)[1]["colour"][key]
        return Expected("none") if entry is None else stated(entry)

    return oracle


def limit_fact(case, place):
    return of_limit(evaluation(case, place.stage)[2][place.group]["limits"][place.number])


def figure_fact(case, place):
    return stated(evaluation(case, place.stage)[2][place.group]["figures"][place.number]["value"])


def worst_of_roads(case, place):
    every = evaluation(case, place.stage)[2][place.group]["limits"]
    return of_limit(worst_on(case.lens["spec"]["roads"], every)[place.number])


def of_limit(entry):
    factor, unit = (100, "%") if entry["quantity"].endswith("share of the flux") else (1.0, None)
    told = judged(entry["value"], entry["sense"], entry["bound"])
    return stated(entry["value"], factor, unit, **told | {"limit": (entry["sense"], factor * entry["bound"])})


def way_fact(case, place):
    return stated(
        evaluation(case, place.stage)[2][place.group]["ways"][int(place.key.split("_")[1])]["share"], 100, "%"
    )


def from_first(*path, factor=1.0, unit=""):
    def oracle(case, place):
        entry = evaluation(case, place.stage)[0]
        for key in path:
            entry = entry[key]
        if isinstance(entry, dict):
            return stated(entry, factor, unit)
        value, within = entry if isinstance(entry, tuple) else (entry, 0.0)
        return Expected(value * factor, within * factor, unit)

    return oracle


def pixels_fact(case, place):
    rows, columns = receivers_of(case.lens["spec"])[0].shape
    return Expected(f"{columns} × {rows}")


def table_fact(key, unit=""):
    """Of the tables of the evaluation; in the far field the angle at that distance from the axis."""

    def oracle(case, place):
        figure = stated(evaluation(case, place.stage)[0]["preset_error"]["evaluation"][key])
        if not unit:
            return figure
        far = receivers_of(case.lens["spec"])[0].kind == "far_field"
        factor = np.degrees(1) if far else 1.0  # of twice the arcsine of half of a small distance
        return Expected(factor * figure.value, factor * figure.within, "°" if far else unit)

    return oracle


ORACLES = {
    "table_nmse": table_fact("irradiance_nmse"), "table_hits": table_fact("hit_mm", "mm"),
    "nmse": nmse_fact, "share_in_target": share_fact, "level": level_fact, "u": evenness_fact,
    "efficiency": from_receiver("efficiency", factor=100, unit="%", possible=...),
    "uniformity": from_receiver("uniformity"), "rsd": from_receiver("rsd"), "peak": from_receiver("in_region", "peak"),
    "colour_u": colour_fact("u"), "colour_v": colour_fact("v"), "cct": colour_fact("cct"), "duv": colour_fact("duv"),
    "rms_delta_uv": colour_fact("rms"), "worst_delta_uv": colour_fact("worst"), "limit": limit_fact,
    "figure": figure_fact, "way": way_fact,
    "of_road": worst_of_roads, "classes": lambda case, place: Expected("; ".join(dict.fromkeys(
        f"{road['lighting_class']}, {traffic_of(road)}" for road in case.lens["spec"]["roads"]))),
    "rays": from_first("rays"), "pixels": pixels_fact, "file_origin": led_place("file", "at_mm"),
    "led_position": led_place("position_mm"), "led_tilt": led_place("tilt_deg"),
    "raw_nmse": from_first("receivers", 0, "raw", "nmse"), "noise_nmse": from_first("receivers", 0, "nmse_of_noise"),
    "fitted_nmse": from_first("fitted", "nmse"),
    "fitted_efficiency": from_first("fitted", "efficiency", factor=100, unit="%"),
}  # fmt: skip
ORACLES = {f"evaluate.{key}": oracle for key, oracle in ORACLES.items()}
RECORDS = {"evaluate": lambda case: evaluation(case)[0], "warm": lambda case: evaluation(case, "warm")[0]}
