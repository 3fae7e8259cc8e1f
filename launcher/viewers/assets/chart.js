// One pair of axes over time. Where an interval holds several values the band between least and greatest is
// drawn, so that no peak is lost at any zoom.

const MARGIN = { left: 58, right: 10, top: 24, bottom: 20 };

/** 1, 2 or 5 times a power of ten, at least `least`. */
function niceStep(least) {
  const power = 10 ** Math.floor(Math.log10(Math.max(least, 1e-12)));
  return [1, 2, 5, 10].map((k) => k * power).find((step) => step >= least * 0.999);
}

function ticksOf(low, high, count, log) {
  if (log) {
    const ticks = [];
    for (let e = Math.ceil(Math.log10(low) - 1e-9); e <= Math.log10(high) + 1e-9; e++) ticks.push(10 ** e);
    return { ticks, write: (v) => (v >= 1 ? figure(v, 0) : String(Number(v.toPrecision(1)))) };
  }
  const step = niceStep((high - low) / count);
  const digits = Math.max(0, -Math.floor(Math.log10(step) + 1e-9));
  const ticks = [];
  for (let i = Math.ceil(low / step - 1e-9); i * step <= high + step * 1e-9; i++) ticks.push(i * step);
  return { ticks, write: (v) => figure(Math.abs(v) < step / 1e6 ? 0 : v, digits) };
}

class Chart {
  constructor(canvas, chart, flight) {
    Object.assign(this, { canvas, chart, flight });
    this.context = canvas.getContext("2d");
    canvas.setAttribute("role", "img");
    canvas.setAttribute("aria-label", `${chart.title} in ${chart.unit} over time`);
    this.refresh();
  }

  /** After more data: a chart without any is low, and hidden unless its group's name stands above it. */
  refresh() {
    this.isEmpty = this.chart.series.every((series) => series.least.length === 0);
    this.canvas.classList.toggle("small", this.isEmpty);
    this.isHidden = this.isEmpty && !this.chart.group;
    this.canvas.hidden = this.isHidden;
  }

  /** Least and greatest of what is between two instants. */
  range(from, to, withBounds) {
    let [low, high] = [Infinity, -Infinity];
    const { chart } = this;
    for (const series of chart.series) {
      if (series.is_bound && !withBounds) continue;
      const first = Math.max(0, Math.floor((from - series.from_s) / (series.width_s || 1)) - 1);
      const last = Math.min(series.least.length - 1, Math.ceil((to - series.from_s) / (series.width_s || 1)) + 1);
      for (let i = first; i <= last; i++) {
        if (Number.isNaN(series.least[i]) || (chart.log && series.least[i] <= 0)) continue;
        low = Math.min(low, series.least[i]);
        high = Math.max(high, series.greatest[i]);
      }
    }
    if (withBounds) for (const level of chart.levels) [low, high] = [Math.min(low, level.at), Math.max(high, level.at)];
    if (!(low <= high)) return chart.log ? [0.1, 1000] : [-1, 1];
    if (chart.log) return [10 ** Math.floor(Math.log10(low)), 10 ** Math.ceil(Math.log10(high * 1.001))];
    const room = high > low ? Math.max((high - low) * 0.07, Math.abs(high) * 1e-3) : Math.abs(high) || 1;
    return [low - room, high + room];
  }

  draw(t, [from, to], withBounds, marks) {
    const { context, canvas, chart } = this;
    const ratio = fit(canvas);
    const [wide, tall] = [canvas.width / ratio, canvas.height / ratio];
    const style = getComputedStyle(document.documentElement);
    const colour = (name) => style.getPropertyValue(`--${name}`).trim();
    context.setTransform(ratio, 0, 0, ratio, 0, 0);
    context.clearRect(0, 0, wide, tall);
    const box = { left: MARGIN.left, right: wide - MARGIN.right, top: MARGIN.top, bottom: tall - MARGIN.bottom };
    this.box = box;
    const [low, high] = this.range(from, to, withBounds);
    const level = chart.log ? Math.log10 : (v) => v;
    const x = (s) => box.left + ((s - from) / (to - from)) * (box.right - box.left);
    const y = (v) => box.bottom - ((level(v) - level(low)) / (level(high) - level(low))) * (box.bottom - box.top);
    context.font = "11px system-ui, 'DejaVu Sans', sans-serif";
    context.lineWidth = 1;
    this.frame(box, [from, to], [low, high], x, y, colour);
    context.save();
    context.beginPath();
    context.rect(box.left, box.top, box.right - box.left, box.bottom - box.top);
    context.clip();
    for (const mark of marks) {
      if (mark.until_s !== undefined) this.shade([x(mark.at_s), x(mark.until_s)], box, colour(MARKS[mark.kind].colour));
    }
    for (const mark of marks) this.upright(x(mark.at_s), box, colour(MARKS[mark.kind].colour), [3, 3]);
    for (const line of chart.levels) {
      context.strokeStyle = colour("red");
      context.setLineDash([6, 4]);
      context.beginPath();
      context.moveTo(box.left, y(line.at));
      context.lineTo(box.right, y(line.at));
      context.stroke();
    }
    for (const series of chart.series) this.series(series, [from, to], x, y, colour);
    this.upright(x(t), box, colour("text"), []);
    context.restore();
    this.legend(t, box, colour);
  }

