"""What is checked in and written to a node before it may be started: identity, watchdogs, mode, limits, PDOs.

Each write is read back. A PDO is remapped as CiA 301 wants it: disable (bit 31), no entries, entries,
count, transmission type, enable. The steps are one generator that yields transfers; whoever runs it feeds
it with results, so the order stands here as it is read.
"""

from __future__ import annotations

from collections.abc import Generator
from dataclasses import dataclass
from typing import Final

from hil.config import RigFile
from hil.drives.cia402.aborts import SdoAbort
from hil.drives.cia402.codec import NodeIds, PdoLayout
from hil.drives.cia402.mapping import MODE_CODES, TPDO, CyclicMode, candidates, rpdo, supports
from hil.drives.cia402.profile import Cia402Profile
from hil.drives.cia402.sdo import Transfer
from hil.errors import ConfigError, DriveError, ProtocolError

DISABLED: Final = 0x8000_0000
"""Bit 31 of a PDO's identifier: the PDO is not used."""
NO_REMOTE: Final = 0x4000_0000
"""Bit 30 of a TPDO's: no remote frames. A drive that serves none lets nobody clear it (CiA 301) [M]."""
SERVO_PROFILE: Final = 402
MODE_READS: Final = 100
"""So often the mode that a drive shows is read, one read a cycle or two, until it is the one that was set."""
AT_EVERY_SYNC: Final = 1
AT_ONCE: Final = 255

Steps = Generator[Transfer, None, None]


class Refused(Exception):
    """The node cannot be run: a stable name and a sentence."""

    def __init__(self, name: str, text: str) -> None:
        super().__init__(text)
        self.name = name


@dataclass(frozen=True, slots=True)
class Wanted:
    """What a rig wants of one of its drives, in the drive's own units."""

    profile: Cia402Profile
    ids: NodeIds
    modes: tuple[CyclicMode, ...]
    is_synchronous: bool
    """Targets act at the next SYNC; otherwise as soon as they arrive."""
    cycle_us: int
    settings: tuple[tuple[int, int, int, str], ...]
    """Index, subindex, value, and what it is."""
    watchdog_ms: int


def wanted_of(rig: RigFile, i: int, profile: Cia402Profile, ids: NodeIds) -> Wanted:
    """What `rig` wants of the drive of actuator `i`; ConfigError where the drive file cannot give it."""
    a = rig.actuators[i]
    counts, watch = a.drive.counts_per_unit, profile.supervision
    cycle_us = round(rig.bus.cycle * 1e6)
    period, exponent = interpolation_period(cycle_us)
    watchdog_ms = round(rig.safety.drive_watchdog * 1000.0)
    settings = [
        (0x1016, 1, watch.master_node << 16 | watchdog_ms, "our heartbeat's time"),
        (0x6007, 0, watch.abort_reaction, "its reaction to our silence"),
        (0x1017, 0, round(watch.heartbeat * 1000.0), "its heartbeat's time"),
        (0x605A, 0, watch.quick_stop_option, "quick stop option"),
        (0x60C2, 1, period, "interpolation period"),
        (0x60C2, 2, exponent, "interpolation exponent"),
        (0x607D, 1, round(a.stroke[0] * counts), "lower position limit"),
        (0x607D, 2, round(a.stroke[1] * counts), "upper position limit"),
        (0x607F, 0, round(a.velocity_max * counts), "largest velocity"),
        (0x6072, 0, round(a.force_max / a.drive.force_per_count), "largest torque"),
        (0x6065, 0, round(watch.following_error * counts), "following error window"),
        (0x6066, 0, round(watch.following_time * 1000.0), "following error time"),
    ]
    for index, sub, _, what in settings[:3]:
        if (index, sub) not in profile.objects:
            raise ConfigError(f"{profile.objects.source}: lacks {index:#06x}:{sub:02x}, {what}")
    held = tuple(s for s in settings if (s[0], s[1]) in profile.objects)
    for index, sub, value, what in held:
        try:
            profile.objects[index, sub].encode(value)
        except ProtocolError as error:
            raise ConfigError(
                f"{rig.name}: {a.name}: its {what} does not fit the drive: {error}; correct the rig file's "
                "limits or actuators.drive.counts_per_unit"
            ) from error
    return Wanted(
        profile,
        ids,
        candidates(rig, a),
        rig.bus.schedule == "fast",
        cycle_us,
        held,
        watchdog_ms,
    )


