"""The signs that a diagnosis doubts by, over cases whose answers are known: what its thresholds are set on.

    hil gap exam make --out CASES --rigs axis --cases 60 --seed 3400
    python -m benchmarks.gap_signs CASES [CASES ...] --out signs.csv

One row a case: what it is and what was said; of the best candidate, right or wrong, the share of the seen
gap that it explains (`judged.doubt`: EXPLAINED, FEW), what it takes off unseen data (HOLDS, BORNE_OUT),
how much of it varies (VARIES), its nats, the floors of its trace and the nats of priors that it saves
(`judged.clear`: COUNTED, BORNE_OUT), and how high unseen data stand without it; what the nuisances' priors
cost without it (decision 6; half a sum of squares); the largest signal in floors (`judged.verdict`: LARGE),
how loud the record is beside the noise model (`floor.loudness`: LEVEL_RANGE, LOUDEST), and its lone samples
(`located.events`: WILD, STRUCK, HELD; 1 is a gap), the slow bands of its drives' signals that stand highest
(`judged.verdict`: BANDS); all in `hil.gap`. Then their quantiles by kind of case.
Rows are kept as they come and never made twice. Meant for tuning seeds, from 1000 on, never for an exam's.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from hil.config import BicycleFile
from hil.errors import HilError, RunError
from hil.exam.case import ANSWER, case_folders, load_case, read_answer
from hil.exam.paper import Paper
from hil.gap.diagnose import consider
from hil.gap.fits.evidence import weigh
from hil.gap.fits.fitted import Fit
from hil.gap.fits.heldout import traces
from hil.gap.judged.causes import Shown
from hil.gap.judged.clear import signals
from hil.gap.judged.constancy import variation
from hil.gap.judged.doubt import explained_share
from hil.gap.judged.verdict import SLOW_HZ
from hil.gap.located.events import jumps
from hil.gap.located.result import Located
from hil.gap.rounds.round import Considered

SIGNS = (
    "share", "unseen", "stands", "varies", "nats", "trace", "saved", "priors", "floors", "loud", "lone",
    "force_band", "position_band",
)  # fmt: skip


def slow_band(located: Located, kinds: tuple[str, ...]) -> float:
    """Floors of its own that the highest slow band of signals of `kinds` stands; 0 where none stands out."""
    slow = [
        p.rms / p.noise_floor
        for p in located.where
        if p.band_hz[1] <= SLOW_HZ and p.signal.rpartition(".")[2] in kinds
    ]
    return max(slow, default=0.0)


def signs(x: Considered) -> tuple[Fit | None, dict[str, float]]:
    """The best candidate, and what the doubt and the noise of one diagnosis are made of."""
    c, none = x.calibrated, x.fits[0]
    out = {
        "floors": max(s.ratio for s in x.located.signals),
        "loud": max(
            (level.factor for level in x.located.evidence.noise.levels.values()),
            default=float("nan"),
        ),
        "lone": jumps(x.located)[1],
        "priors": none.prior_cost,
        "force_band": slow_band(x.located, ("force", "current")),
        "position_band": slow_band(x.located, ("position", "velocity")),
    }
    weighed, worth = weigh(c, x.fits)
    zero = next(w.log_evidence for w in weighed if not w.fit.leaves)
    first = next((w for w in weighed if w.fit.leaves), None)
    if first is None:
        return None, out
    best = first.fit
    out["nats"] = first.log_evidence - zero
    out["share"] = explained_share(c, none, best, out["nats"])
    out["trace"] = max(traces(c, none, best).values())
    out["saved"] = none.prior_cost - best.prior_cost
    varies = variation(c, none, best, x.bank, worth)
    if varies is not None:
        out["varies"] = varies.share
    shown = Shown(x.located, none, x.held, np.random.default_rng(2))
    part = shown.score(best, signals(c, none, best))
    out["stands"] = part.before / part.floor if part.floor > 0.0 else float("nan")
    if part.shrink is not None:
        out["unseen"] = part.shrink
    return best, out


def row_of(folder: Path) -> dict[str, Any]:
    """One case diagnosed beside its answer (`folder`: CASES/cases/ID)."""
    case = load_case(folder)
    answer = read_answer(folder.parents[1] / "answers" / folder.name / ANSWER)
    if isinstance(case.rig, BicycleFile):
        raise RunError(f"{folder}: a ride; its signs are others")
    try:
        x = consider(case.runs, case.rig, references=case.references)
        found = x.answer()
    except HilError as error:
        return {"case": folder.name, "said": f"error: {error}"}
    paper = Paper(folder.name, answer, found.tables())
    best, told = signs(x)
    nearest = [] if best is None else list(best.leaves)
    return {
        "case": folder.name, "kind": paper.kind, "severity": paper.severity, "said": found.verdict,
        "nearest": " + ".join(x.name for x in nearest),
        "is_right": {(x.effect, x.location) for x in nearest} == set(paper.truth),
        **told,
    }  # fmt: skip


def table(rows: pd.DataFrame) -> pd.DataFrame:
    """Quantiles of each sign by kind of case, and by whether its nearest candidate is right."""
    named = rows["kind"].where(rows["kind"].isin(["none", "outside"]), rows["is_right"].map(
        {True: "catalogue, right", False: "catalogue, wrong"}))  # fmt: skip
    parts: list[pd.DataFrame] = []
    for kind, some in rows.groupby(named):
        q = (
            some[[s for s in SIGNS if s in some]]
            .quantile([0.05, 0.25, 0.5, 0.75, 0.95, 1.0])
            .round(3)
        )
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
