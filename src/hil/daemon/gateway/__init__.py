"""The gateway process: Zenoh clients, cues and commands in, state and events out, recording and metrics."""
