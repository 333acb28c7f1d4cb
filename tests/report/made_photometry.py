"""Photometry of a Lambertian far field of 1000 lm, in closed form, whose figures agree with its table."""

import numpy as np
from filled import filled

from lensforge.light.angular_grid import AngularGrid
from lensforge.light.area_lamp import AreaLamp
from lensforge.light.by_intensities import judgements
from lensforge.light.luminaire_classes import LampLight
from lensforge.light.photometry_result import (
    Direction,
    Photometry,
    PlaneFigures,
    WrittenFile,
    WrittenFiles,
)
from lensforge.results import Extent, Metric
from lensforge.results.level_width import width_above
from lensforge.sources.intensity import TabulatedIntensity, plane_profile

C_DEG, GAMMA_DEG = np.linspace(0.0, 360.0, 37), np.linspace(0.0, 90.0, 46)


def make_photometry(lens, **changes):
    """The record of a lens that sends 0.9 of 1 W out; ``changes``: of its fields."""
    table = TabulatedIntensity(C_DEG, GAMMA_DEG, np.tile(1000.0 / np.pi * np.cos(np.deg2rad(GAMMA_DEG)), (37, 1)))
    written = WrittenFile(lumens=1000.0, watts=0.9, rays=100, relative_error=1e-9)
    files = WrittenFiles(ies=written, ldt=written, tm33=written, tm25ray=written)
    lumens = Metric(value=1000.0, unit="lm", standard_error=0.5)
    samples = np.tile(table.values[None, :-1], (16, 1, 1))
    lamp = LampLight(AngularGrid(36, GAMMA_DEG), samples, lens.spec.photometry.street_side_deg)
    zones = _zones(lamp)
    content = {
        "inputs": {"lens": lens.sha256},
        "source_w": 1.0,
        "exit_w": Metric(value=0.9, unit="W", standard_error=1e-4),
        "light_output_ratio": Metric(value=0.9, standard_error=1e-4),
        "source_lm": 1000.0 / 0.9,
        "per_1000_lm": False,
        "exit_lm": lumens,
        "axis_cd": _candela(table.values[0, 0]),
        "peak_cd": _candela(table.values.max()),
        "peak_direction": Direction(c_deg=0.0, gamma_deg=0.0),
        "beam_c0": _beam(table, 0.0),
        "beam_c90": _beam(table, 90.0),
        **judgements(lens.spec, lamp, 1000.0 / 0.9),
        "road": AreaLamp.of(lens.spec.photometry, lamp, lumens, zones),
        "node_error": Extent(max=0.03, rms=0.01),
        "interpolation_error": 0.002,
        "files": files,
        "c_deg": C_DEG,
        "gamma_deg": GAMMA_DEG,
        "candela": table.values,
        "candela_standard_error": 0.01 * table.values,
    }
    return filled(Photometry, **{**content, **changes})


def _candela(value):
    return Metric(value=float(value), unit="cd", standard_error=2.0)


def _beam(table, c_deg):
    peak = float(table.values.max())
    angles = {
        name: Metric(value=width_above(*plane_profile(table, c_deg), share * peak), unit="°", standard_error=0.2)
        for name, share in (("beam_angle_deg", 0.5), ("field_angle_deg", 0.1))
    }
    return PlaneFigures(c_deg=c_deg, peak_cd=_candela(peak), **angles)


def _zones(lamp):
    """Flux (lm) of each sample forward and back, at gamma to 30, 60, 80 and 90 degrees, by midpoints."""
    lateral, gamma = (
        coordinates.ravel() for coordinates in np.meshgrid(np.arange(360) + 0.5, np.arange(0.25, 90.0, 0.5))
    )
    flux = lamp.intensities(lateral, gamma) * np.sin(np.radians(gamma)) * np.radians(1.0) * np.radians(0.5)
    zone = np.digitize(gamma, (30.0, 60.0, 80.0)) + 4 * (np.cos(np.radians(lateral)) < 0.0)
    return np.stack([np.bincount(zone, replicate, minlength=8).reshape(2, 4) for replicate in flux])
