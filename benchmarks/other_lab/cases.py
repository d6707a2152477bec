"""Cases: which rig, which runs, which effect of which size, and the folders that hold them."""

from __future__ import annotations

import hashlib
import json
import shutil
import zlib
from datetime import UTC, datetime, timedelta

import numpy as np

from benchmarks.other_lab import record
from benchmarks.other_lab.motions import KINDS, motion
from benchmarks.other_lab.outside import FAULTS
from benchmarks.other_lab.recipes import RECIPES, Base, names_for
from benchmarks.other_lab.severity import Yardstick
from benchmarks.other_lab.world import World

BLOCK = ("null",) * 3 + ("single",) * 4 + ("pair",) + ("outside",) * 2
"""What ten cases in a row are, in an order drawn for each ten."""
SINGLES, OUTSIDE = BLOCK.count("single"), BLOCK.count("outside")
ALIKE = (
    {"payload_mass", "actuator_inertia", "force_constant"},
    {"coulomb_friction", "asymmetric_friction", "hysteresis", "sensor_bias"},
    {"transport_delay", "sensor_latency", "loop_gain", "clock_drift"},
)
"""Effects of which no two act together in a case: their sum says nothing about its parts."""
ATTEMPTS = 5
LEAST = 0.7
"""Severity below which an effect is not said to be there."""
EPOCH = datetime(2026, 2, 2, 8, 0, tzinfo=UTC)


def _number(*what):
    return zlib.crc32("/".join(str(w) for w in what).encode())


def role_of(rig_name, seed, index):
    """(what case `index` is, its number among those of its sort in this rig and seed)."""
    block, place = divmod(index, len(BLOCK))
    order = np.random.default_rng([_number("block", rig_name), seed, block]).permutation(len(BLOCK))
    sorts = [BLOCK[k] for k in order]
    return sorts[place], block * BLOCK.count(sorts[place]) + sorts[:place].count(sorts[place])


def _deck(rig_name, names, seed, stride, number):
    """Card `number` of a shuffled deck of names; another seed goes on `stride` cards later."""
    order = np.random.default_rng(_number("deck", rig_name, len(names))).permutation(len(names))
    return names[order[((seed - 1) * stride + number) % len(names)]]


class Invisible(Exception):
    """The runs drawn for a case do not excite its effect."""


def draw_case(rig, seed, index, stride):
    """The case, drawn again with other runs where its effect would not show."""
    for attempt in range(ATTEMPTS):
        try:
            return Draft(rig, seed, index, stride, attempt)
        except Invisible as reason:
            last = reason
    raise last


