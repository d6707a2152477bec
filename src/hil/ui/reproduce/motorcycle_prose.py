"""What the pages about the motorcycle platform say in words."""

from __future__ import annotations

from typing import Final

from hil.ui.reproduce.prose import F, M, Prose, R

PAPER: Final = "Parameters Identification for Motorcycle Simulator's Platform Characterization"

OPENING: Final = f"""<p>The experiments of the paper, played on the simulated motorcycle platform of
<code>configs/motorcycle.toml</code> through the whole daemon: cue shaping, controller, gate, CAN
frames, simulated CDD3000 drives, recorder. “Measured” means here: what the simulated drives answered
over the bus, with their sampling, delays, noise and quantisation, and with friction and rotor
inertia, which the paper's model does not have.</p>
<p>None of the paper's curves can be read off: text and captions are available, the plots' scales are
not. Nor are its geometry, masses, gains or motor data published. Those in the rig file are
reconstructed so that they fit together {R}, or general knowledge of such drives {M}. So this page can
show whether the paper's <i>methods</i> do what it says, and in which direction its comparisons go; it
cannot confirm any of its numbers.</p>"""

BUS: Final = Prose(
    "Figure 3 · what is on the bus",
    """<p>How frames follow each other on the CAN bus. Legible: initialisation is a frame with
identifier 0DD; the error of a leg at its limit comes with 1B9; position, velocity, torque and phase
current share one parameter channel of low priority, so no two of them are had at once; a request with
its response takes a fixed 10 ms, position and torque together 20 ms.</p>""",
    """<p>The candump log of figure 6's servo-loop run, decoded frame by frame with the drive file's
layout; 42 ms of it are drawn. Hover a frame to read it.</p>""",
    f"""<p>The paper's 20 ms for position and torque are what any scheme on this channel gets: one
pair a drive in 10 ms, the quantities in turn. (Its text counts 10 ms for each single frame; then two
requests and two responses would need 40 ms. Only a pair in 10 ms agrees with its 20 ms.) Here the
slots of the three drives are staggered, so that their pairs do not meet, and every sample keeps its
own instant. Identifiers 0DD and 1B9 are the paper's; the others are those of the drive's manual {F}.
The bytes of the error frame were found nowhere: they are a setting of the drive file.</p>""",
)

STEP: Final = Prose(
    "Figure 5 · a step of 1 cm of one leg",
    """<p>Measured displacement of a leg for a step of 1 cm, with the servocontroller's own loops (VC,
pre-control off) and with computed torque (CT). Computed torque is judged better; the loops in the
drive are judged good enough for riding, and they save delays and computing time. Axes are not
legible.</p>""",
    """<p>The same 1 cm of leg 1 through the daemon, four ways: position setpoints to the drives' own
cascade (VC), force setpoints by the model (CT), a P/PI cascade closed by the daemon over the bus, and
VC with the drives' pre-control. The step is as quick as the cue limits allow, with a smooth rise: a
rig that carries a person jumps nowhere.</p>""",
    f"""<p>Computed torque leaves {{torque:.3f}} mm RMS, the drives' loops {{servo:.3f}} mm:
{{ratio:.1f}} times as much, in the direction that the paper reports. The drives' P loop lags by its
speed over k<sub>p</sub>; the model knows the acceleration beforehand and need not wait for an error.
Pre-control closes most of the gap inside the drive, as the paper expects of it. The same loops closed
by the daemon pay for every bus delay with bandwidth: the paper's reason to leave them where they are.
How large each difference is depends on gains and friction that are reconstructed {R}; only the order
is to be compared.</p>""",
)

CHIRP: Final = Prose(
    "Figure 6 · a chirp, under both controllers",
    """<p>Measured displacement of the legs for a sine of rising frequency: (a) computed torque, (b)
the servocontroller's loops. Computed torque is said to allow more bandwidth. The range that matters
for cues of acceleration and braking is given as 3–5 Hz. Axes are not legible.</p>""",
    """<p>A sine of {size:.1f} mrad in pitch (as many mm of each leg), rising from 0.2 to {high:g} Hz,
in the same four modes. The response is estimated from cue and measured pose by the local polynomial
method, with nothing known of the controller.</p>""",
    f"""<p>Over the chirp computed torque leaves {{torque:.3f}} mm RMS, the drives' loops
{{servo:.3f}} mm. The paper's “more bandwidth” shows here as lag: both keep the amplitude up to 5 Hz,
where a cascade with k<sub>p</sub> = 80 1/s {M} is not yet at its limit, but the cascade is
{{servo_ms}} ms late at 3 Hz and computed torque {{torque_ms}} ms. A slower cascade, as the
daemon's own shows, loses amplitude too. The paper's gains are not published, so how far its two
curves should part cannot be told.</p>""",
)

