"""From runs to a frequency response with all that is known about it: noise, distortion, model, delay.

Where the cue is the input and a coordinate of the measured pose the output, the response is a chain:
what the daemon makes of the cue (shaping and platform filter, up to the setpoints), then the drives.
Each link has a response of its own; with the drives' part taken from the rig file, the filter is told
from the measured pose alone.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Final, Literal

import numpy as np
from numpy.typing import NDArray

from hil.config import RigFile
from hil.errors import IdentificationError
from hil.identify.frequency.bla import Distortion, best_linear, distortion, merge_repeats
from hil.identify.frequency.channels import Channel, Posed, Sampled, channel, shift_s
from hil.identify.frequency.in_step import in_step
from hil.identify.frequency.known import command_response, drives_response
from hil.identify.frequency.local_polynomial import local_response
from hil.identify.frequency.parametric import SecondOrderFit, fit_second_order
from hil.identify.frequency.periodic import line_count, spectra
from hil.identify.frequency.response import FrequencyResponse
from hil.identify.frequency.windows import Window, measuring_windows
from hil.runs import Run

Array = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]
Choice = Literal["auto", "periodic", "local"]

FOLLOWED: Final = 0.998
"""Coherence of cue and setpoints above which the daemon did not hold the cue back."""
STILL: Final = 1.0e-4
"""A cue below this share of its coordinate's limit does not count as moved."""


@dataclass(frozen=True, slots=True)
class FrfAnalysis:
    """What runs tell about one input and output."""

    rig: str
    runs: tuple[str, ...]
    reference: str
    """The cue that noise cannot reach."""
    response: FrequencyResponse
    period_s: float | None = None
    """None where the record does not repeat."""
    periods: tuple[int, ...] = ()
    """Of each realisation."""
    distortion: Distortion | None = None
    links: Mapping[str, FrequencyResponse] = field(default_factory=dict)
    """"cue to setpoints" and "setpoints to pose", where the response is this chain."""
    fits: Mapping[str, SecondOrderFit] = field(default_factory=dict)
    """Second order and delay: "whole" for all that lies between input and output; "filter by setpoints" and
    "filter by measured pose" for what is left when shaping, and the rig file's drives, are taken off."""
    notes: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class _Record:
    """The channels of one run."""

    name: str
    reference: Channel
    input: Channel
    output: Channel


def analyse(
    runs: Sequence[Run],
    rig: RigFile,
    *,
    input_name: str | None = None,
    output_name: str | None = None,
    period_s: float | None = None,
    highest_hz: float | None = None,
    method: Choice = "auto",
) -> FrfAnalysis:
    """Response of `output_name` to `input_name` over `runs` of one design.

    Defaults: the cue that moves most, and the measured pose of its coordinate. Several runs are
    realisations of one multisine, or repeats. `period_s` is found where it is not given; `method` "auto"
    takes records that do not repeat by the local polynomial method. IdentificationError says what is
    wrong with the runs for this question and what to do.
    """
    if not runs:
        raise IdentificationError("no run is given")
    moved = _moved(runs[0], rig, output_name)
    output_name = output_name or moved
    input_name = input_name or f"cue.{moved}"
    reference = input_name if input_name.startswith("cue.") else f"cue.{moved}"
    records = []
    for run in runs:
        r = channel(run, rig, reference if reference in run.table.columns else input_name)
        u = r if input_name == r.name else channel(run, rig, input_name)
        records.append(_Record(run.path.name, r, u, channel(run, rig, output_name)))
    windows = [
        ()
        if method == "local"
        else measuring_windows(run, r.reference, (r.input, r.output), period_s)
        for run, r in zip(runs, records, strict=True)
    ]
    chain = _is_chain(runs, rig, input_name, output_name)
    unlike = next((k for k, w in enumerate(windows) if not w), None)
    if unlike is None:
        found = _periodic(records, windows, highest_hz)
    elif method == "periodic" or len(records) > 1:
        raise IdentificationError(
            f"{records[unlike].name}: {records[unlike].reference.name} is not periodic: no part of it "
            "repeats twice after settling; analyse it alone with the local polynomial method, or play a "
            "multisine"
        )
    else:
        found = _not_periodic(records[0], highest_hz)
    links: dict[str, FrequencyResponse] = {}
    between: list[Channel] = []
    if chain:
        between = [channel(run, rig, f"setpoint.{output_name}") for run in runs]
        first = [
            _Record(r.name, r.reference, r.input, s) for r, s in zip(records, between, strict=True)
        ]
        last = [
            _Record(r.name, r.reference, s, r.output) for r, s in zip(records, between, strict=True)
        ]
        for name, part in (("cue to setpoints", first), ("setpoints to pose", last)):
            if unlike is None:
                links[name] = _periodic(part, windows, highest_hz).response
            else:
                links[name] = _not_periodic(part[0], highest_hz).response
    held = _held_back(links.get("cue to setpoints"))
    wanted = [("whole", found.response, _derivative(found.response))]
    if chain:
        wanted += _filter_fits(rig, output_name, found.response, links, records[0], between[0])
    fits, notes = _fits(wanted)
    return FrfAnalysis(
        rig.name,
        tuple(r.name for r in records),
        records[0].reference.name,
        found.response,
        found.period_s,
        found.periods,
        found.distortion,
        links,
        fits,
        (*found.response.notes, *found.notes, *held, *in_step(rig, records[0].output), *notes),
    )


