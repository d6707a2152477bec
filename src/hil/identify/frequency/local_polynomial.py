"""Frequency responses of records that do not repeat: the local polynomial method.

Response and leakage are smooth along frequency. Around each line of the discrete Fourier transform both
are taken as parabolas and fitted to the lines nearby; what is left is noise and tells the uncertainty
(Schoukens et al., "Identification of linear systems with nonlinear distortions", and Pintelon and
Schoukens [M]). Unlike averaged, windowed segments this needs no choice of a window and has no leakage
bias. In a closed loop input and output are both fitted to the reference, and divided.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from hil.errors import IdentificationError
from hil.identify.frequency.channels import Channel
from hil.identify.frequency.periodic import HIGHEST_HZ, RATE_SHARE, check_seen
from hil.identify.frequency.response import FrequencyResponse, ratio_variance

Array = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]

ORDER: Final = 2
FEWEST_SIDE: Final = 6
"""Lines used on either side, at least: 13 for six unknowns leave seven degrees of freedom."""
RESOLUTION_HZ: Final = 0.15
"""Long records have more lines within this on either side [R]: a parabola follows platforms over it."""
SPLINE_SHARE: Final = 0.25
"""Up to this share of the sampling rate a cubic spline between samples errs by under 1 % [V]."""
POWER: Final = 1.0e-5
"""Lines where the reference has less than this share of its strongest power say nothing."""
FEWEST_LINES: Final = 3


def local_response(
    reference: Channel, input_: Channel, output: Channel, highest_hz: float | None
) -> FrequencyResponse:
    """Response over the whole time that all channels share, at lines so far apart that they share no data.

    IdentificationError where the record is too short, or the motion is lost in noise.
    """
    channels = (reference, input_, output)
    start, end = max(c.span_s[0] for c in channels), min(c.span_s[1] for c in channels)
    slowest = min(c.rate_hz for c in channels)
    size = int((end - start) * slowest)
    if size < 8 * FEWEST_SIDE:
        raise IdentificationError(
            f"{input_.name} to {output.name}: {max(end - start, 0.0):.2f} s of record are too short"
        )
    t = start + np.arange(size) / slowest
    limit = min(SPLINE_SHARE * slowest, highest_hz or HIGHEST_HZ, RATE_SHARE * slowest)
    hz = np.asarray(np.fft.rfftfreq(size, 1.0 / slowest), dtype=np.float64)
    r, u, y = (np.fft.rfft(c.at(t) - np.mean(c.at(t))) / size for c in channels)
    side = max(FEWEST_SIDE, round(RESOLUTION_HZ / hz[1]))
    power = np.convolve(np.abs(r) ** 2, np.ones(2 * side + 1) / (2 * side + 1), mode="same")
    lines = np.arange(side + 1, len(hz) - side, 2 * side + 1)
    lines = lines[(hz[lines] <= limit) & (power[lines] > POWER * power.max())]
    if len(lines) < FEWEST_LINES:
        raise IdentificationError(
            f"{input_.name} to {output.name}: {reference.name} tells {len(lines)} independent lines in "
            f"{end - start:.1f} s, {FEWEST_LINES} are the fewest that make a response: record longer, or "
            "move with more frequencies"
        )
    fits = np.array([_fit(r, np.stack([u, y]), int(k), side) for k in lines])
    gu, gy, var_u, var_y, cov, linear = fits.T
    std = np.sqrt(ratio_variance(gy, gu, var_y.real, var_u.real, cov))
    seen = (np.abs(gu) > 3.0 * np.sqrt(var_u.real)) & (np.abs(gy) > 3.0 * np.sqrt(var_y.real))
    notes = check_seen(seen, hz[lines], input_.name, output.name)
    return FrequencyResponse(
        input_.name,
        output.name,
        f"{output.unit}/{input_.unit}",
        "local polynomial",
        hz[lines][seen],
        (gy / gu)[seen],
        std[seen],
        np.full(int(seen.sum()), float(_freedom(side))),
        linear.real[seen],
        notes,
    )


def _freedom(side: int) -> int:
    return 2 * side + 1 - 2 * (ORDER + 1)


def _fit(r: ComplexArray, both: ComplexArray, line: int, side: int) -> ComplexArray:
    """At one line: responses of input and output to the reference, their variances and covariance,
    and the share of the output near it that is linear."""
    near = slice(line - side, line + side + 1)
    offset = np.arange(-side, side + 1) / side
    powers = offset[:, None] ** np.arange(ORDER + 1)
    rows = np.hstack([powers * r[near, None], powers])
    scale = np.linalg.norm(rows, axis=0)
    scale[scale == 0.0] = 1.0
    q, triangle = np.linalg.qr(rows / scale)
    target = both[:, near].T
    x = np.linalg.lstsq(triangle, q.conj().T @ target, rcond=1e-10)[0] / scale[:, None]
    left = target - rows @ x
    noise = left.conj().T @ left / _freedom(side)
    first = np.linalg.pinv(rows.conj().T @ rows, rcond=1e-12, hermitian=True)[0, 0].real
    total = float(np.sum(np.abs(target[:, 1]) ** 2))
    linear = 1.0 - float(np.sum(np.abs(left[:, 1]) ** 2)) / total if total > 0.0 else 0.0
    covariance = noise[0, 1]
    return np.array(
        [x[0, 0], x[0, 1], first * noise[0, 0], first * noise[1, 1], first * covariance, linear],
        dtype=complex,
    )
