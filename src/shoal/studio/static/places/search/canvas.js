/* A canvas in metres: panned and zoomed by hand and keys; graticule, scale bar, arrow to the
   north. */
import { ticksOf } from "../../shared/charts.js";
import { hands, spotOf } from "../../shared/hands.js";
import { el, svg, symbol } from "../../shared/page.js";

// pixels around all that is shown: below and to the right, there are the scale bar and buttons
const ROOM = { left: 36, right: 62, top: 40, bottom: 50 };
const NEAREST = 400,
  FARTHEST = 2e-4; // pixels a metre
const LABEL = { wide: 66, high: 12 }; // pixels of a word of the graticule
const LINES = 7; // about how many lines of the graticule there are

export class MetricCanvas {
  /** `tap(point, event)` is called for a click that is no drag; `over(point)` as the pointer moves,
   *  with null when it leaves. */
  constructor(label, { tap, over }) {
    this.tap = tap;
    this.over = over;
    /** @type {any} null: the canvas is nowhere on Earth; undefined: not known yet */
    this.earth = undefined;
    this.marks = [];
    this.scale = 1; // pixels of a metre
    this.middle = [0, 0];
    this.size = [1, 1];
    this.bounds = null;
    this.moved = false;
    this.drawing = 0;
    this.viewed = () => {}; // called when another part of the plane is seen
    this.drag = null; // what may take a drag for itself, as hands() has it
    this.under = svg("g", {});
    this.graticule = svg("g", { class: "graticule" });
    this.degrees = svg("g", { class: "graticule words" });
    this.world = svg("g", {});
    this.above = svg("g", {});
    this.bar = svg("g", { class: "scalebar" });
    this.plane = svg(
      "svg",
      { class: "plane", role: "group", tabindex: 0, "aria-label": label },
      this.under,
      this.graticule,
      this.world,
      this.degrees,
      this.above,
      this.bar,
    );
    const button = (words, path, act) =>
      el(
        "button.tool",
        { type: "button", title: words, "aria-label": words, onclick: act },
        symbol(path),
      );
    this.element = el(
      "div.metric",
      {},
      this.plane,
      el(
        "div.zooms",
        {},
        button("Nearer", "M12 5v14M5 12h14", () => this.zoomBy(1.5)),
        button("Farther", "M5 12h14", () => this.zoomBy(1 / 1.5)),
        button("Show all of it", "M4.5 9V4.5H9M15 4.5h4.5V9M19.5 15v4.5H15M9 19.5H4.5V15", () =>
          this.fit(),
        ),
      ),
    );
    this.listen();
    new ResizeObserver(() => this.resize()).observe(this.element);
  }

  resize() {
    const [wide, high] = this.size;
    this.size = [Math.max(1, this.element.clientWidth), Math.max(1, this.element.clientHeight)];
    this.plane.setAttribute("viewBox", `0 0 ${this.size.join(" ")}`);
    if (!this.moved) this.fit();
    // the words below may take another line while a hand draws: nothing moves under it
    else this.pan((wide - this.size[0]) / 2, (high - this.size[1]) / 2);
  }

  /** @param {number[]} point in metres */
  at([x, y]) {
    return [
      this.size[0] / 2 + (x - this.middle[0]) * this.scale,
      this.size[1] / 2 - (y - this.middle[1]) * this.scale,
    ];
  }

  /** @param {number[]} spot in pixels */
  back([right, down]) {
    return [
      this.middle[0] + (right - this.size[0] / 2) / this.scale,
      this.middle[1] - (down - this.size[1] / 2) / this.scale,
    ];
  }

  /** Show points; all of the view follows them until a hand moves it. */
  show(points) {
    if (!points.length) return;
    const xs = points.map(([x]) => x),
      ys = points.map(([, y]) => y);
    const least = (values) => values.reduce((a, b) => Math.min(a, b)),
      most = (values) => values.reduce((a, b) => Math.max(a, b));
    this.bounds = [least(xs), least(ys), most(xs), most(ys)];
    if (!this.moved) this.fit();
  }

