"""Write sealed cases: OUT/cases/<id>/ and, apart from them, OUT/answers/<id>/."""

from __future__ import annotations

import argparse
import hashlib
import json
import time
from datetime import UTC, datetime, timedelta
from pathlib import Path

from benchmarks.third_lab.case import Case, make
from benchmarks.third_lab.deck import RIGS
from hil.configfile import find_rig_file, load_rig


def write(out: Path, rig: str, seed: int, index: int, case: Case) -> Path:
    """Write the case, its answer and its notes; returns the case's folder."""
    name = f"{rig}_{seed}_{index:03d}"
    folder, sealed = out / "cases" / name, out / "answers" / name
    folder.mkdir(parents=True, exist_ok=True)
    sealed.mkdir(parents=True, exist_ok=True)
    answer = (json.dumps(case.answer, indent=1) + "\n").encode()
    (sealed / "answer.json").write_bytes(answer)
    (sealed / "notes.json").write_text(json.dumps(case.notes, indent=1) + "\n", encoding="utf-8")
    source = find_rig_file(rig)
    (folder / "rig.toml").write_bytes(source.read_bytes())
    started = datetime(2026, 3, 2, 8, 0, tzinfo=UTC) + timedelta(days=seed % 300, hours=index)
    for k, (record, role) in enumerate(zip(case.records, case.roles, strict=True)):
        run = folder / f"run{k + 1}"
        run.mkdir(exist_ok=True)
        record.to_parquet(run / "signals.parquet", index=False)
        at = (
            started - timedelta(days=20)
            if role == "reference"
            else started + timedelta(minutes=5 * k)
        )
        (run / "run.toml").write_text(
            'format = "hil-run/1"\n'
            f'rig = "{load_rig(source).name}"\n'
            'mode = "position"\n'
            f"started = {at:%Y-%m-%dT%H:%M:%SZ}\n"
            'note = ""\n'
            f'role = "{role}"\n'
            f'answer_sha256 = "{hashlib.sha256(answer).hexdigest()}"\n',
            encoding="utf-8",
        )
    return folder


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.third_lab", description=__doc__)
    parser.add_argument("out", type=Path)
    parser.add_argument("--rig", choices=RIGS, required=True)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--count", type=int, default=40)
    args = parser.parse_args()
    rig = load_rig(find_rig_file(args.rig))
    for index in range(args.first, args.first + args.count):
        began = time.perf_counter()
        folder = write(args.out, args.rig, args.seed, index, make(args.rig, rig, args.seed, index))
        print(f"{folder.name}  {time.perf_counter() - began:.1f} s", flush=True)


if __name__ == "__main__":
    main()
