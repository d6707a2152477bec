"""What the pages about the Stewart platform say in words."""

from __future__ import annotations

from typing import Final

from hil.ui.reproduce.prose import Prose, R

PAPER: Final = "Towards Simulating a Mid-size Stewart Platform on a Large Hexapod Simulator"

OPENING: Final = f"""<p>The experiments of the paper on the simulated platform of
<code>configs/stewart_pd.toml</code>, through the whole daemon: cue shaping, platform filter, CAN
frames, drives with the paper's force law, recorder. In the text of the paper that is to be had the
digits 0 to 4 are lost everywhere (“.5” may be 0.5, 0.25, 0.05 …), and no plot has legible scales.
Geometry, masses and gains of the rig file are reconstructed: consistent with every digit that is
left, and not the only ones that are {R}.</p>
<p>“Measured” is the simulated rig, which has what the model that is fitted to it lacks: friction and
hysteresis in the legs, rotor masses of {{rotor:g}} kg a leg, sampling, jitter and noise. For this
page three things of the rig file are changed. Its IMU samples at another rate (figure 2 says why).
Its encoders get the 0.6 µm that the paper's specifications name. And its friction becomes small,
{{coulomb:g}} N Coulomb and {{hysteresis:g}} N of hysteresis a leg instead of {{file:g}} N: the paper's
scheme lives from a static following error of (1 − K_s) F / K_p, which is about 10 µm with K_p =
{{k_p:g}} kN/m {R}, and {{file:g}} N of friction would bury it under {{buried:.0f}} µm. That the paper
could see both means that its legs rub less, or are held stiffer, than our reconstruction would have
it.</p>"""

FILTER: Final = Prose(
    "Figure 2 · describing function in heave",
    f"""<p>Gain (dB) and phase (°) over frequency (rad/s) of the platform in heave: the analytic
filter of equation (1) as a line, and points measured with two multisines of five and six lines by the
IMU. The points lie close to the line when the delay is taken as “5 ms” with a digit lost; 35 ms fits
{R}. The filter has two equal poles; its printed coefficients fit 10 Hz and no other frequency of the
surviving digits.</p>""",
    """<p>Two multisines in heave with five and six lines up to {highest:g} Hz, {periods} periods of each.
The response from cue to pose is taken by the encoders (forward kinematics) and by the vertical
accelerometer; what the daemon's shaping and the drives add is known and taken off. Two equal poles, a
delay and a gain are fitted; nothing of the true values enters. Bars are 95 %.</p>""",
    f"""<p>The filter comes back: {{frequency:.2f}} Hz and {{delay:.2f}} ms between cue and recorded
setpoints. By encoders the delay is {{pose:.1f}} ms: {{clock:.1f}} ms of it are the drives' own. They
play setpoints on their own clock, which starts somewhere within the jitter of the first frame and
keeps that phase for the whole run; no rig file can know it, and a measured pose cannot part it from
the filter's delay. Whoever reads 35 ms off such a figure, as the paper does, reads the sum. The IMU
needs no kinematics, but its noise shows at low frequency, where there is little acceleration, as the
paper remarks of its deviations. Its gain is off by {{imu_gain:+.1f}} % when it samples {{imu_hz:g}}
times a second, and by {{locked_gain:+.1f}} % at {{locked_hz:g}}: drives draw straight lines between
setpoints, so that all acceleration comes in pushes at their corners, a hundred a second, and a sensor
whose clock is a multiple of theirs meets every push at the same place. No filter after the sampling
can take that off; another rate of samples does. That the 10 Hz are right the surviving digits of the
coefficients show; the 35 ms of the real platform cannot be confirmed: that value was put in, because
it agrees with the digit that is left {R}.</p>""",
)

DIAGRAM: Final = Prose(
    "Figure 4 · the model",
    """<p>A block diagram: references of the legs q_ref, error e, PD controller K_p + K_d, forces of
the legs, platform dynamics with geometry, I_c, m_c and CoG, leg lengths q out; from the pose a
feedback of static forces K_s F_static through the Jacobian. Neither the friction of the actuators nor
their inertia is modelled.</p>""",
    """<p>Ours, as the twin and the simulated drives have it. What is drawn in blue the paper's model
has not; it can be switched off, and is for the fits below.</p>""",
    f"""<p>Equation (8) gives K_p and K_d as multiples of one K_c, with the factors damaged. Damping
on the legs' speed alone, as the words around (8) may be read, would make the platform lag by K_d /
K_p, {{lag:.0f}} ms with any set of factors near these; so it acts on the speed error {R}. K_p = 10
K_c and K_d = 0.8 s K_c are one realisable set {R}. K_s = 0.997 is legible.</p>""",
)

CIRCLE: Final = Prose(
    "Figure 5 · a circle",
    """<p>(a) The trajectory of a circle in the horizontal plane with instants marked along it; (b)
length of leg 1 and its following error. Text: radius “.5 m” and time around “ s” with digits lost
(0.25 m and 40 s by the marked instants and the stroke). A static following error in all legs, laid to
the cabin's mass; peaks at the ends of travel; jumps that show hysteresis.</p>""",
    """<p>The same circle with a fade of its acceleration in and out. The following error is the
setpoint that the drive is at minus the length that it answers, at the same instant; smoothed over 0.3
s.</p>""",
    f"""<p>All three traits of the paper's error are there: an offset of {{mean:.1f}} µm, of which
statics alone explain {{static:.1f}} µm; jumps where the leg turns, {{jump:.1f}} µm between lengthening and
shortening; and a part that follows the motion. The jumps are friction over K_p: twice that of one
direction, {{friction:.1f}} µm, was put in. The model of the paper, simulated with its fitted parameters,
has offset and curvature but no jumps. The size of all this goes with 1 / K_p, of which the paper
leaves no digit {R}.</p>""",
)