def interpolation_period(cycle_us: int) -> tuple[int, int]:
    """0x60C2: value and exponent of ten of the period in s; ConfigError where it is no such number."""
    for exponent in range(-3, -7, -1):
        unit_us = 10 ** (6 + exponent)
        if cycle_us % unit_us == 0 and cycle_us // unit_us <= 255:
            return cycle_us // unit_us, exponent
    raise ConfigError(
        f"bus.cycle of {cycle_us} µs is no interpolation period (0x60C2): that is 1 to 255 times 1 ms, 100, "
        "10 or 1 µs"
    )


class Boot:
    """Runs the steps over one node's SDO client, and remembers what they found."""

    def __init__(self, wanted: Wanted) -> None:
        self._wanted = wanted
        self.restart()

    def restart(self) -> None:
        """Nothing is verified any more."""
        self.failure: str | None = None
        self.failure_name = "drive_not_configured"
        self.notes: list[str] = []
        self.watchdog_ok = False
        self.done = False
        self.mode: CyclicMode | None = None
        self.is_referenced = self._wanted.profile.homing.kind == "absolute"
        self._steps = self._all()
        self._transfer: Transfer | None = None

    def next_transfer(self) -> Transfer | None:
        """The next transfer to submit, once the one before is done; None while it is not, and at the end."""
        if self.done or self.failure is not None:
            return None
        if self._transfer is not None and not self._transfer.is_done:
            return None
        try:
            self._transfer = next(self._steps)
        except StopIteration:
            self.done = True
            return None
        except Refused as refused:
            self.failure, self.failure_name = str(refused), refused.name
            return None
        except (DriveError, ProtocolError) as error:
            self.failure = str(error)
            return None
        return self._transfer

    # -- the steps -----------------------------------------------------------------------------------

    def _all(self) -> Steps:
        yield from self._identity()
        yield from self._expected()
        yield from self._mode()
        for index, sub, value, what in self._wanted.settings:
            yield from self._set(index, sub, value, what)
            if (index, sub) == (0x6007, 0):
                self.watchdog_ok = True
        yield from self._pdos()
        yield from self._mode_shown()
        homing = self._wanted.profile.homing
        if homing.kind == "drive" and homing.referenced_index is not None:
            found = yield from self._read(homing.referenced_index, 0)
            self.is_referenced = bool(found & 1)

    def _identity(self) -> Steps:
        profile = self._wanted.profile
        device = yield from self._read(0x1000, 0)
        if device & 0xFFFF != SERVO_PROFILE:
            raise Refused(
                "drive_identity", f"is a device of profile {device & 0xFFFF}, no servo drive (402)"
            )
        given, eds = profile.identity, profile.objects
        for sub, name, ours in (
            (1, "vendor", eds.vendor if given.vendor is None else given.vendor),
            (2, "product", eds.product if given.product is None else given.product),
        ):
            found = yield from self._read(0x1018, sub)
            if ours is not None and found != ours:
                raise Refused(
                    "drive_identity",
                    f"says {name} {found:#x}, but the drive file is for {ours:#x}: another drive was put "
                    "here, or its EDS is the wrong one. Correct actuators.drive.profile, then reset",
                )
        if eds.revision is None or (0x1018, 3) not in eds:
            return
        revision = yield from self._read(0x1018, 3)
        if revision != eds.revision:
            self.notes.append(f"has revision {revision:#x}, its EDS is of {eds.revision:#x}")

    def _expected(self) -> Steps:
        for want in self._wanted.profile.expected:
            entry = self._wanted.profile.objects[want.index, want.sub]
            data = yield from self._do(Transfer(want.index, want.sub))
            found = entry.decode(data)
            assert isinstance(found, int)  # as a drive file is checked
            if found != want.value:
                raise Refused(
                    "drive_setting",
                    f"has {found:#x} in {entry}, the drive file expects {want.value:#x}: {want.text}. Set "
                    "the drive, or correct [[expected]] in its file; then reset",
                )

    def _mode(self) -> Steps:
        modes = yield from self._read(0x6502, 0)
        fit = [m for m in self._wanted.modes if supports(modes, m)]
        if not fit:
            names = " or ".join(self._wanted.modes)
            raise Refused(
                "drive_mode",
                f"has no mode {names} (0x6502 = {modes:#x}): use another control.mode or another drive",
            )
        self.mode = fit[0]
        yield from self._set(0x6060, 0, MODE_CODES[self.mode], "mode of operation")

    def _mode_shown(self) -> Steps:
        """0x6060 is a wish: a drive may hold it and stay in another mode, which 0x6061 tells."""
        assert self.mode is not None
        shown = 0
        for _ in range(MODE_READS):
            data = yield from self._do(Transfer(0x6061, 0))
            shown = int.from_bytes(data, "little", signed=True)
            if shown == MODE_CODES[self.mode]:
                return
        raise Refused(
            "drive_mode",
            f"was set to mode {self.mode} (0x6060 = {MODE_CODES[self.mode]}) and took it, but stays in mode "
            f"{shown} (0x6061)",
        )

    def _pdos(self) -> Steps:
        assert self.mode is not None
        ids, type_ = self._wanted.ids, AT_EVERY_SYNC if self._wanted.is_synchronous else AT_ONCE
        # only what is mapped here may travel
        for index, sub in self._wanted.profile.objects.entries:
            if sub == 1 and (0x1401 <= index < 0x1600 or 0x1801 <= index < 0x1A00):
                yield from self._disable(index)
        yield from self._map(0x1400, 0x1600, ids.rpdo, type_, rpdo(self.mode))
        yield from self._map(0x1800, 0x1A00, ids.tpdo, AT_EVERY_SYNC, TPDO)

    def _map(
        self, parameter: int, mapping: int, can_id: int, type_: int, layout: PdoLayout
    ) -> Steps:
        name = f"{'RPDO' if parameter == 0x1400 else 'TPDO'} 1"
        found = yield from self._disable(parameter)
        try:
            yield from self._set(mapping, 0, 0, f"{name}, no entries")
            for k, f in enumerate(layout.fields, start=1):
                yield from self._set(mapping, k, f.entry, f"{name}, {f.name}")
            yield from self._set(mapping, 0, len(layout.fields), f"{name}, number of entries")
            yield from self._set(parameter, 2, type_, f"{name}, transmission type")
        except SdoAbort as abort:
            raise Refused("mapping_refused", f"refuses its mapping: {abort}") from abort
        as_is = found & NO_REMOTE if parameter == 0x1800 else 0
        yield from self._set(parameter, 1, can_id | as_is, f"{name}, enabled")

    def _disable(self, parameter: int) -> Generator[Transfer, None, int]:
        found = yield from self._read(parameter, 1)
        if not found & DISABLED:
            yield from self._set(parameter, 1, found | DISABLED, "PDO disabled", mask=DISABLED)
        return found

    def _read(self, index: int, sub: int) -> Generator[Transfer, None, int]:
        data = yield from self._do(Transfer(index, sub))
        return int.from_bytes(data, "little")

    def _set(self, index: int, sub: int, value: int, what: str, *, mask: int = -1) -> Steps:
        entry = self._wanted.profile.objects[index, sub]
        raw = entry.encode(value)
        yield from self._do(Transfer(index, sub, raw))
        found = yield from self._do(Transfer(index, sub))
        if (
            len(found) != len(raw)
            or (int.from_bytes(found, "little") ^ int.from_bytes(raw, "little")) & mask
        ):
            name = "mapping_refused" if 0x1400 <= index < 0x1C00 else "drive_not_configured"
            raise Refused(
                name, f"{entry}, {what}: {raw.hex()} was written, {found.hex()} is read back"
            )

    def _do(self, transfer: Transfer) -> Generator[Transfer, None, bytes]:
        yield transfer
        if transfer.error is None:
            return transfer.result
        if isinstance(transfer.error, SdoAbort) and transfer.error.name in (
            "no_object",
            "no_subindex",
        ):
            raise Refused(
                "wrong_eds",
                f"lacks {transfer.index:#06x}:{transfer.sub:02x}, which its EDS "
                f"({self._wanted.profile.objects.source}) has: the EDS is of another drive or firmware",
            )
        raise transfer.error
