/* The map on a canvas: looked at, painted and erased cell by cell; and the photograph with what
   was found on it. */
import { hands } from "../../shared/hands.js";
import { el } from "../../shared/page.js";

export const LOOK = "look";
export const FREE = "free";
export const WALL = "wall";
export const INLET = "inlet";

export function unpack(text, cells) {
  const bytes = Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0)),
    free = new Uint8Array(cells);
  for (let i = 0; i < cells; i++) free[i] = (bytes[i >> 3] >> (7 - (i & 7))) & 1;
  return free;
}

export function pack(free) {
  const bytes = new Uint8Array(Math.ceil(free.length / 8));
  free.forEach((bit, i) => {
    if (bit) bytes[i >> 3] |= 128 >> (i & 7);
  });
  let text = "";
  for (let i = 0; i < bytes.length; i += 8192)
    text += String.fromCharCode(...bytes.subarray(i, i + 8192));
  return btoa(text);
}

/** Whether packed cells have no free one. */
export const isEmpty = ({ free }) => /^A*=*$/.test(free);

/** Numbers of cells as the player takes them. */
export function packedCells(cells) {
  const bytes = new Uint8Array(new Uint32Array(cells).buffer);
  return btoa(Array.from(bytes, (byte) => String.fromCharCode(byte)).join(""));
}

const colourOf = (name) =>
  getComputedStyle(document.documentElement).getPropertyValue(`--${name}`).trim();
// how much of a photograph shows through free cells, of what shows through walls
const THROUGH_OPEN = 0.25;
const OVERLAY = 0.85; // how much of the vessels' colour covers the photograph
const ON_DARK = "#fff6a0",
  ON_BRIGHT = "#10247a";
/** Relative luminance of a colour, as WCAG 2 defines it. */
function luminance(colour) {
  const [r, g, b] = colour.map((x) =>
    x <= 10 ? x / 255 / 12.92 : ((x / 255 + 0.055) / 1.055) ** 2.4,
  );
  return 0.2126 * r + 0.7152 * g + 0.0722 * b;
}

/** The colour for vessels that differs most in lightness from what is around them in the
 *  photograph, whatever hue an eye sees. */
function contrasting(photograph, mask) {
  const small = document.createElement("canvas"),
    side = 96;
  small.width = small.height = side;
  const pen = small.getContext("2d", { willReadFrequently: true });
  pen.drawImage(mask, 0, 0, side, side);
  const found = pen.getImageData(0, 0, side, side).data;
  pen.drawImage(photograph, 0, 0, side, side);
  const { data } = pen.getImageData(0, 0, side, side);
  let sum = 0,
    count = 0;
  for (let i = 0; i < data.length; i += 4) {
    if (found[i + 3]) {
      sum += luminance([data[i], data[i + 1], data[i + 2]]);
      count += 1;
    }
  }
  const there = count ? sum / count : 0,
    apart = (hex) => {
      const [low, high] = [there, luminance(rgb(hex))].sort((a, b) => a - b);
      return (high + 0.05) / (low + 0.05);
    };
  return apart(ON_DARK) >= apart(ON_BRIGHT) ? ON_DARK : ON_BRIGHT;
}

const rgb = (hex) => [1, 3, 5].map((i) => parseInt(hex.slice(i, i + 2), 16));

export class Editor {
  /** `edited(what)` is called after each stroke: "map", "inlet", or null if it changed nothing;
   *  `over(place)` as the pointer moves, with a place in the picture, in shares of its sides, or
   *  null. */
  constructor(edited, over) {
    this.edited = edited;
    this.over = over;
    this.canvas = el("canvas", {
      tabIndex: 0,
      role: "img",
      "aria-label":
        "The map. Plus and minus zoom, 0 shows all of it, and arrow keys move it; with a brush, they move a cursor, and Space paints.",
    });
    this.pen = this.canvas.getContext("2d");
    this.image = document.createElement("canvas");
    this.overlay = null;
    /** Where the map is in a photograph, if that is known.
     *  @type {(photograph: any) => number[] | null} */
    this.boxIn = () => null;
    this.below = null; // a photograph under the cells: { image, box, share }
    this.photograph = null;
    this.vesselColour = null; // of what was found on it
    this.framed = false; // whether the place of the map in it is that of these vessels
    this.map = null; // { shape, free, start }
    this.applying = el("button.second", { disabled: true }, "Apply"); // of what is painted by numbers
    this.inlet = new Set();
    this.tool = LOOK;
    this.brush = 3;
    this.zoom = 1;
    this.cursor = null;
    this.stroke = null;
    this.listen();
    this.element = el("div.editor", {}, this.canvas);
    new ResizeObserver(() => this.resize()).observe(this.element);
  }

