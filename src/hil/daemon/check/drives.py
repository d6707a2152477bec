"""Whether the drives are there: by listening, by asking one parameter, or by preparing them as for arming."""

from __future__ import annotations

import contextlib
import select
import time
from collections.abc import Sequence

from hil.bus.port import BusPort, open_port
from hil.config import RigFile
from hil.daemon.check import canopen
from hil.daemon.check.finding import Finding, Probe
from hil.daemon.core import RigCore
from hil.daemon.lock import RigLock
from hil.drives import DrivePhase, build_drivers
from hil.drives.build import parts_of
from hil.drives.lust_cdd3000.bus import LustBus
from hil.drives.lust_cdd3000.codec import (
    FrameIds,
    Mode,
    Request,
    encode_request,
    encode_system,
    frame_ids,
)
from hil.drives.profile import GROUP, LustProfile
from hil.drives.profiles import Profiles
from hil.errors import BusBusy, HilError, RigInUse
from hil.frames import Frame
from hil.safety import Gate, gate_limits

ANSWER_S = 0.3
"""A drive that is asked gets so long to answer."""
PREPARE_S = 15.0
"""Drives get so long from log-on to ready."""
SETTLED = (DrivePhase.READY, DrivePhase.FAULT)


def check_drives(rig: RigFile, profiles: Profiles, probe: Probe) -> list[Finding]:
    """All about the drives, as far as `probe` goes. With another daemon on the bus it only listens."""
    is_silent = not (probe.asks or probe.prepares)
    try:
        with contextlib.ExitStack() as stack:
            if not is_silent:
                stack.enter_context(RigLock(rig.name, *rig.can.urls))
            ports = []
            for url, bitrate in zip(rig.can.urls, rig.can.bitrates, strict=True):
                ports.append(open_port(url, bitrate_bps=bitrate, read_only=is_silent))
                stack.callback(ports[-1].close)
            if probe.prepares:
                return _prepare(rig, profiles, ports)
            found = []
            for bus, _, part in parts_of(rig, profiles):
                found += _look(part, profiles, ports[bus], None if probe.asks else probe.listen_s)
            return found
    except RigInUse as error:
        return [Finding("fault", "drives", f"not asked: {error}", "stop the daemon first")]
    except HilError as error:
        return [Finding("fault", "drives", str(error), "see the findings about the bus")]


def _look(rig: RigFile, profiles: Profiles, port: BusPort, listen_s: float | None) -> list[Finding]:
    """Listen to the drives of one family on one bus for so long, or ask them (None)."""
    profile = profiles[rig.actuators[0].drive.profile]
    if isinstance(profile, LustProfile):
        ids = [frame_ids(profile.ids, rig.address(i)) for i in range(len(rig.actuators))]
        if listen_s is None:
            return _ask(rig, profile, ids, port)
        return _listen(rig, profile, ids, port, listen_s)
    if listen_s is None:
        return canopen.ask(rig, profiles, port, _heard, ANSWER_S)
    return canopen.heard_of(rig, {frame.can_id for frame in _heard(port, listen_s)})


def _listen(
    rig: RigFile, profile: LustProfile, ids: list[FrameIds], port: BusPort, listen_s: float
) -> list[Finding]:
    seen = {frame.can_id for frame in _heard(port, listen_s)}
    found = _strides(rig, profile, seen)
    for name, drive in zip(rig.actuator_names, ids, strict=True):
        if drive.log_on in seen:
            found.append(Finding("ok", "drives", f"{name} logs on and waits for its master"))
        elif drive.status in seen or drive.answer in seen:
            found.append(Finding("ok", "drives", f"{name} is in operation under a master"))
        elif not found or found[0].level != "fault":
            found.append(
                Finding(
                    "warn",
                    "drives",
                    f"{name} says nothing",
                    "is it powered, on this bus and set to its address? A drive that had a master keeps "
                    "quiet until it is asked: try --ask",
                )
            )
    if rig.imu is not None:
        found.append(_imu(rig, seen))
    return found


def _strides(rig: RigFile, profile: LustProfile, seen: set[int]) -> list[Finding]:
    """Drives that log on at identifiers of the other stride, or of no actuator."""
    base, stride = profile.ids.log_on, profile.ids.stride
    addresses = [rig.address(i) for i in range(len(rig.actuators))]
    ours = {base + stride * a for a in addresses}
    other = {base + (3 - stride) * a for a in addresses} - ours
    strangers = {i for i in seen if base <= i < base + GROUP} - ours
    found = []
    if strangers & other:
        shown = ", ".join(f"{i:#x}" for i in sorted(strangers & other))
        text = (
            f"drives log on as {shown}: that is stride {3 - stride}, the drive file says {stride}"
        )
        remedy = f"set ids.stride = {3 - stride} in the drive file, or correct the addresses"
        found.append(Finding("fault", "drives", text, remedy))
    for i in sorted(strangers - other):
        text = f"a drive logs on as {i:#x}, address {(i - base) // stride}, which no actuator has"
        found.append(Finding("warn", "drives", text, "correct actuators.drive.address"))
    return found


