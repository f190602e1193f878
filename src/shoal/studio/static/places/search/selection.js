/* Several outlines at once: chosen by a click or a frame, moved, copied, pasted and removed. */
import { area, centreOf, inside, rectangle } from "../../shared/geometry.js";
import { el, svg } from "../../shared/page.js";
import { surface } from "./measures.js";
import { holesOf, KINDS } from "./outlines.js";

const SLIP = 5; // pixels that a click may move
const STEP = 24; // pixels between outlines and their copies
const NAMES = ["outline", "outlines"];

export class Selection {
  /** `drawing` has `told` with the outlines, `canvas`, `edit(change)` and `changed(how)`. */
  constructor(drawing) {
    this.drawing = drawing;
    /** @type {Set<string>} kind and number of each chosen outline */
    this.keys = new Set();
    /** @type {{ kind: string, ring: number[][] }[]} what was copied */
    this.copied = [];
    this.frame = null; // the place on Earth of what was copied
    this.pasted = 0; // how often
    this.marquee = svg("path", { class: "marquee" });
    const button = (words, title, act) =>
      el("button.second.small", { type: "button", title, onclick: act }, words);
    this.buttons = {
      all: button("All", "Choose all outlines (Ctrl A)", () => this.all()),
      copy: button("Copy", "Copy what is chosen (Ctrl C)", () => this.copy()),
      paste: button("Paste", "Paste a copy beside it (Ctrl V)", () => this.paste()),
      remove: button("Delete", "Remove what is chosen (Delete)", () => this.remove()),
    };
    this.element = el("div.group", { role: "group", "aria-label": "Chosen outlines" });
    this.element.append(...Object.values(this.buttons));
  }

  /** Kind and number of each outline, those on top first. */
  every() {
    return ["zones", "holes", "parts"].flatMap((kind) =>
      this.drawing.told[kind].map((ring, k) => ({ kind, k, ring, key: `${kind} ${k}` })),
    );
  }

  /** These keys, and those of the holes in their polygons. */
  withHoles(keys) {
    const all = this.every(),
      holes = all
        .filter(({ kind, key }) => kind === "parts" && keys.has(key))
        .flatMap(({ ring }) => holesOf(ring, this.drawing.told.holes));
    return new Set([
      ...keys,
      ...all.filter(({ ring }) => holes.includes(ring)).map(({ key }) => key),
    ]);
  }

  get chosen() {
    return this.every().filter(({ key }) => this.keys.has(key));
  }

  get hint() {
    const { chosen } = this;
    if (!this.every().length)
      return "Outlines that are drawn can be chosen: Edit its corners makes some of a file.";
    if (!chosen.length) return "Click outlines, or drag a frame around them.";
    const size = chosen.reduce((sum, { ring }) => sum + area(ring), 0);
    return `${chosen.length} ${NAMES[Number(chosen.length > 1)]}, ${surface(size)}`;
  }

  /** Choose these outlines and no others. */
  choose(keys) {
    this.keys = new Set(keys);
    this.drawing.changed({ drawnOnly: true });
  }

  /** Outlines may have gone: what is left stays chosen. */
  refresh() {
    const there = new Set(this.every().map(({ key }) => key));
    this.keys = new Set([...this.keys].filter((key) => there.has(key)));
    const none = !this.keys.size;
    this.buttons.all.disabled = !there.size;
    this.buttons.copy.disabled = this.buttons.remove.disabled = none;
    this.buttons.paste.disabled = !this.copied.length;
  }

  toggle(key) {
    const keys = new Set(this.keys);
    if (!keys.delete(key)) keys.add(key);
    this.choose(keys);
  }

  all() {
    this.choose(this.every().map(({ key }) => key));
  }

  tap(point) {
    const hit = this.every().find(({ ring }) => inside(point, ring));
    if (hit) this.toggle(hit.key);
    else this.choose([]);
  }

