"""The live view of a rig in a terminal: state, pose, tracking error, slot use, lateness, bus load."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence

from rich.console import Group, RenderableType
from rich.panel import Panel
from rich.table import Table
from rich.text import Text

from hil.config import RigFile
from hil.messages import EventMessage, StateMessage

COLOURS = {
    "offline": "dim",
    "preparing": "yellow",
    "parked": "cyan",
    "ready": "cyan",
    "engaged": "green",
    "parking": "yellow",
    "fault": "bold red",
    "emergency": "bold white on red",
}
SPARKS = " ▁▂▃▄▅▆▇█"
HISTORY = 40


class LiveView:
    """Fed with states and events, gives what to draw. Holds no terminal and no clock."""

    def __init__(self, rig: RigFile) -> None:
        self._rig = rig.name
        self._limits = dict(zip(rig.coordinates, rig.limits, strict=True))
        self._units = {c: "rad" if rig.rotates(c) else "m" for c in rig.coordinates}
        self._length, self._force = ("rad", "N·m") if rig.is_rotary else ("m", "N")
        self._state: StateMessage | None = None
        self._errors: deque[float] = deque(maxlen=HISTORY)
        self._lateness: deque[float] = deque(maxlen=HISTORY)
        self._events: deque[EventMessage] = deque(maxlen=5)

    def add_state(self, state: StateMessage) -> None:
        """Take in the newest state."""
        self._state = state
        self._errors.append(state.tracking_error)
        self._lateness.append(state.lateness_s)

    def add_event(self, event: EventMessage) -> None:
        """Take in an event; the last few are shown."""
        self._events.append(event)

    def render(self, progress: str = "") -> RenderableType:
        """What to draw now; `progress` is a line of the caller's."""
        state = self._state
        if state is None:
            return Panel(f"waiting for hil/{self._rig}/state", title=self._rig)
        head = Text(f" {state.state} ", style=f"reverse {COLOURS.get(state.state, '')}")
        head.append(f"  {progress}" if progress else "", style="not reverse")
        if state.fault:
            head.append(f"  {state.fault}", style="not reverse bold red")
        parts: list[RenderableType] = [head, self._poses(state), self._actuators(state)]
        parts.append(self._loop(state))
        parts += [
            Text(f"{e.t:9.2f} s  {e.name}: {e.text}", style=_severity(e), no_wrap=True)
            for e in self._events
        ]
        return Panel(Group(*parts), title=f"{self._rig}  t = {state.t:.2f} s", padding=(0, 1))

    def line(self) -> str:
        """The newest state in one line, for where no terminal is."""
        state = self._state
        if state is None:
            return "no state yet"
        pose = ", ".join(f"{n} {v:+.3f} {self._units.get(n, '')}" for n, v in state.pose.items())
        return (
            f"{state.state}, {pose}, error {state.tracking_error * 1e3:.2f} m{self._length}, "
            f"slots {state.slot_use:.1%}, late {state.lateness_s * 1e6:.0f} µs, "
            f"bus {state.bus_load:.0%}"
        )

    def _poses(self, state: StateMessage) -> Table:
        table = Table("", "asked for", "measured", "", box=None, padding=(0, 2), header_style="dim")
        for name, limit in self._limits.items():
            asked, measured = state.setpoint.get(name), state.pose.get(name)
            label = f"{name}, {self._units[name]}"
            table.add_row(label, _value(asked), _value(measured), _bar(measured, limit))
        return table

    def _actuators(self, state: StateMessage) -> Table:
        table = Table(
            "", f"position, {self._length}", f"velocity, {self._length}/s", f"force, {self._force}", "age",
            box=None, padding=(0, 2), header_style="dim",
        )  # fmt: skip
        for name, actuator in state.actuators.items():
            age = "–" if actuator.age_s is None else f"{actuator.age_s * 1e3:.0f} ms"
            force = "–" if actuator.force is None else f"{actuator.force:+8.1f}"
            table.add_row(name, _value(actuator.position), _value(actuator.velocity), force, age)
        return table

    def _loop(self, state: StateMessage) -> Table:
        table = Table(box=None, show_header=False, padding=(0, 2))
        table.add_row(
            "tracking error",
            f"{state.tracking_error * 1e3:7.2f} m{self._length}",
            _spark(self._errors),
        )
        table.add_row("lateness", f"{state.lateness_s * 1e6:7.0f} µs", _spark(self._lateness))
        table.add_row(
            "slots used",
            f"{state.slot_use:7.2%}",
            f"bus load {state.bus_load:.0%}, "
            f"{state.overruns} overrun{'' if state.overruns == 1 else 's'}",
        )
        return table


def _value(value: float | None) -> str:
    return "–" if value is None else f"{value:+8.4f}"


def _bar(value: float | None, limit: float, width: int = 31) -> str:
    """A mark between the workspace's ends."""
    cells = ["·"] * width
    cells[width // 2] = "│"
    if value is not None:
        place = round((value / limit + 1.0) / 2.0 * (width - 1))
        cells[min(max(place, 0), width - 1)] = "●"
    return "".join(cells)


def _spark(values: Sequence[float]) -> str:
    top = max(values, default=0.0)
    if top <= 0.0:
        return SPARKS[0] * len(values)
    return "".join(SPARKS[min(8, int(max(v, 0.0) / top * 8.0 + 0.5))] for v in values)


def _severity(event: EventMessage) -> str:
    return {"fault": "red", "warning": "yellow"}.get(event.severity, "dim")
