// A flight under way: asks the server for what is new, joins it to what is there, and sends what is asked of it.

const POLL_MS = 200;
/** While the page is hidden. */
const HIDDEN_MS = 2000;
const RETRY_MS = 1000;
/** An answer that takes longer does not come. */
const PATIENCE_MS = 10_000;
/** The server stays until every open page has shown the end, so it has to distinguish them. */
const PAGE = `page=${Math.random().toString(36).slice(2)}`;

/** Notifies the server not to wait for this page any longer. */
function notifyClosed() {
  navigator.sendBeacon(`/close?${PAGE}`);
}

/** The first `keep` numbers, then others. */
function joined(held, keep, more) {
  const values = new Float32Array(keep + more.length);
  values.set(held.subarray(0, keep));
  values.set(more, keep);
  return values;
}

/** True if what came continues what is held. */
function fits(flight, news) {
  const seriesFits = (held, more) => more.first === 0
    || more.first <= held.least.length && more.width_s === held.width_s && more.from_s === held.from_s;
  const framesFit = (held, more) => more.first === 0
    || more.first <= held.count && more.step_s === held.step_s && news.from_s === flight.from_s
      // A track without values has none for any frame.
      && Object.keys(TRACKS).every((name) => (held[name].length === 0) === (more[name].length === 0));
  return news.server === flight.server
    && news.events_first <= flight.known.length
    && framesFit(flight.frames, news.frames)
    && news.charts.every((chart, i) => chart.series.every((series, k) => seriesFits(flight.charts[i].series[k], series)));
}

/** Joins an answer that fits to the flight. */
function join(flight, news) {
  for (const key of ["server", "from_s", "to_s", "outcome", "loops"]) flight[key] = news[key];
  const { first, count, step_s } = news.frames;
  for (const [name, width] of Object.entries(TRACKS)) {
    flight.frames[name] = joined(flight.frames[name], first * width, news.frames[name]);
  }
  Object.assign(flight.frames, { count, step_s });
  news.charts.forEach((chart, i) => chart.series.forEach((more, k) => {
    const held = flight.charts[i].series[k];
    const merged = held.merged || more.merged;
    const least = joined(held.least, more.first, more.least);
    const greatest = merged ? joined(held.greatest, more.first, more.greatest) : least;
    Object.assign(held, { from_s: more.from_s, width_s: more.width_s, merged: more.first === 0 ? more.merged : merged, least, greatest });
  }));
  const isNew = news.events.length > 0 || news.events_first < flight.known.length;
  flight.known = [...flight.known.slice(0, news.events_first), ...news.events];
  flight.events = flight.known.toSorted((a, b) => a.at_s - b.at_s);
  return isNew;
}

class Live {
  /** `report` receives what came: `{ status, dropped, isOver, hasEvents }`, or `{ lost }` with a reason. */
  constructor(flight, edge, report) {
    Object.assign(this, { flight, edge, report, timer: null, asks: false });
    flight.known = flight.events;
    edge.arrived(flight.to_s, performance.now() / 1000);
    document.addEventListener("visibilitychange", () => { if (!document.hidden) this.plan(0); });
    addEventListener("pagehide", () => { if (!this.edge.isOver) notifyClosed(); });
    this.plan(POLL_MS);
  }

  plan(after_ms) {
    clearTimeout(this.timer);
    if (!this.edge.isOver && !this.asks) this.timer = setTimeout(() => this.poll(), after_ms);
  }

  async poll() {
    this.asks = true;
    const begun = performance.now();
    let wait_ms = document.hidden ? HIDDEN_MS : POLL_MS;
    try {
      await this.take();
    } catch (error) {
      wait_ms = RETRY_MS;
      this.report({ lost: error.isOther ? error.message : `connection lost (${error.message}), trying again` });
    }
    this.asks = false;
    this.plan(Math.max(20, wait_ms - (performance.now() - begun)));
  }

  async take() {
    const { flight } = this;
    let news = await this.ask(`/flight?${PAGE}&since_s=${flight.to_s}&events=${flight.known.length}`);
    if (!fits(flight, news)) news = await this.ask(`/flight?${PAGE}`);
    const hasEvents = join(flight, news);
    this.edge.isOver = news.is_over;
    this.edge.arrived(flight.to_s, performance.now() / 1000);
    this.report({ status: news.status, dropped: news.dropped, isOver: news.is_over, hasEvents });
    if (news.is_over) notifyClosed();
  }

  async ask(address) {
    const response = await fetch(address, { cache: "no-store", signal: AbortSignal.timeout(PATIENCE_MS) });
    if (!response.ok) throw new Error(await response.text());
    const news = await response.json();
    const { run } = this.flight.live;
    if ((news.run ?? news.status?.run ?? run) !== run) {
      throw Object.assign(new Error("another flight is at this address now: reload the page to see it"), { isOther: true });
    }
    unpackFrames(news.frames);
    for (const chart of news.charts) chart.series.forEach(unpackSeries);
    return news;
  }
}

/** What a request of the control protocol came to: `{ isGood, text, replies }`. A wrong token has `isWrongToken`. */
async function command(token, request, path = "/control") {
  let response, refusal, replies;
  try {
    response = await fetch(path, { method: "POST", headers: { Authorization: `Bearer ${token}` }, body: typeof request === "string" ? request : JSON.stringify(request) });
    if (response.ok) ({ replies } = await response.json());
    else refusal = (await response.text()).trim();
  } catch {
    return { isGood: false, text: "the flight does not answer" };
  }
  if (!response.ok) return { isGood: false, isWrongToken: response.status === 403, text: refusal || `status ${response.status}` };
  const last = replies.at(-1);
  if (!last) return { isGood: false, text: "no reply" };
  if (last.reply === "refused") return { isGood: false, text: `refused: ${last.text}`, replies };
  if (last.reply !== "ordered") return { isGood: true, text: last.text ?? last.reply, replies };
  const done = last.done_s === null ? "" : `, done at ${figure(last.done_s, 3)} s`;
  return { isGood: true, text: `${last.order}: from ${figure(last.begins_s, 3)} s on${done}` };
}
