"""Pictures of a road: from above, and as each driver sees it by night."""

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from lensforge.addons.road.road_field import BEFORE_M, DriverView, RoadReadings, lux_across, steps_along
from lensforge.addons.road.road_record import RoadJudgement, SeenRoad
from lensforge.addons.road.road_section import RoadSection
from lensforge.light.by_intensities import lenses_in, of_table
from lensforge.report.added_section import ShownApplication, application_pictures
from lensforge.report.page import PagePicture, picture
from lensforge.report.study_figures import table_of
from lensforge.results.figure_style import GREY, ORANGE, WIDE, in_report_style
from lensforge.scene.intensity_limit import Candela

_FROM_ABOVE = "One field between two lamps; the arrow is the driver’s lane, the driver 60 m before the field."
_FROM_ABOVE_BY_RP8 = "One field between two lamps for each direction of travel, each point seen from 83 m away."
_BY_NIGHT = (
    "View from 60 m before the field, which lies between the two lines across the road. Poles and lamps are to scale. "
    "The r-table holds for 60 m and beyond; it is used for the nearer road, too."
)
_ISOLINES = 5  # of luminance
# What a driver's view shows: distances ahead, tangents below, beside and above the horizon straight ahead.
_NEAR_M = 15.0
_FAR_M = 400.0
_ROWS = 120
_PER_LANE = 10
_DOWN = 0.1
_ASIDE = 0.35
_MOST_UP = 0.36
_ABOVE_LAMPS = 1.2
_POLE_M = 0.15  # width of a pole
_HEAD_M = (0.6, 0.12)  # width and depth of a lamp


@application_pictures.register
def road_pictures(judgement: RoadJudgement, shown: ShownApplication) -> list[PagePicture]:
    """The road from above, and of a class by luminance as each driver sees it."""
    road = _road(shown)
    name = judgement.name.capitalize()
    caption = _FROM_ABOVE_BY_RP8 if road.by_rp8 else _FROM_ABOVE
    above = picture(shown.picture_name("road"), road_from_above(shown), name, caption)
    if not road.by_luminance:
        return [above]
    return [above, picture(shown.picture_name("night"), road_by_night(shown), f"{name} by night", _BY_NIGHT)]


@in_report_style
def road_from_above(shown: ShownApplication) -> Figure:
    """A road from above: in the luminance that each driver sees, the left lane first; of a class P or C in lux."""
    road = _road(shown)
    readings = RoadReadings.of(road)
    candela = _kept_candela(shown)
    unit = "lx"
    lights = [(lux_across(0.0, road.width_m), readings.illuminance)]
    seen_by = _drivers(shown)
    drivers = sorted(seen_by, key=lambda driver: -road.from_right(driver.lane - 1))
    if road.by_luminance:
        unit = "cd/m²"
        of_drivers = zip(readings.rows, readings.luminance, strict=True)
        by_driver = dict(zip((driver.lane for driver in seen_by), of_drivers, strict=True))
        lights = [by_driver[driver.lane] for driver in drivers]
    seen = [light.of(candela(light)).reshape(len(rows), -1) for rows, light in lights]
    least = min(float(field.min()) for field in seen)
    top = max(float(field.max()) for field in seen) or 1.0
    figure = Figure(figsize=(WIDE, 0.5 + 1.3 * len(seen)), layout="constrained")
    views = figure.subplots(len(seen), 1, sharex=True, squeeze=False)[:, 0]
    levels = np.asarray(MaxNLocator(_ISOLINES).tick_values(least, top))
    for light, (rows, _), axes in zip(seen, lights, views, strict=True):
        _road_view(axes, light, road, rows, levels, top)
    if road.by_luminance:
        for driver, axes in zip(drivers, views, strict=True):
            at = DriverView(road, driver.lane - 1)
            start = at.place(np.zeros(1)).item()
            axes.plot(start, at.y, "<" if at.oncoming else ">", color=ORANGE, clip_on=False, markersize=6.0)
            axes.set_title(_of_driver(driver), loc="left", fontsize=8.0)
    views[-1].set(xlabel="along the road (m)")
    figure.colorbar(views[0].images[0], ax=list(views), label=unit)
    return figure


def _road(shown: ShownApplication) -> RoadSection:
    assert isinstance(shown.entry, RoadSection)
    return shown.entry


def _drivers(shown: ShownApplication) -> tuple[SeenRoad, ...]:
    assert isinstance(shown.judgement, RoadJudgement)
    return shown.judgement.drivers


def _kept_candela(shown: ShownApplication) -> Candela:
    road = _road(shown)
    factor = lenses_in(road, shown.spec, shown.photometry.source_lm) * road.maintenance_factor
    return of_table(table_of(shown.photometry), -shown.spec.photometry.street_side_deg, factor)


