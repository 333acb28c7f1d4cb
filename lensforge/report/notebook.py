"""A result folder as a notebook shows it: verdict, headline numbers, the light and a section."""

from html import escape
from pathlib import Path

from lensforge.lens import Lens
from lensforge.report import headline
from lensforge.report.cards import cards
from lensforge.report.pictures import first_picture, section_pictures
from lensforge.report.results import Results, load_results

_MARKS = {"pass": "✓", "fail": "✗", "open": "see shop", "": ""}


class ResultFolder:
    """What the stages left in ``directory``. Raises :class:`InputError` as the report does.

    ``results`` holds every stage's record and arrays; ``lens`` the lens. As the last value of a notebook's cell it
    shows itself.
    """

    def __init__(self, directory: Path | str) -> None:
        self.results: Results = load_results(Path(directory))

    @property
    def lens(self) -> Lens:
        """The designed lens."""
        return self.results.lens

    def __repr__(self) -> str:
        return f"ResultFolder({str(self.results.directory)!r}): {headline.verdict(self.results).sentence}"

    def _repr_html_(self) -> str:
        rows = "".join(
            f"<tr><th>{escape(card.label)}</th><td>{escape(f'{card.value} {card.unit}'.strip())}</td>"
            f"<td>{_MARKS[card.state]}</td><td>{escape(card.note)}</td></tr>"
            for card in cards(self.results)
        )
        first = first_picture(self.results)
        shown = [*([first] if first else []), section_pictures(self.results)[0]]
        pictures = "".join(f'<div style="max-width:30em">{picture.svg}</div>' for picture in shown)
        return (
            f"<div><strong>{escape(self.lens.spec.name)}</strong>: {escape(headline.verdict(self.results).sentence)}"
            f'<div style="display:flex;flex-wrap:wrap;gap:1em">{pictures}</div><table>{rows}</table></div>'
        )
