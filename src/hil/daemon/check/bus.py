"""Whether the bus is there and set as the rig wants it: SocketCAN interface, hub or python-can."""

from __future__ import annotations

import json
import shutil
import socket
import subprocess
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from hil.bus.port import open_port
from hil.config import RigFile, bus_of
from hil.daemon.check.finding import Finding
from hil.daemon.service import QUEUE_FRAMES
from hil.errors import BusError

_IFF_UP: Final = 1
Link = dict[str, Any]
"""What `ip -details -json link show` says of an interface."""


@dataclass(frozen=True, slots=True)
class Wanted:
    """A SocketCAN interface as the rig wants it."""

    interface: str
    bitrate_bps: int
    drives: int
    """On its bus."""


def check_bus(rig: RigFile, root: Path) -> list[Finding]:
    """All about each bus of `rig`; interfaces are those below `root`/sys."""
    buses = [bus_of(url) for url in rig.can.urls]
    found = [_kernel()] if "socketcan" in (scheme for scheme, _ in buses) else []
    for k, (scheme, interface) in enumerate(buses):
        if scheme == "socketcan":
            drives = sum(a.drive.bus == k for a in rig.actuators)
            wanted = Wanted(interface, rig.can.bitrates[k], drives)
            found += check_interface(wanted, root, _ip_link)
        else:
            found.append(_opens(rig.can.urls[k], rig.can.bitrates[k]))
    return found


def check_interface(
    wanted: Wanted, root: Path, ask_ip: Callable[[str], Link | None]
) -> list[Finding]:
    """All about a SocketCAN interface; `ask_ip` is asked for what sysfs does not tell."""
    interface = wanted.interface
    folder = root / "sys/class/net" / interface
    if not folder.is_dir():
        virtual = f"ip link add {interface} type vcan"
        return [
            Finding(
                "fault",
                "bus",
                f"there is no interface {interface}",
                f"plug the adapter in and see `ip link` and `dmesg`; or make a virtual one: {virtual}",
            )
        ]
    link = ask_ip(interface) or {}
    details = link.get("linkinfo", {})
    data = details.get("info_data", {})
    found = [_up(wanted, folder), _queue(wanted, folder)]
    if details.get("info_kind") == "vcan":
        found.append(Finding("ok", "bit rate", f"{interface} is virtual: it has no bit rate"))
    elif data:
        found += [_bitrate(wanted, data), _restart(interface, data)]
        found += _controller(interface, data)
    else:
        text = f"the bit rate of {interface} cannot be read"
        found.append(Finding("warn", "bit rate", text, "install iproute2 (`ip -details link`)"))
    return found


def _kernel() -> Finding:
    try:
        socket.socket(socket.AF_CAN, socket.SOCK_RAW, socket.CAN_RAW).close()
    except OSError as error:
        return Finding(
            "fault", "bus", f"this kernel has no CAN sockets: {error.strerror}", "modprobe can-raw"
        )
    return Finding("ok", "bus", "the kernel has CAN sockets")


def _up(wanted: Wanted, folder: Path) -> Finding:
    interface = wanted.interface
    if int(_word(folder / "flags") or "0", 16) & _IFF_UP:
        return Finding("ok", "bus", f"{interface} is up")
    remedy = f"systemctl restart hil-can@{interface}, or {_bring_up(wanted)}"
    return Finding("fault", "bus", f"{interface} is down", remedy)


def _queue(wanted: Wanted, folder: Path) -> Finding:
    interface = wanted.interface
    length = int(_word(folder / "tx_queue_len") or "0")
    burst = 2 * wanted.drives + 1
    if length >= 4 * burst:
        return Finding("ok", "queue", f"the transmit queue of {interface} holds {length} frames")
    text = (
        f"the transmit queue of {interface} holds {length} frames, a late cycle sends {burst} at once: "
        "frames are refused (ENOBUFS)"
    )
    remedy = f"ip link set {interface} txqueuelen {QUEUE_FRAMES}"
    return Finding("fault" if length < burst else "warn", "queue", text, remedy)


def _bitrate(wanted: Wanted, data: Link) -> Finding:
    interface, wanted_kbps = wanted.interface, wanted.bitrate_bps / 1000
    bitrate = data.get("bittiming", {}).get("bitrate")
    if bitrate == wanted.bitrate_bps:
        return Finding("ok", "bit rate", f"{interface} runs at {wanted_kbps:g} kbit/s")
    is_now = "no bit rate" if bitrate is None else f"{bitrate / 1000:g} kbit/s"
    return Finding(
        "fault",
        "bit rate",
        f"{interface} has {is_now}, the rig file wants {wanted_kbps:g} kbit/s: nobody understands us",
        f"ip link set {interface} down; {_bring_up(wanted)}",
    )


def _restart(interface: str, data: Link) -> Finding:
    restart_ms = data.get("restart_ms", 0)
    if not restart_ms:
        return Finding("ok", "restart", f"{interface} stays off after bus-off until a person acts")
    return Finding(
        "warn",
        "restart",
        f"{interface} comes back {restart_ms} ms after bus-off by itself, with the fault still there",
        f"ip link set {interface} down; ip link set {interface} type can restart-ms 0; "
        f"ip link set {interface} up",
    )


def _controller(interface: str, data: Link) -> list[Finding]:
    found = []
    state = data.get("state", "")
    wiring = "check wiring, both 120 Ω terminations, and the bit rate of all nodes"
    if state in ("BUS-OFF", "ERROR-PASSIVE", "ERROR-WARNING"):
        level: Any = "fault" if state == "BUS-OFF" else "warn"
        text = f"the controller of {interface} is in state {state.lower()}: it sees errors"
        found.append(Finding(level, "controller", text, wiring))
    modes = [str(mode).lower() for mode in data.get("ctrlmode", ())]
    for mode in ("listen-only", "loopback"):
        if mode in modes:
            text = f"{interface} is in {mode} mode: drives do not hear it"
            remedy = f"ip link set {interface} down; ip link set {interface} type can {mode} off"
            found.append(Finding("fault", "controller", text, remedy))
    return found


def _opens(url: str, bitrate_bps: int) -> Finding:
    """Hubs and python-can interfaces are there if they open."""
    try:
        open_port(url, bitrate_bps=bitrate_bps, read_only=True).close()
    except BusError as error:
        text, _, remedy = str(error).partition("; ")
        return Finding("fault", "bus", text, remedy)
    return Finding("ok", "bus", f"{url} opens")


def _bring_up(wanted: Wanted) -> str:
    return f"ip link set {wanted.interface} up type can bitrate {wanted.bitrate_bps} restart-ms 0"


def _ip_link(interface: str) -> Link | None:
    if shutil.which("ip") is None:
        return None
    done = subprocess.run(
        ["ip", "-details", "-json", "link", "show", interface],
        capture_output=True,
        text=True,
        check=False,
    )
    links = json.loads(done.stdout) if done.returncode == 0 and done.stdout else []
    return links[0] if links else None


def _word(path: Path) -> str:
    return path.read_text().strip() if path.is_file() else ""
