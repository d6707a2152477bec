"""What the page about the bicycle says in words."""

from __future__ import annotations

from typing import Final

from hil.ui.reproduce.prose import F, Prose, R

PAPER: Final = (
    "Validation of multibody modeling and simulation using an instrumented bicycle: from the computer to "
    "the road"
)

OPENING: Final = f"""<p>The paper's ride, on the simulated bicycle of <code>{{rig}}</code>: 50 m straight, a
U-turn, 50 m back, another, and stop where it began; lean, rear wheel and steer at 100 Hz, an IMU beside.
The paper's own records are not to be had. What it names as the causes of its two disagreements is put into
the simulated bicycle, and only there: a front suspension of {{fork:g}} kN/m and tyres of {{tyre:g}} kN/m on
a road that is uneven by {{road:g}} mm {R}. The model that is held against it has neither, as the paper's.
So shapes and orders of size are compared, never digits.</p>"""

PATH: Final = Prose(
    "Figure 5 · path",
    """<p>The computed trace of the rear wheel does not close, though the bicycle was brought back to its
start. The paper blames the time integration and asks for a better rule or a shorter step.</p>""",
    """<p>The same ride, integrated as the paper does and ten times finer through the same samples; and with
one step of the steer encoder (0.15°), a degree of lean and a percent of wheel radius more. The animation is
in the page of <code>hil bicycle analyse</code>.</p>""",
    """<p>The path ends {end:.2f} m from its start. Integration moves that end by {integration:.3g} mm, one
step of the steer encoder by {steer:.2f} m, a degree of lean by {lean:.2f} m, a percent of radius by
{radius:.2f} m. So it is not the integration: a better rule changes nothing, a better zero of the steer
encoder nearly all.{closing}</p>""",
)

RATES: Final = Prose(
    "Figure 6 · pitch rate and yaw rate",
    """<p>Yaw rate of model and gyroscope agree very well, pitch rate very poorly. The paper names the front
suspension of the bicycle ridden, which its model has not.</p>""",
    """<p>Model without suspension, gyroscope of the bicycle with it; both through the ride's filter, and raw
in pale.</p>""",
    """<p>Yaw rate: {yaw:.4f} rad/s rms apart, {yaw_explained:.1f} % of it explained. Pitch rate: {pitch:.4f}
rad/s apart, {pitch_explained:.0f} % explained; the true pitch rate is {larger:.1f} times as large as the
model's. That is the paper's picture.</p>""",
)

ACCELERATIONS: Final = Prose(
    "Figure 7 · forward and vertical acceleration",
    """<p>Forward acceleration agrees, though not as well as the yaw rate; the paper blames noise of second
derivatives and leaves filtering to the reader. Vertical acceleration is much smaller in the model than on the
road, perhaps for the tyres and the bodies' flexibility.</p>""",
    """<p>The same, with the filter that the paper leaves out: both sides through the ride's own
low-pass.</p>""",
    """<p>Forward: {forward:.3f} m/s² rms apart raw, {forward_soft:.3f} filtered. What is left of it comes
from the suspension too: a diving frame tilts the sensor in gravity. Vertical: measured
{vertical_seen:.2f} m/s² rms, model {vertical_model:.2f}.</p>""",
)

TORQUES: Final = Prose(
    "Figure 8 · steer torque and pedalling torque",
    """<p>Steer torque from its multiplier; pedalling torque from its multiplier and from the reduced inertia,
12.17 kg m² in print, which agree.</p>""",
    f"""<p>The same multipliers. The reduced inertia of the paper's Table 1 by its own formula is 11.708 kg m²
{F}; drag, which the paper's check leaves out, is added to it. Below stands a torque that the paper does not
show: lean torque, which must be zero, because nobody pushes a free bicycle from outside.</p>""",
    """<p>Pedalling torque {drive:.1f} N m rms; the reduced inertia is off by {off:.2f} N m. Lean torque left:
{lean:.1f} N m rms; the sensors' noise alone leaves {noise:.1f}.</p>""",
)

FORCES: Final = Prose(
    "Figures 9 and 10 · forces on the road, friction demand",
    """<p>Normal and transverse force of the front wheel, and the friction that front and rear wheel ask
for.</p>""",
    """<p>The same, and the rear wheel's.</p>""",
    """<p>Front normal force {low:.0f} to {high:.0f} N about {mean:.0f} N. Friction demand: front
{front:.2f}, rear {rear:.2f} at most.</p>""",
)

GAP: Final = Prose(
    "Beyond the paper · what the model lacks",
    """<p>The paper stops at naming the two effects; finding and adding them it leaves open.</p>""",
    """<p><code>hil gap diagnose</code> on this ride and a slalom, which no fit saw; then the effect put into
the rig file by <code>hil gap apply</code>, and the slalom analysed again.</p>""",
    """<p>{sentence} On the slalom the pitch rate is off by {before:.4f} rad/s rms before and {after:.4f}
after. {tyres}</p>""",
)

WEAVE: Final = Prose(
    "A measured bicycle · its weave over speed",
    """<p>Not in the paper: the riderless bicycle of "Model Matching Control Applied to Bicycles" on its
treadmill, struck {count} times. Its authors tried five causes of what separates it from its model by hand;
they leave 0.718 → 0.634 (friction), 0.423 (parameters), 0.641 (speed sensor), 0.648 (motor), 0.718
(encoder).</p>""",
    """<p>The weave after each impulse against the model's eigenvalues under the bicycle's own control; each
cause fitted to every second impulse and judged by the others.</p>""",
    """<p>{sentence} The speed sensor, against the treadmill: {gain:.4f} v {offset:+.4f} m/s. All
{count} impulses are off by {whole:.3f} 1/s from the nominal model, 0.718 by its authors, who take a
logarithmic decrement at 1.5 m/s. What they set by hand is fitted here and judged on impulses not seen: hence
other digits, the same order at the top.</p>""",
)
