"""A self-contained HTML page of titled figures and tables, in the look of the run report."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from string import Template
from typing import Final

from plotly.graph_objects import Figure
from plotly.offline import get_plotlyjs

from hil.errors import RunError

PALETTE: Final = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9")
"""Okabe and Ito's colours, which colour-blind readers tell apart. [M]"""
FONT: Final = {"family": "Inter, system-ui, sans-serif", "size": 12, "color": "#334155"}

_PAGE: Final = Template("""<!doctype html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<title>$title</title>
<style>
html { overflow-y: scroll; } /* a scrollbar that came later would make figures too wide for their place */
body { color-scheme: light; margin: 0; background: #f1f5f9; color: #0f172a;
       font: 15px/1.5 Inter, system-ui, -apple-system, "Segoe UI", sans-serif; }
main { max-width: 1320px; margin: 0 auto; padding: 28px 24px 60px; }
h1 { font-size: 24px; margin: 0 0 2px; letter-spacing: -0.01em; }
h2 { font-size: 16px; margin: 0 0 10px; }
p.sub { margin: 0 0 18px; color: #64748b; }
p.note { margin: -6px 0 10px; color: #64748b; font-size: 13.5px; }
section { background: #fff; border: 1px solid #e2e8f0; border-radius: 10px;
          padding: 18px 20px; margin-bottom: 18px; overflow-x: auto; }
table { border-collapse: collapse; font-variant-numeric: tabular-nums; }
th { text-align: left; font-weight: 600; color: #475569; }
th, td { padding: 4px 28px 4px 0; }
td.n, th.n { text-align: right; }
tr + tr > * { border-top: 1px solid #f1f5f9; }
.warn { background: #fffbeb; border-color: #fcd34d; }
$style
</style>
<script>$plotly</script>
</head>
<body><main>
<h1>$title</h1>
<p class="sub">$subtitle</p>
$body
</main></body></html>
""")


def page(
    out_html: Path, title: str, subtitle: str, sections: Sequence[tuple[str, str, Figure | str]]
) -> Path:
    """Write figures (or HTML), each with a heading and a note; RunError where it cannot be written."""
    parts = [
        f"<section><h2>{head}</h2>{_noted(note)}{_html(body)}</section>"
        for head, note, body in sections
    ]
    return write_page(out_html, title, subtitle, "\n".join(parts))


def write_page(out_html: Path, title: str, subtitle: str, body: str, style: str = "") -> Path:
    """Write a page of `body` (HTML of sections), with a `style` of its own; RunError where that fails.

    About 5 MB of it is the plotting library: nothing is fetched when it is opened.
    """
    text = _PAGE.substitute(
        title=title, subtitle=subtitle, plotly=get_plotlyjs(), body=body, style=style
    )
    try:
        out_html.parent.mkdir(parents=True, exist_ok=True)
        out_html.write_text(text, encoding="utf-8")
    except OSError as error:
        raise RunError(f"{out_html}: cannot be written: {error.strerror}") from error
    return out_html


def _noted(note: str) -> str:
    return f'<p class="note">{note}</p>' if note else ""


def _html(body: Figure | str) -> str:
    return body if isinstance(body, str) else embedded(body)


def embedded(figure: Figure) -> str:
    """A figure as HTML for the body of a page, which has the plotting library."""
    config = {"responsive": True, "displaylogo": False, "scrollZoom": False}
    return str(figure.to_html(full_html=False, include_plotlyjs=False, config=config))


def table(heads: Sequence[str], rows: Sequence[Sequence[str]], numbers: Sequence[int] = ()) -> str:
    """Rows of HTML cells under their heads; `numbers`: columns that stand to the right."""

    def row(cells: Sequence[str], tag: str) -> str:
        return "".join(
            f'<{tag} class="n">{x}</{tag}>' if k in numbers else f"<{tag}>{x}</{tag}>"
            for k, x in enumerate(cells)
        )

    body = "".join(f"<tr>{row(r, 'td')}</tr>" for r in rows)
    return f"<table><tr>{row(heads, 'th')}</tr>{body}</table>"
