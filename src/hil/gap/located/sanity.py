"""Looks at the data before anything is concluded: what is broken, foreign, stuck, late or too quiet.

An error is a fault that no verdict can stand on; a warning is said and lived with. Two looks: at the
tables as they are, and at each signal beside what the twin says it should have been, which shows wrong
units, signs and clocks that no table shows by itself.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass
from typing import Any, Final, Literal

import numpy as np
from numpy.typing import NDArray

from hil.config import RigFile
from hil.errors import IdentificationError
from hil.gap.floor.draws import sensor_noise, sensor_sigma
from hil.gap.floor.rounding import is_still, must_move, step_around, step_of
from hil.gap.record.problem import LATENCY, Problem, Series
from hil.gap.record.standstill import LOOSE
from hil.runs import Run

Array = NDArray[np.float64]

SHORT_S: Final = 5.0
HOLE_S: Final = 0.25
STUCK: Final = 25
"""Equal values in a row, of a sensor that is noisy or on a rig that moves."""
FLAT_SHARE: Final = 0.01
ALIKE: Final = 0.9
"""Correlation with the twin from which a factor between the two can be trusted."""
AGAINST: Final = -0.7
"""The same below which a sign is wrong."""
WITHIN: Final = (-0.5, -0.375, -0.25, -0.125, 0.125, 0.25, 0.375, 0.5)
"""Of a cycle of the bus, how much earlier or later a force may have been read."""
FACTORS: Final = (
    (1000.0, 0.7, "is it in milli-units (mm) instead of SI?"),
    (57.29578, 0.25, "is it in degrees instead of radians?"),
    (1.0 / 9.81, 0.15, "is it in g instead of m/s²?"),
    (1.0 / 1000.0, 0.7, "is it in kilo-units (km, kN) instead of SI?"),
    (1.0 / 57.29578, 0.25, "was it converted to radians twice?"),
)
"""With the logarithm by which a gap of its own may put a signal off besides: the farther a factor is from any
that a rig may have, the more."""
EARLY_S: Final = 0.005
"""From which on a position ahead of its setpoint is none that a drive has followed [R]."""
LATE_S: Final = 0.005
LIKE_LATE: Final = 0.7
"""Share of a residual that must be lateness before it is called so: friction comes late a little too."""
DRIFT: Final = 3e-4
SUREST: Final = 1e-9
"""s/s: no drift is known better, though the twin answer to the last digit."""


@dataclass(frozen=True, slots=True)
class Finding:
    """Something about the data that the reader must know."""

    severity: Literal["error", "warning", "info"]
    subject: str
    """Signal, actuator or run."""
    text: str
    belongs: Any = None
    """What belongs into the rig file at the key `subject`, one for each actuator where the key is theirs."""


def fewer(every: int) -> Finding:
    """Said of a record of which one answer in `every` is judged."""
    return Finding(
        "info", "drives",
        f"answers come so often that one in {every} of each signal is judged, for each costs time",
    )  # fmt: skip


def refuse(findings: Iterable[Finding]) -> None:
    """IdentificationError with all errors among `findings`, if there are any."""
    errors = [f"{f.subject}: {f.text}" for f in findings if f.severity == "error"]
    if errors:
        raise IdentificationError(
            "no verdict can stand on these data:\n" + "\n".join(f"  {e}" for e in errors)
        )


def check_runs(runs: Sequence[Run], rig: RigFile) -> list[Finding]:
    """The tables by themselves: rig, signals that are missing, holes, stuck and clipped values, motion."""
    coarse = _coarse(runs)
    return [
        f for run in runs
        for f in (*_whole(run, rig), *_motion(run, rig), *_signals(run, rig, coarse))
    ]  # fmt: skip


def _coarse(runs: Sequence[Run]) -> frozenset[str]:
    """Columns whose values, over all runs, lie in steps: where one is coarse, a signal stays on it. Those
    that stay on one throughout are asked beside the twin whether they may (`check_answers`)."""
    columns = dict.fromkeys(str(c) for run in runs for c in run.table.columns if c != "t")
    pooled = {
        c: np.concatenate([_values(run, c) for run in runs if c in run.table.columns])
        for c in columns
    }
    return frozenset(
        c for c, x in pooled.items() if step_of(x) is not None or (is_still(x) and x[0] != 0.0)
    )


def _whole(run: Run, rig: RigFile) -> list[Finding]:
    name, out = run.path.name, []
    if run.meta.rig != rig.name:
        out.append(
            Finding("error", name, f"is a run of the rig {run.meta.rig!r}, not of {rig.name!r}")
        )
    if run.damage is not None:
        out.append(Finding("warning", name, f"the recording is damaged: {run.damage}"))
    if run.rig is not None and run.rig.name == rig.name:
        mine, own = rig.model_dump(), run.rig.model_dump()
        parts = ("geometry", "mass", "actuators", "bus", "imu", "noise")
        differing = [k for k in parts if mine[k] != own[k]]
        if differing:
            out.append(
                Finding(
                    "warning", name,
                    f"the rig file kept with the run differs in {', '.join(differing)}: the gap is that "
                    "of the file given, not of the one that ran",
                )
            )  # fmt: skip
    columns = set(map(str, run.table.columns))
    for a in rig.actuator_names:
        if f"{a}.force" not in columns and f"{a}.current" not in columns:
            text = "no force and no current is recorded: closed loops hide friction and load from positions"
            out.append(Finding("warning", a, text))
    return out


def _motion(run: Run, rig: RigFile) -> list[Finding]:
    out = []
    kind = "setpoint" if run.meta.mode == "position" else "position"
    for a in rig.actuators:
        told = _values(run, f"{a.name}.{kind}")
        if len(told) < 2:
            continue
        if float(np.ptp(told)) < 2.0 * LOOSE:
            out.append(
                Finding("warning", a.name, "never moved: friction and load there cannot be judged")
            )
        elif float(np.ptp(told)) < 0.02 * (a.stroke[1] - a.stroke[0]):
            out.append(
                Finding("info", a.name, f"moved by {1e3 * float(np.ptp(told)):.3g} mm or mrad only")
            )
        low, high = a.stroke
        beyond = max(low - float(told.min()), float(told.max()) - high)
        if beyond > 0.01 * (high - low):
            out.append(
                Finding("warning", a.name, f"goes {beyond:.4g} beyond its stroke {low:g}..{high:g}: "
                        "is it the rig file of this rig?")
            )  # fmt: skip
    if run.duration_s < SHORT_S:
        out.append(
            Finding("warning", run.path.name, f"lasts {run.duration_s:.3g} s: too short to tell slow "
                    "effects, intervals will be wide")
        )  # fmt: skip
    return out


def _signals(run: Run, rig: RigFile, coarse: Collection[str]) -> list[Finding]:
    out: list[Finding] = []
    for column in map(str, run.table.columns):
        if column == "t" or column.startswith("cue."):
            continue
        there = run.table[column].notna().to_numpy()
        t = run.table["t"].to_numpy(dtype=float)[there]
        values = run.table[column].to_numpy(dtype=float)[there]
        if len(t) < 20:
            out.append(Finding("warning", column, f"holds {len(t)} samples: it is not judged"))
            continue
        out += _holes(column, t)
        if not column.endswith("setpoint"):
            if column not in coarse:
                out += _stuck(run, rig, column, t, values)
            out += _clipped(rig, column, values)
    return out


def _holes(column: str, t: Array) -> list[Finding]:
    steps = np.diff(t)
    k = int(np.argmax(steps))
    if steps[k] <= max(HOLE_S, 10.0 * float(np.median(steps))):
        return []
    text = f"no sample from {t[k]:.3f} to {t[k + 1]:.3f} s; what happened there is not judged"
    return [Finding("warning", column, text)]


def _stuck(run: Run, rig: RigFile, column: str, t: Array, values: Array) -> list[Finding]:
    """A sensor that repeats itself, though it is noisy or what it measures moves."""
    place, _, rest = column.partition(".")
    quantity = rest.partition("_")[0]
    changes = np.flatnonzero(np.diff(values) != 0.0)
    edges = np.concatenate([[-1], changes, [len(values) - 1]])
    k = int(np.argmax(np.diff(edges)))
    first, last = int(edges[k]) + 1, int(edges[k + 1])
    if last - first < STUCK:
        return []
    spread, step = sensor_noise(rig, quantity)
    told = _during(run, f"{place}.setpoint", t[first], t[last])
    if not must_move(quantity, told, spread, step):
        return []  # at rest
    share = (t[last] - t[first]) / max(t[-1] - t[0], 1e-9)
    text = f"stands at {values[first]:.6g} from {t[first]:.3f} to {t[last]:.3f} s"
    if quantity == "position":
        text += " while its setpoint moves"
    return [Finding("error" if share > 0.5 else "warning", column, f"{text}: is the sensor stuck?")]


def _clipped(rig: RigFile, column: str, values: Array) -> list[Finding]:
    """Many samples at exactly the largest or smallest value, and values well inside it besides."""
    span = float(np.ptp(values))
    _, step = sensor_noise(rig, column.partition(".")[2].partition("_")[0])
    if span <= 50.0 * step:
        return []
    out = []
    for end in (float(values.max()), float(values.min())):
        at = np.abs(values - end) <= 1e-9 * max(abs(end), 1.0)
        runs = np.diff(np.flatnonzero(np.diff(np.concatenate([[0], at.astype(np.int8), [0]]))))[::2]
        if at.mean() > FLAT_SHARE and int(runs.max()) >= 5:
            a = next((x for x in rig.actuators if column == f"{x.name}.force"), None)
            limit = a is not None and abs(end) > 0.97 * a.force_max
            why = "the drive's largest force" if limit else "it looks clipped"
            out.append(
                Finding("warning", column, f"{100.0 * at.mean():.2g} % of samples stand at exactly "
                        f"{end:.6g}: {why}")
            )  # fmt: skip
    return out


def check_answers(problem: Problem) -> list[Finding]:
    """Each signal beside the twin: factor, sign, delay, and clocks that drift apart."""
    predicted = problem.predict(problem.base)[0]
    out: list[Finding] = []
    drifts: dict[str, list[tuple[float, float]]] = {"drives": [], "imu": []}
    for x in problem.series:
        kept = problem.kept[x.part]
        if kept.sum() < 50:
            continue
        t = problem.t_s[x.part][kept]
        m, p = problem.measured[x.part][kept], predicted[x.part][kept]
        sigma = sensor_sigma(problem.rig, x)
        if p.std() < 10.0 * sigma or m.std() == 0.0:
            continue
        found = _factor(problem, x, m, p)
        if found is not None:
            out.append(found)
            continue
        ahead = _ahead_of_setpoint(problem, x, t, m)
        if ahead is not None:
            out.append(ahead)
            continue
        late, drift, sd, share = _lateness(t, m, p)
        if np.corrcoef(m, p)[0, 1] > ALIKE:
            group = "imu" if x.actuator == "imu" else "drives"
            drifts[group].append((drift, sd))
            if abs(late) > LATE_S and share > LIKE_LATE:
                word = "later" if late > 0.0 else "earlier"
                text = f"comes {1e3 * abs(late):.1f} ms {word} than the twin says"
                out.append(Finding("warning", x.signal, text))
    out += [f for group, values in drifts.items() for f in _drift(group, values)]
    return out + [f for s in problem.signals for f in _still(problem, s, predicted)]


def _still(problem: Problem, signal: str, predicted: Array) -> list[Finding]:
    """What a signal that stays on one value may be, as far from it as the twin says it should go."""
    mine = np.concatenate([np.r_[x.part] for x in problem.series if x.signal == signal])
    values = problem.measured[mine]
    quantity = signal.partition(".")[2].partition("_")[0]
    spread, own = sensor_noise(problem.rig, quantity)
    if not is_still(values) or not must_move(quantity, predicted[mine], spread, own):
        return []
    value = float(values[0])
    step = step_around(value, values - predicted[mine], spread)
    text = f"stands at {value:.6g} throughout"
    if step is None:
        return [Finding("error", signal, f"{text}: is the sensor stuck?")]
    text += f", as in steps of {step:.3g} or more; a sensor that is stuck there looks the same"
    return [Finding("warning", signal, text)]


def _ahead_of_setpoint(problem: Problem, x: Series, t: Array, m: Array) -> Finding | None:
    """A position ahead of its own setpoint all the time: one whose clock drifts is so at one end only."""
    sent = problem.sent[x.stretch]
    if x.quantity != "position" or sent.mode != "position":
        return None
    told = np.interp(t, *sent.setpoints[x.actuator])
    late, drift, _, share = _lateness(t, m, told)
    least = -(late + 0.5 * abs(drift) * (t[-1] - t[0]))
    if least < EARLY_S or share < LIKE_LATE or np.corrcoef(m, told)[0, 1] < ALIKE:
        return None
    return Finding(
        "error", x.signal,
        f"comes {-1e3 * late:.1f} ms before its own setpoint: are the columns exchanged, or their clocks "
        "not the same?",
    )  # fmt: skip


def _factor(problem: Problem, x: Series, m: Array, p: Array) -> Finding | None:
    a, b = m - m.mean(), p - p.mean()
    alike = float(a @ b / np.sqrt((a @ a) * (b @ b)))
    gain = float(a @ b / (b @ b))
    if alike < AGAINST and x.quantity != "accel" and not _swings(problem, x, m):
        return Finding(
            "error", x.signal,
            f"moves against the twin (correlation {alike:.2f}): is its sign that of the rig file?",
        )  # fmt: skip
    if alike > ALIKE:
        for factor, most, question in FACTORS:
            if abs(np.log(gain / factor)) < most:
                text = f"is {gain:.4g} times what the twin says: {question}"
                return Finding("error", x.signal, text)
    return None


def _swings(problem: Problem, x: Series, m: Array) -> bool:
    """Whether a force that is read elsewhere within a cycle of the bus does not move against `m`: a drive's
    force swings both ways within each, and at which instant of it one is read no rig file tells exactly."""
    if x.quantity not in ("force", "current"):
        return False
    kept, at = problem.kept[x.part], problem.table.index(x.signal + LATENCY)
    rows = np.tile(problem.base, (len(WITHIN), 1))
    rows[:, at] += np.array(WITHIN) * problem.rig.bus.cycle
    others = problem.answers(rows)[:, x.part][:, kept]
    return any(np.corrcoef(m, p)[0, 1] > 0.0 for p in others if np.all(np.isfinite(p)))


def _lateness(t: Array, m: Array, p: Array) -> tuple[float, float, float, float]:
    """(s late, s/s drift, its standard deviation, share of the residual that both are) of `m` against `p`:
    the residual on -dp/dt."""
    slope = np.gradient(p, t)
    X = np.stack([-slope, -slope * (t - t.mean()), np.ones_like(t)], axis=1)
    found, *_ = np.linalg.lstsq(X, m - p, rcond=None)
    left = m - p - X @ found
    # neighbours depend on each other: a tenth of the samples counts
    cov = np.linalg.pinv(X.T @ X) * float(left @ left) / len(t) * 10.0
    share = 1.0 - float(left.var() / max((m - p).var(), 1e-300))
    sd = max(float(np.sqrt(cov[1, 1])), SUREST)
    return float(found[0]), float(found[1]), sd, share


def _drift(group: str, values: Sequence[tuple[float, float]]) -> list[Finding]:
    if not values:
        return []
    weights = np.array([1.0 / sd**2 for _, sd in values])
    mean = float(np.average([d for d, _ in values], weights=weights))
    if abs(mean) < DRIFT or abs(mean) < 5.0 / np.sqrt(weights.sum()):
        return []
    word = "fast" if mean > 0.0 else "slow"
    text = f"stamps run {1e6 * abs(mean):.0f} ppm {word} against the setpoints' clock"
    return [Finding("warning", group, text)]


def _values(run: Run, column: str) -> Array:
    if column not in run.table.columns:
        return np.empty(0)
    values = run.table[column].to_numpy(dtype=float)
    return np.asarray(values[~np.isnan(values)])


def _during(run: Run, column: str, start_s: float, end_s: float) -> Array:
    if column not in run.table.columns:
        return np.empty(0)
    t = run.table["t"].to_numpy(dtype=float)
    part = run.table[column].to_numpy(dtype=float)[(t >= start_s) & (t <= end_s)]
    return np.asarray(part[~np.isnan(part)])
