"""The Stewart platform's figure 4: the block diagram of our model, drawn."""

from __future__ import annotations

from html import escape
from typing import Final

from hil.config import RigFile
from hil.ui.reproduce import stewart_prose as prose
from hil.ui.reproduce.report import Section

INK, OWN, PAPER = "#334155", "#2563eb", "#f8fafc"
_HEAD: Final = """<svg viewBox="0 0 1240 330" role="img" aria-label="block diagram of the model"
style="width:100%;max-width:1240px;font:13px Inter,system-ui,sans-serif">
<defs><marker id="tip" viewBox="0 0 8 8" refX="7" refY="4" markerWidth="8" markerHeight="8" orient="auto">
<path d="M0 0 8 4 0 8z" fill="#334155"/></marker></defs>"""


def diagram_section(rig: RigFile) -> Section:
    """Figure 4."""
    leg = rig.actuators[0]
    words = prose.DIAGRAM.filled(lag=1e3 * leg.speed_gain / leg.position_gain)
    return Section(words, (_svg(rig),), None)


def _svg(rig: RigFile) -> str:
    leg, mass = rig.actuators[0], rig.mass
    own = rig.control.platform_filter
    assert own is not None
    parts = [
        _box(20, 90, 120, ("cue shaping",), is_own=True),
        _box(170, 90, 140, ("platform filter H", f"{own.frequency:g} Hz, {1e3 * own.delay:g} ms")),
        _box(340, 90, 120, ("inverse", "kinematics")),
        _box(490, 90, 110, ("CAN, retimed", f"{1e3 * rig.bus.cycle:g} ms"), is_own=True),
        _sum(640, 120),
        _box(680, 90, 150, ("K_p e + K_d de/dt", f"{leg.position_gain / 1e3:g} kN/m,",
                            f"{leg.speed_gain / 1e3:g} kN s/m")),
        _sum(870, 120),
        _box(910, 90, 150, ("legs", f"rotors {leg.reflected_mass:g} kg,", "friction, hysteresis"),
             is_own=True),
        _box(1090, 90, 130, ("cabin dynamics", f"m_c {mass.m:g} kg, I_c,", "CoG, J(x)")),
        _box(910, 230, 150, ("forward", "kinematics")),
        _box(680, 230, 150, (f"K_s = {leg.static_ff:g}", "F_static(x) = J⁻ᵀ G")),
        _box(490, 230, 110, ("encoders", f"{1e6 * rig.noise.position:g} µm"), is_own=True),
        _line("M140 120H170"), _line("M310 120H340"), _line("M460 120H490"),
        _line("M600 120H628"), _line("M652 120H680"), _line("M830 120H858"), _line("M882 120H910"),
        _line("M1060 120H1090"), _line("M1155 150V260H1060"), _line("M910 260H830"),
        _line("M755 230V200H870V132"), _line("M1155 290V312H545V290", is_tipped=True),
        _line("M545 230V190H640V132"),
        '<path d="M1155 260V290" stroke="#334155" fill="none" stroke-width="1.4"/>',
        _word(606, 108, "q_ref"), _word(655, 108, "e"), _word(840, 108, "F"), _word(1162, 180, "q, x"),
        _word(622, 148, "−"), _word(852, 148, "+"), _word(600, 184, "measured q"),
    ]  # fmt: skip
    return _HEAD + "".join(parts) + "</svg>"


def _box(x: int, y: int, width: int, lines: tuple[str, ...], *, is_own: bool = False) -> str:
    colour = OWN if is_own else INK
    first = y + 35 - 8 * (len(lines) - 1)
    texts = "".join(
        f'<text x="{x + width // 2}" y="{first + 16 * k}" text-anchor="middle" fill="{colour}">'
        f"{escape(line)}</text>"
        for k, line in enumerate(lines)
    )
    return (
        f'<rect x="{x}" y="{y}" width="{width}" height="60" rx="6" fill="{PAPER}" '
        f'stroke="{colour}" stroke-width="1.4"/>{texts}'
    )


def _sum(x: int, y: int) -> str:
    return f'<circle cx="{x}" cy="{y}" r="12" fill="#fff" stroke="{INK}" stroke-width="1.4"/>'


def _line(path: str, *, is_tipped: bool = True) -> str:
    tip = ' marker-end="url(#tip)"' if is_tipped else ""
    return f'<path d="{path}" stroke="{INK}" fill="none" stroke-width="1.4"{tip}/>'


def _word(x: int, y: int, text: str) -> str:
    return f'<text x="{x}" y="{y}" fill="{INK}" font-style="italic">{escape(text)}</text>'