  fit() {
    const [left, low, right, high] = this.bounds ?? [-250, -150, 250, 150];
    this.moved = false;
    const [wide, tall] = this.size,
      room = [wide - ROOM.left - ROOM.right, tall - ROOM.top - ROOM.bottom].map((side) =>
        Math.max(40, side),
      );
    this.scale = Math.max(
      FARTHEST,
      Math.min(
        NEAREST,
        Math.min(room[0] / Math.max(right - left, 1), room[1] / Math.max(high - low, 1)),
      ),
    );
    this.middle = [
      (left + right) / 2 - (ROOM.left - ROOM.right) / 2 / this.scale,
      (low + high) / 2 + (ROOM.top - ROOM.bottom) / 2 / this.scale,
    ];
    this.draw();
  }

  zoomBy(factor, spot = this.size.map((side) => side / 2)) {
    const held = this.back(spot);
    this.scale = Math.max(FARTHEST, Math.min(NEAREST, this.scale * factor));
    const now = this.back(spot);
    this.middle = this.middle.map((x, axis) => x + held[axis] - now[axis]);
    this.moved = true;
    this.draw();
  }

  pan(right, down) {
    this.middle = [this.middle[0] - right / this.scale, this.middle[1] + down / this.scale];
    this.moved = true;
    this.draw();
  }

  // ---- drawing ----

  draw() {
    this.drawing ||= requestAnimationFrame(() => {
      this.drawing = 0;
      const [right, down] = this.at([0, 0]),
        turned = `matrix(${this.scale} 0 0 ${-this.scale} ${right} ${down})`;
      this.world.setAttribute("transform", turned);
      this.under.setAttribute("transform", turned);
      for (const mark of this.marks) this.place(mark);
      this.drawGraticule();
      this.drawBar();
      this.viewed();
    });
  }

  place({ element, point }) {
    const [right, down] = this.at(point);
    element.setAttribute("transform", `translate(${right.toFixed(2)} ${down.toFixed(2)})`);
  }

  /** Things of one size whatever the zoom: each has a `point` in metres and an `element` around (0,
   *  0). */
  setMarks(marks) {
    const focused = document.activeElement?.getAttribute("data-mark");
    this.marks = marks;
    for (const mark of marks) this.place(mark);
    this.above.replaceChildren(...marks.map((mark) => mark.element));
    if (focused)
      this.above.querySelector(`[data-mark="${focused}"]`)?.focus({ preventScroll: true });
  }

  drawGraticule() {
    if (this.earth === undefined) return; // neither in degrees nor in metres
    const [wide, high] = this.size,
      corners = [
        [0, 0],
        [wide, 0],
        [0, high],
        [wide, high],
      ].map((spot) => this.back(spot));
    const there = this.earth ? corners.map((corner) => this.earth.degrees(corner)) : corners;
    const most = (LINES * Math.max(wide, high)) / 900 + 1;
    const lines = [0, 1].flatMap((axis) => {
      const values = there.map((one) => one[axis]),
        other = there.map((one) => one[1 - axis]),
        low = Math.min(...values),
        top = Math.max(...values);
      const ticks = ticksOf(low, top, most),
        digits = Math.max(0, Math.ceil(-Math.log10((ticks[1] ?? top) - (ticks[0] ?? low)) - 1e-9));
      const ends = [Math.min(...other), Math.max(...other)];
      return ticks.map((tick) =>
        this.drawLine(
          axis,
          tick,
          ends,
          this.earth ? degreesText(tick, axis, digits) : `${Number(tick.toFixed(digits))} m`,
        ),
      );
    });
    this.graticule.replaceChildren(...lines.map(([path]) => path));
    this.degrees.replaceChildren(...lines.map(([, words]) => words).filter(Boolean));
  }

  /** @param {number} axis @param {number} tick @param {number[]} ends @param {string} words */
  drawLine(axis, tick, [low, high], words) {
    const spots = Array.from({ length: this.earth ? 9 : 2 }, (_, k, n = this.earth ? 8 : 1) => {
      const along = low + ((high - low) * k) / n,
        given = axis ? [along, tick] : [tick, along];
      return this.at(this.earth ? this.earth.metres(given) : given);
    });
    const d = spots
      .map((spot, k) => `${k ? "L" : "M"}${spot.map((x) => x.toFixed(1)).join(" ")}`)
      .join("");
    const [x, y] = axis
      ? [6, spots.find(([right]) => right > 4)?.[1] - 4]
      : [spots.find(([, down]) => down < 40)?.[0] + 4, 14];
    // words of the left side make room for those at the top, and for the scale bar
    const [width, height] = this.size,
      free = axis ? y > 14 + LABEL.high && y < height - 46 : x > 0 && x + LABEL.wide < width;
    return [svg("path", { d }), free ? svg("text", { x, y }, words) : null];
  }