TORQUE: Final = Prose(
    "Figure 7 · the torque of a leg during that chirp",
    """<p>Torque of a leg as the servocontroller reports it over CAN, for the chirp of figure 6. Axes
are not legible.</p>""",
    """<p>The force that leg 1's drive reports, every 20 ms in turn with its position, in the
servo-loop run of figure 6; shown as torque of its motor by the screw's 5 mm lead and its efficiency.
Beside it what three models say: two of the mechanism for the commanded motion, and the twin, which
replays the setpoints through the drives' loops too (drawn where it is large).</p>""",
    f"""<p>The motor gives up to {{peak:.2f}} N·m, {{mean:.2f}} N·m of it to carry the platform:
inside what a 60 mm, 4500 rpm servomotor has {M}. The paper calls the dynamics of the legs negligible.
On a 5 mm screw they are not: a rotor of 0.3·10⁻⁴ kg m² {M} is worth {{rotor:.0f}} kg at the leg.</p>
<p>No model of the mechanism explains this torque, with rotors and friction ({{whole:.0f}} % of its
spread are left) or without ({{body:.0f}} %). The drive follows a polygon of setpoints, a straight
line every {{cycle:.0f}} ms; at each corner its speed loop gives a pulse of torque, and as drives are
asked in step with the setpoints, every sample catches that pulse at the same point. Only a model with
the drives' loops and the bus's timing has it: the twin leaves {{twin:.0f}} %. Whoever identifies from
such torques, as the paper did, books the pulses as inertia and friction; see figure 8.</p>""",
)

ADAPTING: Final = Prose(
    "Figure 8 · identified mass and inertias",
    """<p>m, I1, I2 and I3 over time as the adaptive gradient law (36) finds them, each degree of
freedom driven alone so that the inertia matrix is excited element by element; gains set by trial;
velocity and acceleration by numerical derivation. The values reached are not legible, and no interval
is given.</p>""",
    """<p>Yaw, pitch and roll, each in a chirp of its own (0.3–3 Hz, 70 % of the cue limits). The law
starts from zero and runs over the three records one after another, four times. <i>Platform alone</i>:
four unknowns, as in the paper. <i>Projected</i>: on the three degrees of freedom, so that the
constraint forces are gone (in (34) they stand among the unknowns, and they are not constant), rotor
masses taken off, friction of each actuator estimated along. Derivatives are those of one zero-phase
filter; in one column they are plain differences of the samples. <i>Less bias</i>: the twin replays
the runs with known parameters, and what the estimator gets wrong there is taken off. Least squares
has that correction, and its 95 % intervals know of it.</p>""",
    f"""<p>m comes at once, from gravity. Each inertia comes only while its coordinate moves, one
after another, which is what driving one degree of freedom at a time makes visible. With the paper's
four unknowns the law converges smoothly, and to wrong values: rotors, friction and the torque pulses
of figure 7 are booked as inertia of the platform (I2 {{wrong:.0f}} instead of {{right:.0f}} kg m²). A
smooth curve is no sign of a right number. With the projected form and friction among the unknowns the
pulses alone are left, and are worth {{bias:.0f}} kg m² in I2. The twin knows them: with that taken
off the law comes to {{law:.0f}} kg m², least squares to {{least:.0f}}; the law's gains make it slow
where unknowns look alike, here I2 and the legs' friction. The law says nothing of its uncertainty;
least squares does ({{held}} of its four 95 % intervals hold the true value here; of many, one in twenty
may miss), and finds the friction too: {{friction}}. The true values are our own
reconstruction {R}: this tests the method, and says nothing of the paper's platform. Largest step of
the law: {{worst:.2f}} of the 2 at which it turns unstable.</p>""",
)
