/* A drawn region: polygons to search, their holes and zones to keep out of, in metres; by hand and
   by numbers. */
import {
  CROSSES,
  CROSSES_CLOSED,
  area,
  bearing,
  centreOf,
  circle,
  crosses,
  distance,
  perimeter,
  rectangle,
  snapped,
  turned,
} from "../../shared/geometry.js";
import { capital, el, guarded, svg, symbol } from "../../shared/page.js";
import { stepButtons } from "../../shared/store.js";
import { handle } from "./canvas.js";
import { earthAt, pointText, pointsOf } from "./earth.js";
import { metres, surface } from "./measures.js";
import { holesOf, KINDS } from "./outlines.js";
import { Ruler } from "./ruler.js";
import { Selection } from "./selection.js";

const LOOK = "look",
  SELECT = "select",
  RULER = "ruler",
  PART = "parts",
  HOLE = "holes", // of a region that was opened
  ZONE = "zones",
  LAUNCH = "launch";
const SHAPE_HINTS = {
  rectangle: "Drag from one corner to the opposite one.",
  circle: "Drag from the middle to the rim.",
};
const DRAWS = new Set([LOOK, PART, ZONE]); // tools that give way to an outline that is open again
const WORDS = { parts: "Region", holes: "Hole", zones: "No-go zone" };
const OPEN = "An outline is still open: finish it with Close, or drop it with Escape.";
const SHAPES = { corners: null, rectangle, circle };
const NEAR = 10; // pixels within which a corner snaps
const SAME = 5; // pixels within which a corner is the last one again, as in a double click
const LEVER = 44; // pixels from the middle of a shape to what turns it
const MOST_HANDLES = 300;
const MANY = 24, // corners of an outline that may be too many to be shown
  CROWD = 24; // pixels between two of them
const FINE = { degrees: 9, metres: 3 }; // digits of corners: as many as a drawing keeps
const rounded = (point) => point.map((x) => Math.round(x * 1000) / 1000);
const path = (ring) => ring.map((point, k) => `${k ? "L" : "M"}${point.join(" ")}`).join("") + "Z";

export class Drawing {
  /** `changed()` is called when something was drawn, with `drawnOnly` while a hand still draws it
   *  and with `corner` for an outline that is not closed yet; `begins(kind)` before the first corner
   *  of an outline; `launched(point)` when the tool of launch points is used. */
  constructor(canvas, { changed, launched, begins, store }) {
    this.canvas = canvas;
    this.changed = changed;
    this.launched = launched;
    this.begins = begins;
    this.tool = LOOK;
    this.shape = "corners";
    this.held = "";
    this.sketching = false;
    this.rounded = rounded;
    canvas.drag = (point, back) => this.drag(point, back);
    this.selection = new Selection(this);
    this.ruler = new Ruler(canvas, {
      changed: () => this.changed({ drawnOnly: true }),
      snap: (point) => this.snap(point),
    });
    this.load(null);
    this.layer = svg("g", { class: "drawn" });
    this.toolbar = this.makeToolbar(store);
  }

  /** Show what is drawn, an outline that is not closed yet included. */
  load(told) {
    const given = structuredClone(told ?? {}),
      { frame = null, parts = [], holes = [], zones = [], draft = null } = given;
    this.told = { frame, parts, holes, zones };
    this.draft = draft;
    if (draft && this.buttons && DRAWS.has(this.tool)) this.pick(draft.kind);
  }

  get empty() {
    return !this.told.parts.length && !this.told.zones.length;
  }

  /** All that is drawn; null for nothing. */
  get state() {
    return this.empty && !this.draft && !this.told.frame
      ? null
      : { ...this.told, ...(this.draft ? { draft: this.draft } : {}) };
  }

  /** What questions are asked with: null where nothing is drawn. */
  get asked() {
    return this.empty ? null : this.told;
  }

  get points() {
    return [...this.told.parts, ...this.told.zones].flat();
  }

  edit(change) {
    change(this.told);
    this.changed();
  }

  // ---- by hand ----

