"""Describing functions: frequency responses with uncertainty, nonlinear distortion, delay, AGARD measures.

`analyse` turns runs into a response with all that is known about it; `agard` measures sinusoids and steps.
"""

from hil.identify.frequency.agard import AgardAnalysis, agard
from hil.identify.frequency.frf import FrfAnalysis, analyse

__all__ = ["AgardAnalysis", "FrfAnalysis", "agard", "analyse"]
