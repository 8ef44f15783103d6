// Traces over time: one canvas a chart, all with the same span of time; what lies at the cursor is said in the legend.

const lowerBound = (array, value) => {
  let low = 0, high = array.length;
  while (low < high) {
    const middle = (low + high) >> 1;
    if (array[middle] < value) low = middle + 1; else high = middle;
  }
  return low;
};

const LEFT = 44, BOTTOM = 15;

class Charts {
  constructor(box, data, seek) {
    this.span = this.all = [0, data.end];
    this.data = data;
    this.now = 0;
    this.charts = data.charts.map((chart) => this.make(box, chart, seek));
    new ResizeObserver(() => this.draw()).observe(box);
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => this.draw());
  }

  make(box, chart, seek) {
    const card = document.createElement("div"), legend = document.createElement("p");
    const canvas = document.createElement("canvas");
    card.className = "chart";
    card.append(legend, canvas);
    box.append(card);
    const title = document.createElement("b");
    title.textContent = chart.title;
    legend.append(title);
    const series = chart.series.map(({ name, time, values }) => {
      const label = document.createElement("span");
      label.style.cssText = `color: var(--${name}); order: ${["goal", "lamp", "twin"].indexOf(name) + 1}`;
      legend.append(label);
      return { name, label, time: unpack(time, Float32Array), values: unpack(values, Float32Array) };
    });
    const at = (event) => {
      const inside = (event.offsetX - LEFT) / (canvas.clientWidth - LEFT);
      return this.span[0] + Math.min(Math.max(inside, 0), 1) * (this.span[1] - this.span[0]);
    };
    canvas.addEventListener("pointerdown", (event) => { canvas.setPointerCapture(event.pointerId); seek(at(event)); });
    canvas.addEventListener("pointermove", (event) => { if (event.buttons & 1) seek(at(event)); });
    canvas.addEventListener("dblclick", () => this.zoom(this.all));
    canvas.addEventListener("wheel", (event) => {
      event.preventDefault();
      const middle = at(event), by = Math.exp(event.deltaY * 0.002), [begin, end] = this.span;
      this.zoom([middle - (middle - begin) * by, middle + (end - middle) * by]);
    }, { passive: false });
    return { unit: chart.unit, canvas, series };
  }

  zoom([begin, end]) {
    const length = Math.min(Math.max(end - begin, 0.05), this.all[1]);
    const from = Math.min(Math.max(begin, 0), this.all[1] - length);
    this.span = [from, from + length];
    this.draw();
  }

  show(now) {
    this.now = now;
    const [begin, end] = this.span, length = end - begin;
    if (length < this.all[1] && (now < begin || now > end)) this.zoom([now - 0.1 * length, now + 0.9 * length]);
    else this.draw();
  }

  draw() {
    const style = getComputedStyle(document.documentElement);
    const color = (name) => style.getPropertyValue(`--${name}`).trim();
    for (const chart of this.charts) this.drawOne(chart, color);
  }

  drawOne({ unit, canvas, series }, color) {
    const ratio = window.devicePixelRatio || 1, wide = canvas.clientWidth, tall = canvas.clientHeight;
    if (!wide || !tall) return;
    canvas.width = Math.round(wide * ratio);
    canvas.height = Math.round(tall * ratio);
    const pen = canvas.getContext("2d");
    pen.scale(ratio, ratio);
    const [begin, end] = this.span, bottom = tall - BOTTOM, plot = wide - LEFT;
    let low = Infinity, high = -Infinity;
    for (const { time, values } of series) {
      for (let i = Math.max(lowerBound(time, begin) - 1, 0); i < time.length && time[i] <= end; i++) {
        if (values[i] < low) low = values[i];
        if (values[i] > high) high = values[i];
      }
    }
    if (!(low < high)) [low, high] = low === high ? [low - 0.5, high + 0.5] : [0, 1];
    const margin = 0.08 * (high - low), x = (t) => LEFT + (t - begin) / (end - begin) * plot;
    const y = (v) => 4 + (1 - (v - low + margin) / (high - low + 2 * margin)) * (bottom - 4);
    pen.font = "11px system-ui, sans-serif";
    pen.fillStyle = color("run");
    for (const [name, from, to] of this.data.phases) {
      if (name === "run") pen.fillRect(Math.max(x(from), LEFT), 0, Math.max(Math.min(x(to), wide) - Math.max(x(from), LEFT), 0), bottom);
    }
    pen.strokeStyle = color("line");
    pen.fillStyle = color("faint");
    pen.lineWidth = 1;
    pen.textBaseline = "middle";
    pen.textAlign = "right";
    for (const value of ticks(low, high, Math.max(3, Math.floor(bottom / 24)))) {
      stroke(pen, [[LEFT, y(value)], [wide, y(value)]]);
      pen.fillText(short(value), LEFT - 5, y(value));
    }
    pen.textBaseline = "bottom";
    pen.textAlign = "center";
    for (const value of ticks(begin, end, Math.max(2, Math.floor(plot / 70)))) {
      stroke(pen, [[x(value), bottom], [x(value), bottom + 3]]);
      if (x(value) < wide - 8) pen.fillText(`${short(value)} s`, Math.max(x(value), LEFT + 8), tall);
    }
    pen.save();
    pen.beginPath();
    pen.rect(LEFT, 0, plot, bottom);
    pen.clip();
    for (const { name, time, values, label } of series) {
      pen.strokeStyle = color(name);
      pen.lineWidth = name === "lamp" ? 1.8 : 1.2;
      pen.setLineDash(name === "goal" ? [4, 3] : []);
      this.trace(pen, time, values, x, y, plot, name === "goal");
      const value = values[Math.min(Math.max(lowerBound(time, this.now + 1e-6) - 1, 0), values.length - 1)];
      label.textContent = `${name} ${Number.isFinite(value) ? rounded(value, unit) : "-"} ${unit}`;
    }
    pen.setLineDash([]);
    pen.strokeStyle = color("accent");
    pen.lineWidth = 1.2;
    stroke(pen, [[x(this.now), 0], [x(this.now), bottom]]);
    pen.restore();
  }

  trace(pen, time, values, x, y, plot, steps) {
    const first = Math.max(lowerBound(time, this.span[0]) - 1, 0);
    const last = Math.min(lowerBound(time, this.span[1]) + 1, time.length);
    const crowd = Math.max(1, Math.floor((last - first) / (2 * plot)));  // samples in half a pixel: their extremes do
    let drawing = false, before = 0;
    pen.beginPath();
    for (let i = first; i < last; i += crowd) {
      let low = i, high = i;
      for (let j = i + 1; j < Math.min(i + crowd, last); j++) {
        if (!(values[j] >= values[low])) low = j;
        if (!(values[j] <= values[high])) high = j;
      }
      for (const k of low === high ? [low] : [Math.min(low, high), Math.max(low, high)]) {
        if (!Number.isFinite(values[k])) { drawing = false; continue; }
        if (drawing && steps) pen.lineTo(x(time[k]), y(before));
        if (drawing) pen.lineTo(x(time[k]), y(values[k])); else pen.moveTo(x(time[k]), y(values[k]));
        drawing = true;
        before = values[k];
      }
    }
    pen.stroke();
  }
}

const stroke = (pen, points) => {
  pen.beginPath();
  points.forEach(([x, y], i) => (i ? pen.lineTo(x, y) : pen.moveTo(x, y)));
  pen.stroke();
};

const ticks = (low, high, count) => {
  const raw = (high - low) / count, size = 10 ** Math.floor(Math.log10(raw));
  const step = [1, 2, 5, 10].map((k) => k * size).find((s) => s >= raw);
  const out = [];
  for (let v = Math.ceil(low / step) * step; v <= high + step * 1e-9; v += step) out.push(v);
  return out;
};

const PLACES = { rad: 3, N: 2, cm: 1 };  // that the sensors tell, and no more
const rounded = (value, unit) => value.toFixed(PLACES[unit] ?? 3).replace(/^-(?=[0.]+$)/, "");

const short = (value) => String(+value.toFixed(4));
