"""Rides a rig with nothing but zenoh-python and json: the pattern for a client in any language.

python plain_zenoh_client.py [ENDPOINT [RIG [SECONDS]]]
"""

import json
import math
import sys
import time

import zenoh

NAME = "plain-example"
DEFAULTS = ["tcp/127.0.0.1:7447", "motorcycle", "10"]
ENDPOINT, RIG, SECONDS = sys.argv[1:4] + DEFAULTS[len(sys.argv[1:4]) :]


def open_session() -> zenoh.Session:
    """A client session that talks to the rig's daemon only."""
    config = zenoh.Config()
    config.insert_json5("mode", '"client"')
    config.insert_json5("connect/endpoints", json.dumps([ENDPOINT]))
    config.insert_json5("scouting/multicast/enabled", "false")
    return zenoh.open(config)


def command(session: zenoh.Session, name: str, **arguments: object) -> bool:
    """Give a command and show its answer; commands are queries, so there always is one."""
    payload = json.dumps({"client": NAME, "arguments": arguments})
    for reply in session.get(f"hil/{RIG}/command/{name}", payload=payload, timeout=8.0):
        if reply.ok is None:
            print(f"{name}: refused: {reply.err.payload.to_string()}")
            return False
        answer = json.loads(reply.ok.payload.to_string())
        print(f"{name}: {'done' if answer['ok'] else 'refused'}: {answer['message']}")
        return bool(answer["ok"])
    print(f"{name}: nobody answered; is the daemon of {RIG} running?")
    return False


def wait_until_ready(states: zenoh.Subscriber, patience_s: float = 10.0) -> None:
    """Return when the rig follows cues: `ready` before the first one, `engaged` after."""
    end_s = time.monotonic() + patience_s
    while time.monotonic() < end_s:
        sample = states.try_recv()
        if sample is None:
            time.sleep(0.01)
        elif json.loads(sample.payload.to_string())["state"] in ("ready", "engaged"):
            return
    raise SystemExit(f"{RIG} did not get ready within {patience_s} s")


def ride(session: zenoh.Session, states: zenoh.Subscriber) -> None:
    """Sway gently from side to side, fifty cues a second, and show what the rig makes of it."""
    cues = session.declare_publisher(f"hil/{RIG}/cue", express=True)
    start_s = time.monotonic()
    shown_s = -1.0
    seq = 0
    while (t_s := time.monotonic() - start_s) < float(SECONDS):
        seq += 1
        roll = 0.05 * math.sin(0.5 * math.pi * t_s) * min(1.0, t_s)
        pose = {"dt": 0.0, "yaw": 0.0, "pitch": 0.0, "roll": roll}
        cues.put(
            json.dumps({"seq": seq, "t": time.monotonic(), "poses": [pose]}),
            attachment=NAME,
            source_info=zenoh.SourceInfo(cues.id, seq),
        )
        while (sample := states.try_recv()) is not None:
            state = json.loads(sample.payload.to_string())
            if t_s - shown_s >= 1.0:
                shown_s = t_s
                measured = ", ".join(f"{k} {v:+.3f}" for k, v in state["pose"].items())
                print(f"{t_s:5.1f} s  {state['state']:<9} {measured} rad  {state['fault']}")
        time.sleep(0.02)


def main() -> None:
    """Arm, ride; then the rig parks, unless somebody stopped it."""
    with open_session() as session:
        states = session.declare_subscriber(f"hil/{RIG}/state", zenoh.handlers.RingChannel(10))
        if command(session, "arm"):
            wait_until_ready(states)
            ride(session, states)
            command(session, "finish")


if __name__ == "__main__":
    main()