@dataclass(frozen=True, slots=True)
class _Found:
    response: FrequencyResponse
    period_s: float | None = None
    periods: tuple[int, ...] = ()
    distortion: Distortion | None = None
    notes: tuple[str, ...] = ()


_Wanted = tuple[str, FrequencyResponse, ComplexArray | None]
"""Name of a fit, response, known factor."""


def _periodic(
    records: Sequence[_Record], windows: Sequence[Sequence[Window]], highest_hz: float | None
) -> _Found:
    pairs = [(r, w) for r, several in zip(records, windows, strict=True) for w in several]
    period_s = pairs[0][1].period_s
    count = min(line_count((r.reference, r.input, r.output), period_s, highest_hz) for r in records)
    all_spectra = [spectra(w, r.reference, r.input, r.output, count) for r, w in pairs]
    realisations = merge_repeats(all_spectra, [r.name for r, _ in pairs])
    response = best_linear(realisations, records[0].input, records[0].output)
    return _Found(
        response,
        period_s,
        tuple(s.window.periods for s in realisations),
        distortion(realisations, response, records[0].output),
    )


def _not_periodic(record: _Record, highest_hz: float | None) -> _Found:
    response = local_response(record.reference, record.input, record.output, highest_hz)
    note = "not periodic: nonlinear distortion cannot be told from noise"
    return _Found(response, notes=(note,))


def _moved(run: Run, rig: RigFile, output_name: str | None) -> str:
    """The coordinate that is meant: the output's, or the one whose cue uses most of its limit."""
    if output_name in rig.coordinates:
        return str(output_name)
    uses = {
        c: float(np.nanmax(np.abs(run.table[f"cue.{c}"]))) / limit
        for c, limit in zip(rig.coordinates, rig.limits, strict=True)
        if f"cue.{c}" in run.table.columns
    }
    if not uses:
        raise IdentificationError(
            f"{run.path.name}: holds no cue; name input and output, such as leg1.setpoint and leg1.position"
        )
    best = max(uses, key=lambda c: uses[c])
    if uses[best] < STILL:
        raise IdentificationError(f"{run.path.name}: no cue moved; there is nothing to respond to")
    return best


def _is_chain(runs: Sequence[Run], rig: RigFile, input_name: str, output_name: str) -> bool:
    return (
        input_name == f"cue.{output_name}"
        and output_name in rig.coordinates
        and all(f"{a}.setpoint" in r.table.columns for r in runs for a in rig.actuator_names)
    )


def _held_back(asked: FrequencyResponse | None) -> tuple[str, ...]:
    """A note where setpoints do not follow the cue linearly: they owe nothing to noise."""
    if asked is None or float(np.median(asked.coherence)) > FOLLOWED:
        return ()
    return (
        "the daemon held the cue back (coherence of cue and setpoints "
        f"{float(np.median(asked.coherence)):.3f}): it asks for more than the cue limits allow; lower it",
    )


def _filter_fits(
    rig: RigFile,
    coordinate: str,
    whole: FrequencyResponse,
    links: Mapping[str, FrequencyResponse],
    record: _Record,
    setpoints: Channel,
) -> list[_Wanted]:
    """The platform filter by setpoints and by the measured pose: with what stands beside it known."""
    cue, asked = record.reference, links["cue to setpoints"]
    if not isinstance(cue, Sampled) or not isinstance(setpoints, Posed):
        return []
    slots = setpoints.parts[0].t_s - shift_s(rig, setpoints.parts[0].name)

    def command(hz: Array) -> ComplexArray:
        return command_response(rig, coordinate, hz, cue.t_s, slots)

    speeds = np.array([_moving_rms(part) for part in setpoints.parts])
    drives = drives_response(rig, coordinate, whole.hz, speeds if speeds.all() else None)
    return [
        ("filter by setpoints", asked, command(asked.hz)),
        ("filter by measured pose", whole, command(whole.hz) * drives),
    ]


def _moving_rms(position: Sampled) -> float:
    """Root mean square speed while it moves, m/s."""
    speed = np.gradient(position.value, position.t_s)
    moving = np.abs(speed) > 0.0
    return float(np.sqrt(np.mean(speed[moving] ** 2))) if moving.any() else 0.0


def _fits(wanted: Sequence[_Wanted]) -> tuple[dict[str, SecondOrderFit], tuple[str, ...]]:
    """The models, and what could not be fitted, as notes."""
    fits, notes = {}, []
    for name, response, known in wanted:
        try:
            fits[name] = fit_second_order(response, known)
        except IdentificationError as error:
            notes.append(f"no model for {name}: {error}")
    return fits, tuple(notes)


def _derivative(response: FrequencyResponse) -> ComplexArray | None:
    """What turns the model of a position into one of speed or acceleration, by the units of the gain."""
    output, _, input_ = response.unit.rpartition("/")
    order = output.endswith("/s") + 2 * output.endswith("/s²")
    order -= input_.endswith("/s") + 2 * input_.endswith("/s²")
    return None if order == 0 else np.asarray((2j * np.pi * response.hz) ** order)
