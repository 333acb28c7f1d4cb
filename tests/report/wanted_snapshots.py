"""Numbers below the snapshots of a search that the report must show, by their label, each from its snapshot."""

from shown_numbers import shown

_COURSE = "Search / Course of the search, level by level"


def title_of(snapshot):
    """Title of its pictures."""
    return f"Level {snapshot.level}: {snapshot.functions} functions"


def snapshot_numbers(taken):
    """Entries of the titles and captions."""
    for each in taken:
        label = f"{_COURSE} / {title_of(each)}"
        yield shown(f"{label} / title", "Level {}: {} functions", each.level, each.functions)
        words = "After step {}: NMSE {}, efficiency {}\u2009%."
        yield shown(f"{label} / figcaption", words, each.step, each.nmse, 100.0 * each.efficiency)