  tap(point) {
    if (this.tool === LAUNCH) this.launched(rounded(point));
    if (this.tool === RULER) this.ruler.tap(point);
    if (this.tool !== PART && this.tool !== ZONE) return;
    if (this.draft && this.draft.kind !== this.tool) return this.refuse(OPEN);
    if (SHAPES[this.shape] && !this.draft) return;
    if (!this.draft) this.begins?.(this.tool);
    this.draft ??= { kind: this.tool, points: [] };
    const { points } = this.draft,
      within = (corner, pixels) => corner && distance(point, corner) < pixels / this.canvas.scale;
    if (points.length > 2 && within(points[0], 12)) this.close();
    else if (within(points.at(-1), SAME)) return;
    else if (crosses(this.draft.points, point)) this.refuse(CROSSES);
    else {
      this.draft.points.push(rounded(this.snap(point)));
      this.changed({ corner: true });
    }
  }

  /** A drag over the canvas draws a rectangle or a circle, if one of them is chosen, or chooses. */
  drag(from, back) {
    if (this.tool === SELECT) return this.selection.drag(from, back);
    const make = SHAPES[this.shape];
    if (this.draft || !make || (this.tool !== PART && this.tool !== ZONE)) return null;
    const kind = this.tool,
      start = this.snap(from);
    let ring = null;
    this.sketching = true;
    return {
      move: (spot) => {
        ring = make(start, this.snap(back(spot))).map(rounded);
        this.layer.append(this.sketched);
        this.sketched.setAttribute("class", `draft ${kind}`);
        this.sketched.setAttribute("d", path(ring));
        const [a, , c] = ring;
        const sides =
          this.shape === "circle"
            ? `radius ${metres(distance(start, a))}`
            : `${metres(Math.abs(c[0] - a[0]))} × ${metres(Math.abs(c[1] - a[1]))}`;
        this.measure(`${sides}, area ${surface(area(ring))}`);
      },
      end: () => {
        this.sketching = false;
        this.sketched.remove();
        if (!ring || area(ring) < (4 / this.canvas.scale) ** 2) return this.measure("");
        this.begins?.(kind);
        this.told[kind].push(ring);
        this.pick(LOOK);
        return this.changed({ closed: true });
      },
      cancel: () => {
        this.sketching = false;
        this.sketched.remove();
      },
    };
  }

  /** A corner or side of the other outlines that is near, else the point itself. */
  snap(point, own = null) {
    const others = KINDS.flatMap((kind) => this.told[kind]).filter((ring) => ring !== own);
    return snapped(point, others, NEAR / this.canvas.scale);
  }

  measure(words) {
    this.measured.textContent = words;
    this.guide.hidden = !words && !this.hint.textContent;
  }

  /** The next side follows the pointer: how long it is, where it goes, and the area so far. */
  over(point) {
    const points = this.draft?.points ?? [];
    this.sketched.remove();
    if (this.tool === RULER) {
      this.ruler.over(point);
      this.layer.querySelector(".ruler")?.replaceWith(this.ruler.line());
      this.measure(this.ruler.ends.length === 1 ? this.ruler.text : "");
      return;
    }
    if (!points.length || !point || this.tool !== this.draft.kind) return;
    const next = this.snap(point),
      last = points.at(-1),
      ring = [...points, next];
    this.sketched.setAttribute("class", `draft ${this.draft.kind} next`);
    this.sketched.setAttribute("d", `M${last.join(" ")}L${next.join(" ")}`);
    this.layer.append(this.sketched);
    this.measure(
      [
        `side ${metres(distance(last, next))}, bearing ${Math.round(bearing(last, next))}°`,
        ring.length > 2 ? `around ${metres(perimeter(ring))}, area ${surface(area(ring))}` : "",
      ]
        .filter(Boolean)
        .join(", "),
    );
  }

  /** Say why the hand's corner is not taken, until the next one is. */
  refuse(sentence) {
    this.hint.textContent = sentence;
    this.guide.classList.add("refuses");
  }

  /** Close the outline: to take it back is one step, however many corners it has. */
  close() {
    const { kind, points } = this.draft;
    if (points.length < 3) return this.refuse("An outline has at least three corners.");
    if (crosses(points, points[0], { closes: true })) return this.refuse(CROSSES_CLOSED);
    this.told[kind].push(points);
    this.draft = null;
    this.pick(LOOK);
    return this.changed({ closed: true });
  }

