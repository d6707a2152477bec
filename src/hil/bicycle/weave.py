"""The weave of a bicycle that was struck: how it dies away at each speed, against the model's eigenvalues.

A lateral impulse makes a riderless bicycle weave; its lean rate then is a damped oscillation whose decay and
frequency are one eigenvalue of the linear model under its own control. Measured over speed they are a test
of the model that needs no IMU and no kinematics.

The bicycle of "Model Matching Control Applied to Bicycles" (TU Delft) steers into its lean by a torque of
K (v_top - v) times the lean rate; a second law may match another bicycle: u = F x + G u'. Both are known to
the digit, speeds come from its own sensor.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy.optimize import OptimizeWarning, curve_fit

from hil.errors import IdentificationError, RunError
from hil.rigs.bicycle import Canonical
from hil.runs.jsonfile import read_json

Array = NDArray[np.float64]

LONGEST_FIT: Final = 50_000
"""Evaluations of a damped oscillation."""
NEEDED_R2: Final = 0.9
"""Share of the variance that it must explain to be a weave at all."""
RIDDEN_M_S: Final = 1.0
"""Above which a logged speed counts as ridden."""
GUESSED: Final = 5
"""Numbers of a damped oscillation: as many as a guess has, and fewer than a window has rows."""
LOGGED: Final = ("lean_rate", "speed")


@dataclass(frozen=True, slots=True)
class Window:
    """The stretch of a log after an impulse."""

    file: str
    speed: float
    """Of the treadmill, m/s."""
    start: int
    stop: int
    guess: tuple[float, ...]
    """1/s, rad/s and three amplitudes."""
    group: str
    """What was switched on."""


@dataclass(frozen=True, slots=True)
class Impulse:
    """The weave after one impulse."""

    window: Window
    weave: complex
    """1/s."""
    r2: float
    log_speed: float
    """By the bicycle's own sensor, m/s."""


@dataclass(frozen=True, slots=True)
class SteerControl:
    """What steers a riderless bicycle, by its own speed sensor."""

    gain: float = 0.0
    """N m s/rad for each m/s below `top`."""
    top: float = 0.0
    matching: Mapping[str, Array] | None = None
    """Speeds (S,), F (S, 2, 4) and G (S, 2, 2) of the second law; None where it is off."""

    def feedback(self, speed: float) -> Array:
        """(2, 4) from (lean, steer, rates), to the right, to lean and steer torque."""
        K = np.zeros((2, 4))
        K[1, 2] = self.gain * (self.top - speed)
        if self.matching is None:
            return K
        F, G = (_at(self.matching["speeds"], self.matching[k], speed) for k in ("F", "G"))
        return np.asarray(F + G @ K)


def _at(speeds: Array, table: Array, speed: float) -> Array:
    flat = table.reshape(len(speeds), -1)
    return np.array([np.interp(speed, speeds, c) for c in flat.T]).reshape(table.shape[1:])


def read_windows(path: Path) -> list[Window]:
    """From JSON: a list of {file, speed_mps, start, stop, p0, set}; RunError where it is none."""
    rows = read_json(path)
    try:
        windows = [
            Window(
                str(r["file"]), float(r["speed_mps"]), int(r["start"]), int(r["stop"]),
                tuple(float(x) for x in r["p0"]), str(r.get("set", "")),
            )
            for r in rows
        ]  # fmt: skip
    except (ValueError, KeyError, TypeError) as error:
        raise RunError(f"{path}: is no list of windows: {error!r}") from error
    for w in windows:
        if len(w.guess) != GUESSED or not np.all(np.isfinite((*w.guess, w.speed))):
            raise RunError(
                f"{path}: window {w.start} to {w.stop} of {w.file}: p0 must be {GUESSED} numbers and "
                "speed_mps one"
            )
    return windows


def read_matching(path: Path) -> dict[str, Array]:
    """The second law from .npz: speeds_mps, mm_gains/F, mm_gains/G; RunError where it is none."""
    try:
        found = np.load(path)
        keys = (("speeds", "speeds_mps"), ("F", "mm_gains/F"), ("G", "mm_gains/G"))
        law = {k: np.asarray(found[name], dtype=np.float64) for k, name in keys}
    except (OSError, EOFError, ValueError, KeyError, IndexError) as error:
        raise RunError(f"{path}: holds no gains over speed: {error}") from error
    count = len(np.atleast_1d(law["speeds"]))
    wanted = {"speeds": (count,), "F": (count, 2, 4), "G": (count, 2, 2)}
    for (k, shape), (_, name) in zip(wanted.items(), keys, strict=True):
        if law[k].shape != shape:
            raise RunError(f"{path}: {name} is {law[k].shape}, not {shape}")
    return law


def fit_impulses(windows: Sequence[Window], logs: Path, rate_hz: float = 100.0) -> list[Impulse]:
    """Fit the weave in each window of the logs (CSV, also .gz) below `logs`.

    RunError where a log lacks lean_rate or speed, IdentificationError where a window holds no weave.
    """
    tables: dict[str, pd.DataFrame] = {}
    out = []
    for w in windows:
        if w.file not in tables:
            tables[w.file] = _log(logs / w.file)
        table = tables[w.file]
        if not 0 <= w.start < w.stop <= len(table):
            raise RunError(
                f"{logs / w.file}: has {len(table)} rows, a window asks for {w.start} to {w.stop}"
            )
        rate = table["lean_rate"].to_numpy()[w.start : w.stop]
        try:
            weave, r2 = fit_weave(rate, 1.0 / rate_hz, w.guess)
        except IdentificationError as error:
            raise IdentificationError(f"{w.file}: rows {w.start} to {w.stop}: {error}") from error
        if not r2 >= NEEDED_R2:
            raise IdentificationError(
                f"{w.file}: rows {w.start} to {w.stop} are no damped oscillation (R² {r2:.2f})"
            )
        speed = table["speed"].to_numpy()
        ridden = speed[speed > RIDDEN_M_S]
        logged = float(np.median(ridden)) if ridden.size else float("nan")
        out.append(Impulse(w, weave, r2, logged))
    return out


