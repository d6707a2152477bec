"""One self-contained page on where a rig and its twin differ: sentence, map, curves, method."""

from __future__ import annotations

from html import escape
from pathlib import Path
from string import Template
from typing import Final

from hil.gap import Located
from hil.ui.calibration_table import ALONE, calibration_table
from hil.ui.gap_figures import map_figure, signal_figure, state_figure, time_figure
from hil.ui.page import embedded, write_page

STRONGEST: Final = 3
"""Signals shown band by region."""

_STYLE: Final = """p.verdict { font-size: 19px; line-height: 1.4; margin: 0; }
h2 { margin: 0 0 6px; }
p.how { margin: 0 0 10px; color: #475569; max-width: 900px; }
table { width: 100%; }
th, td { padding: 4px 16px 4px 0; }
.n { text-align: right; }
.gap { border-left: 5px solid #dc2626; } .none { border-left: 5px solid #16a34a; }
li.error { color: #b91c1c; } li.warning { color: #92400e; }"""
_BODY: Final = Template("""<section class="$kind"><p class="verdict">$sentence</p></section>
$findings
$where
<section><h2>Gap map</h2><p class="how">How many times its noise floor the residual is, after calibration, in
each frequency band and in each region of operation. 1 is noise alone. Written in: share of the whole
explainable gap.</p>$map</section>
<section><h2>Signals</h2>$signals</section>
<section><h2>Residual over time</h2><p class="how">Measured minus twin. Grey: twice the floor, which grows
where timing on the bus matters. Blank: not judged, as forces at rest.</p>$time</section>
$state
<section><h2>Calibration that was taken out first</h2><p class="how">$calibration</p>$nuisances</section>
<section><h2>How it was computed</h2><p class="how">Floor: $floor.</p><p class="how">Shares: squares
of the residual over the squared floor of its signal, less what the floor itself has in the same
band and region, over all bands that stand clear of chance. Intervals (90 %): blocks of time of a
second drawn again, all signals together. Bands: cosine transform, so that they add up. Regions:
from the twin's own motion.</p></section>""")


def gap_page(found: Located, out_html: Path) -> Path:
    """Write the page about `found` to `out_html` and return that. RunError where it cannot be written."""
    body = _BODY.substitute(
        kind="gap" if found.is_gap else "none",
        sentence=escape(found.sentence),
        findings=_findings(found),
        where=_where(found),
        map=embedded(map_figure(found)) + _details(found),
        signals=_signals(found),
        time=embedded(time_figure(found)),
        state=_state(found),
        calibration=ALONE,
        nuisances=calibration_table(found.nuisances),
        floor=escape(found.floor_text),
    )
    title = escape(f"{found.rig}: rig against twin")
    return write_page(out_html, title, escape(" · ".join(found.runs)), body, _STYLE)


def _findings(found: Located) -> str:
    if not found.findings:
        return ""
    items = "".join(
        f'<li class="{f.severity}"><b>{escape(f.subject)}</b>: {escape(f.text)}</li>'
        for f in found.findings
    )
    return f'<section class="warn"><h2>About the data</h2><ul>{items}</ul></section>'


def _where(found: Located) -> str:
    if not found.where:
        return ""
    rows = "".join(
        f"<tr><td>{escape(p.signal)}</td><td>{p.band_hz[0]:g} … {p.band_hz[1]:.3g} Hz</td>"
        f"<td>{escape(p.region.replace('_', ' '))}</td>"
        f'<td class="n">{100 * p.share:.0f} %</td>'
        f'<td class="n">{100 * p.share_ci[0]:.0f} … {100 * p.share_ci[1]:.0f} %</td>'
        f'<td class="n">{100 * p.time_share:.0f} %</td>'
        f'<td class="n">{p.rms / p.noise_floor:.1f}</td></tr>'
        for p in found.where
    )
    head = (
        "<tr><th>signal</th><th>band</th><th>region</th><th class='n'>share of gap</th>"
        "<th class='n'>90 %</th><th class='n'>of the time</th><th class='n'>times the floor</th></tr>"
    )
    return f"<section><h2>Where the gap stands</h2><table>{head}{rows}</table></section>"


def _signals(found: Located) -> str:
    rows = "".join(
        f"<tr><td>{escape(s.signal)}</td>"
        f'<td class="n">{s.before:.3g} {escape(s.unit)}</td>'
        f'<td class="n">{s.before_ci[0]:.3g} … {s.before_ci[1]:.3g} {escape(s.unit)}</td>'
        f'<td class="n">{s.noise_floor:.3g} {escape(s.unit)}</td><td class="n">{s.ratio:.2f}</td></tr>'
        for s in found.signals
    )
    head = (
        "<tr><th>signal</th><th class='n'>twin off by (rms)</th><th class='n'>90 %</th>"
        "<th class='n'>floor</th><th class='n'>times</th></tr>"
    )
    return f"<table>{head}{rows}</table>"


def _details(found: Located) -> str:
    strongest = sorted(found.signals, key=lambda s: -s.share)[:STRONGEST]
    return "".join(embedded(signal_figure(found, s.signal)) for s in strongest if s.share > 0.02)


def _state(found: Located) -> str:
    figure = state_figure(found)
    if figure is None:
        return ""
    return (
        '<section><h2>Residual over velocity and position</h2><p class="how">One row an actuator. The line '
        "is the median: a step at zero velocity is Coulomb friction, a slope viscous friction, a wave over "
        f"position ripple or lead error.</p>{embedded(figure)}</section>"
    )
