"""One self-contained HTML page about a run: nothing is fetched, it opens anywhere and in ten years."""

from __future__ import annotations

from html import escape
from pathlib import Path
from string import Template
from typing import Final

from plotly.graph_objects import Figure
from plotly.offline import get_plotlyjs

from hil.errors import RunError
from hil.runs import Run
from hil.signals import Event
from hil.ui.report_data import RunView, view
from hil.ui.report_figures import SEVERITY_COLOURS, lateness_figure, time_figure
from hil.ui.report_summary import summary

MOST_EVENTS: Final = 500
"""Lines of the table of events."""

_PAGE: Final = Template("""<!doctype html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<title>$title</title>
<style>
:root { color-scheme: light; }
body { margin: 0; background: #f1f5f9; color: #0f172a;
       font: 15px/1.5 Inter, system-ui, -apple-system, "Segoe UI", sans-serif; }
main { max-width: 1320px; margin: 0 auto; padding: 28px 24px 60px; }
h1 { font-size: 24px; margin: 0 0 2px; letter-spacing: -0.01em; }
h2 { font-size: 16px; margin: 0 0 10px; }
p.sub { margin: 0 0 18px; color: #64748b; }
section { background: #fff; border: 1px solid #e2e8f0; border-radius: 10px;
          padding: 18px 20px; margin-bottom: 18px; }
table { border-collapse: collapse; width: 100%; }
th { text-align: left; vertical-align: top; white-space: nowrap; width: 1%; font-weight: 600;
     color: #475569; padding: 4px 22px 4px 0; }
td { vertical-align: top; padding: 4px 0; font-variant-numeric: tabular-nums; }
tr + tr > * { border-top: 1px solid #f1f5f9; }
.warn { background: #fffbeb; border-color: #fcd34d; }
.events td { padding-right: 18px; white-space: nowrap; }
.events td:last-child { width: 99%; white-space: normal; }
.mark { display: inline-block; width: 9px; height: 9px; border-radius: 2px; margin-right: 8px; }
details summary { cursor: pointer; font-weight: 600; }
pre { overflow: auto; max-height: 480px; font-size: 12.5px; }
</style>
<script>$plotly</script>
</head>
<body><main>
<h1>$title</h1>
<p class="sub">$subtitle</p>
$damage
<section><h2>Summary</h2><table>$summary</table></section>
<section><h2>Over time</h2>$time</section>
$timing
$events
</main></body></html>
""")


def run_report(run: Run, out_html: Path) -> Path:
    """Write the page about `run` to `out_html` and return that.

    RunError where it cannot be written. About 5 MB of it is the plotting library; curves are
    thinned so that even long runs add less than that again.
    """
    shown = view(run)
    page = _PAGE.substitute(
        title=escape(f"{run.meta.rig}: {run.path.stem}"),
        subtitle=escape(_subtitle(run)),
        plotly=get_plotlyjs(),
        damage=_damage(run),
        summary="".join(_line(label, text) for label, text in summary(shown)),
        time=_embed(time_figure(shown)),
        timing=_timing(shown),
        events=_events(run.events),
    )
    try:
        out_html.write_text(page, encoding="utf-8")
    except OSError as error:
        raise RunError(f"{out_html}: cannot be written: {error.strerror}") from error
    return out_html


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
    return f"<section><h2>Timing</h2>{_embed(lateness_figure(shown.lateness_us))}</section>"


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


def _embed(figure: Figure) -> str:
    config = {"responsive": True, "displaylogo": False, "scrollZoom": False}
    return str(figure.to_html(full_html=False, include_plotlyjs=False, config=config))