  /** A drag from within a chosen outline moves all that are chosen; any other draws a frame. */
  drag(from, back) {
    const { canvas, layer } = this.drawing;
    const moves = this.chosen.some(({ ring }) => inside(from, ring));
    let last = from,
      far = false;
    return {
      move: (spot) => {
        const to = back(spot);
        far ||= Math.hypot(to[0] - from[0], to[1] - from[1]) * canvas.scale > SLIP;
        if (!far) return;
        if (moves) {
          this.shift([to[0] - last[0], to[1] - last[1]]);
          last = to;
          this.drawing.changed({ drawnOnly: true });
        } else {
          last = to;
          const corners = rectangle(from, to).map((corner) => corner.join(" "));
          this.marquee.setAttribute("d", `M${corners.join("L")}Z`);
          layer.append(this.marquee);
        }
      },
      end: () => {
        this.marquee.remove();
        if (!far) this.tap(from);
        else if (moves) this.drawing.changed();
        else {
          const within = ([x, y]) =>
            (x - from[0]) * (x - last[0]) <= 0 && (y - from[1]) * (y - last[1]) <= 0;
          this.choose(
            this.every()
              .filter(({ ring }) => ring.every(within))
              .map(({ key }) => key),
          );
        }
      },
      cancel: () => {
        this.marquee.remove();
        if (moves && far) {
          this.shift([from[0] - last[0], from[1] - last[1]]);
          this.drawing.changed({ drawnOnly: true });
        }
      },
    };
  }

  /** Move the outlines of these keys, or all that are chosen. */
  shift([east, north], keys = this.keys) {
    const moved = this.withHoles(keys);
    for (const { kind, k, ring, key } of this.every())
      if (moved.has(key))
        this.drawing.told[kind][k] = ring.map(([x, y]) =>
          this.drawing.rounded([x + east, y + north]),
        );
  }

  copy() {
    if (!this.keys.size) return;
    const keys = this.withHoles(this.keys),
      chosen = this.every().filter(({ key }) => keys.has(key));
    this.copied = chosen.map(({ kind, ring }) => ({ kind, ring: structuredClone(ring) }));
    this.frame = String(this.drawing.told.frame);
    this.pasted = 0;
    this.drawing.changed({ drawnOnly: true });
  }

  /** Beside what was copied; in the middle of the canvas if that is somewhere else. */
  paste() {
    if (!this.copied.length) return;
    const { canvas, told, rounded } = this.drawing;
    this.pasted += 1;
    const corners = this.copied.flatMap(({ ring }) => ring),
      xs = corners.map(([x]) => x),
      wide = Math.max(...xs) - Math.min(...xs),
      middle = centreOf(corners),
      [right, down] = canvas.at(middle),
      seen = right >= 0 && down >= 0 && right <= canvas.size[0] && down <= canvas.size[1];
    const by =
      seen && this.frame === String(told.frame)
        ? [this.pasted * (wide + STEP / canvas.scale), 0]
        : canvas.middle.map((x, axis) => x - middle[axis]);
    const keys = this.copied.map(({ kind }, i) => {
      const before = this.copied.slice(0, i).filter((one) => one.kind === kind).length;
      return `${kind} ${told[kind].length + before}`;
    });
    this.keys = new Set(keys);
    this.drawing.edit(() => {
      for (const { kind, ring } of this.copied)
        told[kind].push(ring.map((point) => rounded(point.map((x, axis) => x + by[axis]))));
    });
  }

  remove(keys = this.keys) {
    const gone = this.withHoles(keys);
    if (!gone.size) return;
    this.keys = new Set();
    this.drawing.edit((told) => {
      for (const kind of KINDS) told[kind] = told[kind].filter((_, k) => !gone.has(`${kind} ${k}`));
    });
  }

  /** Take a key of the canvas; whether it was one of these. */
  key(event) {
    const letter = event.ctrlKey || event.metaKey ? event.key.toLowerCase() : "";
    if (letter === "a") this.all();
    else if (letter === "c" && this.keys.size) this.copy();
    else if (letter === "x" && this.keys.size) {
      this.copy();
      this.remove();
    } else if (letter === "v" && this.copied.length) this.paste();
    else if (["Delete", "Backspace"].includes(event.key) && this.keys.size) this.remove();
    else if (event.key === "Escape" && this.keys.size) this.choose([]);
    else return false;
    return true;
  }
}
