"""What a diagnosis knows of effects by their names: how they enter the answer, when and where they show.

An effect that is in none of these sets enters in proportion to its parameters, either way, now and then, at
its own actuator. `hil.gap.fits.friction` has the laws of friction, which stand for one another.
"""

from __future__ import annotations

from typing import Final

ALWAYS: Final = frozenset(
    {"loop_gain", "transport_delay", "sensor_latency", "sensor_scale", "clock_drift", "force_constant",
     "actuator_inertia", "payload_mass", "payload_inertia", "viscous_friction", "load_friction", "compliance",
     "front_suspension", "tyre_compliance"}
)  # fmt: skip
"""They act at all times: whatever a twin lacks everywhere looks a little like one of them."""
PLACING: Final = frozenset({"position_offset", "lead_error"})
"""They move the platform itself, which every signal shows."""
WAVES: Final = frozenset({"force_ripple", "lead_error"})
"""They go round with place: a wave of another shape looks a little like one that changes with it."""
ONE_SIDED: Final = frozenset(
    {"compliance", "hysteresis", "load_friction", "front_suspension", "tyre_compliance"}
)
"""There is more of them than none, never less."""
LIMITS: Final = frozenset({"force_saturation", "velocity_saturation"})
"""Their starts are read from the record: nothing to scale."""
EVENTS: Final = LIMITS | {"lost_frames"}
"""They may act in a few samples alone, and there leave what no twin's small ways make."""
FLANKS: Final = frozenset({"backlash"})
"""They do most as flanks meet."""
MOMENTS: Final = EVENTS | FLANKS
RIDER: Final = "rider_motion"
"""It needs a rider in the rig file."""
DRAG: Final = "viscous_friction"
"""Whatever brakes more the faster it goes comes so near it that little of a small gap is left."""
NEAR: Final = frozenset({"backlash", "transport_delay", "sensor_latency", "clock_drift"})
"""They grow in no proportion to their parameter: only near a start is its column what they do."""
