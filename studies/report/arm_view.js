// Turns the drawing of the arm: the same parts, order and places as arm_drawing.py draws.
// Figures speak with the page by the event `posecal:pose` on document, detail {pose, source, pinned}.
(() => {
  "use strict";
  const SVG = "http://www.w3.org/2000/svg";
  const MARGIN = 32, JOINT = 4, MARKER = 4.5, LETTERED = 20, REACH = 14; // px
  const VIEWS = { Front: [0, 0], Side: [-90, 0], Top: [-90, 90] };

  function element(tag, attributes, text) {
    const made = document.createElementNS(SVG, tag);
    for (const name in attributes) made.setAttribute(name, attributes[name]);
    if (text !== undefined) made.textContent = text;
    return made;
  }
  const path = (kind, d, width) =>
    element("path", width === undefined ? { class: kind, d } : { class: kind, d, "stroke-width": width.toFixed(1) });
  const dot = (kind, [x, y], r) =>
    element("circle", { class: kind, cx: x.toFixed(1), cy: y.toFixed(1), r: r.toFixed(1) });
  const label = (kind, [x, y], text) =>
    element("text", { class: kind + " arm-middle", x: x.toFixed(1), y: y.toFixed(1) }, text);
  const track = (places) => "M" + places.map(([x, y]) => `${x.toFixed(1)} ${y.toFixed(1)}`).join("L");
  const plus = (a, b, s = 1) => a.map((v, i) => v + s * b[i]);
  const dotted = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
  const last = (list) => list[list.length - 1];
  const length = (v) => Math.hypot(...v);
  const flat = ([x, y]) => [x, y, 0];

  class ArmView {
    constructor(figure) {
      this.figure = figure;
      this.data = JSON.parse(figure.querySelector('script[type="application/json"]').textContent);
      this.stage = figure.querySelector(".arm-stage");
      this.svg = figure.querySelector(".arm-drawing");
      this.parts = figure.querySelector(".arm-parts");
      this.number = new Map(this.data.poses.map((name, i) => [name, i]));
      this.why = new Map(this.data.hidden.map(([i, j, reason]) => [i * this.data.markers.length + j, this.data.reasons[reason]]));
      this.perPose = this.data.moving.length / this.data.poses.length;
      this.chosen = 0; // what the controls say
      this.peeked = null; // what the pointer is over, here or elsewhere on the page
      this.controls();
      this.pointer();
      this.keys();
      document.addEventListener("posecal:pose", (event) => this.heard(event.detail));
      new ResizeObserver(() => this.fit()).observe(this.svg);
      this.reset();
    }

    // ---- what is shown

    get pose() { return this.peeked ?? this.chosen; }

    choose(i) {
      const count = this.data.poses.length;
      this.chosen = (i + count) % count;
      this.peeked = null;
      this.tell(this.chosen, true);
      this.shown();
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
      if (pinned && i !== null) this.chosen = i;
      this.peeked = pinned ? null : i;
      this.shown();
    }

    shown() {
      const { data, pose } = this;
      this.select.value = String(this.chosen);
      const [name, joints, markers] = this.figure.querySelector(".arm-now").children;
      name.textContent = data.poses[pose];
      joints.textContent = data.joints.map((joint, k) => {
        const value = data.values[pose][k].toFixed(2).replace("-", "\u2212");
        return `${joint} ${value}${data.units[k] === "deg" ? "\u00b0" : " mm"}${k === data.level ? " (level)" : ""}`;
      }).join(" \u00b7 ");
      const lost = (j) => this.why.get(pose * data.markers.length + j);
      const names = data.markers.filter((_, j) => lost(j) === undefined);
      const seen = names.length ? `marker${names.length > 1 ? "s" : ""} ${names.join(", ")}` : "no marker";
      const hidden = data.markers.flatMap((marker, j) => (lost(j) === undefined ? [] : [`${marker} ${lost(j)}`]));
      markers.textContent = [`${seen} ${data.seen}`.trim(), ...hidden].join("; ");
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

    line(points) { return track(points.map((p) => this.at(p))); }

    lines(several) { return several.map((points) => this.line(points)).join(""); }

    point(pose, c) {
      const { still, moving } = this.data;
      const from = 3 * c < still.length ? 3 * c : pose * this.perPose + 3 * c - still.length;
      const held = 3 * c < still.length ? still : moving;
      return [held[from], held[from + 1], held[from + 2]];
    }

    // ---- drawing, once a frame

    draw() {
      if (this.waiting || !this.size) return;
      this.waiting = true;
      requestAnimationFrame(() => {
        this.waiting = false;
        this.aim();
        this.place();
        this.parts.replaceChildren(...this.floor(), ...this.all(), ...this.arm(this.pose));
      });
    }

    // Zooming leaves the tip of the arm where it is in the drawing.
    place() {
      const middle = this.seen(this.pivot), tip = this.seen(this.point(this.pose, last(this.data.chain)));
      const rest = this.scale * (1 - this.zoom), [u, v] = tip.map((w, k) => rest * w - this.scale * middle[k]);
      this.drawnScale = this.scale * this.zoom;
      this.shift = [this.size[0] / 2 + u, this.size[1] / 2 - v];
    }

    *floor() {
      const { floor, foot, solids } = this.data;
      yield path("arm-floor", this.lines(floor));
      yield path("arm-foot", this.line(foot));
      yield* this.ruler();
      for (const solid of solids) {
        yield path(solid.plane ? "arm-plane" : "arm-solid", this.lines(solid.lines));
        if (solid.radius) yield dot("arm-solid", this.at(solid.centre), solid.radius * this.drawnScale);
        const place = this.at(solid.centre);
        if (place.every((v, k) => v >= 0 && v <= this.size[k])) yield label("arm-label", place, solid.name);
      }
    }

    // The side of a floor cell at the corner that is lowest in the drawing.
    *ruler() {
      const { floor, step } = this.data, ends = floor.flat();
      const [low, high] = [Math.min, Math.max].map((f) => [0, 1].map((k) => f(...ends.map((p) => p[k]))));
      const corners = [low[0], high[0]].flatMap((x) => [low[1], high[1]].map((y) => [x, y, 0]));
      const corner = corners.reduce((a, b) => (this.at(b)[1] > this.at(a)[1] ? b : a));
      const long = (side) => Math.abs(this.at(side)[0] - this.at(corner)[0]);
      const sides = [0, 1].map((k) => corner.map((v, i) => v + (i === k ? (v === low[k] ? step : -step) : 0)));
      const side = sides.reduce((a, b) => (long(b) > long(a) ? b : a));
      yield path("arm-scale", this.line([corner, side]));
      yield label("arm-label", plus(this.at(corner.map((v, i) => (v + side[i]) / 2)), [0, 15]), `${step} mm`);
    }

    *triad(origin, axes, names, kind) {
      for (const [i, axis] of axes.entries()) {
        const end = plus(origin, axis), [from, to] = [this.at(origin), this.at(end)], away = plus(to, from, -1);
        yield path(kind, this.line([origin, end]));
        if (length(away) > LETTERED) yield label(`${kind}-name`, plus(plus(to, away, 8 / length(away)), [0, 4]), names[i]);
      }
    }

    // All poses in two paths; where their tips stand is kept for the pointer.
    *all() {
      const { poses, chain, still } = this.data;
      const moving = chain.slice(Math.max(0, chain.findIndex((c) => 3 * c >= still.length) - 1));
      let arms = "", dots = "";
      this.tips = poses.map((_, i) => {
        const points = moving.map((c) => this.at(this.point(i, c)));
        const [x, y] = last(points);
        arms += track(points);
        dots += `M${x.toFixed(1)} ${y.toFixed(1)}h0`;
        return [x, y];
      });
      for (const [kind, d] of [["arm-all", arms], ["arm-tips", dots]])
        yield element("path", { class: kind, d, opacity: this.data.fade.toFixed(2) });
    }

    *arm(pose) {
      const { chain, shaped, tip: axes, step } = this.data;
      const points = chain.map((c) => this.point(pose, c)), tip = last(points);
      yield path("arm-shadow", this.line(points.map(flat)));
      yield path("arm-drop", this.line([tip, flat(tip)]));
      yield this.bodies(pose);
      if (shaped) yield path("arm-chain", this.line(points));
      for (const joint of points.slice(0, -1)) yield dot("arm-joint", this.at(joint), JOINT);
      yield* this.triad([0, 0, 0], [[step, 0, 0], [0, step, 0], [0, 0, step]], "XYZ", "arm-base-axis");
      yield* this.sight(pose);
      const [x, y] = [0, 3].map((k) => axes.slice(6 * pose + k, 6 * pose + k + 3).map((v) => v / 100));
      const z = [x[1] * y[2] - x[2] * y[1], x[2] * y[0] - x[0] * y[2], x[0] * y[1] - x[1] * y[0]];
      yield* this.triad(tip, [x, y, z].map((axis) => axis.map((v) => v * step * 0.35)), "xyz", "arm-tip-axis");
      yield* this.marks(pose);
    }

    bodies(pose) {
      const { bodies, shaped } = this.data, group = element("g", { class: shaped ? "arm-shape" : "arm-links" });
      const depth = ([a, b]) => dotted(this.near, plus(this.point(pose, a), this.point(pose, b)));
      const order = bodies.map((body) => [depth(body), body]).sort((a, b) => a[0] - b[0]);
      for (const [, [a, b, radius]] of order) {
        const line = this.line([this.point(pose, a), this.point(pose, b)]), width = 2 * radius * this.drawnScale;
        group.append(path("arm-rim", line, width + 2), path("arm-body", line, width));
      }
      return group;
    }

    lost(pose, j) { return this.why.has(pose * this.data.markers.length + j); }

    *sight(pose) {
      const { instrument, far, at, step, chain } = this.data;
      if (instrument === null) return;
      let first = null;
      for (const [j, c] of at.entries()) {
        const point = this.point(pose, c), away = plus(instrument, point, -1);
        const end = plus(point, away, far ? (3 * step) / Math.max(length(away), 1) : 1);
        first = first ?? end;
        yield path(this.lost(pose, j) ? "arm-blocked" : "arm-sight", this.line([point, end]));
      }
      if (far) {
        const away = length(plus(instrument, this.point(pose, last(chain)), -1)) / 1e3;
        yield label("arm-label", this.at(first), `instrument ${away.toFixed(1)} m off`);
        return;
      }
      const [x, y] = this.at(instrument);
      yield path("arm-drop", this.line([instrument, flat(instrument)]));
      yield dot("arm-instrument", [x, y], 7);
      yield path("arm-instrument", `M${(x - 11).toFixed(1)} ${y.toFixed(1)}h22M${x.toFixed(1)} ${(y - 11).toFixed(1)}v22`);
      yield label("arm-label", [Math.max(MARGIN, Math.min(this.size[0] - MARGIN, x)), y - 17], "instrument");
    }

    *marks(pose) {
      const { markers, at, chain } = this.data, tip = this.point(pose, last(chain));
      for (const [j, c] of at.entries()) {
        const point = this.point(pose, c), place = this.at(point), [x, y] = place;
        yield path("arm-tool", this.line([tip, point]));
        yield dot(this.lost(pose, j) ? "arm-marker arm-hidden" : "arm-marker", place, MARKER);
        if (this.lost(pose, j)) {
          const [left, top, low] = [x - 6, y - 6, y + 6].map((v) => v.toFixed(1));
          yield path("arm-hidden", `M${left} ${top}l12 12M${left} ${low}l12 -12`);
        }
        const away = plus(place, this.at(tip), -1);
        yield label("arm-name", plus(plus(place, away, 13 / Math.max(length(away), 1)), [0, 4]), markers[j]);
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
