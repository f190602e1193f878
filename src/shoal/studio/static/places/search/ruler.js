/* A ruler on the canvas: how far two points are apart, and in which direction. */
import { bearing, distance } from "../../shared/geometry.js";
import { svg } from "../../shared/page.js";
import { handle } from "./canvas.js";
import { metres } from "./measures.js";

export class Ruler {
  /** `changed()` is called when an end is set or moved; `snap(point)` is where an end goes. */
  constructor(canvas, { changed, snap }) {
    this.canvas = canvas;
    this.changed = changed;
    this.snap = snap;
    this.clear();
  }

  clear() {
    /** @type {number[][]} its ends, in metres */
    this.ends = [];
    this.next = null; // where the pointer is
  }

  get text() {
    const [from, to = this.next] = this.ends;
    return from && to
      ? `${metres(distance(from, to))}, bearing ${Math.round(bearing(from, to))}°`
      : "";
  }

  get hint() {
    return ["Click where the distance begins.", "Click where it ends.", this.text][
      this.ends.length
    ];
  }

  tap(point) {
    if (this.ends.length === 2) this.clear();
    this.ends.push(this.snap(point));
    this.next = null;
    this.changed();
  }

  /** The line follows the pointer to its second end. */
  over(point) {
    this.next = point && this.snap(point);
  }

  /** What is drawn in metres, below the marks. */
  line() {
    const [from, to = this.next] = this.ends;
    const d = from && to ? `M${from.join(" ")}L${to.join(" ")}` : "";
    return svg("path", { class: "ruler", d });
  }

  marks() {
    const ends = this.ends.map((point, k) =>
      handle(
        this.canvas,
        `ruler${k}`,
        point,
        `Ruler, end ${k + 1}. Arrow keys move it, Delete takes the ruler away.`,
        svg("circle", { class: "corner ruler", r: 5 }),
        {
          move: (to) => {
            this.ends[k] = this.snap(to);
            this.changed();
          },
          remove: () => {
            this.clear();
            this.changed();
          },
        },
      ),
    );
    if (this.ends.length < 2) return ends;
    const [[ax, ay], [bx, by]] = this.ends;
    const words = svg("text", { class: "ruler", y: -8, "text-anchor": "middle" }, this.text);
    return [{ point: [(ax + bx) / 2, (ay + by) / 2], element: words }, ...ends];
  }
}
