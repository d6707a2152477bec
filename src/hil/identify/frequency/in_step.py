"""An IMU in step with the setpoints: it meets what they do at their corners always at the same place.

Drives draw straight lines between setpoints, so the acceleration comes in pushes, one a setpoint; their
harmonics fold onto the very lines that are measured where they are multiples of the IMU's rate. On the
simulated platform a gain came out at 1.049 in step and at 0.9995 out of step [V].
"""

from __future__ import annotations

from typing import Final

from hil.config import RigFile
from hil.identify.frequency.channels import Channel

HARMONICS: Final = 3
"""Of the setpoints' rate that are strong enough to matter where they fold: they fall with the square."""
SAME_RATE: Final = 2.0e-3
"""Two rates nearer than this share of one stay in step for long."""


def in_step(rig: RigFile, output: Channel) -> tuple[str, ...]:
    """A note where `output` is an IMU's signal in step with the setpoints; nothing otherwise."""
    if not output.name.startswith("imu."):
        return ()
    setpoints_hz, rate_hz = 1.0 / rig.bus.cycle, output.rate_hz
    folds = [
        k * setpoints_hz / rate_hz
        for k in range(1, HARMONICS + 1)
        if k * setpoints_hz > 0.5 * rate_hz
    ]
    if not any(abs(times - round(times)) < SAME_RATE for times in folds):
        return ()
    return (
        f"{output.name} is sampled {rate_hz:.4g} times a second, in step with {setpoints_hz:.4g} setpoints a "
        "second: what happens at their corners folds onto the lines and gains come out some percent wrong; "
        "let the IMU's rate be no multiple and no simple part of the setpoints'",
    )
