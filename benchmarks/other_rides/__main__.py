"""`python -m benchmarks.other_rides OUT --seed 1 --first 0 --count 60`: write cases and sealed answers."""

from __future__ import annotations

import argparse
import time
from pathlib import Path

from benchmarks.other_rides.case import draw, write
from benchmarks.other_rides.deck import cards
from hil.configfile import find_rig_file, load_bicycle


def main() -> None:
    """Write them one by one."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.other_rides", description=__doc__)
    parser.add_argument("out", type=Path)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--count", type=int, default=60)
    parser.add_argument("--rig", default="bicycle", help="a bicycle's rig file with an IMU")
    args = parser.parse_args()
    path = find_rig_file(args.rig)
    rig = load_bicycle(path)
    dealt = cards(args.seed, args.first + args.count - 1)
    for index in range(args.first, args.first + args.count):
        began = time.perf_counter()
        case = draw(rig, args.seed, index, dealt[index])
        write(case, rig, path, args.out)
        print(f"{case.name}: {len(case.runs)} rides, {time.perf_counter() - began:.1f} s")


if __name__ == "__main__":
    main()
