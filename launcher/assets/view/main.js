// Puts the flight on the page and time in motion.

const MARKS = {
  swap: { sign: "◆", colour: "blue", name: "swap" },
  fault: { sign: "✖", colour: "red", name: "fault" },
  disturbance: { sign: "▲", colour: "purple", name: "disturbance" },
  order: { sign: "▶", colour: "green", name: "order" },
  note: { sign: "●", colour: "grey", name: "note" },
};

function start() {
  const element = (id) => document.getElementById(id);
  const flight = readFlight(element("flight").textContent);
  const whole = [flight.from_s, Math.max(flight.to_s, flight.from_s + 1e-3)];
  const state = { t: flight.from_s, window: [...whole], plays: false, speed: 1, dirty: true };
  const changed = () => { state.dirty = true; };

  const setTheme = (name) => {
    document.documentElement.dataset.theme = name;
    element("theme").textContent = name === "dark" ? "light" : "dark";
  };
  // An address may end with what to show: #t=14.1&theme=dark&view=course&from=13&to=17
  const asked = new URLSearchParams(location.hash.slice(1));
  const dark = matchMedia("(prefers-color-scheme: dark)").matches;
  setTheme(["dark", "light"].includes(asked.get("theme")) ? asked.get("theme") : dark ? "dark" : "light");

  document.title = `morphquad · ${flight.title}`;
  element("title").textContent = flight.title;
  element("outcome").textContent = `${flight.outcome.is_good ? "✔" : "✖"} ${flight.outcome.text}`;
  element("outcome").title = flight.outcome.text;
  element("outcome").className = flight.outcome.is_good ? "good" : "bad";

  let view = null;
  try {
    view = asked.get("view") === "2d" ? null : SpaceView.on(element("scene"), element("labels"), flight);
  } catch (error) {
    console.warn(error);
  }
  if (!view) {
    const message = element("message");
    message.textContent = "This browser has no WebGL 2: the vehicle is shown from above and from the side. To see it in space, turn on hardware acceleration or use another browser.";
    message.hidden = false;
    // A canvas that was asked for WebGL gives no other context.
    view = new PlanView(element("labels"), flight);
  }
  document.documentElement.dataset.view = view instanceof PlanView ? "2d" : "3d";
  view.changed = changed;

  const charts = [];
  for (const chart of flight.charts) {
    if (chart.group) {
      const heading = document.createElement("h2");
      heading.textContent = chart.group;
      element("charts").append(heading);
    }
    const canvas = document.createElement("canvas");
    element("charts").append(canvas);
    charts.push(new Chart(canvas, chart, flight));
  }
  fillLists(flight, element, (t) => seek(t));

  const seek = (t) => {
    state.t = Math.max(whole[0], Math.min(whole[1], t));
    changed();
  };
  const play = (plays) => {
    if (plays && state.t >= whole[1]) seek(whole[0]);
    state.plays = plays;
    element("play").textContent = plays ? "pause" : "play";
  };
  const zoom = (window) => {
    const span = Math.max(0.01, Math.min(window[1] - window[0], whole[1] - whole[0]));
    const from = Math.max(whole[0], Math.min(window[0], whole[1] - span));
    state.window = [from, from + span];
    element("unzoom").disabled = span >= whole[1] - whole[0];
    changed();
  };

  for (const chart of charts) {
    let held = false;
    const at = (event) => seek(chart.timeAt(event.clientX, state.window));
    chart.canvas.addEventListener("pointerdown", (event) => { held = true; chart.canvas.setPointerCapture(event.pointerId); at(event); });
    chart.canvas.addEventListener("pointermove", (event) => { if (held) at(event); });
    chart.canvas.addEventListener("pointerup", () => { held = false; });
    chart.canvas.addEventListener("dblclick", () => zoom(whole));
    chart.canvas.addEventListener("wheel", (event) => {
      // A bare wheel scrolls the page.
      if (!event.ctrlKey && !event.shiftKey) return;
      event.preventDefault();
      const centre = chart.timeAt(event.clientX, state.window);
      const factor = Math.exp((event.deltaY || event.deltaX) * 0.002);
      zoom(state.window.map((t) => centre + (t - centre) * factor));
    }, { passive: false });
  }
  element("charts").title = "Click for a time; Shift and wheel to zoom, double click for the whole flight";

  element("play").addEventListener("click", () => play(!state.plays));
  element("speed").addEventListener("change", (event) => { state.speed = Number(event.target.value); });
  element("unzoom").addEventListener("click", () => zoom(whole));
  element("bounds").addEventListener("change", changed);
  element("theme").addEventListener("click", () => {
    setTheme(document.documentElement.dataset.theme === "dark" ? "light" : "dark");
    view.theme();
    fillKey(element("key"), view);
    changed();
  });
  const scrub = element("scrub");
  [scrub.min, scrub.max] = whole;
  scrub.addEventListener("input", () => seek(Number(scrub.value)));
  for (const button of document.querySelectorAll("#views button")) {
    button.addEventListener("click", () => {
      view.mode = button.dataset.view;
      for (const other of document.querySelectorAll("#views button")) other.setAttribute("aria-pressed", String(other === button));
      changed();
    });
  }
  addEventListener("keydown", (event) => {
    if (event.target.tagName === "INPUT" && event.target.type !== "range" || event.target.tagName === "SELECT" || event.target.tagName === "BUTTON") return;
    const step = event.shiftKey ? 1 : 0.05;
    if (event.key === " ") play(!state.plays);
    else if (event.key === "ArrowRight") seek(state.t + step);
    else if (event.key === "ArrowLeft") seek(state.t - step);
    else if (event.key === "Home") seek(whole[0]);
    else if (event.key === "End") seek(whole[1]);
    else return;
    event.preventDefault();
  });
  new ResizeObserver(changed).observe(document.body);
  element("charts").addEventListener("scroll", changed);

  const marks = flight.events.filter((event) => event.is_mark);
  const draw = () => {
    const pose = poseAt(flight, state.t);
    view.draw(pose, state.t);
    const scale = view.scale > 1 ? `, vehicle drawn ${view.scale}×` : "";
    element("key").lastChild.textContent = `grid 1 m${scale}`;
    const pane = element("charts").getBoundingClientRect();
    for (const chart of charts) {
      const { top, bottom } = chart.canvas.getBoundingClientRect();
      if (bottom > pane.top && top < pane.bottom) chart.draw(state.t, state.window, element("bounds").checked, marks);
    }
    drawStrip(element("strip"), flight, whole);
    showNow(element("now"), flight, pose, state.t);
    scrub.value = state.t;
    element("clock").textContent = `${figure(state.t, 2)} / ${figure(whole[1], 2)} s`;
  };
  fillKey(element("key"), view);
  const number = (name) => (asked.has(name) && Number.isFinite(Number(asked.get(name))) ? Number(asked.get(name)) : null);
  if (number("t") !== null) seek(number("t"));
  if (number("from") !== null && number("to") > number("from")) zoom([number("from"), number("to")]);
  if (asked.get("view") === "course") document.querySelector('[data-view="course"]').click();
  let last = null;
  const frame = (now) => {
    if (state.plays && last !== null) {
      seek(state.t + ((now - last) / 1000) * state.speed);
      if (state.t >= whole[1]) play(false);
    }
    last = now;
    if (state.dirty) {
      state.dirty = false;
      draw();
    }
    requestAnimationFrame(frame);
  };
  draw();
  requestAnimationFrame(frame);
  document.documentElement.dataset.ready = "yes";
}

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

