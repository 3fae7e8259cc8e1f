// Puts the flight on the page and time in motion.

/** Between two pictures of the charts while a flight under way is followed. */
const CHARTS_MS = 60;

/** The vehicle in space, or from above and from the side where the browser cannot. */
function viewOf(flight, element, wanted) {
  let view = null;
  try {
    view = wanted === "2d" ? null : SpaceView.on(element("scene"), element("labels"), flight);
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
  return view;
}

function showOutcome(element, { is_good: isGood, text }, isOver) {
  element("outcome").textContent = `${isOver ? (isGood ? "✔ " : "✖ ") : ""}${text}`;
  element("outcome").title = text;
  element("outcome").className = isGood ? "good" : "bad";
}

/** The panes of a flight under way, which get from the server what is new. */
function goLive(flight, player, element, refresh) {
  document.documentElement.dataset.live = "yes";
  for (const id of ["badge", "recent", "edge", "processes"]) element(id).hidden = false;
  const control = new Control(element("control"), flight.live);
  const demo = flight.live.demo ? new Demo(element("demo"), flight, control) : null;
  if (demo) element("control").open = false;
  const notice = (text) => {
    if (element("notice").textContent !== text) element("notice").textContent = text;
    element("notice").hidden = text === "";
  };
  new Live(flight, player.edge, ({ lost, status, dropped, isOver, hasEvents }) => {
    element("badge").textContent = isOver ? "ENDED" : lost ? "LOST" : "LIVE";
    element("badge").className = isOver ? "over" : lost ? "lost" : "";
    if (lost) return notice(lost);
    if (status) {
      fillProcesses(element("processes").lastElementChild, status.processes);
      control.status(status);
      demo?.status(status);
      flight.recording = status.recording;
    }
    element("dropped").textContent = dropped > 0 ? `${dropped} samples left out` : "";
    showOutcome(element, flight.outcome, isOver);
    notice(isOver ? `The flight has ended; this page keeps what it has shown. The whole flight: morphquad view ${flight.recording ?? "FILE"}` : "");
    if (isOver) {
      control.over();
      element("edge").disabled = true;
    }
    refresh(hasEvents);
  });
}

function start() {
  const element = (id) => document.getElementById(id);
  const flight = readFlight(element("flight").textContent);
  // An address may end with what to show: #t=14.1&theme=dark&view=course&from=13&to=17
  const asked = new URLSearchParams(location.hash.slice(1));
  const player = new Player(flight, flight.live ? new Edge() : null);
  let dirty = true;
  const changed = () => { dirty = true; };

  const setTheme = (name) => {
    document.documentElement.dataset.theme = name;
    element("theme").textContent = name === "dark" ? "light" : "dark";
  };
  const dark = matchMedia("(prefers-color-scheme: dark)").matches;
  setTheme(["dark", "light"].includes(asked.get("theme")) ? asked.get("theme") : dark ? "dark" : "light");
  document.title = `morphquad · ${flight.title}`;
  element("title").textContent = flight.title;
  showOutcome(element, flight.outcome, !flight.live);
  const view = viewOf(flight, element, asked.get("view"));
  view.changed = changed;

  const charts = [];
  for (const chart of flight.charts) {
    if (chart.group) element("charts").append(Object.assign(document.createElement("h2"), { textContent: chart.group }));
    const canvas = document.createElement("canvas");
    element("charts").append(canvas);
    charts.push(new Chart(canvas, chart, flight));
  }

  // What buttons and slider show of the player.
  const shown = () => {
    element("play").textContent = player.plays || player.follows ? "pause" : "play";
    element("unzoom").disabled = player.span === null;
    element("edge").setAttribute("aria-pressed", String(player.follows));
    element("recent").setAttribute("aria-pressed", String(player.span === RECENT_S));
    changed();
  };
  const act = (what) => (...args) => { what(...args); shown(); };
  const seek = act((t) => player.seek(t));
  const play = act(() => player.play(!player.plays && !player.follows));
  const zoom = act((window) => player.zoom(window));
  const toEdge = act(() => player.follow());

  element("facts").append(...flight.facts.map((fact) => tableRow(fact, "td")));
  let marks = [];
  const refresh = (hasEvents) => {
    fillLoops(element("loops"), flight.loops);
    [element("scrub").min, element("scrub").max] = player.whole;
    if (hasEvents) {
      marks = flight.events.filter((event) => event.is_mark);
      // Of a flight under way, what has just happened comes first.
      fillEvents(element("events"), element("signs"), flight.live ? flight.events.toReversed() : flight.events, seek);
    }
    changed();
  };
  refresh(true);

  for (const chart of charts) {
    let held = false;
    const at = (event) => seek(chart.timeAt(event.clientX, player.window));
    chart.canvas.addEventListener("pointerdown", (event) => { held = true; chart.canvas.setPointerCapture(event.pointerId); at(event); });
    chart.canvas.addEventListener("pointermove", (event) => { if (held) at(event); });
    chart.canvas.addEventListener("pointerup", () => { held = false; });
    chart.canvas.addEventListener("dblclick", () => zoom(player.whole));
    chart.canvas.addEventListener("wheel", (event) => {
      // A bare wheel scrolls the page.
      if (!event.ctrlKey && !event.shiftKey) return;
      event.preventDefault();
      const centre = chart.timeAt(event.clientX, player.window);
      const factor = Math.exp((event.deltaY || event.deltaX) * 0.002);
      zoom(player.window.map((t) => centre + (t - centre) * factor));
    }, { passive: false });
  }
  element("charts").title = "Click for a time; Shift and wheel to zoom, double click for the whole flight";

  element("play").addEventListener("click", play);
  element("edge").addEventListener("click", toEdge);
  element("recent").addEventListener("click", act(() => player.recent()));
  element("speed").addEventListener("change", (event) => { player.speed = Number(event.target.value); });
  element("unzoom").addEventListener("click", () => zoom(player.whole));
  element("bounds").addEventListener("change", changed);
  element("theme").addEventListener("click", () => {
    setTheme(document.documentElement.dataset.theme === "dark" ? "light" : "dark");
    view.theme();
    fillKey(element("key"), view);
    changed();
  });
  const scrub = element("scrub");
  scrub.addEventListener("input", () => seek(Number(scrub.value)));
  for (const button of document.querySelectorAll("#views button")) {
    button.addEventListener("click", () => {
      view.mode = button.dataset.view;
      for (const other of document.querySelectorAll("#views button")) other.setAttribute("aria-pressed", String(other === button));
      changed();
    });
  }
  addEventListener("keydown", (event) => {
    const { target } = event;
    if (target.tagName === "INPUT" && target.type !== "range" || ["SELECT", "BUTTON", "SUMMARY"].includes(target.tagName) || target.closest("#control")) return;
    const step = event.shiftKey ? 1 : 0.05;
    if (event.key === " ") play();
    else if (event.key === "ArrowRight") seek(player.t + step);
    else if (event.key === "ArrowLeft") seek(player.t - step);
    else if (event.key === "Home") seek(player.whole[0]);
    else if (event.key === "End") player.edge ? toEdge() : seek(player.whole[1]);
    else if (event.key.toLowerCase() === "l" && player.edge && !event.ctrlKey && !event.metaKey) toEdge();
    else return;
    event.preventDefault();
  });
  new ResizeObserver(changed).observe(document.body);
  element("charts").addEventListener("scroll", changed);

  let drawn_ms = -Infinity;
  const draw = (now_ms) => {
    const pose = poseAt(flight, player.t);
    view.draw(pose, player.t);
    // Of a flight under way, what moves by less than a pixel waits for a later picture.
    if (player.follows && now_ms - drawn_ms < CHARTS_MS) return;
    drawn_ms = now_ms;
    const scale = view.scale > 1 ? `, vehicle drawn ${view.scale}×` : "";
    element("key").lastChild.textContent = `grid 1 m${scale}`;
    const pane = element("charts").getBoundingClientRect();
    for (const chart of charts) {
      const { top, bottom } = chart.canvas.getBoundingClientRect();
      if (!chart.isHidden && bottom > pane.top && top < pane.bottom) chart.draw(player.t, player.window, element("bounds").checked, marks);
    }
    drawStrip(element("strip"), flight, player.whole);
    showNow(element("now"), flight, pose, player.t);
    showEvent(element("events"), player.t);
    scrub.value = player.t;
    element("clock").textContent = `${figure(player.t, 2)} / ${figure(player.whole[1], 2)} s`;
  };
  fillKey(element("key"), view);
  const number = (name) => (asked.has(name) && Number.isFinite(Number(asked.get(name))) ? Number(asked.get(name)) : null);
  if (number("t") !== null) seek(number("t"));
  if (number("from") !== null && number("to") > number("from")) zoom([number("from"), number("to")]);
  if (asked.get("view") === "course") document.querySelector('[data-view="course"]').click();
  if (flight.live) {
    goLive(flight, player, element, (hasEvents) => {
      for (const chart of charts) chart.refresh();
      view.refresh();
      refresh(hasEvents);
    });
  }
  shown();
  let last = null;
  const frame = (now) => {
    const { plays, follows } = player;
    if (last !== null && player.advance(now / 1000, (now - last) / 1000)) changed();
    // It has come to an end, or to the newest sample.
    if (plays !== player.plays || follows !== player.follows) shown();
    last = now;
    if (dirty) {
      dirty = false;
      draw(now);
    }
    requestAnimationFrame(frame);
  };
  draw(performance.now());
  requestAnimationFrame(frame);
  document.documentElement.dataset.ready = "yes";
}

try {
  start();
} catch (error) {
  document.documentElement.dataset.error = String(error);
  document.body.prepend(Object.assign(document.createElement("p"), { id: "broken", textContent: `This page cannot show the flight: ${error.message}` }));
  throw error;
}