  // ---- what is shown ----

  /** Show a map; none, if there is none. */
  setMap(map) {
    const same = this.map && map && String(this.map.shape) === String(map.shape);
    const view = this.photograph ? this.look() : null;
    const other = this.photograph || !same;
    this.map = map;
    this.applying.disabled = !map;
    this.photograph = null;
    if (other) this.lookAt(map && view);
    this.paint();
    this.redraw();
  }

  setPhotograph(image, mask, framed = false) {
    const view = this.photograph ? null : this.look();
    const same =
      this.photograph &&
      this.photograph.naturalWidth === image.naturalWidth &&
      this.photograph.naturalHeight === image.naturalHeight;
    this.photograph = image;
    this.overlay = mask ? this.tinted(mask) : null;
    this.framed = framed;
    if (!same) this.lookAt(view);
    this.redraw();
  }

  /** What of the map is in the middle, and how many of its widths the canvas shows, as zoomed in;
   *  null: all of it, or a photograph whose map is not known. */
  look() {
    const box = this.box;
    if (this.zoom === 1 || !this.map || !box) return null;
    const [rows, columns] = this.size,
      [left, top, right, bottom] = box;
    const [x, y] = [
      (this.canvas.width / 2 - this.left) / (columns * this.scale),
      (this.canvas.height / 2 - this.top) / (rows * this.scale),
    ];
    return {
      x: (x - left) / (right - left),
      y: (y - top) / (bottom - top),
      wide: this.canvas.width / (columns * this.scale) / (right - left),
    };
  }

  /** Show what `look` told, of the cells or of the photograph. */
  lookAt(view) {
    this.fit();
    const box = this.box;
    if (!view || !box) return;
    const [rows, columns] = this.size,
      [left, top, right, bottom] = box;
    const scale = this.canvas.width / (view.wide * (right - left) * columns);
    if (scale <= this.scale) return;
    this.zoom = scale / this.scale;
    this.scale = scale;
    this.left = this.canvas.width / 2 - (left + view.x * (right - left)) * columns * scale;
    this.top = this.canvas.height / 2 - (top + view.y * (bottom - top)) * rows * scale;
  }

  /** Where the map is in what is shown, in shares of its sides. */
  get box() {
    return this.photograph ? this.boxIn(this.photograph) : [0, 0, 1, 1];
  }

  tinted(mask) {
    const own = contrasting(this.photograph, mask),
      other = own === ON_DARK ? ON_BRIGHT : ON_DARK;
    this.vesselColour = own;
    const thick = Math.max(1, Math.round(Math.max(mask.naturalWidth, mask.naturalHeight) / 800));
    const layer = (/** @type {string} */ colour, /** @type {number[]} */ shifts) => {
      const made = document.createElement("canvas"),
        pen = made.getContext("2d");
      [made.width, made.height] = [mask.naturalWidth, mask.naturalHeight];
      for (const x of shifts) for (const y of shifts) pen.drawImage(mask, x, y);
      pen.globalCompositeOperation = "source-in";
      pen.fillStyle = colour;
      pen.fillRect(0, 0, made.width, made.height);
      return made;
    };
    // a line of the other colour around them: also vessels as dark or light as their own stand out
    const made = layer(other, [-thick, 0, thick]);
    made.getContext("2d").globalCompositeOperation = "source-over";
    made.getContext("2d").drawImage(layer(own, [0]), 0, 0);
    return made;
  }

  get size() {
    if (this.photograph) return [this.photograph.naturalHeight, this.photograph.naturalWidth];
    return this.map ? this.map.shape : [1, 1];
  }

  resize() {
    const ratio = window.devicePixelRatio || 1;
    this.ratio = ratio;
    this.canvas.width = Math.max(1, Math.round(this.element.clientWidth * ratio));
    this.canvas.height = Math.max(1, Math.round(this.element.clientHeight * ratio));
    if (this.zoom === 1) this.fit();
    this.redraw();
  }

  fit() {
    const [rows, columns] = this.size,
      margin = 16 * (this.ratio || 1);
    this.zoom = 1;
    this.scale = Math.max(
      0.01,
      Math.min(
        (this.canvas.width - 2 * margin) / columns,
        (this.canvas.height - 2 * margin) / rows,
      ),
    );
    this.left = (this.canvas.width - columns * this.scale) / 2;
    this.top = (this.canvas.height - rows * this.scale) / 2;
    this.redraw();
  }

