"""Places of a screen as it was printed: titles of blocks, and labelled lines with what follows them."""

import re

from shown_numbers import Place

_WIDTH = 80
_ROW = re.compile(r"  (?=\S)(.+?)(?: {2,}(\S.*))?$")


def places_of(screen):
    """Every text; its label is the title of its block up to a colon, and that of its line, repeated ones numbered."""
    lines = screen.splitlines()
    found, counted = [], {}
    for number, line in enumerate(lines):
        row = _ROW.match(line)
        if not line.startswith(" "):
            if number and _continues(lines[number - 1], line):
                found[-1] = Place(found[-1].label, f"{found[-1].text} {line}")
            else:
                block, counted = re.split(r"[:(]", line)[0].strip(), {}
                found.append(Place(block, line))
        elif row is None:  # goes on, or a line without a label
            if found[-1].label == block:
                found.append(Place(f"{block} / ", ""))
            found[-1] = Place(found[-1].label, f"{found[-1].text} {line.strip()}".strip())
        else:
            label, text = row.groups()
            counted[label] = counted.get(label, 0) + 1
            again = f" ({counted[label]})" if counted[label] > 1 and label != "Because" else ""
            found.append(Place(f"{block} / {label}{again}", text or ""))
    return found


def _continues(before, line):
    """True where ``line`` goes on with a title that was too long for one line; a sentence has ended."""
    return before[:1].strip() and not before.endswith(".") and len(before) + 1 + len(line.split(" ")[0]) > _WIDTH
