"""Table of the receivers of a lens, where there are several: the metrics of the light on each."""

from dataclasses import dataclass

from lensforge.records import Metric
from lensforge.report.numerals import number_with_error, percent
from lensforge.report.shown_receivers import shown_receivers
from lensforge.results import Results


@dataclass(frozen=True)
class ReceiverRow:
    """One receiver: its name and place, and its metrics with their standard errors."""

    name: str
    place: str
    nmse: str
    efficiency: str
    in_target: str
    uniformity: str


def receiver_rows(results: Results) -> list[ReceiverRow]:
    """A row for each receiver; none where there is only one, whose metrics are on the cards."""
    shown = shown_receivers(results)
    if len(shown) < 2:
        return []
    return [
        ReceiverRow(
            name=each.light.name,
            place=each.light.place,
            nmse=number_with_error(each.light.nmse, 3),
            efficiency=share_with_error(each.light.efficiency),
            in_target=share_with_error(each.light.share_in_target),
            uniformity=number_with_error(each.light.uniformity, 3),
        )
        for each in shown
    ]


def share_with_error(metric: Metric) -> str:
    """A share in per cent and, where it is known and not 0, its standard error."""
    error = f" ± {percent(metric.standard_error, 3)}" if metric.standard_error else ""
    return f"{percent(metric.value)}{error}"