def _imu(rig: RigFile, seen: set[int]) -> Finding:
    base = rig.can.imu_base_id
    if {base, base + 1} <= seen:
        return Finding("ok", "imu", "the IMU speaks")
    remedy = f"is it powered, and does it send {base:#x} and {base + 1:#x} (can.imu_base_id)?"
    return Finding("warn", "imu", "the IMU says nothing, or only half of it", remedy)


def _ask(rig: RigFile, profile: LustProfile, ids: list[FrameIds], port: BusPort) -> list[Finding]:
    """Read each drive's position once, through the gate as everything that leaves."""
    drives = LustBus(rig, profile)
    gate = Gate(gate_limits(rig, drives[0].setpoint_kind), drives.meaning)
    number = profile.parameters.measurements.position.number
    found = []
    for name, drive in zip(rig.actuator_names, ids, strict=True):
        request = encode_request(drive.request, Request(number, Mode.READ))
        verdict = gate.pass_frame(time.monotonic(), request)
        if not verdict.ok:
            found.append(Finding("fault", "drives", f"{name}: {verdict.text}"))
            continue
        port.send(request)
        if any(frame.can_id == drive.answer for frame in _heard(port, ANSWER_S, drive.answer)):
            found.append(Finding("ok", "drives", f"{name} answers"))
        else:
            text = f"{name} does not answer within {ANSWER_S:g} s"
            remedy = "is it powered, on this bus, at this bit rate, and set to its address?"
            found.append(Finding("fault", "drives", text, remedy))
    return found


def _prepare(rig: RigFile, profiles: Profiles, ports: Sequence[BusPort]) -> list[Finding]:
    """From log-on to ready, as the daemon does it: watchdogs written and read back, power off throughout."""
    drives = build_drivers(rig, profiles)
    core = RigCore(rig, drives, time.monotonic() + rig.bus.cycle)
    end_s = time.monotonic() + PREPARE_S
    while time.monotonic() < end_s and not all(d.status.phase in SETTLED for d in drives):
        select.select(ports, [], [], max(0.0, core.next_due_s - time.monotonic()))
        for bus, port in enumerate(ports):
            for t_s, frame in port.receive():
                core.on_frame(t_s, frame._replace(bus=bus))
        now_s = time.monotonic()
        if now_s >= core.next_due_s:
            for frame in core.on_due(now_s):
                try:
                    ports[frame.bus].send(frame)
                except BusBusy as error:
                    core.on_refused(now_s, frame, error)
            core.take_records()
    statuses = [(d.name, d.status) for d in drives]
    for bus, _, part in parts_of(rig, profiles):
        _release(part, profiles, ports[bus])
    found = []
    for name, status in statuses:
        if status.phase is DrivePhase.READY:
            text = f"{name} is ready: its watchdog is written and read back"
            found.append(Finding("ok", "drives", text))
        else:
            why = status.error or status.waiting_for or f"it is {status.phase.value}"
            remedy = "mend that, then check again; `hil sniff` shows what is said on the bus"
            found.append(Finding("fault", "drives", f"{name} cannot be armed: {why}", remedy))
    return found


def _release(rig: RigFile, profiles: Profiles, port: BusPort) -> None:
    """System Stop: without it the drives would miss their master and report that their watchdog ran out."""
    profile = profiles[rig.actuators[0].drive.profile]
    if not isinstance(profile, LustProfile):
        for frame in canopen.release(rig, profiles):
            port.send(frame)
        return
    drives = LustBus(rig, profile)
    stop = encode_system(profile.ids, profile.system.stop)
    gate = Gate(gate_limits(rig, drives[0].setpoint_kind), drives.meaning)
    if gate.pass_frame(time.monotonic(), stop).ok:
        port.send(stop)


def _heard(port: BusPort, for_s: float, until_id: int | None = None) -> list[Frame]:
    """What `port` hears within `for_s`, or until a frame with `until_id` came."""
    end_s = time.monotonic() + for_s
    frames: list[Frame] = []
    while (left_s := end_s - time.monotonic()) > 0.0:
        select.select([port], [], [], left_s)
        frames += [stamped.frame for stamped in port.receive()]
        if until_id is not None and any(frame.can_id == until_id for frame in frames):
            break
    return frames
