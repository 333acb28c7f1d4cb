"""Results in a notebook: verdicts, headline numbers, the light and a section."""

from html import escape

from lensforge.report.cards import cards
from lensforge.report.headline import headline
from lensforge.report.light_pictures import first_picture
from lensforge.report.pictures import section_pictures
from lensforge.runs.results import Results

_MARKS = {"pass": "✓", "fail": "✗", "open": "ask the shop", "": ""}


def results_html(results: Results) -> str:
    """``results`` as HTML for the output of a notebook's cell."""
    top, first = headline(results), first_picture(results)
    rows = "".join(
        f"<tr><th>{escape(card.label)}</th><td>{escape(f'{card.value} {card.unit}'.strip())}</td>"
        f"<td>{_MARKS[card.state]}</td><td>{escape(card.note)}</td></tr>"
        for card in cards(results)
    )
    states = ", ".join(f"{part.name.lower()}: {part.word}" for part in top.parts)
    reasons = "".join(f"<li>{part.name}: {escape(reason)}</li>" for part in top.parts for reason in part.reasons)
    shown = [*([first] if first else []), section_pictures(results)[0]]
    pictures = "".join(f'<div style="max-width:30em">{picture.svg}</div>' for picture in shown)
    return (
        f"<div><strong>{escape(results.spec.name)}</strong>: {states}. {escape(top.sentence)}<ul>{reasons}</ul>"
        f'<div style="display:flex;flex-wrap:wrap;gap:1em">{pictures}</div><table>{rows}</table></div>'
    )