  drop() {
    this.draft = null;
    this.pick(LOOK);
    this.changed({ corner: true });
  }

  /** Take another tool; an outline that is open stays, and goes on with its own tool. */
  pick(tool) {
    this.tool = tool;
    if (tool !== RULER) this.ruler.clear();
    if (tool !== SELECT) this.selection.keys = new Set();
    this.buttons.forEach((button) =>
      button.setAttribute("aria-pressed", String(button.dataset.tool === tool)),
    );
    this.canvas.element.classList.toggle("aims", tool !== LOOK);
    // a click on a corner of another outline snaps to it, and does not take it
    this.canvas.element.classList.toggle("passes", [PART, ZONE, RULER].includes(tool));
    this.show();
  }

  /** Draw it, and return the marks of its corners. */
  show() {
    const { parts, holes, zones } = this.told,
      draft = this.draft?.points ?? [];
    this.selection.refresh();
    const chosen = (kind, k) => (this.selection.keys.has(`${kind} ${k}`) ? " chosen" : "");
    this.layer.replaceChildren(
      ...parts.map((ring, k) =>
        svg("path", {
          class: `part${chosen(PART, k)}`,
          "fill-rule": "evenodd",
          d: [ring, ...holesOf(ring, holes)].map(path).join(""),
        }),
      ),
      ...holes.map((ring, k) => svg("path", { class: `hole${chosen(HOLE, k)}`, d: path(ring) })),
      ...zones.map((ring, k) => svg("path", { class: `zone${chosen(ZONE, k)}`, d: path(ring) })),
      this.ruler.line(),
      ...(draft.length
        ? [svg("path", { class: `draft ${this.draft.kind}`, d: path(draft).slice(0, -1) })]
        : []),
    );
    this.guide.classList.remove("refuses");
    this.hint.textContent =
      this.tool === PART || this.tool === ZONE
        ? draft.length > 2
          ? "To finish, click the first corner, double-click, or press Enter or Close."
          : SHAPES[this.shape]
            ? SHAPE_HINTS[this.shape]
            : "Click the corners of the outline, one after another."
        : ({
            [LAUNCH]: "Click where robots set out.",
            [SELECT]: this.selection.hint,
            [RULER]: this.ruler.hint,
          }[this.tool] ?? "");
    if (draft.length && this.tool !== this.draft.kind) this.hint.textContent = OPEN;
    if (!this.hint.textContent && this.points.length > MOST_HANDLES)
      this.hint.textContent = "Too many corners to move by hand: By numbers lists them.";
    this.closing.hidden = draft.length < 3;
    this.numbers.element.style.visibility = this.closing.hidden ? "" : "hidden";
    this.selection.element.hidden = this.tool !== SELECT;
    this.shaping.hidden = (this.tool !== PART && this.tool !== ZONE) || draft.length > 0;
    // a plan that comes does not take the shape out of the hand
    if (this.sketching) this.layer.append(this.sketched);
    else if (!draft.length) this.measured.textContent = "";
    this.guide.hidden = !this.hint.textContent && !this.measured.textContent;
    const corners =
      this.points.length <= MOST_HANDLES
        ? KINDS.flatMap((kind) =>
            this.told[kind].flatMap((ring, k) => [
              ...(this.tool === SELECT || this.crowded(`${kind}${k}`, ring)
                ? []
                : this.cornersOf(kind, ring, k)),
              ...this.wholeOf(kind, ring, k),
            ]),
          )
        : [];
    return [
      ...corners,
      ...this.ruler.marks(),
      ...draft.map((point) => ({ point, element: svg("circle", { class: "corner draft", r: 5 }) })),
    ];
  }

