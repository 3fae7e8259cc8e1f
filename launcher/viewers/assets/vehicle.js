// The vehicle's shape over the deployable angle, for both ways to draw it.

const DEGREE = Math.PI / 180;

/** Arm length [m] by the flight's own law, with the angle in degrees. */
function armLength(vehicle, beta) {
  const [c0, c1, c2] = vehicle.arm_length_m;
  const degrees = beta / DEGREE;
  return c0 + c1 * degrees + c2 * degrees * degrees;
}

/**
 * Points of the vehicle in its own frame. Each rotor sits at the model's arm length; what holds it is drawn
 * as a scissor of two links each way whose opening is the deployable angle at the ends of its range.
 */
function shapeOf(vehicle, beta) {
  const [small, large] = [45 * DEGREE, 160 * DEGREE];
  const [closed, open] = [Math.sin(small / 2), Math.sin(large / 2)];
  const [shortest, longest] = [armLength(vehicle, small), armLength(vehicle, large)];
  const link = Math.max((longest - shortest) / (2 * (open - closed)), 0.2 * longest);
  const arm = armLength(vehicle, beta);
  const hub = Math.max(shortest - 2 * link * closed, 0.15 * shortest);
  const half = Math.min((arm - hub) / 2, link);
  const aside = Math.sqrt(Math.max(link * link - half * half, 0));
  // Front, left, rear, right: the directions of (1).
  const arms = [[1, 0], [0, 1], [-1, 0], [0, -1]].map(([x, y]) => {
    const at = (along, across) => [x * along - y * across, y * along + x * across, 0];
    return { root: at(hub, 0), elbows: [at(hub + half, aside), at(hub + half, -aside)], rotor: at(arm, 0) };
  });
  return { arm, hub, arms, propeller: 0.62 * shortest };
}

/** A body vector in the world: q v q*. */
function turn([w, x, y, z], [a, b, c]) {
  const [s, t, u] = [2 * (y * c - z * b), 2 * (z * a - x * c), 2 * (x * b - y * a)];
  return [a + w * s + y * u - z * t, b + w * t + z * s - x * u, c + w * u + x * t - y * s];
}

const add = (a, b, k = 1) => [a[0] + k * b[0], a[1] + k * b[1], a[2] + k * b[2]];
const sub = (a, b) => add(a, b, -1);
const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
const unit = (a) => { const l = Math.hypot(...a) || 1; return [a[0] / l, a[1] / l, a[2] / l]; };

/** Lengths of arrows [m per unit], for a vehicle drawn `scale` times its size. */
function arrows(vehicle, scale) {
  const hover = (vehicle.mass_kg * vehicle.gravity_m_s2) / 4;
  return { thrust: (0.16 * scale) / hover, wind: 0.07 * scale, force: (0.1 * scale) / hover };
}

/** The box that holds both paths and the ground below, [least, greatest]. */
function extentOf(flight) {
  const low = [Infinity, Infinity, 0], high = [-Infinity, -Infinity, 0.5];
  const take = (values, width) => {
    for (let i = 0; i + width <= values.length; i += width) {
      for (let k = 0; k < 3; k++) {
        low[k] = Math.min(low[k], values[i + k]);
        high[k] = Math.max(high[k], values[i + k]);
      }
    }
  };
  take(flight.frames.body, 8);
  take(flight.frames.wanted_w_m, 3);
  if (flight.frames.count === 0) take([0, 0, 0], 3);
  for (let k = 0; k < 2; k++) {
    low[k] = Math.floor(low[k] - 0.4);
    high[k] = Math.ceil(high[k] + 0.4);
  }
  return [low, high];
}

/** Colours of the theme as [r, g, b], 0 to 1. */
function palette() {
  const style = getComputedStyle(document.documentElement);
  const read = (name) => {
    const hex = style.getPropertyValue(`--${name}`).trim().slice(1);
    return [0, 2, 4].map((i) => parseInt(hex.slice(i, i + 2), 16) / 255);
  };
  const names = ["back", "line", "grid", "text", "faint", "black", "grey", "red", "blue", "green", "orange", "purple", "sky"];
  return Object.fromEntries(names.map((name) => [name, read(name)]));
}
