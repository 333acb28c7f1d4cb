"""Numbers that the lines above the tables for the shop must show, by file and the name before the colon."""

import numpy as np
from handover_places import REQUEST, table_of
from shown_numbers import shown
from wanted_handover import rounded_up


def head_numbers(results, made):
    """Entries of every table, and of the dense ones what was measured of them."""
    shop, lens = results.spec.manufacture, results.lens
    for name in made.handover.files:
        if name.endswith(".csv"):
            yield shown(f"{name} / lens", lens.sha256)
            yield shown(f"{name} / author", f"by lensforge {lens.version}")
            yield shown(f"{name} / units", "z = 0 the plane")
            if shop.make == "insert":
                words, numbers = "shrinkage: {}; the points are those of the mould, the lens times {}", shop.shrinkage
                yield shown(f"{name} / shrinkage", words, numbers, 1.0 + shop.shrinkage)
    for grid, measured in zip(made.handover.grids, made.grids, strict=True):
        yield shown(f"{grid.file} / offset", "offset: 0; the points lie on the face")
        yield shown(f"{grid.file} / interpolation", "bicubic, the polynomial through the 4 x 4 nearest nodes")
        label, words = f"{grid.file} / interpolation error", "at most {} nm along the normal"
        yield shown(label, words, rounded_up(grid.error_nm))
        yield shown(label, "at {} middles", measured.measured)
        yield from _raster(grid, measured.grid) if grid.kind == "raster" else _polar(grid, measured.grid)


def _raster(grid, raster):
    x = np.unique(table_of(grid.content)["x_mm"])
    nodes, cells = f"{grid.file} / nodes", f"{grid.file} / complete cells"
    yield shown(nodes, "with h = {} mm", float(np.diff(x).min()))
    yield shown(nodes, "within {} mm of the axis, the steepest {} degrees", raster.extent.radius_mm, raster.slope_deg)
    yield shown(nodes, "steeper than {} degrees", REQUEST.slope_deg)
    covered = (raster.covered_mm(REQUEST.interpolation), 100.0 * grid.covered)
    yield shown(cells, "within {} mm of the axis, {} % of the face's area", *covered)


def _polar(grid, polar):
    """Steps of both angles as the rows of the table have them."""
    table = table_of(grid.content)
    rings, turns = (np.unique(table[f"{name}_deg"]) for name in ("polar", "azimuth"))
    nodes = f"{grid.file} / nodes"
    yield shown(nodes, "with p = {} degrees", polar.step_deg)
    np.testing.assert_allclose(np.diff(rings), polar.step_deg, atol=2e-9)
    yield shown(nodes, "{} azimuths k q with q = {} degrees", len(turns), 360.0 / len(turns))
    yield shown(nodes, "spacing up to {} mm", grid.spacing_mm)
    yield shown(f"{grid.file} / extent", "ring {} is at the lowest point", polar.rim)
    yield shown(f"{grid.file} / extent", "rim, {} more", len(rings) - 1 - polar.rim)
