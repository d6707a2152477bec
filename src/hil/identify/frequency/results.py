"""Analyses as plain values for JSON: complex numbers as gain and phase, nothing that is not a number."""

from __future__ import annotations

import cmath
import math
from dataclasses import asdict
from typing import Any

from hil.identify.frequency.agard import AgardAnalysis
from hil.identify.frequency.bla import Distortion
from hil.identify.frequency.frf import FrfAnalysis
from hil.identify.frequency.parametric import SecondOrderFit
from hil.identify.frequency.response import FrequencyResponse

FRF_FORMAT = "hil-frf/1"
AGARD_FORMAT = "hil-agard/1"


def frf_json(a: FrfAnalysis) -> dict[str, Any]:
    """A frequency response analysis; SI, frequencies in Hz, phases in degrees."""
    return {
        "format": FRF_FORMAT,
        "rig": a.rig,
        "runs": list(a.runs),
        "reference": a.reference,
        "period_s": a.period_s,
        "periods": list(a.periods),
        "response": _response(a.response),
        "links": {name: _response(r) for name, r in a.links.items()},
        "fits": {name: _fit(f) for name, f in a.fits.items()},
        "distortion": None if a.distortion is None else _distortion(a.distortion),
        "notes": list(a.notes),
    }


def agard_json(a: AgardAnalysis) -> dict[str, Any]:
    """The AGARD measures; what no sensor told is null."""
    return {
        "format": AGARD_FORMAT,
        "rig": a.rig,
        "excursions": [asdict(e) for e in a.excursions],
        "sines": [
            {
                **{k: _number(v) for k, v in asdict(s).items() if k != "describing"},
                "gain": abs(s.describing),
                "phase_deg": math.degrees(cmath.phase(s.describing)),
                "noise": s.noise,
                "noise_ratio": s.noise_ratio,
            }
            for s in a.sines
        ],
        "thresholds": [{k: _number(v) for k, v in asdict(t).items()} for t in a.thresholds],
        "notes": list(a.notes),
    }


def _number(value: Any) -> Any:
    return None if isinstance(value, float) and not math.isfinite(value) else value


def _response(r: FrequencyResponse) -> dict[str, Any]:
    return {
        "input": r.input_name,
        "output": r.output_name,
        "unit": r.unit,
        "method": r.method,
        "hz": r.hz.tolist(),
        "real": r.value.real.tolist(),
        "imag": r.value.imag.tolist(),
        "gain_db": r.gain_db.tolist(),
        "phase_deg": r.phase_deg.tolist(),
        "std": r.std.tolist(),
        "radius95": r.radius.tolist(),
        "coherence": r.coherence.tolist(),
        **{f"std_{part}": x.tolist() for part, x in r.extra_std.items()},
    }


def _fit(f: SecondOrderFit) -> dict[str, Any]:
    return {
        "parameters": {
            name: {"value": e.value, "ci": list(e.interval), "unit": e.unit, "is_told": e.is_told}
            for name, e in f.parameters.items()
        },
        "low_frequency_delay_s": f.low_frequency_delay_s,
        "misfit": f.misfit,
    }


def _distortion(d: Distortion) -> dict[str, Any]:
    return {
        "output": d.output_name,
        "unit": d.unit,
        "hz": d.hz.tolist(),
        "linear": d.linear.tolist(),
        "noise": d.noise.tolist(),
        "nonlinear": None if d.nonlinear is None else d.nonlinear.tolist(),
        "lines": [
            {
                "kind": x.kind,
                "hz": x.hz.tolist(),
                "level": x.level.tolist(),
                "noise": x.noise.tolist(),
                "distortion": x.distortion,
                "floor": x.floor,
                "is_seen": x.is_seen,
            }
            for x in d.lines
        ],
    }