  /** A bar of a round length, and the north where the canvas is on Earth. */
  drawBar() {
    const [, high] = this.size,
      most = 130 / this.scale,
      power = 10 ** Math.floor(Math.log10(most)),
      length = [5, 2, 1].find((step) => step * power <= most) * power;
    const long = length * this.scale,
      y = high - 14,
      words =
        length >= 1000
          ? `${length / 1000} km`
          : length >= 1
            ? `${length} m`
            : `${Math.round(100 * length)} cm`;
    const parts = [
      svg("path", { class: "rim", d: `M14 ${y - 6}V${y}H${14 + long}V${y - 6}` }),
      svg("path", { d: `M14 ${y - 6}V${y}H${14 + long}V${y - 6}` }),
      svg("text", { x: 14 + long / 2, y: y - 8, "text-anchor": "middle" }, words),
    ];
    if (this.earth) {
      const right = 14 + long + 26;
      parts.push(
        svg("path", { class: "arrow", d: `M${right} ${y - 32}l6 15l-6 -4l-6 4Z` }),
        svg("text", { class: "north", x: right, y: y + 1, "text-anchor": "middle" }, "N"),
      );
    }
    this.bar.replaceChildren(...parts);
  }

  // ---- hands ----

  spotOf(event) {
    return spotOf(this.plane, event);
  }

  listen() {
    hands(this.plane, {
      zoom: (factor, spot) => this.zoomBy(factor, spot),
      pan: (right, down) => this.pan(right, down),
      fit: () => this.fit(),
      tap: (spot, event) => this.tap(this.back(spot), event),
      take: (spot) => this.drag?.(this.back(spot), (moved) => this.back(moved)) ?? null,
      over: (spot) => this.over(spot && this.back(spot)),
    });
  }
}

function degreesText(value, axis, digits) {
  return `${Math.abs(value).toFixed(digits)}° ${axis ? (value < 0 ? "S" : "N") : value < 0 ? "W" : "E"}`;
}

/** A mark that the hand moves, or the arrow keys (with Shift farther); Delete removes it. With
 *  `press`, a click and the keys Enter and Space press it; it is `pressed` or not. */
export function handle(
  canvas,
  key,
  point,
  words,
  shapes,
  { move, done = () => {}, remove = null, press = null, pressed = false, quiet = false },
) {
  const element = svg(
    "g",
    {
      class: "handle",
      tabindex: quiet ? -1 : 0,
      role: "button",
      "aria-label": words,
      "data-mark": key,
      ...(press ? { "aria-pressed": String(pressed) } : {}),
    },
    svg("circle", { class: "touch", r: 13 }),
    shapes,
  );
  element.addEventListener("pointerdown", (event) => {
    if (event.button !== 0) return;
    event.preventDefault();
    event.stopPropagation();
    element.focus({ preventScroll: true });
    const plane = canvas.plane;
    let gone = false;
    const first = (moved) => {
      gone = true;
      move(canvas.back(canvas.spotOf(moved)));
    };
    const stop = (ended) => {
      // where it is let go counts, whatever moves were told before
      if (gone && ended.type === "pointerup") first(ended);
      plane.removeEventListener("pointermove", first);
      for (const kind of ["pointerup", "pointercancel"]) plane.removeEventListener(kind, stop);
      if (gone) done();
      else if (ended.type === "pointerup") press?.();
    };
    plane.setPointerCapture(event.pointerId);
    plane.addEventListener("pointermove", first);
    for (const kind of ["pointerup", "pointercancel"]) plane.addEventListener(kind, stop);
  });
  element.addEventListener("keydown", (event) => {
    const step = { ArrowUp: [0, 1], ArrowDown: [0, -1], ArrowLeft: [-1, 0], ArrowRight: [1, 0] }[
      event.key
    ];
    if (step) {
      event.preventDefault();
      const by = (event.shiftKey ? 40 : 4) / canvas.scale;
      move([point[0] + by * step[0], point[1] + by * step[1]]);
      done();
    } else if (press && ["Enter", " "].includes(event.key)) {
      event.preventDefault();
      press();
    } else if (remove && ["Delete", "Backspace"].includes(event.key)) {
      event.preventDefault();
      remove();
    }
  });
  return { point, element };
}
