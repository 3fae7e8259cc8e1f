// What stands beside the pictures: read-outs, events, loops, and the signs on the time axis.

const MARKS = {
  swap: { sign: "◆", colour: "blue", name: "swap" },
  fault: { sign: "✖", colour: "red", name: "fault" },
  disturbance: { sign: "▲", colour: "purple", name: "disturbance" },
  order: { sign: "▶", colour: "green", name: "order" },
  note: { sign: "●", colour: "grey", name: "note" },
};

/** What the lines in space mean. */
function fillKey(list, view) {
  const entries = [["blue", "flown; rotor thrusts"], ["orange", "reference; front rotor"], ["sky", "wind"], ["red", "external force"]];
  list.replaceChildren(...entries.map(([colour, text]) => {
    const item = document.createElement("li");
    const line = document.createElement("i");
    line.style.borderColor = `var(--${colour})`;
    item.append(line, text);
    return item;
  }), document.createElement("li"));
  view.changed?.();
}

function tableRow(cells, kind) {
  const line = document.createElement("tr");
  line.append(...cells.map((text) => Object.assign(document.createElement(kind), { textContent: text })));
  return line;
}

function fillLoops(table, loops) {
  const columns = ["steps", "skipped", "missed", "late", "lost", "restarts"];
  table.replaceChildren(tableRow(["loop", ...columns], "th"), ...loops.map((one) => tableRow([one.name, ...columns.map((c) => one[c])], "td")));
}

/** The processes that fly, as the launcher of a running flight knows it. */
function fillProcesses(table, processes) {
  const rows = processes.map((one) => tableRow([
    one.seat > 0 ? `${one.name}@${one.seat}` : one.name, one.state, one.pid ?? "\u2013", figure(one.rate_hz, 0), one.generation, figure(one.mark_age_s, 2),
  ], "td"));
  table.replaceChildren(tableRow(["process", "state", "pid", "Hz", "restarts", "last mark [s]"], "th"), ...rows);
}

/** What happened, with the signs that stand for it on the time axis. */
function fillEvents(list, signs, events, seek) {
  const items = events.map((event) => {
    const { sign, colour, name } = MARKS[event.kind];
    const button = document.createElement("button");
    const icon = Object.assign(document.createElement("span"), { textContent: sign, title: name });
    icon.style.color = `var(--${colour})`;
    const time = Object.assign(document.createElement("b"), { textContent: `${figure(event.at_s, 3)} s` });
    button.append(icon, time, Object.assign(document.createElement("span"), { textContent: event.text }));
    button.className = event.is_mark ? "" : "minor";
    button.addEventListener("click", () => seek(event.at_s));
    const item = document.createElement("li");
    item.append(button);
    return item;
  });
  list.events = events;
  if (items.length === 0) items.push(Object.assign(document.createElement("li"), { textContent: "nothing but the flight itself" }));
  list.replaceChildren(...items);
  const kinds = [...new Set(events.map((event) => event.kind))];
  signs.replaceChildren(...kinds.map((kind) => {
    const sign = document.createElement("i");
    sign.textContent = `${MARKS[kind].sign} ${MARKS[kind].name}`;
    sign.style.color = `var(--${MARKS[kind].colour})`;
    return sign;
  }));
}

/** Marks what happened last before time t in the list, and keeps it in sight. */
function showEvent(list, t) {
  const { events } = list;
  let last = -1;
  events.forEach((event, i) => {
    if (event.at_s <= t + 1e-9 && (last < 0 || event.at_s >= events[last].at_s)) last = i;
  });
  const item = last < 0 ? null : list.children[last];
  const before = list.querySelector("[aria-current]");
  if (item === before) return;
  before?.removeAttribute("aria-current");
  if (!item) return;
  item.setAttribute("aria-current", "true");
  const room = list.parentElement;
  const [inner, outer] = [item.getBoundingClientRect(), room.getBoundingClientRect()];
  if (inner.top < outer.top || inner.bottom > outer.bottom) room.scrollTop += inner.top - outer.top - outer.height / 3;
}

/** Signs of the events over the slider. */
function drawStrip(canvas, flight, [from, to]) {
  const context = canvas.getContext("2d");
  const ratio = fit(canvas);
  const wide = canvas.width / ratio;
  const style = getComputedStyle(document.documentElement);
  context.setTransform(ratio, 0, 0, ratio, 0, 0);
  context.clearRect(0, 0, wide, canvas.height);
  context.textAlign = "center";
  context.textBaseline = "middle";
  // The slider's thumb is this far from its ends.
  const inset = 8;
  for (const event of flight.events) {
    const x = inset + ((event.at_s - from) / (to - from)) * (wide - 2 * inset);
    const { sign, colour } = MARKS[event.kind];
    context.fillStyle = style.getPropertyValue(`--${colour}`);
    context.globalAlpha = event.is_mark ? 1 : 0.5;
    context.font = event.is_mark ? "13px sans-serif" : "8px sans-serif";
    context.fillText(sign, Math.max(inset, Math.min(wide - inset, x)), 7);
  }
  context.globalAlpha = 1;
}

function showNow(list, flight, pose, t) {
  const [w, x, y, z] = pose.attitude;
  const degrees = 180 / Math.PI;
  const roll = Math.atan2(2 * (w * x + y * z), 1 - 2 * (x * x + y * y)) * degrees;
  const pitch = Math.asin(Math.max(-1, Math.min(1, 2 * (w * y - z * x)))) * degrees;
  const yaw = Math.atan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z)) * degrees;
  const error = pose.wanted ? `${figure(Math.hypot(...sub(pose.position, pose.wanted)) * 1000, 1)} mm` : "no reference";
  const entries = [
    ["position x, y, z [m]", pose.position.map((v) => figure(v, 2)).join("  ")],
    ["roll, pitch, yaw [°]", [roll, pitch, yaw].map((v) => figure(v, 1)).join("  ")],
    ["deployable angle β", `${figure(pose.beta * degrees, 1)}°`],
    ["arm length", `${figure(armLength(flight.vehicle, pose.beta) * 1000, 1)} mm`],
    ["position error", error],
    ["thrust", `${figure(pose.thrust.reduce((a, b) => a + b, 0), 2)} N`],
    ["wind", `${figure(Math.hypot(...pose.wind), 2)} m/s`],
    ["external force", `${figure(Math.hypot(...pose.force), 2)} N`],
  ];
  list.replaceChildren(...entries.map(([name, value]) => {
    const cell = document.createElement("div");
    cell.append(Object.assign(document.createElement("dt"), { textContent: name }), Object.assign(document.createElement("dd"), { textContent: value }));
    return cell;
  }));
}
