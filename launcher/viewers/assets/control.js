// Buttons for what can be asked of a flight under way. Ranges are those of the launcher's orders.

const MAX_DURATION_S = 3600;
const REACH_M = 100;
/** A second click on Stop counts for this long. */
const SURE_MS = 3000;
/** What a swap goes through, by the launcher's names of its stages. */
const COURSE = [["join", ["joining"]], ["shadow", ["tracking", "shadowing"]], ["rehearse", ["rehearsing"]], ["flip", ["flipping", "reverting"]], ["window", ["window"]]];
/** How long the controller before stays warm after a swap: a user has to see it and find the button. */
const ROLLBACK_S = 10;
const WITHOUT_TOKEN = "To use these buttons, open the address with the token that `morphquad run --live` printed where it was started, on the line that begins with “live”.";

/** Three numbers along east, north and up, or along the vehicle's own axes. */
const vector = (unit, limit, preset) => ["x", "y", "z"].map((name, i) => ({ name, unit, min: -limit, max: limit, value: preset[i] }));

/** What can disturb the vehicle: its numbers, and the load that they make. `once` does not last. */
const LOADS = {
  wind: {
    fields: [...vector("m/s", 100, [4, 0, 0]), { name: "gust", unit: "m/s", min: 0, max: 50, value: 0 }], lasts_s: 5,
    load: ([x, y, z, gust]) => ({ wind: { mean_w_m_s: [x, y, z], sigma_w_m_s: [gust, gust, gust] } }),
  },
  force: { fields: vector("N", 100, [0.3, 0, 0]), lasts_s: 1, load: (force) => ({ force_w_n: force }) },
  torque: { fields: vector("N m", 10, [0.02, 0, 0]), lasts_s: 1, load: (torque) => ({ torque_b_nm: torque }) },
  kick: { fields: vector("rad/s", 100, [2, 0, 0]), once: true, load: (rate) => ({ kick_b_rad_s: rate }) },
  payload: { fields: [{ name: "mass", unit: "kg", min: 0, max: 10, value: 0.02 }], lasts_s: 5, load: ([mass]) => ({ payload_kg: mass }) },
  rotor: {
    fields: [{ name: "rotor", unit: "1 front, 2 left, 3 rear, 4 right", min: 1, max: 4, value: 1, step: 1 }, { name: "efficiency", unit: "1 is healthy", min: 0, max: 1, value: 0.85 }],
    lasts_s: 5, load: ([rotor, efficiency]) => ({ rotor: { rotor, efficiency } }),
  },
};

/** An element with properties and what is in it. */
function made(tag, properties, ...inside) {
  const { aria, ...others } = properties;
  const element = Object.assign(document.createElement(tag), others);
  if (aria) element.setAttribute("aria-label", aria);
  element.append(...inside);
  return element;
}

/** A labelled number. */
function numeric({ name, unit, min, max, value = "", step = "any", required = true }) {
  const input = made("input", { type: "number", min, max, step, value, required, title: `${name} [${unit}], ${min} to ${max}` });
  return { input, label: made("label", {}, name, " ", input) };
}

/** The token in the page's address is taken out of it; a reload finds it again. */
function takeToken(run) {
  const key = `morphquad-token-${run}`;
  const fragment = new URLSearchParams(location.hash.slice(1));
  const kept = (use) => { try { return use(sessionStorage); } catch { return null; } };
  const token = fragment.get("token");
  if (token === null) return kept((store) => store.getItem(key));
  fragment.delete("token");
  const rest = fragment.toString();
  history.replaceState(null, "", location.pathname + location.search + (rest ? `#${rest}` : ""));
  kept((store) => store.setItem(key, token));
  return token;
}

class Control {
  constructor(panel, live) {
    Object.assign(this, { panel, live, isOver: false, slots: [] });
    this.answer = panel.querySelector("output");
    const rows = panel.querySelector("#orders");
    this.slots = live.slots.map((slot) => this.slot(slot));
    rows.append(...this.slots.map(({ form }) => form), this.goTo(), this.morph(), this.disturb(), this.stop());
    addEventListener("hashchange", () => this.open(takeToken(live.run)));
    this.open(takeToken(live.run));
    panel.hidden = false;
  }

