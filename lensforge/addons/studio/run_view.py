"""View of a finished lens for the page: light, search, figures, verdicts, and files that are of an older one."""

from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

import numpy as np

from lensforge.addons.studio.cures import cure_of
from lensforge.addons.studio.folder_files import DOWNLOADS
from lensforge.addons.studio.lens_view import drawn
from lensforge.addons.studio.physics import chart_head
from lensforge.errors import InputError
from lensforge.kernels.fate import Fate
from lensforge.light.receiver_light import ReceiverLight
from lensforge.report.folder import Run
from lensforge.report.headline import headline, required_facts
from lensforge.report.results import REPORT_FILE
from lensforge.report.travel_section import stop_caption, travel_of
from lensforge.results.files import MIB, read_file
from lensforge.spec import ReceiverSection

_PHOTOMETRIC = (".ies", ".ldt", ".iesxml", ".tm25ray", ".gldf")
_MOST_REPORT_BYTES = 256 * MIB


def run_arrays(run: Run, figure: str) -> dict[str, np.ndarray]:
    """Arrays of the page: course of the search, light and target of each receiver, and the lens with a ``figure``."""
    levels = run.design.history if "design" in run.found else ()
    arrays = {
        name: np.array([value for level in levels for value in getattr(level, name)]) for name in ("nmse", "efficiency")
    }
    for number, (light, _, lumens) in enumerate(_lit_receivers(run)):
        arrays[f"light{number}"] = (lumens or 1.0) * light.map
        arrays[f"target{number}"] = (lumens or 1.0) * light.target_map
    if (travel_and_unit := travel_of(run)) is not None:
        travel, unit = travel_and_unit
        number = len(run.light.receivers)
        arrays |= {f"light{number}_{index}": unit.per_watt * stop.map for index, stop in enumerate(travel.stops)}
    return arrays | drawn(run.lens, figure, whole=True)


def run_words(run: Run) -> dict[str, object]:
    """Texts of the page: names, receivers, facts, verdicts, and the files that are of another lens."""
    return {
        "name": run.spec.name,
        "folder": run.folder.resolve().name,
        "receivers": [
            *(chart_head(section, light.width, light.height, lumens) for light, section, lumens in _lit_receivers(run)),
            *_travel(run),
        ],
        "facts": [[fact.label, fact.sentence, fact.state] for fact in required_facts(run)],
        "sentence": headline(run).sentence,
        "verdicts": _verdicts(run),
        "old": list(_files_of_lens_before(run)),
        "fates": [fate.name.lower().replace("_", " ") for fate in Fate],
    }


def _lit_receivers(run: Run) -> Iterator[tuple[ReceiverLight, ReceiverSection, float | None]]:
    """Light on each receiver, its section, and the lumens of a watt if known; nothing before the light is evaluated."""
    if "evaluate" in run.found:
        for light, section in zip(run.light.receivers, run.spec.in_first_state.all_receivers, strict=True):
            yield light, section, run.light.lumens_per_watt


def _travel(run: Run) -> Iterator[dict[str, object]]:
    """Chart of the light over the travel of the LED, with a caption for each stop; empty without a travel."""
    if (travel_and_unit := travel_of(run)) is not None:
        travel, unit = travel_and_unit
        chart = {"width": travel.width, "height": travel.height, "far": travel.far_field, "unit": unit.symbol}
        yield {"name": "travel of the LED", **chart, "stops": [stop_caption(group) for group in travel.groups(unit)]}


def _verdicts(run: Run) -> list[dict[str, object]]:
    """Verdicts that do not pass: each with its reasons, and what cures it."""
    failing = [verdict for verdict in headline(run).parts if verdict.shown != "pass"]
    return [
        {
            "name": verdict.name,
            "word": verdict.word,
            "reasons": verdict.sentences,
            "cure": cure_of(verdict.name, run),
        }
        for verdict in failing
    ]


def _files_of_lens_before(run: Run) -> Iterator[str]:
    """Names of the files to take whose stage has not run for this lens, and of a report without its hash."""
    for path in filter(Path.is_file, run.folder.iterdir()):
        stages = ("photometry",) if path.suffix in _PHOTOMETRIC else ("export", "check")
        if path.name == REPORT_FILE:
            is_old = not _names_lens(path, run)
        else:
            is_old = not all(stage in run.found for stage in stages)
        if is_old and path.suffix in DOWNLOADS - {".json"}:
            yield path.name


def _names_lens(page: Path, run: Run) -> bool:
    """True where a report states the hash of the lens; one that cannot be read is of no lens."""
    with suppress(InputError):
        return run.lens.sha256.encode() in read_file(page, missing="", most_bytes=_MOST_REPORT_BYTES)
    return False