  /** What moves and turns an outline as a whole. */
  wholeOf(kind, ring, k) {
    const selects = this.tool === SELECT;
    if (this.draft || (this.tool !== LOOK && !selects)) return [];
    const name = `${WORDS[kind]} ${k + 1}`,
      key = `${kind}${k}`,
      centre = centreOf(ring);
    const chosen = this.selection.keys.has(`${kind} ${k}`),
      together = selects && chosen ? this.selection.keys : new Set([`${kind} ${k}`]);
    let last = centre;
    const all = handle(
      this.canvas,
      `${key}-all`,
      centre,
      `${name}, all of it. Arrow keys move it, Delete removes it${selects ? ", Space chooses it" : ""}.`,
      svg("path", {
        class: `whole ${kind}`,
        d: "M-8 0H8M0 -8V8M-3 -5L0 -8L3 -5M-3 5L0 8L3 5M-5 -3L-8 0L-5 3M5 -3L8 0L5 3",
      }),
      {
        ...this.moving((_, to) => {
          this.selection.shift([to[0] - last[0], to[1] - last[1]], together);
          last = to;
        }),
        remove: () => this.selection.remove(together),
        ...(selects ? { press: () => this.selection.toggle(`${kind} ${k}`), pressed: chosen } : {}),
      },
    );
    if (selects) return [all];
    all.element.addEventListener("focus", () => this.hold(key));
    if (this.held !== key) return [all];
    const reach = LEVER / this.canvas.scale,
      tip = [centre[0] + reach, centre[1]];
    let angle = 0;
    const lever = handle(
      this.canvas,
      `${key}-turn`,
      tip,
      `${name}: turn it. Up and down arrow keys turn it.`,
      [
        svg("path", { class: "lever", d: `M${-LEVER + 12} 0H-9` }),
        svg("path", { class: `whole ${kind}`, d: "M6 -3A7 7 0 1 0 7 2M7 -7V-2H2" }),
      ],
      {
        move: (to) => {
          const now = Math.atan2(to[1] - centre[1], to[0] - centre[0]);
          const turn = (one) => turned(one, centre, now - angle).map(rounded),
            own = kind === PART ? holesOf(this.told[kind][k], this.told.holes) : [];
          this.told.holes = this.told.holes.map((hole) => (own.includes(hole) ? turn(hole) : hole));
          this.told[kind][k] = turn(this.told[kind][k]);
          angle = now;
          this.changed({ drawnOnly: true });
          this.measure(`turned by ${Math.round((now * 180) / Math.PI)}°`);
        },
        done: () => this.changed(),
      },
    );
    return [all, lever];
  }

  /** The outline whose lever is shown. */
  hold(key) {
    if (this.held === key) return;
    this.held = key;
    this.changed({ drawnOnly: true });
  }

  /** Whether corners would hide the outline, as those of a circle: the cross in its middle shows
   *  them. */
  crowded(key, ring) {
    const apart = (perimeter(ring) * this.canvas.scale) / ring.length;
    return ring.length >= MANY && apart < CROWD && this.held !== key;
  }

  cornersOf(kind, ring, k) {
    const name = `${WORDS[kind]} ${k + 1}`;
    const corners = ring.map((point, i) =>
      handle(
        this.canvas,
        `${kind}${k}-${i}`,
        point,
        `${name}, corner ${i + 1}. Arrow keys move it, Delete removes it.`,
        svg("circle", { class: `corner ${kind}`, r: 5 }),
        {
          ...this.moving(
            (told, to) => {
              told[kind][k][i] = rounded(this.snap(to, told[kind][k]));
            },
            kind,
            k,
          ),
          remove: () =>
            this.edit((told) => {
              if (ring.length > 3) told[kind][k].splice(i, 1);
              else told[kind].splice(k, 1);
            }),
        },
      ),
    );
    const sides =
      ring.length > 40
        ? []
        : ring.map((point, i) => {
            const next = ring[(i + 1) % ring.length],
              middle = point.map((x, axis) => (x + next[axis]) / 2);
            let added = false;
            return handle(
              this.canvas,
              `${kind}${k}-${i}+`,
              middle,
              `${name}, between corners ${i + 1} and ${((i + 1) % ring.length) + 1}`,
              svg("circle", { class: "between", r: 3 }),
              {
                quiet: true,
                ...this.moving(
                  (told, to) => {
                    told[kind][k].splice(
                      i + 1,
                      added ? 1 : 0,
                      rounded(this.snap(to, told[kind][k])),
                    );
                    added = true;
                  },
                  kind,
                  k,
                ),
              },
            );
          });
    return [...sides, ...corners];
  }

