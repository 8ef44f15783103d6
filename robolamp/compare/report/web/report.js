// The report's plots and its moving figure. DATA is written into the page by robolamp/compare/report/data.py.
(() => {
  "use strict";
  const data = JSON.parse(document.getElementById("data").textContent);
  const bytes = text => Uint8Array.from(atob(text), c => c.charCodeAt(0)).buffer;
  const time = Array.from(new Float32Array(bytes(data.time)));
  const series = {};
  for (const [name, { low, step, values }] of Object.entries(data.series))
    series[name] = Array.from(new Int16Array(bytes(values)), v => (v === -32768 ? null : low + (v + 32767) * step));
  const css = name => getComputedStyle(document.documentElement).getPropertyValue(name).trim();
  const style = () => ({ ink: css("--ink"), faint: css("--faint"), line: css("--line"),
                         lamp: css("--lamp"), twin: css("--twin"), goal: css("--goal") });
  const plots = [];
  const digits = (v, n) => (v == null ? "–" : v.toFixed(n).replace("-", "−"));

  // ---- plots: zoom by dragging, a double click shows everything; all of them together
  function shade(panel) {
    return u => {
      const { ctx } = u, { left, top, width, height } = u.bbox, colours = style();
      ctx.save();
      ctx.beginPath(); ctx.rect(left, top, width, height); ctx.clip();
      ctx.fillStyle = colours.faint; ctx.globalAlpha = 0.07;
      for (const [a, b] of [[-1e9, data.begin], [data.end, 1e9]]) {
        const x0 = Math.max(u.valToPos(a, "x", true), left), x1 = Math.min(u.valToPos(b, "x", true), left + width);
        if (x1 > x0) ctx.fillRect(x0, top, x1 - x0, height);
      }
      if (panel.band) {
        const y0 = u.valToPos(panel.band, "y", true), y1 = u.valToPos(-panel.band, "y", true);
        ctx.fillStyle = colours.twin; ctx.globalAlpha = 0.10;
        ctx.fillRect(left, y0, width, y1 - y0);
      }
      ctx.setLineDash([5, 4]);
      if (panel.level != null) {
        const y = u.valToPos(panel.level, "y", true), ratio = devicePixelRatio || 1;
        ctx.globalAlpha = 1; ctx.strokeStyle = ctx.fillStyle = colours[panel.levelled]; ctx.lineWidth = 1.4 * ratio;
        ctx.beginPath(); ctx.moveTo(left, y); ctx.lineTo(left + width, y); ctx.stroke();
        const below = y - top < 18 * ratio;  // no room above the line
        ctx.font = `${12 * ratio}px system-ui, sans-serif`; ctx.textAlign = "left"; ctx.textBaseline = below ? "top" : "bottom";
        ctx.fillText(panel.says, left + 6 * ratio, y + (below ? 4 : -3) * ratio);
      }
      ctx.globalAlpha = 0.8; ctx.strokeStyle = colours.faint; ctx.lineWidth = 1; ctx.beginPath();
      if (data.parted != null) {
        const x = u.valToPos(data.parted, "x", true);
        ctx.moveTo(x, top); ctx.lineTo(x, top + height);
      }
      ctx.stroke(); ctx.restore();
    };
  }
  function draw(box, panel) {
    const colours = style(), axis = { stroke: colours.faint, grid: { stroke: colours.line, width: 1 },
                                      ticks: { show: false }, font: "12px system-ui, sans-serif" };
    const readout = box.parentElement.querySelector(".readout");
    const show = i => {
      readout.textContent = i == null ? "" : `${digits(time[i], 2)} s   ` + panel.lines
        .map(l => `${l.label} ${digits(series[l.name][i], panel.digits)}`).join("   ") + ` ${panel.unit}`;
    };
    const options = {
      width: box.clientWidth, height: panel.height, legend: { show: false },
      cursor: { sync: { key: "run", filters: { pub: type => type === "mousemove" || type === "mouseleave" } }, drag: { x: true, y: false }, points: { size: 6 } },
      scales: { x: { time: false }, y: { range: (u, a, b) => {
        if (panel.symmetric) { const m = 1.08 * Math.max(Math.abs(a ?? 0), Math.abs(b ?? 0), panel.symmetric); return [-m, m]; }
        if (a == null) return [0, 1];
        if (panel.level != null && panel.levelled === "goal") { a = Math.min(a, panel.level); b = Math.max(b, panel.level); }
        const span = Math.max(b - a, panel.least), middle = (a + b) / 2; return [middle - 0.56 * span, middle + 0.56 * span];
      } } },
      axes: [{ ...axis, size: 26, gap: 2 }, { ...axis, size: 56, space: 26 }],
      series: [{}, ...panel.lines.map(l => ({ stroke: colours[l.colour], width: l.width || 1.6, points: { show: false },
                                               spanGaps: false, dash: l.dash }))],
      hooks: { drawClear: [shade(panel)], setCursor: [u => { show(u.cursor.idx); if (u.cursor.idx != null) pose(u.cursor.idx); }],
               setScale: [(u, key) => { if (key === "x") together(u); }] },
    };
    const plot = new uPlot(options, [time, ...panel.lines.map(l => series[l.name])], box);
    plots.push(plot);
    return plot;
  }
  let settling = false;
  function together(from) {
    if (settling) return;
    settling = true;
    const { min, max } = from.scales.x;
    for (const plot of plots) if (plot !== from) plot.setScale("x", { min, max });
    settling = false;
  }

  // ---- the figure: both lamps from the side, at the moment under the cursor
  const stage = document.getElementById("stage"), slider = document.getElementById("moment"),
        button = document.getElementById("play"), clock = document.getElementById("clock");
  let at = 0;
  const turn = ([x, z], a) => [x * Math.cos(a) + z * Math.sin(a), -x * Math.sin(a) + z * Math.cos(a)];
  function points(who, i) {
    const get = name => series[`${who}.${name}`]?.[i];
    const base = [get("x"), get("z")], lean = get("pitch");
    if (base.some(v => v == null) || lean == null) return null;
    let angle = lean, here = [base[0] / 100, base[1] / 100];
    const out = [here], f = data.skeleton.foot;
    const foot = [[-f.radius, 0], [f.radius, 0], [0.75 * f.radius, f.height], [-0.75 * f.radius, f.height]]
      .map(p => turn(p, angle)).map(p => [here[0] + p[0], here[1] + p[1]]);
    data.skeleton.links.forEach((link, j) => {
      const step = turn(link, angle);
      here = [here[0] + step[0], here[1] + step[1]];
      out.push(here);
      angle += series[`${who}.${data.joints[j]}`][i] ?? 0;
    });
    const head = data.skeleton.head.map(p => turn(p, angle)).map(p => [here[0] + p[0], here[1] + p[1]]);
    return { foot, joints: out, head };
  }
  function pose(i) {
    at = i;
    slider.value = i;
    clock.textContent = `${digits(time[i], 2)} s`;
    const ratio = devicePixelRatio || 1, w = stage.clientWidth, h = stage.clientHeight, colours = style();
    if (stage.width !== w * ratio) { stage.width = w * ratio; stage.height = h * ratio; }
    const ctx = stage.getContext("2d");
    ctx.setTransform(ratio, 0, 0, ratio, 0, 0);
    ctx.clearRect(0, 0, w, h);
    const reach = data.reach, scale = Math.min(h / 0.36, w / (reach[1] - reach[0] + 0.3)), floor = h - 26;
    const left = w / 2 - scale * (reach[0] + reach[1]) / 2, to = ([x, z]) => [left + x * scale, floor - z * scale];
    ctx.strokeStyle = colours.faint; ctx.fillStyle = colours.faint; ctx.lineWidth = 1; ctx.font = "11px system-ui, sans-serif";
    ctx.textAlign = "center";
    ctx.beginPath(); ctx.moveTo(0, floor + 0.5); ctx.lineTo(w, floor + 0.5); ctx.stroke();
    for (let cm = Math.ceil((0 - left) / scale * 20) * 5; cm / 100 * scale + left < w; cm += 5) {
      const x = left + cm / 100 * scale;
      ctx.globalAlpha = cm % 10 ? 0.4 : 0.9;
      ctx.fillRect(x, floor, 1, cm % 10 ? 4 : 7);
      if (cm % 10 === 0) ctx.fillText(`${cm} cm`, x, floor + 19);
    }
    ctx.globalAlpha = 1;
    for (const who of ["twin", "lamp"]) {
      const p = points(who, i);
      if (!p) continue;
      const path = (list, close) => { ctx.beginPath(); list.map(to).forEach(([x, y], k) => k ? ctx.lineTo(x, y) : ctx.moveTo(x, y));
                                      if (close) ctx.closePath(); };
      ctx.strokeStyle = ctx.fillStyle = colours[who];
      ctx.lineWidth = Math.max(2, 0.007 * scale); ctx.lineJoin = ctx.lineCap = "round";
      path(p.joints); ctx.globalAlpha = who === "twin" ? 0.85 : 1; ctx.stroke();
      for (const part of [p.foot, p.head]) { path(part, true); ctx.globalAlpha = 0.35; ctx.fill(); ctx.globalAlpha = 1; ctx.lineWidth = 2; ctx.stroke(); }
    }
  }
  let last = null;
  function run(now) {
    if (last === null) return;
    const until = Math.min(time[at] + (now - last) / 1000 * 0.5, data.shown);
    let i = at;
    while (i + 1 < time.length && time[i + 1] <= until) i++;
    if (i > at) { last = now; pose(i); }
    if (until >= data.shown || at + 1 >= time.length) return stop();
    requestAnimationFrame(run);
  }
  function stop() { last = null; button.textContent = "Play"; button.setAttribute("aria-pressed", "false"); }
  button.addEventListener("click", () => {
    if (last !== null) return stop();
    if (time[at] >= data.shown - 0.05 || time[at] < -0.05) pose(time.findIndex(t => t >= 0));
    button.textContent = "Pause"; button.setAttribute("aria-pressed", "true");
    last = performance.now();
    requestAnimationFrame(run);
  });
  slider.max = time.length - 1;
  slider.addEventListener("input", () => { stop(); pose(+slider.value); });

  // ---- everything
  const boxes = [...document.querySelectorAll("[data-panel]")];
  function all() {
    plots.splice(0).forEach(plot => plot.destroy());
    for (const box of boxes) draw(box, data.panels[box.dataset.panel]);
    const whole = { min: Math.max(data.begin - 0.3, time[0]), max: Math.min(data.shown + 0.3, time.at(-1)) };
    settling = true;
    for (const plot of plots) plot.setScale("x", whole);
    settling = false;
    pose(at);
  }
  at = Math.max(0, time.findIndex(t => t >= data.look));
  all();
  let width = innerWidth;
  addEventListener("resize", () => { if (innerWidth !== width) { width = innerWidth; all(); } });
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", all);
  document.documentElement.dataset.ready = "yes";
})();