function fillLists(flight, element, seek) {
  const row = (cells, kind) => {
    const line = document.createElement("tr");
    line.append(...cells.map((text) => Object.assign(document.createElement(kind), { textContent: text })));
    return line;
  };
  element("facts").append(...flight.facts.map((fact) => row(fact, "td")));
  const columns = ["steps", "skipped", "missed", "late", "lost", "restarts"];
  element("loops").append(row(["loop", ...columns], "th"), ...flight.loops.map((one) => row([one.name, ...columns.map((c) => one[c])], "td")));
  const items = flight.events.map((event) => {
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
  if (items.length === 0) items.push(Object.assign(document.createElement("li"), { textContent: "nothing but the flight itself" }));
  element("events").append(...items);
  const kinds = [...new Set(flight.events.map((event) => event.kind))];
  element("signs").append(...kinds.map((kind) => {
    const sign = document.createElement("i");
    sign.textContent = `${MARKS[kind].sign} ${MARKS[kind].name}`;
    sign.style.color = `var(--${MARKS[kind].colour})`;
    return sign;
  }));
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

try {
  start();
} catch (error) {
  document.documentElement.dataset.error = String(error);
  document.body.prepend(Object.assign(document.createElement("p"), { id: "broken", textContent: `This page cannot show the flight: ${error.message}` }));
  throw error;
}
