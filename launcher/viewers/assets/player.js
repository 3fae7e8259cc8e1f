// Which instant is shown, how it goes on, and how much of the flight the charts cover.

/** Width of the charts' window while a live flight is followed [s]. */
const RECENT_S = 20;
/** How far behind the newest sample a live flight is shown, so that it moves between two answers [s of wall time]. */
const HOLD_S = 0.3;

/** The newest end of a flight under way, and how fast it moves: its clock may run at any pace, and may stand. */
class Edge {
  constructor() {
    this.arrivals = [];
    this.isOver = false;
  }

  /** Flight time `newest_s` was known at the wall time `now_s`. */
  arrived(newest_s, now_s) {
    this.arrivals.push([now_s, newest_s]);
    while (this.arrivals.length > 2 && now_s - this.arrivals[0][0] > 2) this.arrivals.shift();
  }

  /** Seconds of flight per second. */
  get pace() {
    const [first, last] = [this.arrivals[0], this.arrivals.at(-1)];
    return last && last[0] > first[0] ? Math.max(0, (last[1] - first[1]) / (last[0] - first[0])) : 0;
  }

  /** What to show `step_s` of wall time after `t`: never back, never beyond what is known. */
  next(t, now_s, step_s) {
    if (this.arrivals.length === 0) return t;
    const [at_s, newest_s] = this.arrivals.at(-1);
    const { pace } = this;
    const goal = this.isOver ? newest_s : Math.min(newest_s, newest_s + pace * (now_s - at_s - HOLD_S));
    const gap = goal - t;
    // Far behind, after the page was hidden or opened late: there is nothing to glide through.
    if (gap > 0.5 + 1.5 * pace || this.isOver && newest_s - t < 0.02) return goal;
    const onward = pace * step_s + gap * Math.min(1, step_s / 0.5);
    return Math.min(newest_s, t + Math.max(0, onward));
  }
}

class Player {
  /** `edge` is null for a recording. */
  constructor(flight, edge) {
    Object.assign(this, { flight, edge, t: flight.from_s, speed: 1, plays: false, follows: edge !== null });
    // Width and begin of the charts' window; null for the whole flight.
    this.span = edge ? RECENT_S : null;
    this.from = flight.from_s;
  }

  /** First and last instant of the flight. */
  get whole() {
    return [this.flight.from_s, Math.max(this.flight.to_s, this.flight.from_s + 1e-3)];
  }

  /** What the charts cover. */
  get window() {
    return this.span === null ? this.whole : [this.from, this.from + this.span];
  }

  seek(t) {
    this.leave();
    this.show(t);
    // A live flight's window is narrow: it goes where the time goes.
    if (!this.edge || this.span === null || this.t >= this.from && this.t <= this.from + this.span) return;
    const [first, last] = this.whole;
    this.from = Math.max(first, Math.min(this.t - this.span / 2, last - this.span));
  }

  show(t) {
    const [first, last] = this.whole;
    this.t = Math.max(first, Math.min(last, t));
  }

  play(plays) {
    this.leave();
    if (plays && this.t >= this.whole[1]) this.show(this.whole[0]);
    this.plays = plays;
  }

  /** To the newest sample, and on with it. */
  follow() {
    this.plays = false;
    this.follows = this.edge !== null && !this.edge.isOver;
    this.show(this.whole[1]);
    this.slide();
  }

  leave() {
    this.follows = false;
  }

  /** The charts cover a window; the whole flight if it is as wide. */
  zoom([from, to]) {
    const [first, last] = this.whole;
    const span = Math.max(0.01, Math.min(to - from, last - first));
    this.span = span >= last - first ? null : span;
    this.from = Math.max(first, Math.min(from, last - span));
    if (this.follows) this.slide();
  }

  /** The charts cover the last seconds. */
  recent() {
    this.span = RECENT_S;
    this.slide();
  }

  slide() {
    this.from = Math.max(this.flight.from_s, this.t - this.span);
  }

  /** One picture later. True if another instant is shown. */
  advance(now_s, step_s) {
    const before = this.t;
    if (this.follows) {
      this.show(this.edge.next(this.t, now_s, step_s));
      this.slide();
      if (this.edge.isOver && this.t >= this.whole[1]) this.leave();
    } else if (this.plays) {
      this.show(this.t + step_s * this.speed);
      if (this.t >= this.whole[1]) {
        this.plays = false;
        // A replay that has caught up with a flight under way goes on with it.
        if (this.edge && !this.edge.isOver) this.follow();
      }
    }
    return this.t !== before;
  }
}
