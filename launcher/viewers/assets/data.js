// The flight as the page uses it. Of a flight under way it grows: see live.js.

/** Numbers from letters: 32-bit floats, least significant byte first. */
function unpack(letters) {
  const text = atob(letters);
  const bytes = new Uint8Array(text.length);
  for (let i = 0; i < text.length; i++) bytes[i] = text.charCodeAt(i);
  const view = new DataView(bytes.buffer);
  const values = new Float32Array(text.length >> 2);
  for (let i = 0; i < values.length; i++) values[i] = view.getFloat32(4 * i, true);
  return values;
}

/** Numbers per frame of what moves. */
const TRACKS = { body: 8, wanted_w_m: 3, rotor_thrust_n: 4, world: 6 };

function unpackFrames(frames) {
  for (const name of Object.keys(TRACKS)) frames[name] = unpack(frames[name]);
}

function unpackSeries(series) {
  series.least = unpack(series.least);
  // Without a second side every interval has one value, as recorded at its beginning.
  series.merged = series.greatest !== undefined;
  series.greatest = series.merged ? unpack(series.greatest) : series.least;
}

/** Reads the JSON that `morphquad view` writes. */
function readFlight(text) {
  const flight = JSON.parse(text);
  if (flight.format !== 1) throw new Error(`the flight has format ${flight.format}, this page reads 1`);
  unpackFrames(flight.frames);
  for (const chart of flight.charts) {
    for (const series of chart.series) {
      unpackSeries(series);
    }
  }
  return flight;
}

/** Time of an interval of a series [s]. */
function timeOf(series, i) {
  return series.from_s + (series.merged ? i + 0.5 : i) * series.width_s;
}

/** Index of the interval that holds time t; the last one with a value before it if it is empty. */
function indexAt(series, t) {
  const at = series.width_s > 0 ? Math.floor((t - series.from_s) / series.width_s + 1e-6) : 0;
  let i = Math.min(at, series.least.length - 1);
  while (i >= 0 && Number.isNaN(series.least[i])) i--;
  return i;
}

/** Before the first frame of a flight that is about to begin. */
const AT_REST = {
  position: [0, 0, 0.5], attitude: [1, 0, 0, 0], beta: Math.PI / 2, wanted: null, thrust: [0, 0, 0, 0], wind: [0, 0, 0], force: [0, 0, 0],
};

/** Where everything is at time t, between two frames. */
function poseAt(flight, t) {
  const { frames } = flight;
  if (frames.count === 0) return AT_REST;
  const place = Math.max(0, Math.min((t - flight.from_s) / frames.step_s, frames.count - 1));
  const i = Math.floor(place);
  const j = Math.min(i + 1, frames.count - 1);
  const between = (values, width, first, n) => {
    const out = new Array(n).fill(0);
    if (values.length === 0) return out;
    for (let k = 0; k < n; k++) {
      const a = values[i * width + first + k];
      const b = values[j * width + first + k];
      out[k] = a + (b - a) * (place - i);
    }
    return out;
  };
  const q = between(frames.body, 8, 3, 4);
  // The stored sign of a quaternion may flip from one frame to the next.
  let dot = 0;
  for (let k = 3; k < 7; k++) dot += frames.body[i * 8 + k] * frames.body[j * 8 + k];
  if (dot < 0) for (let k = 0; k < 4; k++) q[k] = frames.body[i * 8 + 3 + k];
  const length = Math.hypot(...q) || 1;
  return {
    position: between(frames.body, 8, 0, 3),
    attitude: q.map((v) => v / length),
    beta: between(frames.body, 8, 7, 1)[0],
    wanted: frames.wanted_w_m.length ? between(frames.wanted_w_m, 3, 0, 3) : null,
    thrust: between(frames.rotor_thrust_n, 4, 0, 4),
    wind: between(frames.world, 6, 0, 3),
    force: between(frames.world, 6, 3, 3),
  };
}

/** Digits that a reader can use, with a real minus sign. */
function figure(value, digits) {
  return value.toFixed(digits).replace("-", "\u2212");
}
