"""The signs that a diagnosis doubts by, over cases whose answers are known: what its thresholds are set on.

    hil gap exam make --out CASES --rigs axis --cases 60 --seed 3400
    python -m benchmarks.gap_signs CASES [CASES ...] --out signs.csv

One row a case: what it is and what was said; of the best candidate, right or wrong, the share of the seen
gap that it explains (`hil.gap.doubt`: EXPLAINED, FEW), what it takes off unseen data (HOLDS, BORNE_OUT),
how much of it varies (VARIES), its nats and the floors of its trace (`hil.gap.clear`: COUNTED, IN_FULL);
the largest signal in floors (`hil.gap.verdict`: LARGE), how loud the record is beside
the noise model (`hil.gap.loudness`: LEVEL_RANGE, LOUDEST), and its lone samples (`hil.gap.events`: WILD,
STRUCK, HELD; 1 is a gap). Then their quantiles by kind of case. Rows are kept as they come and never made
twice. Meant for tuning seeds, from 1000 on, never for an exam's.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

import pandas as pd

from hil.errors import HilError
from hil.exam.case import ANSWER, case_folders, load_case, read_answer
from hil.exam.paper import Paper
from hil.gap import Diagnosis, diagnose
from hil.gap.constancy import variation
from hil.gap.doubt import explained_share
from hil.gap.events import jumps
from hil.gap.evidence import weigh
from hil.gap.heldout import traces
from hil.gap.training import candidates_of

SIGNS = ("share", "unseen", "varies", "nats", "trace", "floors", "loud", "lone")


def signs(found: Diagnosis) -> dict[str, float]:
    """What the doubt and the noise of one diagnosis are made of, as far as it came to that."""
    out = {
        "floors": max(s.ratio for s in found.located.signals),
        "loud": max(
            (x.factor for x in found.located.evidence.noise.levels.values()), default=float("nan")
        ),
        "lone": jumps(found.located)[1],
    }
    c, none, best = found.calibrated, found.none, found.best
    if c is None or none is None or best is None:
        return out
    weighed, worth = weigh(c, [none, best])
    logs = {len(w.fit.leaves): w.log_evidence for w in weighed}
    out["nats"] = logs[len(best.leaves)] - logs[0]
    out["share"] = explained_share(c, none, best, out["nats"])
    out["trace"] = max(traces(c, none, best).values())
    varies = variation(c, none, best, candidates_of(c, none, ()), worth)
    if varies is not None:
        out["varies"] = varies.share
    if found.score is not None and found.score.shrink is not None:
        out["unseen"] = found.score.shrink
    return out


def row_of(folder: Path) -> dict[str, Any]:
    """One case diagnosed beside its answer (`folder`: CASES/cases/ID)."""
    case = load_case(folder)
    answer = read_answer(folder.parents[1] / "answers" / folder.name / ANSWER)
    try:
        found = diagnose(case.runs, case.rig, references=case.references)
    except HilError as error:
        return {"case": folder.name, "said": f"error: {error}"}
    paper = Paper(folder.name, answer, found.tables())
    nearest = [] if found.best is None else list(found.best.leaves)
    return {
        "case": folder.name, "kind": paper.kind, "severity": paper.severity, "said": found.verdict,
        "nearest": " + ".join(x.name for x in nearest),
        "is_right": {(x.effect, x.location) for x in nearest} == set(paper.truth),
        **signs(found),
    }  # fmt: skip


def table(rows: pd.DataFrame) -> pd.DataFrame:
    """Quantiles of each sign by kind of case, and by whether its nearest candidate is right."""
    named = rows["kind"].where(rows["kind"].isin(["none", "outside"]), rows["is_right"].map(
        {True: "catalogue, right", False: "catalogue, wrong"}))  # fmt: skip
    parts = []
    for kind, some in rows.groupby(named):
        q = some[[s for s in SIGNS if s in some]].quantile([0.05, 0.25, 0.5, 0.75, 0.95]).round(3)
        q.insert(0, "cases", len(some))
        parts.append(pd.concat({kind: q}))
    return pd.concat(parts)


def main() -> None:
    """Diagnose what is not in the file yet, then print the quantiles."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("cases", type=Path, nargs="+", help="folders with cases/ and answers/")
    parser.add_argument("--out", type=Path, default=Path("signs.csv"))
    given = parser.parse_args()
    rows = pd.read_csv(given.out) if given.out.is_file() else pd.DataFrame({"case": []})
    folders = [f for root in given.cases for f in case_folders(root)]
    todo = [f for f in folders if f.name not in set(rows["case"])]
    for k, folder in enumerate(todo, start=1):
        rows = pd.concat([rows, pd.DataFrame([row_of(folder)])], ignore_index=True)
        rows.to_csv(given.out, index=False)
        print(f"{k}/{len(todo)} {folder.name}: {rows['said'].iloc[-1]}", flush=True)
    print(table(rows).to_string(na_rep="-"))


if __name__ == "__main__":
    main()
