// What a demo offers: one click each, what comes of it, and commands to go on with.

/** A rehearsal that ended badly is drawn this long [s], at a part of its speed. */
const DRAWN_S = 20;
const SLOWED = 0.35;
/** How long it rests at its end before it is drawn again [s]. */
const RESTS_S = 0.8;

const NEXT = [
  ["a flight in realtime, with a swap", "morphquad run figure8-morph --clock realtime --swap attitude=attitude-lqr@6s"],
  ["a picture of this one", "morphquad plot latest truth.position_w_m"],
  ["a scenario of your own", "morphquad scenario new mine.toml"],
];

/** The vehicle of a rehearsal that ended badly, as a pose beside the one that flies; null if there is none. */
function rehearsedPose(flight, pose) {
  const { rehearsed } = flight;
  if (!rehearsed) return null;
  const { course, since_ms } = rehearsed;
  const shown_s = (performance.now() - since_ms) / 1000;
  if (shown_s > DRAWN_S) {
    flight.rehearsed = null;
    return null;
  }
  const length_s = course.at(-1)[0] - course[0][0];
  const t = course[0][0] + Math.min((shown_s * SLOWED) % (length_s + RESTS_S * SLOWED), length_s);
  const [, x, y, z, ...attitude] = course.findLast(([at]) => at <= t) ?? course[0];
  return { beta: pose.beta, position: [x, y, z], attitude, thrust: [0, 0, 0, 0], wind: [0, 0, 0], force: [0, 0, 0], wanted: null };
}

class Demo {
  constructor(panel, flight, control) {
    Object.assign(this, { panel, flight, control, isWide: false, owner: "" });
    this.answer = panel.querySelector("output");
    const tries = [
      ["Gust", "Wind of 4.5 m/s with gusts for 4 s", () => this.order({ disturb: { load: { wind: { mean_w_m_s: [4, 2, 0], sigma_w_m_s: [1.5, 1.5, 0.7] } }, for_s: 4 } }),
        () => "the vehicle leans against the wind; see “position error” and “tilt”"],
      ["Arms", "The arms sweep from the smallest vehicle to the largest, or back", () => this.fold(), () => "inertia changes by a factor of five, and the attitude law with it"],
      ["Swap", "Another attitude controller takes over in flight", () => this.swap(), (text) => text],
      ["Bad swap", "An attitude controller whose rate loop is eight times too slow", () => this.ask("bad", "/demo"), (text) => text],
      ["Kill", "Kills the process that commands the attitude", () => this.ask("kill", "/demo"), (text) => `${text}; its successor goes on where it was: see Events`],
    ];
    panel.querySelector(".tries").append(...tries.map(([name, title, ask, describe]) => this.button(name, title, ask, describe)));
    panel.querySelector(".next").append(...NEXT.map(([what, line]) => this.next(what, line)));
    panel.hidden = false;
  }

  button(name, title, ask, describe) {
    const button = made("button", { type: "button", textContent: name, title });
    button.addEventListener("click", async () => {
      if (button.ariaBusy === "true") return;
      button.ariaBusy = "true";
      this.report(true, `${name}: ${title} …`);
      let came = { isGood: false, text: "no answer" };
      try {
        came = await ask();
      } finally {
        button.ariaBusy = "false";
      }
      const { isGood, text, replies } = came;
      const course = replies?.find((reply) => reply.course)?.course;
      if (course) this.flight.rehearsed = { course, since_ms: performance.now() };
      const drawn = course ? " The red course is how the rehearsal went; nothing of it was flown." : "";
      this.report(isGood, isGood ? `✔ ${name}: ${describe(text)}` : `✖ ${name}: ${text}.${drawn}`);
    });
    return button;
  }

  report(isGood, text) {
    this.answer.textContent = text;
    this.answer.className = isGood ? "" : "bad";
  }

  ask(request, path) {
    return command(this.control.token, request, path);
  }

  order(order) {
    return this.ask({ request: "order", order });
  }

  async fold() {
    const found = await this.order({ morph: { angle_deg: this.isWide ? 45 : 160, over_s: 1.5 } });
    if (found.isGood) this.isWide = !this.isWide;
    return found;
  }

  swap() {
    const to = this.owner.startsWith("attitude-mpc") ? "attitude-lqr" : "attitude-mpc";
    return this.ask({ request: "swap", slot: "attitude", to });
  }

  /** Keeps which controller commands now. */
  status(status) {
    this.owner = status.slots.find(({ slot }) => slot === "attitude")?.owner ?? "";
  }

  /** A command with a button that copies it. */
  next(what, line) {
    // Only an address of this machine, or an encrypted one, may write to the clipboard.
    const copy = made("button", { type: "button", textContent: "copy", title: "Copies the command", hidden: !navigator.clipboard });
    copy.addEventListener("click", async () => {
      await navigator.clipboard.writeText(line);
      copy.textContent = "copied";
      setTimeout(() => { copy.textContent = "copy"; }, 1500);
    });
    return made("li", {}, `${what}: `, made("code", { textContent: line }), " ", copy);
  }
}
