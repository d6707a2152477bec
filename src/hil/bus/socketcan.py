"""Ports on Linux' SocketCAN: raw classic frames of one interface, with its error frames.

Bit rate and queue length belong to the interface and are set where it is brought up
(`ip link set can0 up type can bitrate 500000`), not here.
"""

from __future__ import annotations

import errno
import fcntl
import socket
import struct
from collections.abc import Sequence
from typing import Final, NamedTuple

from hil.bus.socketport import SocketPort
from hil.bus.state import ERR_ALL
from hil.errors import BusError
from hil.frames import EFF_FLAG, EFF_MASK, RTR_FLAG, SFF_MASK

_CAN_RAW_ERR_FILTER: Final = 2
"""linux/can/raw.h; not in every Python's socket module."""

RECEIVE_BUFFER: Final = 1 << 20
"""SO_RCVBUF of ports. The kernel reckons 768 bytes a frame, and by default loses what comes beyond 277
frames, without a word: 70 ms of a full bus at 500 kbit/s. Without privilege it grants less."""

_SO_RCVBUFFORCE: Final = 33
"""asm-generic/socket.h; beyond net.core.rmem_max, with CAP_NET_ADMIN."""

_SIOCGIFFLAGS: Final = 0x8913
_IFF_UP: Final = 1
_IFREQ: Final = struct.Struct("16sH22x")
_FILTER: Final = struct.Struct("=II")
_INT: Final = struct.Struct("=i")


class IdFilter(NamedTuple):
    """Lets data frames pass whose identifier equals `can_id` in the bits of `mask`."""

    can_id: int
    mask: int = SFF_MASK


def open_socketcan(
    interface: str, *, read_only: bool = False, filters: Sequence[IdFilter] = ()
) -> SocketPort:
    """A port on `interface`; BusError says what is missing and how to bring it about.

    With `filters` only frames that pass one of them are received (and every error frame). A
    read-only port is bound to no interface, so that the kernel itself refuses (ENXIO) whatever
    is written to its descriptor; it hears all interfaces and hands out the frames of its own.
    """
    name = f"socketcan:{interface}"
    sock = _raw_socket(name)
    try:
        _require_up(name, sock, interface)
        _request_buffer(sock)
        sock.setsockopt(socket.SOL_CAN_RAW, socket.CAN_RAW_LOOPBACK, _INT.pack(1))
        sock.setsockopt(socket.SOL_CAN_RAW, socket.CAN_RAW_RECV_OWN_MSGS, _INT.pack(0))
        sock.setsockopt(socket.SOL_CAN_RAW, _CAN_RAW_ERR_FILTER, _INT.pack(ERR_ALL))
        if filters:
            packed = b"".join(_packed(name, item) for item in filters)
            sock.setsockopt(socket.SOL_CAN_RAW, socket.CAN_RAW_FILTER, packed)
        try:
            sock.bind((interface,))
            if read_only:
                sock.bind(("",))
        except OSError as error:
            raise BusError(f"{name}: cannot be opened: {error.strerror}") from error
        return SocketPort(
            name,
            sock,
            read_only=read_only,
            remedy=f"see `ip -details link show {interface}`, and bring it up again with "
            f"`ip link set {interface} up`",
            only_from=interface if read_only else None,
        )
    except BaseException:
        sock.close()
        raise


def parse_filters(text: str) -> tuple[IdFilter, ...]:
    """Filters in candump's notation, `371:7ff,520:7f0` (hexadecimal); BusError if they are not."""
    filters = []
    for part in text.split(","):
        can_id, colon, mask = part.partition(":")
        try:
            filters.append(IdFilter(int(can_id, 16), int(mask, 16) if colon else SFF_MASK))
        except ValueError:
            raise BusError(
                f"{part!r} is no filter; write identifier:mask in hexadecimal, as in 371:7ff"
            ) from None
    return tuple(filters)


def _raw_socket(name: str) -> socket.socket:
    if not hasattr(socket, "AF_CAN"):
        raise BusError(f"{name}: this system is no Linux with SocketCAN; use the hub instead")
    try:
        return socket.socket(socket.AF_CAN, socket.SOCK_RAW, socket.CAN_RAW)
    except OSError as error:
        if error.errno == errno.EAFNOSUPPORT:
            raise BusError(
                f"{name}: this kernel has no CAN sockets (errno {error.errno}); load them with "
                "`modprobe can-raw`, or use a hub (hub:PATH) where there are none"
            ) from error
        raise BusError(f"{name}: no CAN socket: {error.strerror}") from error


def _request_buffer(sock: socket.socket) -> None:
    try:
        sock.setsockopt(socket.SOL_SOCKET, _SO_RCVBUFFORCE, RECEIVE_BUFFER)
    except PermissionError:
        sock.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, RECEIVE_BUFFER)


def _require_up(name: str, sock: socket.socket, interface: str) -> None:
    try:
        request = _IFREQ.pack(interface.encode()[:15], 0)
        flags = _IFREQ.unpack(fcntl.ioctl(sock, _SIOCGIFFLAGS, request))[1]
    except OSError as error:
        raise BusError(
            f"{name}: there is no interface {interface}; plug the adapter in and look at "
            f"`ip link`, or make a virtual one: `ip link add {interface} type vcan`"
        ) from error
    if not flags & _IFF_UP:
        raise BusError(
            f"{name}: the interface is down; bring it up with "
            f"`ip link set {interface} up type can bitrate 500000`"
        )


def _packed(name: str, item: IdFilter) -> bytes:
    if not 0 <= item.can_id <= EFF_MASK or not 0 <= item.mask <= EFF_MASK:
        raise BusError(f"{name}: filter {item.can_id:x}:{item.mask:x} is wider than 29 bits")
    # Without the flags in the mask, a standard filter would let extended and remote frames pass.
    extended = EFF_FLAG if max(item) > SFF_MASK else 0
    return _FILTER.pack(item.can_id | extended, item.mask | EFF_FLAG | RTR_FLAG)