  /** What a drag does: shown at once, told at its end; with the measures of the outline. */
  moving(change, kind = null, k = 0) {
    return {
      move: (to) => {
        change(this.told, rounded(to));
        this.changed({ drawnOnly: true });
        const ring = kind && this.told[kind][k];
        if (ring) this.measure(`around ${metres(perimeter(ring))}, area ${surface(area(ring))}`);
      },
      done: () => this.changed(),
    };
  }

  makeToolbar(store) {
    const tools = [
      [
        LOOK,
        "Move",
        "M12 3v18M3 12h18M9 6l3-3 3 3M9 18l3 3 3-3M6 9l-3 3 3 3M18 9l3 3-3 3",
        "Move the canvas and corners",
      ],
      [
        SELECT,
        "Select",
        "M4 4h3M11 4h3M18 4h2v2M20 10v3M4 8v3M4 15v4h3M12 11l8 4-3.5 1L15 19.5z",
        "Choose several outlines: click them, or drag a frame around them",
      ],
      [PART, "Region", "M5 8l6-4 8 4-2 10-10 2z", "Draw a region to search: click its corners"],
      [
        ZONE,
        "No-go",
        "M12 4a8 8 0 1 0 .01 0zM6.5 6.5l11 11",
        "Draw a no-go zone: click its corners",
      ],
      [LAUNCH, "Launch", "M12 4l6 14H6zM12 18v3", "Click where robots set out"],
      [
        RULER,
        "Ruler",
        "M3 16L16 3l5 5L8 21zM7 12l2 2M10 9l3 3M13 6l2 2",
        "Click two points: how far they are apart",
      ],
    ];
    this.buttons = tools.map(([tool, words, symbolPath, help]) =>
      el(
        "button.tool",
        {
          type: "button",
          title: help,
          "aria-label": words,
          "aria-pressed": String(tool === LOOK),
          "data-tool": tool,
          onclick: () => {
            this.pick(tool);
            this.changed({ corner: true });
          },
        },
        symbol(symbolPath),
        el("span", {}, words),
      ),
    );
    this.closing = el(
      "button.second.small",
      {
        type: "button",
        hidden: true,
        title: "Close the outline (Enter)",
        onclick: () => this.close(),
      },
      "Close",
    );
    this.hint = el("span.soft.hint", { role: "status" });
    this.measured = el("span.measured", {});
    this.sketched = svg("path", {});
    const shapes = Object.keys(SHAPES).map((shape) =>
      el(
        "button",
        {
          type: "button",
          "aria-pressed": String(shape === this.shape),
          onclick: () => {
            this.shape = shape;
            for (const button of shapes)
              button.setAttribute(
                "aria-pressed",
                String(button.textContent.toLowerCase() === shape),
              );
            this.show();
          },
        },
        capital(shape),
      ),
    );
    this.shaping = el(
      "div.segmented",
      { role: "group", "aria-label": "Draw by", hidden: true },
      shapes,
    );
    this.canvas.element.addEventListener("keydown", (event) => {
      if (event.key === "Enter" && this.draft && event.target === this.canvas.plane) this.close();
      else if (event.key === "Escape" && this.draft) this.drop();
      else if (event.key === "Escape" && this.ruler.ends.length) {
        this.ruler.clear();
        this.changed({ drawnOnly: true });
      } else if (
        this.canvas.plane.contains(/** @type {Node} */ (event.target)) &&
        !event.defaultPrevented &&
        !event.altKey &&
        [LOOK, SELECT].includes(this.tool) &&
        this.selection.key(event)
      ) {
        event.preventDefault();
        const { keys } = this.selection;
        this.pick(SELECT);
        this.selection.choose(keys);
      }
    });
    this.canvas.plane.addEventListener("dblclick", () => {
      if (this.draft?.kind === this.tool) this.close();
    });
    this.numbers = byNumbers(this);
    // on the canvas, whose size must not change under the hand
    this.guide = el(
      "div.guide",
      { hidden: true },
      this.shaping,
      this.hint,
      this.measured,
      this.selection.element,
    );
    this.canvas.element.append(this.guide);
    return el(
      "div.toolbar",
      { role: "toolbar", "aria-label": "Drawing" },
      el("div.group", {}, this.buttons),
      stepButtons(store),
      // not on the canvas, where a corner may be anywhere, and without another row of tools
      el("div.either", {}, this.numbers.element, this.closing),
    );
  }
}