  frame(box, [from, to], [low, high], x, y, colour) {
    const { context, chart } = this;
    const across = ticksOf(from, to, Math.max(2, (box.right - box.left) / 80), false);
    const up = ticksOf(low, high, Math.max(2, (box.bottom - box.top) / 26), chart.log);
    context.strokeStyle = colour("grid");
    context.fillStyle = colour("faint");
    context.textBaseline = "middle";
    context.beginPath();
    context.textAlign = "center";
    for (const v of across.ticks) {
      context.moveTo(x(v), box.top);
      context.lineTo(x(v), box.bottom);
      if (x(v) < box.right - 26) context.fillText(across.write(v), x(v), box.bottom + 10);
    }
    context.textAlign = "right";
    const every = Math.ceil((up.ticks.length * 14) / (box.bottom - box.top));
    up.ticks.forEach((v, i) => {
      context.moveTo(box.left, y(v));
      context.lineTo(box.right, y(v));
      if (i % every === 0) context.fillText(up.write(v), box.left - 5, y(v));
    });
    context.stroke();
    context.fillText("t [s]", box.right, box.bottom + 10);
    context.strokeStyle = colour("line");
    context.strokeRect(box.left, box.top, box.right - box.left, box.bottom - box.top);
  }

  /** What goes on for a while; what is outside the chart is cut off. */
  shade([from, to], box, colour) {
    const { context } = this;
    context.globalAlpha = 0.12;
    context.fillStyle = colour;
    context.fillRect(from, box.top, Math.max(1, to - from), box.bottom - box.top);
    context.globalAlpha = 1;
  }

  upright(x, box, colour, dash) {
    const { context } = this;
    context.strokeStyle = colour;
    context.setLineDash(dash);
    context.beginPath();
    context.moveTo(x, box.top);
    context.lineTo(x, box.bottom);
    context.stroke();
    context.setLineDash([]);
  }

  series(series, [from, to], x, y, colour) {
    const { context } = this;
    const first = Math.max(0, Math.floor((from - series.from_s) / (series.width_s || 1)) - 1);
    const last = Math.min(series.least.length - 1, Math.ceil((to - series.from_s) / (series.width_s || 1)) + 1);
    const bottom = this.chart.log ? 1e-3 : -Infinity;
    context.strokeStyle = colour(series.colour);
    context.setLineDash(series.dash);
    context.lineWidth = series.is_bound ? 1.1 : 1.4;
    context.lineJoin = "round";
    if (!this.chart.log && x(from + (series.width_s || 0)) - x(from) > 2) {
      this.band(series, [first, last], x, y, colour);
      return;
    }
    context.beginPath();
    let [column, low, high, entry, exit] = [null, 0, 0, 0, 0];
    // Values that fall on one column of pixels become one upright stroke.
    const flush = () => {
      if (column === null) return;
      context.lineTo(column, y(entry));
      if (high > low) {
        context.lineTo(column, y(low));
        context.lineTo(column, y(high));
        context.lineTo(column, y(exit));
      }
    };
    for (let i = first; i <= last; i++) {
      if (Number.isNaN(series.least[i])) continue;
      const b = Math.max(series.greatest[i], bottom);
      // Of durations the slowest counts; bands of several loops would hide one another.
      const a = this.chart.log ? b : Math.max(series.least[i], bottom);
      const at = Math.round(x(timeOf(series, i)) * 2) / 2;
      if (at !== column) {
        flush();
        [column, low, high, entry] = [at, a, b, a];
      }
      [low, high, exit] = [Math.min(low, a), Math.max(high, b), b];
    }
    flush();
    if (column !== null && series.is_bound && timeOf(series, last) < to) context.lineTo(x(Math.min(to, this.flight.to_s)), y(exit));
    context.stroke();
    context.setLineDash([]);
    context.lineWidth = 1;
  }

