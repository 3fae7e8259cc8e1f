// Without WebGL: the vehicle from above and from the side, on a plain canvas.

/** Where there is less room [px], the views stand side by side. */
const LOW = 200;

class PlanView {
  constructor(canvas, flight) {
    Object.assign(this, { canvas, flight, mode: "follow", scale: 1 });
    this.context = canvas.getContext("2d");
    this.refresh();
    this.theme();
  }

  /** After more of the flight. */
  refresh() {
    this.extent = extentOf(this.flight);
  }

  theme() {
    const style = getComputedStyle(document.documentElement);
    this.colour = (name) => style.getPropertyValue(`--${name}`).trim();
  }

  draw(pose, t) {
    const { context, canvas } = this;
    const ratio = fit(canvas);
    const [wide, tall] = [canvas.width / ratio, canvas.height / ratio];
    context.setTransform(ratio, 0, 0, ratio, 0, 0);
    context.clearRect(0, 0, wide, tall);
    const top = 124, middle = top + (tall - top) * 0.55;
    if (tall - top > LOW) {
      this.plane(pose, t, [52, top, wide - 14, middle - 30], 1, "y [m] north");
      this.plane(pose, t, [52, middle, wide - 14, tall - 34], 2, "z [m] up");
    } else {
      this.plane(pose, t, [52, top, wide / 2 - 14, tall - 34], 1, "y [m] north");
      this.plane(pose, t, [wide / 2 + 38, top, wide - 14, tall - 34], 2, "z [m] up");
    }
  }

  /** x to the right, and axis `other` up, within [left, top, right, bottom]. */
  plane(pose, t, [left, top, right, bottom], other, name) {
    const { context, flight } = this;
    const [low, high] = this.extent;
    const follows = this.mode === "follow";
    this.scale = follows ? 1 : 3;
    const span = follows ? [0.7, 0.7] : [high[0] - low[0], high[other] - low[other]];
    const centre = [0, other].map((k) => (follows ? pose.position[k] : (low[k] + high[k]) / 2));
    const px = Math.min((right - left) / span[0], (bottom - top) / span[1]);
    const at = (p) => [(left + right) / 2 + (p[0] - centre[0]) * px, (top + bottom) / 2 - (p[other] - centre[1]) * px];
    context.save();
    context.strokeStyle = this.colour("line");
    context.strokeRect(left, top, right - left, bottom - top);
    context.fillStyle = this.colour("faint");
    context.font = "11px system-ui, 'DejaVu Sans', sans-serif";
    const ticks = (k, length, write) => {
      const step = niceStep(length / px / 5);
      const half = length / px / 2;
      for (let v = Math.ceil((centre[k] - half) / step) * step; v <= centre[k] + half; v += step) write(v, figure(v, step < 1 ? 1 : 0));
    };
    context.textAlign = "center";
    ticks(0, right - left, (v, text) => context.fillText(text, at([v, 0, 0])[0], bottom + 13));
    context.fillText("x [m] east", (left + right) / 2, bottom + 26);
    context.textAlign = "right";
    ticks(1, bottom - top, (v, text) => context.fillText(text, left - 5, (top + bottom) / 2 - (v - centre[1]) * px + 4));
    context.textAlign = "left";
    context.fillText(name, left, top - 5);
    context.beginPath();
    context.rect(left, top, right - left, bottom - top);
    context.clip();
    const { frames } = flight;
    const until = Math.ceil((t - flight.from_s) / frames.step_s);
    this.path(frames.wanted_w_m, 3, frames.count, at, "orange", [6, 4]);
    this.path(frames.body, 8, Math.min(until + 1, frames.count), at, "blue", []);
    const ghost = rehearsedPose(flight, pose);
    if (ghost) {
      context.beginPath();
      for (const [, ...posture] of flight.rehearsed.course) context.lineTo(...at(posture));
      context.strokeStyle = this.colour("red");
      context.lineWidth = 2.4;
      context.stroke();
      this.vehicle(ghost, at);
    }
    this.vehicle(pose, at);
    context.restore();
  }

  path(values, width, count, at, colour, dash) {
    const { context } = this;
    if (!values.length) return;
    context.beginPath();
    for (let i = 0; i < count; i++) context.lineTo(...at(values.subarray(i * width, i * width + 3)));
    context.strokeStyle = this.colour(colour);
    context.lineWidth = 1.6;
    context.setLineDash(dash);
    context.stroke();
    context.setLineDash([]);
  }

  vehicle(pose, at) {
    const { context, scale } = this;
    const shape = shapeOf(this.flight.vehicle, pose.beta);
    const world = (p) => add(pose.position, turn(pose.attitude, p.map((v) => v * scale)));
    const line = (from, to, colour, wide) => {
      context.beginPath();
      context.moveTo(...at(from));
      context.lineTo(...at(to));
      context.strokeStyle = this.colour(colour);
      context.lineWidth = wide;
      context.stroke();
    };
    const arrow = (from, vector, colour) => {
      if (Math.hypot(...vector) > 1e-3) line(from, add(from, vector), colour, 3);
    };
    const reach = arrows(this.flight.vehicle, scale);
    const up = turn(pose.attitude, [0, 0, 1]);
    shape.arms.forEach(({ root, elbows, rotor }, i) => {
      line(pose.position, world(root), "grey", 5);
      for (const elbow of elbows) {
        line(world(root), world(elbow), "black", 2);
        line(world(elbow), world(rotor), "purple", 2);
      }
      context.beginPath();
      for (let k = 0; k <= 32; k++) {
        const a = (k * Math.PI) / 16;
        context.lineTo(...at(world(add(rotor, [Math.cos(a), Math.sin(a), 0], shape.propeller))));
      }
      context.globalAlpha = 0.4;
      context.fillStyle = this.colour(i === 0 ? "orange" : "sky");
      context.fill();
      context.globalAlpha = 1;
      arrow(world(rotor), up.map((v) => v * pose.thrust[i] * reach.thrust), "blue");
    });
    arrow(pose.position, pose.wind.map((v) => v * reach.wind), "sky");
    arrow(pose.position, pose.force.map((v) => v * reach.force), "red");
    if (pose.wanted) {
      const [x, y] = at(pose.wanted);
      context.fillStyle = this.colour("orange");
      context.fillRect(x - 3, y - 3, 6, 6);
    }
  }
}