/** The same without drawing: corners as a list, and where on Earth the metres are. */
function byNumbers(drawing) {
  const which = el("select", { "aria-label": "Which outline", onchange: () => fill(true) });
  const text = el("textarea.code", { rows: 6, spellcheck: false, id: "cornersText" }),
    unit = el("label", { htmlFor: "cornersText" }, "");
  const longitude = el("input", {
    type: "number",
    step: "any",
    min: -180,
    max: 180,
    placeholder: "none",
    id: "frameLongitude",
  });
  const latitude = el("input", {
    type: "number",
    step: "any",
    min: -89.9,
    max: 89.9,
    placeholder: "none",
    id: "frameLatitude",
  });
  const apply = el("button.second", { type: "button", onclick: guarded(corners) }, "Apply");
  const remove = el(
    "button.second",
    {
      type: "button",
      onclick: () => {
        drawing.selection.remove(new Set([which.value]));
      },
    },
    "Remove",
  );
  const place = el("button.second", { type: "button", onclick: guarded(earth) }, "Place it");
  const chosen = () => {
    const [kind, k] = which.value.split(" ");
    return [kind, Number(k)];
  };

  function fill(changed = false) {
    const { parts, holes, zones, frame } = drawing.told,
      kept = which.value;
    const names = [
      ...parts.map((_, k) => [`parts ${k}`, `Region ${k + 1}`]),
      ...holes.map((_, k) => [`holes ${k}`, `Hole ${k + 1}`]),
      ...zones.map((_, k) => [`zones ${k}`, `No-go zone ${k + 1}`]),
      [`parts ${parts.length}`, "A new region"],
      [`zones ${zones.length}`, "A new no-go zone"],
    ];
    which.replaceChildren(...names.map(([value, words]) => el("option", { value }, words)));
    which.value = names.some(([value]) => value === kept) ? kept : names[0][0];
    const [kind, k] = chosen(),
      ring = drawing.told[kind][k],
      there = frame ? drawing.canvas.earth : null;
    if (changed || document.activeElement !== text)
      text.value = (ring ?? [])
        .map((point) => pointText(point, there, FINE).replace(",", ", "))
        .join("\n");
    unit.textContent = frame
      ? "Corners: one longitude, latitude per line"
      : "Corners: one x, y per line, in metres";
    remove.disabled = !ring;
    if (document.activeElement !== longitude) longitude.value = frame?.[0] ?? "";
    if (document.activeElement !== latitude) latitude.value = frame?.[1] ?? "";
  }

  async function corners() {
    const [kind, k] = chosen(),
      points = pointsOf(text.value, drawing.told.frame ? await earthAt(drawing.told.frame) : null);
    if (!points || points.length < 3)
      throw new Error(
        "An outline needs at least three corners: one line with two numbers per corner.",
      );
    drawing.edit((told) => {
      told[kind][k] = points.map(rounded);
    });
    which.value = `${kind} ${k}`;
    fill(true);
  }

  async function earth() {
    const given = [longitude.value, latitude.value].map((word) =>
      word === "" ? null : Number(word),
    );
    if (given.includes(null) !== given.every((one) => one === null))
      throw new Error("A place on Earth needs a longitude and a latitude.");
    drawing.edit((told) => {
      told.frame = given.includes(null) ? null : given;
    });
  }

  return {
    fill,
    element: el(
      "details.by",
      { ontoggle: () => fill(true) },
      el("summary", {}, "By numbers"),
      el(
        "div.numbers",
        {},
        which,
        el("div.whole", {}, unit, text),
        apply,
        remove,
        el(
          "p.help.whole",
          {},
          "The place of x = 0, y = 0 on Earth. Without this place, the drawing has coordinates in metres only.",
        ),
        el("label", { htmlFor: "frameLongitude" }, "Longitude", longitude),
        el("label", { htmlFor: "frameLatitude" }, "Latitude", latitude),
        place,
      ),
    ),
  };
}
