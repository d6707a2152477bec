"""The rig that is not there: plant, drive loops and effects in one compiled model, behind frames or alone.

`Plant` is driven by events in injected time and serves simulated drives; `Twin` replays recordings.
"""
