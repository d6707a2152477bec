"""What a reproduction is made of: sections with the paper on one side and ours on the other, as a page."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from html import escape
from pathlib import Path
from typing import Final

from plotly.graph_objects import Figure

from hil.ui.page import embedded, page
from hil.ui.reproduce.prose import Prose


@dataclass(frozen=True, slots=True)
class Lengths:
    """How much is played, s and counts; long enough for the intervals to mean something, or just so."""

    chirp_s: float
    """Each of the motorcycle platform's chirps."""
    circle_s: float
    circle_fade_s: float
    sweep_s: float
    multisine_s: float
    """One period of the describing function's signals."""
    periods: int
    """To measure, of each of the two signals."""
    heave_cycles: int
    grid: int
    """Points of each axis of the grid over mass and controller gain."""


FULL: Final = Lengths(30.0, 40.0, 10.0, 30.0, 10.0, 4, 8, 9)
FAST: Final = Lengths(8.0, 12.0, 4.0, 8.0, 5.0, 2, 3, 5)


@dataclass(frozen=True, slots=True)
class Table:
    """Rows of text under a head; columns after the first are aligned right."""

    head: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]

    def html(self) -> str:
        """The table as HTML."""
        lines = [_row("th", self.head), *(_row("td", row) for row in self.rows)]
        return f'<table class="numbers">{"".join(lines)}</table>'


@dataclass(frozen=True, slots=True)
class Section:
    """One figure or table of the paper and what came of it here."""

    words: Prose
    pictures: tuple[Figure | str, ...]
    table: Table | None
    facts: Mapping[str, float] = field(default_factory=dict)
    """The numbers that matter, by name, SI."""


@dataclass(frozen=True, slots=True)
class Report:
    """A finished reproduction."""

    path: Path
    sections: tuple[Section, ...]

    @property
    def facts(self) -> dict[str, float]:
        """All sections' numbers."""
        return {name: float(value) for s in self.sections for name, value in s.facts.items()}


_STYLE: Final = """<style>
.sides { display: grid; grid-template-columns: 1fr 1fr; gap: 18px; margin-bottom: 10px; }
.sides > div { background: #f8fafc; border-left: 3px solid #94a3b8; padding: 8px 14px; }
.sides > div.ours { border-color: #2563eb; }
.sides b, .reading b { display: block; color: #475569; font-size: 12px; text-transform: uppercase;
  letter-spacing: 0.04em; margin-bottom: 2px; }
.sides p, .reading p { margin: 0 0 6px; }
table.numbers { margin: 10px 0 14px; }
table.numbers th { white-space: normal; vertical-align: bottom; }
table.numbers td { white-space: nowrap; }
table.numbers td + td, table.numbers th + th { text-align: right; }
.reading { max-width: 1000px; }
.mark { font-family: ui-monospace, monospace; font-size: 12.5px; color: #64748b; }
@media (max-width: 900px) { .sides { grid-template-columns: 1fr; } }
</style>"""


def write_report(
    out_html: Path, title: str, subtitle: str, opening: str, sections: Sequence[Section]
) -> Report:
    """Write the page; `opening` (HTML) stands before the sections. RunError where it cannot be written."""
    parts: list[tuple[str, str, Figure | str]] = [("How to read this", "", _STYLE + opening)]
    parts += [(escape(s.words.title), "", _html(s)) for s in sections]
    page(out_html, escape(title), escape(subtitle), parts)
    return Report(out_html, tuple(sections))


def _html(section: Section) -> str:
    pictures = "".join(p if isinstance(p, str) else embedded(p) for p in section.pictures)
    return (
        f'<div class="sides"><div><b>What the paper shows</b>{section.words.paper}</div>'
        f'<div class="ours"><b>What was done here</b>{section.words.ours}</div></div>{pictures}'
        f"{section.table.html() if section.table else ''}"
        f'<div class="reading"><b>What it says</b>{section.words.reading}</div>'
    )


def _row(tag: str, cells: Sequence[str]) -> str:
    return "<tr>" + "".join(f"<{tag}>{escape(c)}</{tag}>" for c in cells) + "</tr>"