class Draft:
    """Everything that is drawn for one case before its folders are written."""

    def __init__(self, rig, seed, index, stride, attempt=0):
        self.rig, self.id = rig, f"{rig.name}-{seed}-{index:03d}"
        self.rng = np.random.default_rng([_number("case", rig.name), seed, index, attempt])
        self.sort, number = role_of(rig.name, seed, index)
        self.world = World(rig, self.rng)
        recipes = self._recipes(seed, stride, number)
        self._plan_runs([r for _, r in recipes])
        self.yardstick = Yardstick(
            self.world, [p for p, ref in zip(self.plans, self.reference, strict=True) if not ref]
        )
        self.chosen = [self._sized(name, recipe) for name, recipe in recipes]

    def _recipes(self, seed, stride, number):
        names = names_for(self.world.kind)
        if self.sort == "null":
            return []
        if self.sort == "outside":
            name = _deck(
                self.rig.name,
                list(FAULTS),
                seed,
                max(round(stride * OUTSIDE / len(BLOCK)), 1),
                number,
            )
            return [(name, FAULTS[name])]
        share = SINGLES if self.sort == "single" else 1
        name = _deck(self.rig.name, names, seed, max(round(stride * share / len(BLOCK)), 1), number)
        if self.sort == "single":
            return [(name, RECIPES[name])]
        while True:
            first, second = (str(x) for x in self.rng.choice(names, 2, replace=False))
            if not any({first, second} <= alike for alike in ALIKE):
                return [(first, RECIPES[first]), (second, RECIPES[second])]

    def _plan_runs(self, recipes):
        rng = self.rng
        count = int(rng.integers(2, 5))
        kinds = [str(k) for k in rng.permutation(KINDS)[:count]]
        calibrated = any(r.calibrated for r in recipes)
        healthy = int(rng.integers(count)) if rng.random() < 0.45 or calibrated else -1
        diagnosed = [k for k in range(count) if k != healthy]
        for r in recipes:  # at least one diagnosed motion that the effect can show in
            if not any(kinds[k] in r.motions for k in diagnosed):
                kinds[int(rng.choice(diagnosed))] = str(rng.choice(r.motions))
        self.reference = [k == healthy for k in range(count)]
        with_imu = rng.random() < 0.7 or any(r.imu for r in recipes)
        self.plans = []
        for kind in kinds:
            t, poses = motion(rng, self.world, kind, float(rng.uniform(8.0, 25.0)))
            self.plans.append(
                record.plan_run(self.world, kind, t, poses, with_imu, int(rng.integers(2**31)))
            )

    def _base(self):
        """What the healthy rig does, for limits that have to bite."""
        speed, peak, median, heat = [], [], [], []
        for i, name in enumerate(self.rig.actuator_names):
            forces = [h[f"{name}.force"] for h in self.yardstick.healthy]
            everything = np.abs(np.concatenate(forces))
            rates = [
                np.abs(np.gradient(record.setpoints(self.world, p)[:, i], p.t)).max()
                for p in self.plans
            ]
            speed.append(max(rates))
            peak.append(everything.max())
            median.append(np.median(everything))
            warm = np.concatenate(
                [
                    record.mean_square(f, self.rig.bus.cycle * len(self.rig.bus.pattern))
                    for f in forces
                ]
            )
            heat.append(np.sqrt(np.quantile(warm, 0.67)))
        return Base(np.array(speed), np.array(peak), np.array(median), np.array(heat))

    def _sized(self, name, recipe):
        """(candidate, size, ratio): drawn again where the runs do not show enough of it."""
        base = self._base()
        wanted = float(self.rng.choice((1.0, 3.0, 10.0), p=(0.1, 0.5, 0.4)))
        found = None
        for _ in range(4):
            candidate = recipe.draw(self.rng, self.world, base)
            size, ratio = self.yardstick.fit(candidate, wanted)
            if found is None or abs(np.log(max(ratio, 1e-9) / wanted)) < abs(
                np.log(max(found[2], 1e-9) / wanted)
            ):
                found = (candidate, size, ratio)
            if 0.6 < found[2] / wanted < 1.7:
                break
        if found[2] < LEAST:
            raise Invisible(f"{self.id}: {name} does not show in these runs")
        return found

    def hurt(self):
        """The rig with all effects of the case."""
        setup = self.world.setup
        for candidate, size, _ in self.chosen:
            setup = candidate.apply(self.world, setup, size)
        return setup

    def answer(self):
        """The contract's answer, with rig and severity for marks by them."""
        verdict = {"null": "no_gap", "outside": "unknown"}.get(self.sort, "identified")
        effects = []
        if verdict == "identified":
            effects = [
                {"effect": c.effect, "location": c.location, "parameters": c.parameters(s)}
                for c, s, _ in self.chosen
            ]
        severity = max((ratio for _, _, ratio in self.chosen), default=0.0)
        return {
            "verdict": verdict,
            "effects": effects,
            "rig": self.rig.name,
            "severity": round(severity, 3),
        }

    def notes(self):
        """What the answer has no room for: sizes over the floor, motions, the outside fault's name."""
        return {
            "sort": self.sort,
            "effects": [
                {"effect": c.effect, "location": c.location, "size": s, "severity": r}
                for c, s, r in self.chosen
            ],
            "ratios": self.yardstick.ratios(self.hurt()) if self.chosen else {},
            "floor": self.yardstick.floor,
            "motions": [p.kind for p in self.plans],
            "reference": self.reference,
        }


def write_case(draft, rig_file, out):
    """cases/<id>/ with its runs, answers/<id>/ with answer and notes."""
    case, answers = out / "cases" / draft.id, out / "answers" / draft.id
    for folder in (case, answers):
        shutil.rmtree(folder, ignore_errors=True)
        folder.mkdir(parents=True)
    shutil.copy(rig_file, case / "rig.toml")
    sealed = json.dumps(draft.answer(), indent=1).encode()
    (answers / "answer.json").write_bytes(sealed)
    (answers / "notes.json").write_text(json.dumps(draft.notes(), indent=1))
    hurt = draft.hurt()
    started = EPOCH + timedelta(minutes=int(draft.rng.integers(100_000)))
    for k, (plan, healthy) in enumerate(zip(draft.plans, draft.reference, strict=True)):
        setup = draft.world.setup if healthy else hurt
        clean = record.read(draft.world, setup, plan, record.play(draft.world, setup, plan))
        folder = case / f"run{k + 1}"
        folder.mkdir()
        record.table(draft.world, setup, plan, clean).to_parquet(
            folder / "signals.parquet", index=False
        )
        at = (started + timedelta(minutes=3 * k)).strftime("%Y-%m-%dT%H:%M:%SZ")
        (folder / "run.toml").write_text(
            f'format = "hil-run/1"\nrig = "{draft.rig.name}"\nmode = "position"\nstarted = {at}\n'
            f'note = "{plan.kind}"\nrole = "{"reference" if healthy else "diagnose"}"\n'
            f'answer_sha256 = "{hashlib.sha256(sealed).hexdigest()}"\n'
        )
