"""What a rig's parameters are, from its runs: values, intervals that hold, and what the data cannot tell.

`identify` fits body and friction by least squares, instruments or the adaptive law; `identify_twin` fits
anything through the twin; `updated_rig_text` writes a rig file of it, `fit_page` shows the evidence.
"""

from hil.identify.estimate.adaptive import AdaptiveGradient, adapt, stability_bound_s
from hil.identify.estimate.fit import LinearMethod, LinearOptions, Outcome, identify
from hil.identify.estimate.fit_twin import TwinOptions, identify_twin
from hil.identify.estimate.gridsearch import grid_search
from hil.identify.estimate.outputerror import profile
from hil.identify.estimate.picture import fit_page
from hil.identify.estimate.regression import BodySet
from hil.identify.estimate.result import Estimate, Identification
from hil.identify.estimate.rigfile import updated_rig_text
from hil.identify.estimate.twinproblem import TwinProblem

__all__ = [
    "AdaptiveGradient",
    "BodySet",
    "Estimate",
    "Identification",
    "LinearMethod",
    "LinearOptions",
    "Outcome",
    "TwinOptions",
    "TwinProblem",
    "adapt",
    "fit_page",
    "grid_search",
    "identify",
    "identify_twin",
    "profile",
    "stability_bound_s",
    "updated_rig_text",
]