def _log(path: Path) -> pd.DataFrame:
    try:
        table = pd.read_csv(path)
    except (OSError, EOFError, ValueError) as error:
        raise RunError(f"{path}: cannot be read: {error}") from error
    missing = [c for c in LOGGED if c not in table]
    if missing:
        raise RunError(f"{path}: has no column {', '.join(missing)}")
    try:
        return table[list(LOGGED)].astype(float)
    except ValueError as error:
        raise RunError(f"{path}: column {' or '.join(LOGGED)}: {error}") from error


def fit_weave(rate: Array, dt_s: float, guess: Sequence[float]) -> tuple[complex, float]:
    """Eigenvalue (1/s, imaginary part positive) of a lean rate (N,) that dies away, and R² of the fit.

    IdentificationError where no fit is found.
    """
    if len(rate) <= GUESSED or not np.all(np.isfinite(rate)):
        raise IdentificationError(
            f"no damped oscillation fits: {np.isfinite(rate).sum()} of {len(rate)} rows are numbers, more "
            f"than {GUESSED} are needed and none may be missing"
        )
    t = np.asarray(dt_s * np.arange(len(rate)), dtype=np.float64)

    def wave(t: Array, s: float, o: float, c: float, a: float, b: float) -> Array:
        return np.asarray(c + np.exp(s * t) * (a * np.cos(o * t) + b * np.sin(o * t)))

    try:
        p = curve_fit(wave, t, rate, guess, maxfev=LONGEST_FIT)[0]
    except (RuntimeError, OptimizeWarning) as error:
        raise IdentificationError(f"no damped oscillation fits: {error}") from error
    left = rate - wave(t, *p)
    spread = float(np.var(rate))
    return complex(p[0], abs(p[1])), 1.0 - float(np.var(left)) / spread if spread else 0.0


def model_weave(
    linear: Canonical,
    speed: float,
    control: SteerControl,
    *,
    near: complex,
    read_speed: float | None = None,
    steer_friction: float = 0.0,
    motor: float = 1.0,
    encoder: float = 1.0,
) -> complex:
    """The model's oscillating eigenvalue nearest to `near` (1/s), under its control.

    `read_speed`: what the control takes the speed for; `steer_friction` N m s/rad; `motor` and `encoder`:
    true over told steer torque, told over true steer angle.
    """
    feedback = control.feedback(speed if read_speed is None else read_speed)
    feedback[:, [1, 3]] *= encoder
    feedback[1] *= motor
    feedback[1, 3] -= steer_friction
    found = np.linalg.eigvals(linear.state_matrix(speed) + linear.input_matrix() @ feedback)
    waves = found[found.imag > 1e-6]
    if not waves.size:  # it has stopped to oscillate: its slowest real root is as near as it comes
        return complex(found[np.argmin(np.abs(found - near.real))].real, 0.0)
    return complex(waves[np.argmin(np.abs(waves - near))])


def distance(measured: complex, model: complex) -> float:
    """Mean of the differences of real and imaginary part, 1/s."""
    return 0.5 * (abs(measured.real - model.real) + abs(measured.imag - model.imag))


def by_speed(speeds: Sequence[float], values: Sequence[float]) -> float:
    """Mean over speeds of the mean at each: speeds count alike, however often the bicycle was struck."""
    table = pd.DataFrame({"speed": speeds, "value": values})
    return float(table.groupby("speed")["value"].mean().mean())


def speed_reading(impulses: Sequence[Impulse]) -> tuple[float, float]:
    """Gain and offset (m/s) of the bicycle's speed sensor against the treadmill: logged = gain v + offset.

    IdentificationError with fewer than three speeds.
    """
    pairs = {(i.window.file, i.window.speed): i.log_speed for i in impulses}
    true = np.array([v for _, v in pairs])
    told = np.array(list(pairs.values()))
    if len(set(true.tolist())) < 3 or not np.all(np.isfinite(told)):
        raise IdentificationError("a speed sensor's gain needs logs at three speeds or more")
    gain, offset = np.polyfit(true, told, 1)
    return float(gain), float(offset)


def table_of(impulses: Sequence[Impulse], model: Sequence[complex]) -> list[dict[str, Any]]:
    """By speed: how many impulses, the measured weave's mean and spread, the model's mean."""
    rows = []
    for v in sorted({i.window.speed for i in impulses}):
        seen = np.array([i.weave for i in impulses if i.window.speed == v])
        told = np.array([m for i, m in zip(impulses, model, strict=True) if i.window.speed == v])
        rows.append(
            {
                "speed": v, "impulses": len(seen),
                "decay": float(seen.real.mean()), "decay_sd": float(seen.real.std()),
                "frequency": float(seen.imag.mean()), "frequency_sd": float(seen.imag.std()),
                "model_decay": float(told.real.mean()), "model_frequency": float(told.imag.mean()),
            }
        )  # fmt: skip
    return rows