  zoomAt(factor, x, y) {
    const zoom = Math.max(1, Math.min(80, this.zoom * factor)),
      by = zoom / this.zoom;
    if (zoom === 1) return this.fit();
    this.zoom = zoom;
    this.left = x - (x - this.left) * by;
    this.top = y - (y - this.top) * by;
    this.scale *= by;
    return this.redraw();
  }

  /** Draw the cells into an image of one pixel each. */
  paint() {
    if (!this.map) return;
    const [rows, columns] = this.map.shape,
      pen = this.image.getContext("2d");
    this.image.width = columns;
    this.image.height = rows;
    const pixels = pen.createImageData(columns, rows),
      words = new Uint32Array(pixels.data.buffer);
    const through = this.below?.share ?? 0;
    const packed = (/** @type {number[]} */ [r, g, b], share = THROUGH_OPEN * through) =>
      ((Math.round(255 * (1 - share)) << 24) | (b << 16) | (g << 8) | r) >>> 0;
    const free = packed(rgb(colourOf("free"))),
      wall = packed(rgb(colourOf("obstacle")), through),
      inlet = packed(rgb(colourOf("frontier")));
    this.map.free.forEach((bit, i) => {
      words[i] = bit ? free : wall;
    });
    this.inlet.forEach((cell) => {
      words[cell] = inlet;
    });
    pen.putImageData(pixels, 0, 0);
    this.redraw();
  }

  redraw() {
    this.pending ||= requestAnimationFrame(() => {
      this.pending = 0;
      this.draw();
    });
  }

  draw() {
    const { pen, canvas, scale, left, top } = this,
      [rows, columns] = this.size;
    pen.clearRect(0, 0, canvas.width, canvas.height);
    if (this.photograph) {
      pen.imageSmoothingEnabled = true;
      pen.drawImage(this.photograph, left, top, columns * scale, rows * scale);
      if (this.overlay) {
        pen.globalAlpha = OVERLAY;
        pen.drawImage(this.overlay, left, top, columns * scale, rows * scale);
        pen.globalAlpha = 1;
      }
      this.drawFrame();
      return;
    }
    if (!this.map) return;
    if (this.below) {
      const { image, box } = this.below,
        wide = (columns * scale) / (box[2] - box[0]),
        high = (rows * scale) / (box[3] - box[1]);
      pen.save();
      pen.beginPath();
      pen.rect(left, top, columns * scale, rows * scale);
      pen.clip();
      pen.imageSmoothingEnabled = true;
      pen.drawImage(image, left - box[0] * wide, top - box[1] * high, wide, high);
      pen.restore();
    }
    pen.imageSmoothingEnabled = scale < 1;
    pen.drawImage(this.image, left, top, columns * scale, rows * scale);
    pen.fillStyle = colourOf("particle");
    const dot = Math.max(1.5 * this.ratio, scale * 0.8);
    for (const cell of this.map.start ?? []) {
      const row = Math.floor(cell / columns),
        column = cell % columns;
      const x = left + (column + 0.5) * scale,
        y = top + (row + 0.5) * scale;
      if (scale < 5) pen.fillRect(x - dot / 2, y - dot / 2, dot, dot);
      else {
        pen.beginPath();
        pen.arc(x, y, dot / 2, 0, 2 * Math.PI);
        pen.fill();
      }
    }
    if (this.cursor && this.tool !== LOOK) {
      pen.strokeStyle = colourOf("accent");
      pen.lineWidth = 2 * this.ratio;
      const half = (this.brush - 1) / 2;
      pen.strokeRect(
        left + (this.cursor[1] - half) * scale,
        top + (this.cursor[0] - half) * scale,
        this.brush * scale,
        this.brush * scale,
      );
    }
  }

  /** Frame what of the photograph the map takes: all around it is dim. */
  drawFrame() {
    const box = this.framed && this.box;
    if (!box) return;
    const { pen, ratio, scale } = this,
      [rows, columns] = this.size;
    const [left, top, right, bottom] = box.map((share, i) =>
      i % 2 ? this.top + share * rows * scale : this.left + share * columns * scale,
    );
    pen.save();
    pen.beginPath();
    pen.rect(this.left, this.top, columns * scale, rows * scale);
    pen.rect(left, top, right - left, bottom - top);
    pen.fillStyle = "rgb(12 16 22 / .45)";
    pen.fill("evenodd");
    pen.lineWidth = 1.5 * ratio;
    for (const [colour, dash] of [
      ["#10151b", []],
      ["#ffffff", [5 * ratio, 5 * ratio]],
    ]) {
      pen.strokeStyle = colour;
      pen.setLineDash(dash);
      pen.strokeRect(left, top, right - left, bottom - top);
    }
    pen.restore();
  }

