"""One self-contained HTML page about a run: nothing is fetched, it opens anywhere and in ten years."""

from __future__ import annotations

from html import escape
from pathlib import Path
from typing import Final

from hil.runs import Run
from hil.signals import Event
from hil.ui.page import embedded, write_page
from hil.ui.report_data import RunView, view
from hil.ui.report_figures import SEVERITY_COLOURS, lateness_figure, time_figure
from hil.ui.report_summary import summary

MOST_EVENTS: Final = 500
"""Lines of the table of events."""

_STYLE: Final = """table { width: 100%; }
th { vertical-align: top; white-space: nowrap; width: 1%; padding: 4px 22px 4px 0; }
td { vertical-align: top; padding: 4px 0; }
.events td { padding-right: 18px; white-space: nowrap; }
.events td:last-child { width: 99%; white-space: normal; }
.mark { display: inline-block; width: 9px; height: 9px; border-radius: 2px; margin-right: 8px; }
details summary { cursor: pointer; font-weight: 600; }
pre { overflow: auto; max-height: 480px; font-size: 12.5px; }"""


def run_report(run: Run, out_html: Path) -> Path:
    """Write the page about `run` to `out_html` and return that.

    RunError where it cannot be written. Curves are thinned so that even long runs add less than the
    plotting library does.
    """
    shown = view(run)
    lines = "".join(_line(label, text) for label, text in summary(shown))
    body = (
        f"{_damage(run)}<section><h2>Summary</h2><table>{lines}</table></section>"
        f"<section><h2>Over time</h2>{embedded(time_figure(shown))}</section>"
        f"{_timing(shown)}{_events(run.events)}"
    )
    title = escape(f"{run.meta.rig}: {run.path.stem}")
    return write_page(out_html, title, escape(_subtitle(run)), body, _STYLE)


def _subtitle(run: Run) -> str:
    made = run.meta.recording
    by = f"recorded by hil {made.hil} on {made.host}" if made and made.hil else "imported"
    return " · ".join(filter(None, (run.meta.note, by, run.meta.role)))


def _damage(run: Run) -> str:
    if run.damage is None:
        return ""
    return f'<section class="warn"><b>This recording is damaged.</b> {escape(run.damage)}</section>'


def _line(label: str, text: str) -> str:
    return f"<tr><th>{escape(label)}</th><td>{escape(text)}</td></tr>"


def _timing(shown: RunView) -> str:
    if not len(shown.lateness_us):
        return ""
    return f"<section><h2>Timing</h2>{embedded(lateness_figure(shown.lateness_us))}</section>"


def _events(events: tuple[Event, ...]) -> str:
    if not events:
        return ""
    rows = "".join(
        f"<tr><td>{e.t_s:.3f}&nbsp;s</td>"
        f'<td><span class="mark" style="background:{SEVERITY_COLOURS[e.severity]}"></span>'
        f"{e.severity}</td><td><code>{escape(e.name)}</code></td><td>{escape(e.text)}</td></tr>"
        for e in events[:MOST_EVENTS]
    )
    more = len(events) - MOST_EVENTS
    rest = f"<p>and {more} more in events.jsonl</p>" if more > 0 else ""
    table = f'<table class="events">{rows}</table>'
    return f"<section><h2>Events</h2>{table}{rest}</section>"