  /** With a token the buttons work; without, the panel shows where it is. */
  open(token) {
    this.token = token;
    const works = this.live.may_order && token !== null && !this.isOver;
    for (const part of this.panel.querySelectorAll("fieldset")) part.disabled = !works;
    if (this.isOver) this.report(true, "The flight has ended.");
    else if (!this.live.may_order) this.report(true, "This flight takes no orders from a page.");
    else this.report(true, token === null ? WITHOUT_TOKEN : "");
    if (works) this.prove(token);
  }

  /** A token of another flight is found out before a user presses a button. */
  async prove(token) {
    const { isWrongToken, text } = await command(token, { request: "ps" });
    if (!isWrongToken || token !== this.token || this.isOver) return;
    for (const part of this.panel.querySelectorAll("fieldset")) part.disabled = true;
    this.report(false, `wrong token: ${text}`);
  }

  over() {
    this.isOver = true;
    this.open(this.token);
  }

  report(isGood, text) {
    this.answer.textContent = text;
    this.answer.title = text;
    this.answer.className = isGood ? "" : "bad";
  }

  /** Sends a request and reports what came of it; a button asks one thing at a time. */
  async send(button, name, request) {
    if (button.ariaBusy === "true") return;
    button.ariaBusy = "true";
    this.report(true, `${name}: asked …`);
    const { isGood, isWrongToken, text } = await command(this.token, request);
    button.ariaBusy = "false";
    if (this.isOver) return;
    this.report(isGood, isWrongToken ? `wrong token: ${text}` : `${isGood ? "✔" : "✖"} ${name}: ${text}`);
  }

  /** A row whose first button, or Enter, asks for something. */
  row(name, parts, submit) {
    const field = made("fieldset", { aria: name }, ...parts);
    const form = made("form", { className: "row" }, made("b", { textContent: name }), field);
    form.addEventListener("submit", (event) => {
      event.preventDefault();
      submit(form.querySelector("[type=submit]"));
    });
    return form;
  }

  slot({ slot, controllers }) {
    const owner = made("span", { className: "owner", textContent: "–" });
    const choice = made("select", { aria: `next controller of the ${slot} slot` }, ...controllers.map((name) => made("option", { value: name, textContent: name })));
    const back = made("button", { type: "button", textContent: "Roll back", title: `To the controller before, which stays warm for ${ROLLBACK_S} s after a swap` });
    back.addEventListener("click", () => this.send(back, `roll back ${slot}`, { request: "rollback", slot }));
    const swap = made("button", { textContent: "Swap", type: "submit" });
    const course = made("span", { className: "course", hidden: true });
    const stages = COURSE.map(([name, stages]) => ({ stages, part: made("span", { textContent: name }) }));
    const when = made("span", { className: "when" });
    course.append(...stages.map(({ part }) => part), when);
    const form = this.row(slot, [owner, choice, swap, back, course],
      (button) => this.send(button, `swap ${slot} to ${choice.value}`, { request: "swap", slot, to: choice.value, rollback_ns: ROLLBACK_S * 1e9 }));
    return { form, slot, owner, choice, swap, back, course, stages, when };
  }

  goTo() {
    const place = [..."xyz"].map((name, i) => numeric({ name, unit: "m", min: name === "z" ? 0.2 : -REACH_M, max: REACH_M, value: [0, 0, 1][i] }));
    const yaw = numeric({ name: "yaw °", unit: "deg", min: -360, max: 360, required: false });
    yaw.input.placeholder = "as is";
    yaw.input.className = "optional";
    return this.row("go to", [...place.map(({ label }) => label), yaw.label, made("button", { textContent: "Go", type: "submit" })], (button) => {
      const goto = { position_w_m: place.map(({ input }) => input.valueAsNumber) };
      if (yaw.input.value !== "") goto.yaw_deg = yaw.input.valueAsNumber;
      this.send(button, "go to", { request: "order", order: { goto } });
    });
  }

