"""The bus: its timing as model and twin reckon with it, and the interface that carries it."""

from __future__ import annotations

from math import pi, sqrt
from typing import Annotated, Final, Literal

from pydantic import Field

from hil.config.base import NonNegative, Positive, Settings

SHORTEST_WAIT: Final = 0.1
"""Of a cycle: what a setpoint must wait for a clock of the drives' at least, so that jitter does not show."""


class Bus(Settings):
    """Nominal timing of setpoints and answers."""

    schedule: Literal["parameter", "fast"] = Field(
        "parameter",
        description="parameter: one parameter pair a drive and cycle, quantities take turns; "
        "fast: every quantity of every drive each cycle (CiA 402, at SYNC)",
    )
    cycle: Annotated[float, Field(ge=0.0005, le=0.1)] = Field(
        0.01, description="period of setpoints and slots, s"
    )
    jitter: NonNegative = Field(0.0003, description="standard deviation of setpoint send times, s")
    setpoint_delay: NonNegative = Field(
        0.0006, description="setpoint frame sent to drive acting on it, s"
    )
    answer_delay: NonNegative = Field(0.001, description="drive's sample instant to its answer, s")
    answer_jitter: NonNegative = Field(6e-5, description="standard deviation of that, s")
    interpolation: Literal["linear", "linear_rests", "linear_leads", "hold"] = Field(
        "linear",
        description="how the drive goes from setpoint to setpoint: along a line, along one that starts where "
        "its last tick was (so it rests for a tick at each setpoint), along one whose first step it makes at "
        "the tick at which it takes the setpoint, or at once",
    )
    force_interpolation: Literal["hold", "linear"] = Field(
        "hold",
        description="how the drive goes from one force that it is told to the next: at once, or along a line "
        "of a cycle",
    )
    stagger: NonNegative = Field(
        0.0011, description="start of one drive's slot after the one before it (parameter), s"
    )
    retimed: bool = Field(
        False, description="the drive buffers one cycle and plays on its own clock"
    )
    clock_wait: Annotated[float, Field(gt=0.0, le=0.1)] | None = Field(
        None,
        description="drives that are retimed begin each cycle together, so long after the first drive's "
        "setpoint came, s; where it is not given, each a cycle after its own came",
    )
    position_loop: Positive = Field(0.001, description="period of the drive's position loop, s")
    speed_loop: Positive = Field(0.00025, description="period of the drive's speed loop, s")
    pattern: Annotated[
        tuple[Literal["position", "velocity", "force", "current"], ...], Field(min_length=1)
    ] = Field(
        ("position", "force"), description="what successive parameter slots of a drive ask for"
    )

    def waits_s(self, slot: int) -> float:
        """How long the setpoint of drive `slot`, counted from 0, waits for the drive's clock, s; 0 where it
        acts as it comes."""
        if not self.retimed:
            return 0.0
        if self.clock_wait is None:
            return self.cycle
        return self.clock_wait - (self.stagger * slot if self.schedule == "parameter" else 0.0)

    @property
    def reach_s(self) -> float:
        """From a setpoint's acting at the drive until the reference is there, on average over a cycle."""
        if self.interpolation == "hold":
            return 0.5 * self.cycle
        if self.interpolation == "linear":
            return self.cycle
        if self.interpolation == "linear_leads":
            return self.cycle - self.position_loop
        # A line of n ticks that begins a tick late falls (n + 1) / 2 (n - 1) ticks behind.
        ticks = max(self.cycle / self.position_loop, 2.0)
        return self.cycle + 0.5 * self.position_loop * (ticks + 1.0) / (ticks - 1.0)


class FurtherBus(Settings):
    """A further bus of the rig: its drives say so in actuators.drive.bus."""

    url: str = Field("socketcan:can1", description="as can.url")
    bitrate: Annotated[int, Field(ge=10_000, le=1_000_000)] = Field(
        1_000_000, description="bit rate, bit/s"
    )


def bus_of(url: str) -> tuple[str, str]:
    """What sort of bus a port's `url` is of, and which: "socketcan", "can0". Options are left out."""
    scheme, _, rest = url.partition(":")
    return scheme, rest if scheme == "python-can" else rest.partition("?")[0]


class Can(Settings):
    """The interface behind the bus."""

    url: str = Field(
        "socketcan:can0",
        description="socketcan:IFACE, hub:SOCKET_PATH or python-can:INTERFACE:CHANNEL",
    )
    bitrate: Annotated[int, Field(ge=10_000, le=1_000_000)] = Field(
        500_000, description="bit rate, bit/s"
    )
    imu_base_id: Annotated[int, Field(ge=0x001, le=0x7F0)] = Field(
        0x0A0,
        description="identifier of the IMU node's gyro frame; accelerometer frame is one above",
    )
    further: Annotated[tuple[FurtherBus, ...], Field(max_length=3)] = Field(
        (), description="further buses, for rigs whose drives do not fit on one"
    )

    @property
    def urls(self) -> tuple[str, ...]:
        """Where each bus is, in the order by which actuators.drive.bus counts."""
        return (self.url, *(b.url for b in self.further))

    @property
    def bitrates(self) -> tuple[int, ...]:
        """Bit rate of each bus, bit/s."""
        return (self.bitrate, *(b.bitrate for b in self.further))


class ImuMount(Settings):
    """What holds the inertial sensor: it swings there along its axes."""

    frequency: tuple[NonNegative, NonNegative, NonNegative] = Field(
        (0.0, 0.0, 0.0), description="along each of its axes, Hz; 0: it does not"
    )
    damping: Annotated[float, Field(gt=0.0, lt=1.0)] = Field(0.05, description="damping ratio")


class Imu(Settings):
    """The platform's inertial sensor: where it sits and how fast it is."""

    position: tuple[float, float, float] = Field(description="in the platform frame, m")
    orientation: tuple[float, float, float] = Field(
        (0.0, 0.0, 0.0), description="roll, pitch, yaw of the sensor in the platform frame, rad"
    )
    rate: Positive = Field(200.0, description="samples a second, Hz")
    bandwidth: Positive = Field(150.0, description="its low-pass filter, second order, Hz")
    delay: NonNegative = Field(
        0.0, description="delay left in its time stamps, s, its filter's group delay apart"
    )
    mount: ImuMount = ImuMount()

    @property
    def group_delay_s(self) -> float:
        """Of its filter, second-order Butterworth, at low frequency: 2 ζ / ω = √2 / (2 π f)."""
        return sqrt(2.0) / (2.0 * pi * self.bandwidth)


class Noise(Settings):
    """Noise (standard deviation) and quantisation steps of the sensors, as simulated and as expected."""

    position: NonNegative = Field(2e-5, description="m")
    velocity: NonNegative = Field(2e-3, description="m/s")
    force: NonNegative = Field(5.0, description="N")
    current: NonNegative = Field(0.02, description="A")
    gyro: NonNegative = Field(0.002, description="rad/s")
    accel: NonNegative = Field(0.03, description="m/s²")
    position_step: NonNegative = Field(1e-6, description="m")
    velocity_step: NonNegative = Field(1e-4, description="m/s")
    force_step: NonNegative = Field(1.0, description="N")
    current_step: NonNegative = Field(0.01, description="A")
    gyro_step: NonNegative = Field(0.0002, description="rad/s")
    accel_step: NonNegative = Field(0.005, description="m/s²")
