// The clock: what plays, at what speed, and who shows the moment.

const $ = (id) => document.getElementById(id);
const data = JSON.parse($("data").textContent);
const frames = unpack(data.time, Float32Array);
data.end = frames[frames.length - 1];
const motions = data.motions.map(({ name, ghost, poses }) => ({ name, ghost, shown: true, poses: unpack(poses, Float32Array) }));
data.start = motions[0].poses[data.base * 7];  // where its base was at first
let now = 0, playing = false, last = 0;

const stage = new Stage($("view"), data);
const charts = new Charts($("charts"), data, (time) => seek(time));
if (!stage.gl) say("This browser has no WebGL 2: the lamp is not drawn, the traces are.", true);

// Poses between two frames: positions by straight lines, turns by the shorter way.
function posesAt(poses, time) {
  const next = Math.min(Math.max(lowerBound(frames, time), 1), frames.length - 1);
  const share = Math.min(Math.max((time - frames[next - 1]) / (frames[next] - frames[next - 1]), 0), 1);
  const size = data.bodies * 7, out = [];
  for (let body = 0; body < data.bodies; body++) {
    const a = (next - 1) * size + body * 7, b = next * size + body * 7, pose = [];
    for (let i = 0; i < 7; i++) pose.push(poses[a + i] + share * (poses[b + i] - poses[a + i]));
    const length = Math.hypot(pose[3], pose[4], pose[5], pose[6]);
    for (let i = 3; i < 7; i++) pose[i] /= length;
    out.push(pose);
  }
  return out;
}

function say(text, bad = false) {
  $("said").textContent = text;
  $("said").classList.toggle("bad", bad);
}

function show() {
  $("clock").textContent = `${now.toFixed(2)} / ${data.end.toFixed(2)} s`;
  $("scrub").value = data.end ? now / data.end : 0;
  const phase = data.phases.find(([, from, to]) => now >= from && now < to);
  $("phase").textContent = phase ? { start: "soft start", run: "running", landing: "soft landing" }[phase[0]] || phase[0] : "";
  const mark = data.marks.filter(([at]) => at <= now && now < at + 1).pop();
  if (stage.gl) say(mark ? mark[2] : "", mark && mark[1] !== "info");
  charts.show(now);
  draw();
}

function draw() {
  stage.draw(motions.filter(({ shown }, index) => shown || index === 0).map(({ poses, ghost }) => ({ poses: posesAt(poses, now), ghost })));
  const flag = $("goal"), place = data.goal === null ? null : stage.onScreen([data.goal + data.start, -0.09, 0]);
  flag.hidden = !place || place[0] < 0 || place[0] > stage.canvas.clientWidth || place[1] > stage.canvas.clientHeight - 20;
  if (place) Object.assign(flag.style, { left: `${place[0]}px`, top: `${place[1]}px` });
}

function seek(time) {
  now = Math.min(Math.max(time, 0), data.end);
  show();
}

function play(on) {
  playing = on;
  if (on && now >= data.end) now = 0;
  last = performance.now();
  $("play").innerHTML = on ? "&#10074;&#10074;" : "&#9654;";
  $("play").setAttribute("aria-label", on ? "Pause" : "Play");
  if (on) requestAnimationFrame(step);
}

function step(at) {
  if (!playing) return;
  now += Math.max(0, at - last) / 1000 * Number($("speed").value);
  last = at;
  if (now >= data.end) { now = data.end; play(false); }
  show();
  if (playing) requestAnimationFrame(step);
}

function ribbon() {
  const canvas = $("ribbon"), style = getComputedStyle(document.documentElement), pen = canvas.getContext("2d");
  const ratio = window.devicePixelRatio || 1;
  canvas.width = canvas.clientWidth * ratio;
  canvas.height = canvas.clientHeight * ratio;
  pen.scale(ratio, ratio);
  const knob = 8, x = (t) => knob + t / data.end * (canvas.clientWidth - 2 * knob);  // the range's thumb stays inside
  for (const [at, level] of data.marks) {
    if (level === "info") continue;
    pen.fillStyle = style.getPropertyValue("--bad");
    pen.fillRect(x(at) - 1, 0, 2, canvas.clientHeight);
  }
  pen.fillStyle = style.getPropertyValue("--line");
  for (const [name, from, to] of data.phases) if (name === "run") pen.fillRect(x(from), canvas.clientHeight - 4, x(to) - x(from), 3);
}

$("play").onclick = () => play(!playing);
$("back").onclick = () => { play(false); seek(now - data.period); };
$("on").onclick = () => { play(false); seek(now + data.period); };
$("scrub").oninput = () => seek($("scrub").value * data.end);
$("home").onclick = () => { stage.look = { turn: -1.2, rise: 0.16, far: 0.85 }; stage.target = [0, 0, 0.12]; draw(); };
const press = (button, on) => { button.setAttribute("aria-pressed", on); draw(); };
$("follow").onclick = () => { stage.follow = !stage.follow; press($("follow"), stage.follow); };
motions.slice(1).forEach((motion) => {
  const button = document.createElement("button");
  button.id = `show-${motion.name}`;
  button.textContent = motion.name;
  button.title = `Show or hide the ${motion.name}`;
  button.onclick = () => { motion.shown = !motion.shown; press(button, motion.shown); };
  $("looks").prepend(button);
  press(button, true);
});
if (data.goal !== null) $("goal").textContent = `goal ${+(data.goal * 100).toFixed(1)} cm`;

addEventListener("keydown", (event) => {
  if (event.ctrlKey || event.metaKey || event.altKey || event.target.tagName === "SELECT") return;
  const key = event.key;
  const act = {
    " ": () => play(!playing), ArrowLeft: () => $("back").click(), ArrowRight: () => $("on").click(),
    f: () => $("follow").click(), Home: () => $("home").click(),
  }[key];
  if (!act || (key === " " && event.target.tagName === "BUTTON")) return;
  event.preventDefault();
  act();
});

const fingers = new Map();
$("view").addEventListener("pointerdown", (event) => {
  fingers.set(event.pointerId, [event.clientX, event.clientY]);
  $("view").setPointerCapture(event.pointerId);
});
for (const kind of ["pointerup", "pointercancel"]) $("view").addEventListener(kind, (event) => fingers.delete(event.pointerId));
$("view").addEventListener("pointermove", (event) => {
  const before = fingers.get(event.pointerId);
  if (!before) return;
  const place = [event.clientX, event.clientY], look = stage.look;
  if (fingers.size === 1) {
    look.turn -= (place[0] - before[0]) * 0.008;
    look.rise = Math.min(Math.max(look.rise + (place[1] - before[1]) * 0.006, 0.01), 1.5);
  } else {
    const [other] = [...fingers].filter(([id]) => id !== event.pointerId).map(([, at]) => at);
    const gap = (at) => Math.hypot(at[0] - other[0], at[1] - other[1]);
    look.far = Math.min(Math.max(look.far * gap(before) / Math.max(gap(place), 1), 0.2), 4);
  }
  fingers.set(event.pointerId, place);
  draw();
});
$("view").addEventListener("wheel", (event) => {
  event.preventDefault();
  stage.look.far = Math.min(Math.max(stage.look.far * Math.exp(event.deltaY * 0.001), 0.2), 4);
  draw();
}, { passive: false });
new ResizeObserver(() => { draw(); ribbon(); }).observe($("stage"));
stage.night.addEventListener("change", () => { draw(); ribbon(); });

show();
if (!matchMedia("(prefers-reduced-motion: reduce)").matches) play(true);
