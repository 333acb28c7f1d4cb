"""Results of a lens whose LED travels: three stops with pictures of chance, of which the last has no width."""

from dataclasses import replace

import numpy as np
from result_folders import make_light, small_lens

from lensforge.light.travel_stops import Travel, TravelStop
from lensforge.report.results import Results
from lensforge.results import Metric
from lensforge.results.chart import Chart

LM_PER_W = 250.0
CHART = Chart(400.0, 300.0)
STATES = [{"name": "near"}, {"name": "far", "shift_mm": [0.0, 0.0, 0.25]}]


def travel():
    rng = np.random.default_rng(3)
    stops = [
        TravelStop(
            shift_mm=shift, state=state, map=rng.uniform(1.0, 2.0, (8, 16)), width=width,
            on_axis=Metric(value=on_axis, standard_error=0.0625),
        )
        for shift, state, on_axis, width in ((0.0, "near", 3.5, 61.0), (0.125, "", 2.5, 83.0), (0.25, "far", 1.5, None))
    ]  # fmt: skip
    return Travel(stops=stops, rays=4321, place="on a wall", width=CHART.width, height=CHART.height, far_field=False)


def results():
    lens = small_lens(lumens_per_watt=LM_PER_W)
    lens = replace(lens, spec=lens.spec.replace(states=STATES))
    others = (make_light(lens, led="far"),)
    return Results(lens, {"evaluate": make_light(lens, led="near", others=others, travel=travel())})