  morph() {
    const angle = made("input", { type: "range", min: 45, max: 160, step: 1, value: 90, aria: "deployable angle β [deg]" });
    const shown = made("output", { className: "angle", textContent: "90°" });
    angle.addEventListener("input", () => { shown.textContent = `${angle.value}°`; });
    const over = numeric({ name: "over s", unit: "s", min: 0, max: MAX_DURATION_S, value: 2 });
    return this.row("morph β", [angle, shown, over.label, made("button", { textContent: "Morph", type: "submit" })], (button) => {
      const morph = { angle_deg: angle.valueAsNumber, over_s: over.input.valueAsNumber };
      this.send(button, "morph", { request: "order", order: { morph } });
    });
  }

  disturb() {
    const choice = made("select", { aria: "what disturbs" }, ...Object.keys(LOADS).map((name) => made("option", { value: name, textContent: name })));
    const place = made("span", { className: "fields" });
    const during = numeric({ name: "for s", unit: "s", min: 0.001, max: MAX_DURATION_S, required: false });
    during.input.placeholder = "ever";
    during.input.className = "optional";
    let inputs = [];
    const choose = () => {
      const { fields, once, lasts_s } = LOADS[choice.value];
      const shown = fields.map(numeric);
      inputs = shown.map(({ input }) => input);
      const unit = new Set(fields.map((field) => field.unit)).size === 1 ? [` ${fields[0].unit}`] : [];
      place.replaceChildren(...shown.map(({ label }) => label), ...unit);
      during.label.hidden = Boolean(once);
      during.input.value = lasts_s ?? "";
    };
    choice.addEventListener("change", choose);
    choose();
    const calm = made("button", { type: "button", textContent: "Calm", title: "Ends every disturbance that was ordered" });
    calm.addEventListener("click", () => this.send(calm, "calm", { request: "order", order: { calm: {} } }));
    return this.row("disturb", [choice, place, during.label, made("button", { textContent: "Disturb", type: "submit" }), calm], (button) => {
      const disturb = { load: LOADS[choice.value].load(inputs.map((input) => input.valueAsNumber)) };
      if (!LOADS[choice.value].once && during.input.value !== "") disturb.for_s = during.input.valueAsNumber;
      this.send(button, `disturb ${choice.value}`, { request: "order", order: { disturb } });
    });
  }

  stop() {
    const button = made("button", { type: "submit", textContent: "Stop" });
    let timer = null;
    const calm = () => {
      clearTimeout(timer);
      timer = null;
      button.textContent = "Stop";
    };
    const form = this.row("stop the flight", [button], () => {
      if (timer === null) {
        button.textContent = "Really stop?";
        timer = setTimeout(calm, SURE_MS);
        return;
      }
      calm();
      this.send(button, "stop", { request: "stop" });
    });
    form.classList.add("ends");
    return form;
  }

  /** Shows which controllers command now. */
  status(status) {
    for (const { slot, owner, choice, swap, back, course, stages, when } of this.slots) {
      const now = status.slots.find((one) => one.slot === slot);
      if (!now?.owner) continue;
      const busy = now.candidate !== null;
      swap.disabled = busy;
      swap.title = busy ? `${now.candidate} is under way: wait for its end` : `The chosen controller shadows ${now.owner}, is flown ahead if it is another one, and then commands`;
      const undoes = now.stage === "flipping" || now.stage === "window";
      back.disabled = !undoes;
      back.title = undoes ? "To the controller before, which is still warm" : `There is no swap to roll back: the controller before stays warm for ${ROLLBACK_S} s after a swap`;
      course.hidden = !busy;
      course.title = busy ? `${now.candidate}: ${now.stage}` : "";
      const at = stages.findIndex(({ stages }) => stages.includes(now.stage));
      stages.forEach(({ part }, i) => { part.className = i < at ? "done" : i === at ? "now" : ""; });
      when.textContent = busy ? ` ${now.candidate}${now.until_s === null ? "" : ` until ${now.until_s.toFixed(1)} s`}` : "";
      const isNew = owner.textContent !== now.owner;
      owner.textContent = now.owner;
      owner.title = `commands the ${slot} slot, epoch ${now.epoch}${now.fallback ? `; ${now.fallback} stands by` : ""}${now.watched ? "; watched by the monitor" : ""}`;
      // The next swap is to another one.
      if (isNew && now.owner.startsWith(choice.value)) {
        choice.value = [...choice.options].find((option) => !now.owner.startsWith(option.value))?.value ?? choice.value;
      }
    }
  }
}