  /** Intervals that are wider than a line: what lies between least and greatest, and its middle. */
  band(series, [first, last], x, y, colour) {
    const { context } = this;
    const points = [];
    for (let i = first; i <= last; i++) {
      if (!Number.isNaN(series.least[i])) points.push([x(timeOf(series, i)), y(series.least[i]), y(series.greatest[i])]);
    }
    if (points.some(([, low, high]) => low !== high)) {
      context.beginPath();
      for (const [at, low] of points) context.lineTo(at, low);
      for (const [at, , high] of points.toReversed()) context.lineTo(at, high);
      context.fillStyle = colour(series.colour);
      context.globalAlpha = 0.3;
      context.fill();
      context.globalAlpha = 1;
    }
    context.beginPath();
    for (const [at, low, high] of points) context.lineTo(at, (low + high) / 2);
    if (points.length > 0 && series.is_bound) {
      const [at, low, high] = points.at(-1);
      context.lineTo(Math.max(at, Math.min(x(this.flight.to_s), this.box.right)), (low + high) / 2);
    }
    context.stroke();
    context.setLineDash([]);
    context.lineWidth = 1;
  }

  /** Title, then each series with its value at time t, as far as there is room. */
  legend(t, box, colour) {
    const { context, chart } = this;
    context.textAlign = "left";
    context.textBaseline = "middle";
    context.fillStyle = colour("text");
    context.font = "600 12px system-ui, 'DejaVu Sans', sans-serif";
    const title = `${chart.title}${chart.unit === "1" ? "" : ` [${chart.unit}]`}`;
    context.fillText(title, 12, 12);
    let left = 12 + context.measureText(title).width + 16;
    context.font = "11px system-ui, 'DejaVu Sans', sans-serif";
    if (this.isEmpty) {
      context.fillStyle = colour("faint");
      context.fillText(this.flight.live ? "nothing yet" : "not in this recording", left, 12);
      return;
    }
    const level = chart.levels.find((line) => line.name);
    const entries = chart.series.filter((series) => series.name && series.least.length).map((series) => {
      const i = series.is_bound ? -1 : indexAt(series, t);
      // Of durations the slowest counts, of anything else the middle of what the interval holds.
      const value = i < 0 ? "" : ` ${short(chart.log ? series.greatest[i] : (series.least[i] + series.greatest[i]) / 2)}`;
      return { text: series.name + value, colour: series.colour, dash: series.dash };
    });
    if (level && chart.levels.length > 1 && level.name !== "smallest") entries.push({ text: level.name, colour: "red", dash: [6, 4] });
    if (level && level.name === "smallest") entries.push({ text: "range", colour: "red", dash: [6, 4] });
    for (const entry of entries) {
      const room = Math.max(24 + context.measureText(entry.text).width + 8, 70);
      if (left + room > box.right + 8) {
        // More than there is room for.
        context.fillStyle = colour("faint");
        context.fillText("\u2026", Math.min(left, box.right - 4), 12);
        break;
      }
      context.strokeStyle = colour(entry.colour);
      context.lineWidth = 2;
      context.setLineDash(entry.dash);
      context.beginPath();
      context.moveTo(left, 12);
      context.lineTo(left + 18, 12);
      context.stroke();
      context.setLineDash([]);
      context.lineWidth = 1;
      context.fillStyle = colour("faint");
      context.fillText(entry.text, left + 22, 12);
      left += room;
    }
  }

  /** Time under a point of the canvas. */
  timeAt(clientX, [from, to]) {
    const left = this.canvas.getBoundingClientRect().left;
    const { box } = this;
    return from + ((clientX - left - box.left) / (box.right - box.left)) * (to - from);
  }
}

/** Three digits. */
function short(value) {
  const size = Math.abs(value);
  return figure(value, size >= 100 ? 0 : size >= 10 ? 1 : size >= 1 ? 2 : size >= 0.01 ? 3 : size === 0 ? 0 : 4);
}
