"""Make sealed diagnosis cases in a world that is not the twin's.

    python -m benchmarks.other_lab OUT --rig axis --seed 1 --count 24

writes OUT/cases/<id>/ (rig.toml, run*/run.toml, run*/signals.parquet) and OUT/answers/<id>/ (answer.json, and
notes.json for who marks). The same rig, seed and index give the same case.
"""

from __future__ import annotations

import argparse
import time
from pathlib import Path

from benchmarks.other_lab.cases import draw_case, write_case
from hil.configfile import find_rig_file, load_rig

STRIDE = {"axis": 40, "motorcycle": 14, "stewart": 6}
"""Cases of one seed of a published set: the next seed goes on where it ended in the list of effects."""


def main() -> None:
    """The command line."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("out", type=Path)
    parser.add_argument("--rig", default="axis", help="axis, motorcycle, stewart, or a rig file")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--count", type=int, default=24)
    parser.add_argument("--first", type=int, default=0, help="index of the first case")
    arguments = parser.parse_args()
    rig_file = find_rig_file(arguments.rig)
    rig = load_rig(rig_file)
    for index in range(arguments.first, arguments.first + arguments.count):
        begun = time.monotonic()
        draft = draw_case(rig, arguments.seed, index, STRIDE.get(rig.name, arguments.count))
        write_case(draft, rig_file, arguments.out)
        print(f"{draft.id}  {len(draft.plans)} runs  {time.monotonic() - begun:.1f} s", flush=True)


if __name__ == "__main__":
    main()
