// Draws a picture at any pose and from anywhere: the parts are those that arm_view.py puts together.
// Figures speak with the page by the event `posecal:pose` on document, detail {pose, source, pinned}.
(() => {
  "use strict";
  const SVG = "http://www.w3.org/2000/svg";
  const MARGIN = 32, REACH = 14; // px
  const STEP = 60; // ms from place to place where the day is played
  const VIEWS = { Front: [0, 0], Side: [-90, 0], Top: [-90, 90] };

  function element(tag, attributes, text) {
    const made = document.createElementNS(SVG, tag);
    for (const name in attributes) made.setAttribute(name, attributes[name]);
    if (text !== undefined) made.textContent = text;
    return made;
  }
  const track = (places) => "M" + places.map(([x, y]) => `${x.toFixed(1)} ${y.toFixed(1)}`).join("L");
  const plus = (a, b, s = 1) => a.map((v, i) => v + s * b[i]);
  const dotted = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
  const mean = (all) => all.reduce((a, b) => plus(a, b)).map((v) => v / all.length);

  // What each kind of part is made of, at the picked pose of a view.
  const DRAWN = {
    *Stroke({ css, tail = "", opacity, ...part }, view) {
      const d = view.runs(part).map((places) => track(places) + tail).join("");
      yield element("path", { class: css, d, ...(opacity && { opacity: opacity.toFixed(2) }) });
    },

    *Dot({ css, mm = 0, px = 0, ...part }, view) {
      const r = (mm * view.drawnScale + px).toFixed(1);
      for (const [x, y] of view.runs(part).flat())
        yield element("circle", { class: css, cx: x.toFixed(1), cy: y.toFixed(1), r });
    },

    *Rods({ css, at, mm, layers }, view) {
      const rods = at.map((run, i) => ({ run, depth: view.depth(run), width: 2 * mm[i] * view.drawnScale }));
      const group = element("g", { class: css });
      for (const { run, width } of rods.sort((a, b) => a.depth - b.depth)) {
        const d = track(view.places(run));
        for (const [kind, wider] of layers)
          group.append(element("path", { class: kind, d, "stroke-width": (width + wider).toFixed(1) }));
      }
      yield group;
    },

    *Text({ css, words, down = 0, beyond, least = 0, ...part }, view) {
      for (const places of view.runs(part)) {
        let place = mean(places);
        if (beyond) {
          const [point, far] = beyond, away = plus(place, view.places([point])[0], -1), length = Math.hypot(...away);
          if (length < least) continue;
          place = plus(place, away, far / Math.max(length, 1));
        }
        const [x, y] = plus(place, [0, down]);
        if ([x, y].every((v, k) => v >= 0 && v <= view.size[k]))
          yield element("text", { class: css, x: x.toFixed(1), y: y.toFixed(1) }, words);
      }
    },
  };

  class ArmView {
    constructor(figure) {
      this.figure = figure;
      this.data = JSON.parse(figure.querySelector('script[type="application/json"]').textContent);
      this.stage = figure.querySelector(".arm-stage");
      this.svg = figure.querySelector(".arm-drawing");
      this.parts = figure.querySelector(".arm-parts");
      this.number = new Map(this.data.poses.map((name, i) => [name, i]));
      this.chosen = 0; // what the controls say
      this.peeked = null; // what the pointer is over, here or elsewhere on the page
      this.moment = null; // place in the day, where it is played
      this.controls();
      this.pointer();
      this.keys();
      document.addEventListener("posecal:pose", (event) => this.heard(event.detail));
      new ResizeObserver(() => this.fit()).observe(this.svg);
      this.reset();
    }

    // ---- what is shown

    get pose() { return this.peeked ?? this.chosen; }

    // The row of points that is drawn: of the pose, or of a place on the way.
    get row() { return this.moment === null || this.peeked !== null ? this.pose : this.data.day[this.moment]; }

    // What is said of the markers at this pose, and which of them are lost.
    get state() { return this.data.states[this.data.state[this.pose]]; }

    choose(i) {
      const count = this.data.poses.length;
      this.chosen = (i + count) % count;
      this.peeked = this.moment = null;
      this.tell(this.chosen, true);
      this.shown();
    }

    // The day at one of its places; the pose that was reached last is the one chosen.
    moveTo(moment) {
      const { day, poses } = this.data, reached = day.slice(0, moment + 1).findLast((row) => row < poses.length);
      if (reached !== this.chosen) this.tell(reached, true);
      [this.moment, this.chosen, this.peeked] = [moment, reached, null];
      this.shown();
    }

    play() {
      const last = this.data.day.length - 1;
      if (this.playing) { clearInterval(this.playing); this.playing = null; }
      else {
        if (this.moment === null || this.moment === last) this.moveTo(0);
        this.playing = setInterval(() => this.moment === null || this.moment === last ? this.play() : this.moveTo(this.moment + 1), STEP);
      }
      this.player.textContent = this.playing ? "Pause" : "Play the day";
    }

    peek(i) {
      if (i === this.peeked) return;
      this.peeked = i;
      this.tell(i, false);
      this.shown();
    }

    tell(i, pinned) {
      const pose = i === null ? null : this.data.poses[i];
      document.dispatchEvent(new CustomEvent("posecal:pose", { detail: { pose, source: this.figure.id, pinned } }));
    }

    heard({ pose, source, pinned }) {
      if (source === this.figure.id) return;
      const i = this.number.get(pose) ?? null;
      if (pinned && i !== null) [this.chosen, this.moment] = [i, null];
      this.peeked = pinned ? null : i;
      this.shown();
    }

    shown() {
      const { data, pose } = this;
      this.select.value = String(this.chosen);
      const [name, joints, markers] = this.figure.querySelector(".arm-now").children;
      const { row } = this;
      name.textContent = row < data.poses.length ? data.poses[pose] : `after ${data.poses[pose]}`;
      if (this.slider) this.slider.value = String(this.moment ?? data.day.indexOf(pose));
      joints.textContent = data.joints.map(([before, after], k) =>
        before + data.values[row][k].toFixed(2).replace("-", "\u2212") + after).join(" \u00b7 ");
      [markers.textContent] = this.state;
      this.draw();
    }

    // ---- the view

    reset() { this.look(...this.data.view); }

    look(azimuth, elevation) {
      [this.azimuth, this.elevation, this.zoom] = [azimuth, elevation, 1];
      this.fit();
    }

    turn(right, up) {
      this.azimuth -= right;
      this.elevation = Math.max(-90, Math.min(90, this.elevation + up));
      this.draw();
    }

    magnify(factor) {
      this.zoom = Math.max(1, Math.min(12, this.zoom * factor));
      this.draw();
    }

    // Scale, and the point to turn about, with which all that is to be seen fills the drawing.
    fit() {
      this.size = [this.svg.clientWidth || 720, this.svg.clientHeight || 480];
      this.svg.setAttribute("viewBox", `0 0 ${this.size[0]} ${this.size[1]}`);
      this.aim();
      const { frame } = this.data, low = [Infinity, Infinity], high = [-Infinity, -Infinity];
      for (let n = 0; n < frame.length; n += 3) {
        this.seen(frame.slice(n, n + 3)).forEach((v, k) => { low[k] = Math.min(low[k], v); high[k] = Math.max(high[k], v); });
      }
      this.scale = Math.min(...this.size.map((v, k) => (v - 2 * MARGIN) / Math.max(high[k] - low[k], 1)));
      this.pivot = this.middleOf(frame);
      const [u, v] = plus(low.map((w, k) => (w + high[k]) / 2), this.seen(this.pivot), -1);
      this.pivot = plus(plus(this.pivot, this.right, u), this.up, v);
      this.draw();
    }

    middleOf(frame) {
      return [0, 1, 2].map((k) => {
        const held = frame.filter((_, n) => n % 3 === k);
        return (Math.min(...held) + Math.max(...held)) / 2;
      });
    }

    aim() {
      const [a, e] = [this.azimuth, this.elevation].map((v) => (v * Math.PI) / 180);
      this.right = [-Math.sin(a), Math.cos(a), 0];
      this.up = [-Math.sin(e) * Math.cos(a), -Math.sin(e) * Math.sin(a), Math.cos(e)];
      this.near = [Math.cos(e) * Math.cos(a), Math.cos(e) * Math.sin(a), Math.sin(e)];
    }

    seen(p) {
      return [dotted(p, this.right), dotted(p, this.up)];
    }

    at(p) {
      const [u, v] = this.seen(p), s = this.drawnScale;
      return [this.shift[0] + u * s, this.shift[1] - v * s];
    }

    point(c, row) {
      if (c < 0) { const [x, y] = this.point(~c, row); return [x, y, 0]; }
      const held = this.data.points[c], from = held.length > 3 ? 3 * row : 0;
      return held.slice(from, from + 3);
    }

    places(run, row = this.row) { return run.map((c) => this.at(this.point(c, row))); }

    // Where a part stands, run by run.
    runs({ at, every }) {
      if (every) return at.flatMap((run) => this.data.poses.map((_, i) => this.places(run, i)));
      return at.map((run) => this.places(run));
    }

    depth(run) { return dotted(this.near, mean(run.map((c) => this.point(c, this.row)))); }

    // ---- drawing, once a frame

    draw() {
      if (this.waiting || !this.size) return;
      this.waiting = true;
      requestAnimationFrame(() => {
        this.waiting = false;
        this.aim();
        this.place();
        this.tips = this.data.poses.map((_, i) => this.places([this.data.tip], i)[0]);
        this.parts.replaceChildren(...this.drawn());
      });
    }

    // Zooming leaves the tip of the arm where it is in the drawing.
    place() {
      const middle = this.seen(this.pivot), tip = this.seen(this.point(this.data.tip, this.row));
      const rest = this.scale * (1 - this.zoom), [u, v] = tip.map((w, k) => rest * w - this.scale * middle[k]);
      this.drawnScale = this.scale * this.zoom;
      this.shift = [this.size[0] / 2 + u, this.size[1] / 2 - v];
    }

    *drawn() {
      const [, lost] = this.state;
      for (const part of this.data.parts) {
        const [marker, where] = part.when ?? [];
        if (marker === undefined || lost.includes(marker) === where) yield* DRAWN[part.kind](part, this);
      }
    }

    // ---- controls

    controls() {
      const bar = this.figure.querySelector(".arm-bar");
      const group = (...held) => { const span = document.createElement("span"); span.append(...held); bar.append(span); };
      const button = (text, name, act) => {
        const made = document.createElement("button");
        Object.assign(made, { type: "button", textContent: text });
        if (name) made.setAttribute("aria-label", name);
        made.addEventListener("click", act);
        return made;
      };
      this.select = document.createElement("select");
      this.select.setAttribute("aria-label", "Pose");
      this.select.append(...this.data.poses.map((name, i) => new Option(name, String(i))));
      this.select.addEventListener("change", () => this.choose(Number(this.select.value)));
      group(
        button("\u2039", "Previous pose", () => this.choose(this.chosen - 1)),
        this.select,
        button("\u203a", "Next pose", () => this.choose(this.chosen + 1)),
      );
      group(
        ...Object.entries(VIEWS).map(([name, view]) => button(name, `${name} view`, () => this.look(...view))),
        button("Reset", "Reset view", () => this.reset()),
      );
      group(
        button("\u2212", "Zoom out", () => this.magnify(1 / 1.25)),
        button("+", "Zoom in", () => this.magnify(1.25)),
      );
      if (this.data.day.length) {
        this.player = button("Play the day", "", () => this.play());
        this.slider = document.createElement("input");
        Object.assign(this.slider, { type: "range", min: "0", max: String(this.data.day.length - 1), value: "0" });
        this.slider.setAttribute("aria-label", "Place in the day");
        this.slider.addEventListener("input", () => this.moveTo(Number(this.slider.value)));
        group(this.player, this.slider);
      }
      bar.hidden = false;
      this.figure.classList.add("arm-live");
    }

    keys() {
      this.stage.tabIndex = 0;
      this.stage.setAttribute("role", "group");
      this.stage.setAttribute("aria-label", "Arm in space: arrow keys turn it, plus and minus zoom, 0 resets");
      const acts = {
        ArrowLeft: () => this.turn(-5, 0), ArrowRight: () => this.turn(5, 0),
        ArrowUp: () => this.turn(0, 5), ArrowDown: () => this.turn(0, -5),
        "+": () => this.magnify(1.25), "=": () => this.magnify(1.25), "-": () => this.magnify(1 / 1.25),
        0: () => this.reset(), PageUp: () => this.choose(this.chosen - 1), PageDown: () => this.choose(this.chosen + 1),
      };
      this.stage.addEventListener("keydown", (event) => {
        const act = acts[event.key];
        if (!act || event.ctrlKey || event.metaKey || event.altKey) return;
        event.preventDefault();
        act();
      });
    }

    pointer() {
      let from = null, moved = 0;
      const { stage } = this;
      const local = (event) => { const box = this.svg.getBoundingClientRect(); return [event.clientX - box.left, event.clientY - box.top]; };
      stage.addEventListener("pointerdown", (event) => {
        if (event.button !== 0 || !event.isPrimary) return;
        [from, moved] = [[event.clientX, event.clientY], 0];
        stage.setPointerCapture(event.pointerId);
        stage.classList.add("arm-turning");
      });
      stage.addEventListener("pointermove", (event) => {
        if (!from) { if (event.pointerType === "mouse") this.peek(this.nearest(local(event))); return; }
        const [dx, dy] = [event.clientX - from[0], event.clientY - from[1]];
        [from, moved] = [[event.clientX, event.clientY], moved + Math.abs(dx) + Math.abs(dy)];
        this.turn(dx * 0.4, dy * 0.4);
      });
      const end = (event) => {
        if (from && moved < 4 && event.type === "pointerup") {
          const i = this.nearest(local(event));
          if (i !== null) this.choose(i);
        }
        from = null;
        stage.classList.remove("arm-turning");
      };
      stage.addEventListener("pointerup", end);
      stage.addEventListener("pointercancel", end);
      stage.addEventListener("pointerleave", () => this.peek(null));
    }

    nearest([x, y]) {
      let best = REACH, found = null;
      this.tips?.forEach(([u, v], i) => {
        const away = Math.hypot(u - x, v - y);
        if (away < best) [best, found] = [away, i];
      });
      return found;
    }
  }

  const start = () => document.querySelectorAll(".arm-view").forEach((figure) => new ArmView(figure));
  if (document.readyState === "loading") document.addEventListener("DOMContentLoaded", start);
  else start();
})();