CIRCLE_POSE: Final = Prose(
    "Figure 6 · pose on the circle: commanded, measured, simulated",
    """<p>Six panels, surge to yaw, over the circle: commanded pose, pose from measured leg lengths,
and pose of the model with its estimated parameters. Surge and sway agree below a millimetre; the
heave axis spans micrometres, and K_s lets the model follow its bias after settling; rotations are
very small, with their trends met.</p>""",
    """<p>Setpoints and measured lengths through forward kinematics on common instants, and the twin
of the paper's model with the values of the table below, replaying the recorded setpoints.</p>""",
    """<p>The model meets the driven axes within {surge:.1f} and {sway:.1f} µm RMS and sinks in heave
as the rig does (by {sag:.1f} µm on average): what K_s leaves unsupported. In the rotations
({roll:.2f}·10⁻³ ° RMS in roll) the measured curves have the steps of hysteresis, the simulated ones
only the trend, as the paper says of its own.</p>""",
)

YAW: Final = Prose(
    "Figure 7 · frequency sweep in yaw",
    """<p>Six panels over an exponential sweep in yaw: driven axis nearly met by the model, undriven
axes with similar trends, from which the paper concludes that the horizontal CoG is right. I_zz is “5
kg m²” with digits lost; 150 by our reading. The heave axis spans micrometres.</p>""",
    """<p>A sweep of yaw in acceleration by equations (9) and (10), with C₂ = 1/(e⁴ − 1) in full,
faded in and out. The twin has I_zz from this sweep, and all else from the circle.</p>""",
    f"""<p>The driven axis is met within {{yaw:.2f}} % of its spread. With a CoG off the axis a yaw
acceleration pushes the cabin sideways; the legs give way, and surge and sway move by {{surge:.1f}}
and {{sway:.1f}} µm, of which the model leaves {{surge_left:.1f}} and {{sway_left:.1f}} µm.
{{verdict}} The undriven axes do carry the CoG, if noise and friction are as small as these {R}. I_zz
comes out at {{moment:.1f}} ± {{half:.1f}} kg m²: see the table for what is in it.</p>""",
)

TABLE: Final = Prose(
    "The parameter table · two stages, and what they cannot tell",
    f"""<p>Estimates by grid search in two stages: m_c, K_c, x_cog, y_cog and K_s from the circle;
z_cog and the moments of inertia from one sweep an axis. m_c and K_c could not be told apart: larger
ones of both explain the data equally well, so m_c was set from the cabin's construction. z_cog showed
no clear influence and was assumed. I_xx and I_yy came out equal and are called too high by the
authors themselves. Values as far as legible stand in the table {R}.</p>""",
    """<p>The same two stages on leg lengths alone, with the paper's model (no friction, no rotors),
from a start that knows nothing (CoG at the origin, 200 kg m² each). The grid over m_c and K_c is
drawn; the mass is then taken as weighed. Beside it least squares on lengths and forces of the three
sweeps, with friction estimated and rotors known: what the drives' torque reports add.</p>""",
    f"""<p>The ridge is there: {{points}} of {{all}} grid points, with masses up to {{ratio:.1f}}-fold
apart, explain the circle as well as the best one. Lengths answer to ratios of forces only, so every
mass and gain may grow together; that is exact, and no better experiment with lengths mends it.
Weighing the cabin does, or a known payload, or forces: with the drives' torque the mass comes to ±
{{m_half:.1f}} kg. The moments of inertia of the paper's model are those of cabin <i>and</i> rotors:
at neutral our legs' rotors add {{rotor_xx:.0f}} kg m² in roll to the cabin's {{true_xx:.0f}}, and the
fit says {{xx:.0f}}; in yaw {{rotor_zz:.0f}} to {{true_zz:.0f}}, and the fit says {{zz:.0f}}. So
neglected legs make I_xx and I_yy too high, in the direction the authors suspect, but by far too
little to be the reason, unless the real legs turn much heavier rotors than ours {R}. z_cog is told to
± {{z_half:.1f}} mm by the sweeps of roll and pitch here, x_cog to ± {{x_half:.1f}} mm by the circle;
these intervals know of noise, not of what the model lacks, and hold only as far as it is right.</p>""",
)

HEAVE: Final = Prose(
    "Figure 8 · heave, which no fit has seen",
    """<p>Six panels over a part of a sinusoid in heave that was not used for the estimate: heave very
well met; undriven axes similar; in yaw hardly any motion, but a step in the measured one wherever the
actuators turn, by hysteresis, while the model has none.</p>""",
    """<p>A sinusoid in heave of 0.5 Hz, faded in and out; the twin of the paper's model with the
table's values replays its setpoints.</p>""",
    f"""<p>Heave is met within {{heave:.3f}} % of its spread ({{micro:.1f}} µm RMS): the parameters
hold beyond the data they were found on. In yaw the rig moves by {{yaw:.2f}}·10⁻³ ° in steps at the
turns, the model by {{yaw_model:.2f}}·10⁻³ °: friction that is the same in all six legs does not quite
cancel. The size of the steps is our choice of friction {R}; that they are there, and that no
parameter of this model removes them, is the paper's point.</p>""",
)