@in_report_style
def road_by_night(shown: ShownApplication) -> Figure:
    """A road of a class M from the eye of each driver, the left lane first, in its luminance, with its lamps."""
    road = _road(shown)
    candela = _kept_candela(shown)
    views = [DriverView(road, lane) for lane in sorted(range(road.lanes), key=road.from_right, reverse=True)]
    away = 1.0 / np.linspace(1.0 / _NEAR_M, 1.0 / _FAR_M, _ROWS)  # even steps in the picture
    away, y = np.meshgrid(away, np.linspace(0.0, road.width_m, _PER_LANE * road.lanes + 1))
    lights = [view.luminance(view.place(away.ravel() - BEFORE_M), y.ravel()) for view in views]
    seen = [light.of(candela(light)).reshape(y.shape) for light in lights]
    top = max(float(field.max()) for field in seen) or 1.0
    roof = min(_ABOVE_LAMPS * road.pole_height_m / BEFORE_M, _MOST_UP)
    tall = WIDE * (roof + _DOWN) / (2.0 * _ASIDE)
    figure = Figure(figsize=(WIDE, 0.2 + (0.15 + 0.85 * tall) * len(seen)), layout="constrained")
    all_axes = figure.subplots(len(seen), 1, squeeze=False)[:, 0]
    for view, light, axes in zip(views, seen, all_axes, strict=True):
        spots = view.seen(view.place(away - BEFORE_M), y, np.zeros_like(y))
        road_colours = axes.pcolormesh(
            *np.moveaxis(spots, -1, 0), light, cmap="inferno", vmin=0.0, vmax=top, shading="gouraud", rasterized=True
        )
        _by_the_road(axes, view)
        axes.set(xlim=(-_ASIDE, _ASIDE), ylim=(-_DOWN, roof), aspect="equal", xticks=[], yticks=[], facecolor="black")
        axes.set_title(f"from lane {view.lane + 1}{', oncoming' * view.oncoming}", loc="left", fontsize=8.0)
    figure.colorbar(road_colours, ax=list(all_axes), label="cd/m²")
    return figure


def _by_the_road(axes: Axes, view: DriverView) -> None:
    """Lines between the lanes and at the ends of the field; poles with their arms, and lamps."""
    road = view.road
    high = view.road.pole_height_m
    shown = view.place(np.array([_NEAR_M, _FAR_M]) - BEFORE_M)
    lines = [(shown, np.full(2, k * road.lane_m)) for k in range(road.lanes + 1)]
    ends = [(np.full(2, end), np.array([0.0, road.width_m])) for end in (0.0, road.pole_spacing_m)]
    for along, aside in (*lines, *ends):
        axes.plot(*view.seen(along, aside, np.zeros(2)).T, color="white", linewidth=0.5)
    x, y, foot = view.lamps(_NEAR_M, _FAR_M)
    arm = np.sort([foot, y], axis=0)
    (wide, deep) = _HEAD_M
    for left, right, low, top, colour in (
        (foot - 0.5 * _POLE_M, foot + 0.5 * _POLE_M, 0.0, high, GREY),
        (*arm, high - _POLE_M, high, GREY),
        (y - 0.5 * wide, y + 0.5 * wide, high - deep, high, "white"),
    ):
        corners = ((left, low), (right, low), (right, top), (left, top))
        shapes = np.stack([view.seen(x, side, np.full_like(x, up)) for side, up in corners], axis=1)
        axes.add_collection(PolyCollection(list(shapes), facecolors=colour, linewidths=0.0))


def _of_driver(driver: SeenRoad) -> str:
    seen = f"mean {driver.mean_cd_per_m2.value:.2f} cd/m²"
    even = driver.uniformity.value
    if driver.veiling_ratio is not None:
        return f"from lane {driver.lane} on: {seen}, U0 {even:.2f}, Lv/Lavg {driver.veiling_ratio.value:.2f}"
    glare = "" if driver.glare_percent is None else f", TI {driver.glare_percent.value:.1f} %"
    return f"seen from lane {driver.lane}: {seen}, U0 {even:.2f}, Ul {driver.uniformity_along.value:.2f}{glare}"


def _road_view(
    axes: Axes,
    light: Float[np.ndarray, "w l"],
    road: RoadSection,
    across: Float[np.ndarray, " w"],
    levels: Float[np.ndarray, " i"],
    top: float,
) -> None:
    half = 0.5 * (across[1] - across[0])
    extent = (0.0, road.pole_spacing_m, across[0] - half, across[-1] + half)
    axes.imshow(
        light, "inferno", aspect="auto", interpolation="bilinear", vmax=top, vmin=0.0, origin="lower", extent=extent
    )
    lines = axes.contour(steps_along(road), across, light, levels=levels, colors="white", linewidths=0.6)
    axes.clabel(lines, fontsize=6.0)
    for lane in range(1, road.lanes):
        axes.axhline(lane * road.lane_m, color="white", linewidth=0.8, linestyle=(0.0, (6.0, 6.0)))
    axes.set(ylabel="across (m)", xlim=extent[:2], ylim=(0.0, road.width_m))