  // ---- painting ----

  /** Set a rectangle of cells. */
  set(tool, row, column, rows, columns) {
    const [height, width] = this.map.shape,
      value = tool === FREE ? 1 : 0;
    for (let r = Math.max(0, row); r < Math.min(height, row + rows); r++) {
      for (let c = Math.max(0, column); c < Math.min(width, column + columns); c++) {
        const cell = r * width + c;
        if (tool === INLET) {
          if (!this.map.free[cell] || this.inlet.has(cell)) continue;
          this.stroke.cells += 1;
          this.inlet.add(cell);
        } else if (this.map.free[cell] !== value) {
          this.stroke.cells += 1;
          this.map.free[cell] = value;
          if (!value) this.inlet.delete(cell);
        }
      }
    }
  }

  beginStroke() {
    this.stroke = { cells: 0, tool: this.tool };
  }

  endStroke() {
    const stroke = this.stroke;
    this.stroke = null;
    if (!stroke) return;
    this.paint();
    this.edited(!stroke.cells ? null : stroke.tool === INLET ? "inlet" : "map");
  }

  /** Paint a rectangle by its numbers, for those who do not draw. */
  fill(tool, row, column, rows, columns) {
    this.tool = tool;
    this.beginStroke();
    this.set(tool, row, column, rows, columns);
    this.endStroke();
  }

  // ---- hands ----

  cellAt(spot) {
    const [x, y] = spot.map((one) => one * this.ratio);
    return [Math.floor((y - this.top) / this.scale), Math.floor((x - this.left) / this.scale)];
  }

  stamp(row, column) {
    const half = Math.floor((this.brush - 1) / 2);
    this.set(this.tool, row - half, column - half, this.brush, this.brush);
  }

  listen() {
    hands(this.canvas, {
      zoom: (factor, spot) => this.zoomAt(factor, ...spot.map((one) => one * this.ratio)),
      pan: (right, down) => this.pan(right, down),
      fit: () => this.fit(),
      over: (spot) => {
        this.cursor = spot && this.cellAt(spot);
        this.over(spot && this.cursor);
        this.redraw();
      },
      take: (spot) => (this.paints ? this.strokeFrom(this.cellAt(spot)) : null),
      arrow: (step, event) => this.paints && this.step(step, event.shiftKey ? 10 : 1),
    });
    this.canvas.addEventListener("keydown", (event) => {
      if (event.key !== " " || !this.paints) return;
      event.preventDefault();
      this.cursor ??= this.middle;
      this.beginStroke();
      this.stamp(...this.cursor);
      this.endStroke();
    });
  }

  /** Whether a hand paints, and does not move the map. */
  get paints() {
    return this.map && !this.photograph && this.tool !== LOOK;
  }

  get middle() {
    return this.map.shape.map((side) => side >> 1);
  }

  pan(right, down) {
    if (this.zoom === 1) return;
    this.left += right * this.ratio;
    this.top += down * this.ratio;
    this.redraw();
  }

  strokeFrom(first) {
    let last = first;
    const { free } = this.map,
      before = free.slice(),
      inlet = new Set(this.inlet);
    this.beginStroke();
    this.stamp(...first);
    this.paint();
    return {
      move: (spot) => {
        const here = this.cellAt(spot),
          by = here.map((x, axis) => x - last[axis]);
        const steps = Math.max(1, ...by.map(Math.abs));
        for (let i = 1; i <= steps; i++) {
          this.stamp(...last.map((x, axis) => Math.round(x + (by[axis] * i) / steps)));
        }
        last = here;
        this.paint();
      },
      end: () => this.endStroke(),
      cancel: () => {
        // a second finger: both of them zoom
        free.set(before);
        this.inlet = inlet;
        this.stroke = null;
        this.paint();
      },
    };
  }

  /** Move the cursor by so many cells. */
  step([left, up], by) {
    const [row, column] = this.cursor ?? this.middle,
      [height, width] = this.map.shape;
    this.cursor = [
      Math.max(0, Math.min(height - 1, row - by * up)),
      Math.max(0, Math.min(width - 1, column - by * left)),
    ];
    this.redraw();
    return true;
  }
}
