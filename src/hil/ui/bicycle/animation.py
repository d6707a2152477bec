"""The ride as an animation on a canvas: points computed here, drawn by a script on the page itself."""

from __future__ import annotations

import json
from string import Template
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from hil.bicycle.analysis import Analysis

Array = NDArray[np.float64]

FRAMES_HZ: Final = 25.0
MOST_FRAMES: Final = 3000


def animation(a: Analysis) -> str:
    """HTML of the animation: play, pause, time, and a camera that follows or is turned by the mouse."""
    step = max(round(1.0 / (FRAMES_HZ * a.motion.dt_s)), 1)
    step = max(step, -(-len(a.motion.q) // MOST_FRAMES))
    q = a.motion.q[::step]
    points = _points(a, q)
    data = {
        "dt": step * a.motion.dt_s,
        "radius": [a.ride.rig.geometry.R, a.ride.rig.geometry.front_radius],
        "frames": np.round(points.reshape(len(q), -1), 4).tolist(),
        "trace": np.round(q[:, :2], 3).tolist(),
        "lean": np.round(q[:, 3], 4).tolist(),
        "steer": np.round(q[:, 6], 4).tolist(),
        "speed": np.round(a.motion.speed[::step], 3).tolist(),
    }
    return _HTML.substitute(data=json.dumps(data, separators=(",", ":")))


def _points(a: Analysis, q: Array) -> Array:
    """(N, 11, 3): centres and two spokes each of the wheels, steer axis, seat, hands, hip and head."""
    rig = a.ride.rig
    g = rig.geometry
    lean = Rotation.from_euler("ZX", q[:, [2, 3]])
    frame = lean * Rotation.from_euler("Y", q[:, 5:6])
    axis = np.array([-np.sin(g.tilt), 0.0, np.cos(g.tilt)])
    fork = frame * Rotation.from_rotvec(q[:, 6:7] * axis)
    rear = np.column_stack([q[:, 0], q[:, 1], np.zeros(len(q))]) + lean.apply([0.0, 0.0, g.R])
    foot = np.array([g.wheelbase + g.trail, 0.0, -g.R])
    centre = np.array([g.wheelbase, 0.0, g.front_radius - g.R])
    on_axis = foot + axis * (axis @ (centre - foot))

    def on_frame(x: float, y: float, z: float) -> Array:
        return np.asarray(rear + frame.apply([x, y, z]))

    def on_fork(place: Array) -> Array:
        return np.asarray(rear + frame.apply(foot) + fork.apply(place - foot))

    front = on_fork(centre)
    rolling = lean * Rotation.from_euler("Y", q[:, 4:5])
    spinning = fork * Rotation.from_euler("Y", q[:, 7:8])
    top = foot + axis * 1.08
    parts = [
        rear,
        rear + rolling.apply([g.R, 0.0, 0.0]),
        rear + rolling.apply([0.0, 0.0, g.R]),
        front,
        front + spinning.apply([g.front_radius, 0.0, 0.0]),
        front + spinning.apply([0.0, 0.0, g.front_radius]),
        on_fork(on_axis),
        on_fork(top),
        on_frame(0.28, 0.0, 0.62),
        on_frame(0.42, 0.0, -0.05),
        on_frame(0.40, 0.0, 1.12),
    ]
    return np.stack(parts, axis=1)


_HTML: Final = Template("""
<div style="position:relative">
<canvas id="ride" style="width:100%;height:460px;display:block;border-radius:8px;background:#f8fafc;cursor:grab"></canvas>
<div style="display:flex;flex-wrap:wrap;gap:4px 12px;align-items:center;margin-top:8px">
<button id="play" style="width:72px">pause</button>
<input id="time" type="range" min="0" value="0" style="flex:1 1 160px">
<label style="white-space:nowrap"><input id="follow" type="checkbox" checked> follow</label>
<span id="said" style="flex:0 0 auto;min-width:min(21em,100%);font-variant-numeric:tabular-nums;color:#475569"></span>
</div></div>
<script>
(() => {
const D = $data, N = D.frames.length;
const canvas = document.getElementById("ride"), pen = canvas.getContext("2d");
const slider = document.getElementById("time"), button = document.getElementById("play");
const said = document.getElementById("said"), follow = document.getElementById("follow");
slider.max = N - 1;
let at = 0, playing = true, azimuth = 2.3, height = 0.35, distance = 4.5, last = null;
let box = [Infinity, Infinity, -Infinity, -Infinity];
for (const [x, y] of D.trace) box = [Math.min(box[0], x), Math.min(box[1], y), Math.max(box[2], x), Math.max(box[3], y)];
const point = (f, k) => D.frames[f].slice(3 * k, 3 * k + 3);
const add = (a, b, s) => [a[0] + s * b[0], a[1] + s * b[1], a[2] + s * b[2]];
const minus = (a, b) => add(a, b, -1);
const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
let eye, right, up, ahead, zoom;
function look() {
  const r = point(at, 0), f = point(at, 3);
  let middle, far = distance;
  if (follow.checked) middle = [(r[0] + f[0]) / 2, (r[1] + f[1]) / 2, 0.75];
  else { middle = [(box[0] + box[2]) / 2, (box[1] + box[3]) / 2, 0];
         far = 1.25 * Math.max(box[2] - box[0], box[3] - box[1], 8) * distance / 4.5; }
  const c = Math.cos(height), s = Math.sin(height);
  ahead = [-Math.cos(azimuth) * c, -Math.sin(azimuth) * c, -s];
  eye = add(middle, ahead, -far);
  right = [-Math.sin(azimuth), Math.cos(azimuth), 0];
  up = [right[1] * ahead[2] - right[2] * ahead[1], right[2] * ahead[0] - right[0] * ahead[2],
        right[0] * ahead[1] - right[1] * ahead[0]];
  zoom = 1.15 * canvas.height;
}
function place(p) {
  const d = minus(p, eye), z = dot(d, ahead);
  return z < 0.05 ? null : [canvas.width / 2 + zoom * dot(d, right) / z, canvas.height / 2 - zoom * dot(d, up) / z];
}
function line(points, colour, width) {
  pen.strokeStyle = colour; pen.lineWidth = width * devicePixelRatio; pen.beginPath();
  let begun = false;
  for (const p of points) { const s = place(p);
    if (!s) { begun = false; continue; }
    begun ? pen.lineTo(s[0], s[1]) : pen.moveTo(s[0], s[1]); begun = true; }
  pen.stroke();
}
function wheel(c, a, b, colour) {
  const u = minus(a, c), v = minus(b, c), rim = [];
  for (let k = 0; k <= 48; k++) { const w = k * Math.PI / 24; rim.push(add(add(c, u, Math.cos(w)), v, Math.sin(w))); }
  line(rim, colour, 3);
  for (let k = 0; k < 5; k++) { const w = k * 2 * Math.PI / 5; line([c, add(add(c, u, Math.cos(w)), v, Math.sin(w))], "#94a3b8", 1); }
}
function draw() {
  const w = Math.round(canvas.clientWidth * devicePixelRatio), h = Math.round(canvas.clientHeight * devicePixelRatio);
  if (canvas.width !== w || canvas.height !== h) { canvas.width = w; canvas.height = h; }
  pen.clearRect(0, 0, w, h); pen.lineCap = pen.lineJoin = "round"; look();
  const wide = follow.checked ? 1 : Math.max(1, Math.ceil(Math.max(box[2] - box[0], box[3] - box[1]) / 24));
  const r = point(at, 0), reach = follow.checked ? 12 : 16 * wide;
  const cx = follow.checked ? Math.round(r[0]) : Math.round((box[0] + box[2]) / 2);
  const cy = follow.checked ? Math.round(r[1]) : Math.round((box[1] + box[3]) / 2);
  for (let k = -reach; k <= reach; k += wide) {
    line(Array.from({length: 9}, (_, i) => [cx + k, cy - reach + i * reach / 4, 0]), "#e2e8f0", 1);
    line(Array.from({length: 9}, (_, i) => [cx - reach + i * reach / 4, cy + k, 0]), "#e2e8f0", 1);
  }
  line(D.trace.map(p => [p[0], p[1], 0]), "#cbd5e1", 1.5);
  line(D.trace.slice(0, at + 1).map(p => [p[0], p[1], 0]), "#d55e00", 2);
  const p = k => point(at, k), flat = v => [v[0], v[1], 0];
  line([flat(p(0)), flat(p(3))], "rgba(15,23,42,0.25)", 6);
  wheel(p(0), p(1), p(2), "#0f172a"); wheel(p(3), p(4), p(5), "#0f172a");
  const lower = p(6), top = p(7), seat = p(8), crank = p(9), head = p(10);
  const neck = add(lower, minus(top, lower), 0.55);
  line([p(3), lower, top], "#0072b2", 4);
  line([p(0), seat, neck, crank, p(0)], "#0072b2", 4); line([crank, seat], "#0072b2", 4);
  const ride = minus(seat, crank), hip = add(seat, ride, 0.12), chest = add(hip, minus(head, hip), 0.75);
  line([crank, hip, chest], "#475569", 7); line([chest, top], "#475569", 4);
  const spot = place(head), edge = place(add(head, up, 0.11));
  if (spot && edge) { pen.fillStyle = "#475569"; pen.beginPath();
    pen.arc(spot[0], spot[1], Math.hypot(spot[0] - edge[0], spot[1] - edge[1]), 0, 7); pen.fill(); }
  const degrees = v => (v * 180 / Math.PI).toFixed(1).padStart(6);
  said.textContent = `t $${(at * D.dt).toFixed(2)} s   $${D.speed[at].toFixed(2)} m/s   lean $${degrees(D.lean[at])}°   steer $${degrees(D.steer[at])}°`;
}
function tick(now) {
  if (playing) { if (last === null) last = now - at * D.dt * 1000;
    at = Math.floor((now - last) / 1000 / D.dt); if (at >= N) { at = 0; last = now; } slider.value = at; draw(); }
  requestAnimationFrame(tick);
}
button.onclick = () => { playing = !playing; last = null; button.textContent = playing ? "pause" : "play"; };
slider.oninput = () => { at = +slider.value; last = null; draw(); };
follow.onchange = draw; window.addEventListener("resize", draw);
let held = null;
canvas.onpointerdown = e => { held = [e.clientX, e.clientY]; canvas.setPointerCapture(e.pointerId); };
canvas.onpointermove = e => { if (!held) return; azimuth -= (e.clientX - held[0]) / 150;
  height = Math.min(1.5, Math.max(0.05, height + (e.clientY - held[1]) / 200)); held = [e.clientX, e.clientY]; draw(); };
canvas.onpointerup = () => held = null;
canvas.onwheel = e => { e.preventDefault(); distance = Math.min(40, Math.max(2, distance * Math.exp(e.deltaY / 800))); draw(); };
at = Math.min(N - 1, +(new URLSearchParams(location.search).get("frame") || 0)); if (at) { playing = false; button.textContent = "play"; slider.value = at; }
draw(); requestAnimationFrame(tick);
})();
</script>
""")  # noqa: E501
