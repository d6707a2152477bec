"""How large an effect is: its own trace on the signal that it touches most, over that signal's floor."""

from __future__ import annotations

import math

import numpy as np

from benchmarks.other_lab import record

STEPS = 7
CLOSE = 0.12


class Yardstick:
    """Healthy traces and floors of a case's diagnosed runs."""

    def __init__(self, world, plans):
        self.world, self.plans = world, plans
        self.healthy = [self._values(world.setup, p) for p in plans]
        again = [self._values(world.setup, p, chance=1) for p in plans]
        disturbed = [record.noise(world, p) for p in plans]
        self.floor = {}
        for name in plans[0].stamps:
            repeat = 0.5 * _square(
                h[name] - a[name] for h, a in zip(self.healthy, again, strict=True)
            )
            quantity = name.split(".")[-1].split("_")[0]
            step = getattr(world.rig.noise, f"{quantity}_step")
            measured = _square(d[name] for d in disturbed)
            self.floor[name] = math.sqrt(repeat + measured + step * step / 12.0)

    def _values(self, setup, plan, chance=0):
        truth = record.play(self.world, setup, plan, chance)
        return record.read(self.world, setup, plan, truth)

    def ratios(self, setup):
        """Trace over floor of every signal of the rig `setup` against the healthy one."""
        hurt = [self._values(setup, p) for p in self.plans]
        out = {}
        for name, floor in self.floor.items():
            trace = _square(h[name] - s[name] for h, s in zip(hurt, self.healthy, strict=True))
            out[name] = math.sqrt(trace) / floor
        return out

    def fit(self, candidate, target):
        """(size, ratio) at which `candidate` comes nearest to `target`; ratio 0 where it cannot be played."""
        size, best = candidate.start, (candidate.start, 0.0)
        below, above = None, None
        for _ in range(STEPS):
            try:
                setup = candidate.apply(self.world, self.world.setup, size)
                ratio = max(self.ratios(setup).values())
            except FloatingPointError:
                ratio = math.inf
            if abs(math.log(max(ratio, 1e-9) / target)) < abs(
                math.log(max(best[1], 1e-9) / target)
            ):
                best = (size, ratio)
            if abs(ratio / target - 1.0) < CLOSE:
                break
            if ratio < target:
                below = size
            else:
                above = size
            if below is not None and above is not None:
                size = math.sqrt(below * above)
            else:
                size *= min(max(target / max(ratio, 1e-6), 0.15), 6.0)
            size = min(max(size, candidate.low), candidate.high)
            if size in (below, above):
                break
        return best


def _square(parts):
    """Mean square of all parts together."""
    return float(np.mean(np.concatenate([np.square(p) for p in parts])))
