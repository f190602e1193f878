/* The map on a canvas: looked at, painted and erased cell by cell; and the photograph with what was found on it. */
import { el, symbol } from "../../shared/page.js";

export const LOOK = "look", FREE = "free", WALL = "wall", INLET = "inlet";

export function unpack(text, cells) {
  const bytes = Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0)), free = new Uint8Array(cells);
  for (let i = 0; i < cells; i++) free[i] = (bytes[i >> 3] >> (7 - (i & 7))) & 1;
  return free;
}

export function pack(free) {
  const bytes = new Uint8Array(Math.ceil(free.length / 8));
  free.forEach((bit, i) => { if (bit) bytes[i >> 3] |= 128 >> (i & 7); });
  let text = "";
  for (let i = 0; i < bytes.length; i += 8192) text += String.fromCharCode(...bytes.subarray(i, i + 8192));
  return btoa(text);
}

/** Numbers of cells as the player takes them. */
export function packedCells(cells) {
  const bytes = new Uint8Array(new Uint32Array(cells).buffer);
  return btoa(Array.from(bytes, (byte) => String.fromCharCode(byte)).join(""));
}

const colourOf = (name) => getComputedStyle(document.documentElement).getPropertyValue(`--${name}`).trim();
const rgb = (hex) => [1, 3, 5].map((i) => parseInt(hex.slice(i, i + 2), 16));

export class Editor {
  /** `edited(what)` is called after each stroke: "map", "inlet", or null if it changed nothing. */
  constructor(edited) {
    this.edited = edited;
    this.canvas = el("canvas", { tabIndex: 0, role: "img", "aria-label": "The map. Arrow keys move a cursor, Space paints." });
    this.pen = this.canvas.getContext("2d");
    this.image = document.createElement("canvas");
    this.overlay = null;
    this.photograph = null;
    this.map = null; // { shape, free, start }
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
    this.map = map;
    this.photograph = null;
    if (!same) this.fit();
    this.paint();
    this.redraw();
  }

  setPhotograph(image, mask) {
    const same = this.photograph && this.photograph.naturalWidth === image.naturalWidth && this.photograph.naturalHeight === image.naturalHeight;
    this.photograph = image;
    this.overlay = mask ? this.tinted(mask) : null;
    if (!same) this.fit();
    this.redraw();
  }

  tinted(mask) {
    const made = document.createElement("canvas"), pen = made.getContext("2d");
    made.width = mask.naturalWidth;
    made.height = mask.naturalHeight;
    pen.drawImage(mask, 0, 0);
    pen.globalCompositeOperation = "source-in";
    pen.fillStyle = "#40ff60";
    pen.fillRect(0, 0, made.width, made.height);
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
    const [rows, columns] = this.size, margin = 16 * (this.ratio || 1);
    this.zoom = 1;
    this.scale = Math.max(0.01, Math.min((this.canvas.width - 2 * margin) / columns, (this.canvas.height - 2 * margin) / rows));
    this.left = (this.canvas.width - columns * this.scale) / 2;
    this.top = (this.canvas.height - rows * this.scale) / 2;
    this.redraw();
  }

  zoomAt(factor, x, y) {
    const zoom = Math.max(1, Math.min(80, this.zoom * factor)), by = zoom / this.zoom;
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
    const [rows, columns] = this.map.shape, pen = this.image.getContext("2d");
    this.image.width = columns;
    this.image.height = rows;
    const pixels = pen.createImageData(columns, rows), words = new Uint32Array(pixels.data.buffer);
    const packed = ([r, g, b]) => ((255 << 24) | (b << 16) | (g << 8) | r) >>> 0;
    const free = packed(rgb(colourOf("free"))), wall = packed(rgb(colourOf("obstacle"))), inlet = packed(rgb(colourOf("frontier")));
    this.map.free.forEach((bit, i) => { words[i] = bit ? free : wall; });
    this.inlet.forEach((cell) => { words[cell] = inlet; });
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
    const { pen, canvas, scale, left, top } = this, [rows, columns] = this.size;
    pen.clearRect(0, 0, canvas.width, canvas.height);
    if (this.photograph) {
      pen.imageSmoothingEnabled = true;
      pen.drawImage(this.photograph, left, top, columns * scale, rows * scale);
      if (this.overlay) {
        pen.globalAlpha = 0.55;
        pen.drawImage(this.overlay, left, top, columns * scale, rows * scale);
        pen.globalAlpha = 1;
      }
      return;
    }
    if (!this.map) return;
    pen.imageSmoothingEnabled = scale < 1;
    pen.drawImage(this.image, left, top, columns * scale, rows * scale);
    pen.fillStyle = colourOf("particle");
    const dot = Math.max(1.5 * this.ratio, scale * 0.8);
    for (const cell of this.map.start ?? []) {
      const row = Math.floor(cell / columns), column = cell % columns;
      const x = left + (column + 0.5) * scale, y = top + (row + 0.5) * scale;
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
      pen.strokeRect(left + (this.cursor[1] - half) * scale, top + (this.cursor[0] - half) * scale, this.brush * scale, this.brush * scale);
    }
  }

  // ---- painting ----

  /** Set a rectangle of cells. */
  set(tool, row, column, rows, columns) {
    const [height, width] = this.map.shape, value = tool === FREE ? 1 : 0;
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
    if (!this.map) return;
    this.tool = tool;
    this.beginStroke();
    this.set(tool, row, column, rows, columns);
    this.endStroke();
  }

  // ---- hands ----

  cellAt(event) {
    const box = this.canvas.getBoundingClientRect();
    const x = (event.clientX - box.left) * this.ratio, y = (event.clientY - box.top) * this.ratio;
    return { x, y, row: Math.floor((y - this.top) / this.scale), column: Math.floor((x - this.left) / this.scale) };
  }

  stamp(row, column) {
    const half = Math.floor((this.brush - 1) / 2);
    this.set(this.tool, row - half, column - half, this.brush, this.brush);
  }

  listen() {
    const { canvas } = this;
    let last = null;
    canvas.addEventListener("pointerdown", (event) => {
      if (event.button !== 0) return;
      canvas.setPointerCapture(event.pointerId);
      last = this.cellAt(event);
      if (this.tool === LOOK || this.photograph || !this.map) return;
      this.beginStroke();
      this.stamp(last.row, last.column);
      this.paint();
    });
    canvas.addEventListener("pointermove", (event) => {
      const here = this.cellAt(event);
      this.cursor = [here.row, here.column];
      if (canvas.hasPointerCapture(event.pointerId) && last) {
        if (this.stroke) {
          const steps = Math.max(1, Math.abs(here.row - last.row), Math.abs(here.column - last.column));
          for (let i = 1; i <= steps; i++) {
            this.stamp(Math.round(last.row + ((here.row - last.row) * i) / steps), Math.round(last.column + ((here.column - last.column) * i) / steps));
          }
          this.paint();
        } else if (this.zoom > 1) {
          this.left += here.x - last.x;
          this.top += here.y - last.y;
        }
        last = this.cellAt(event);
      }
      this.redraw();
    });
    const up = () => {
      last = null;
      this.endStroke();
    };
    canvas.addEventListener("pointerup", up);
    canvas.addEventListener("pointercancel", up);
    canvas.addEventListener("pointerleave", () => {
      this.cursor = null;
      this.redraw();
    });
    canvas.addEventListener("wheel", (event) => {
      event.preventDefault();
      const { x, y } = this.cellAt(event);
      this.zoomAt(Math.exp(-event.deltaY * (event.deltaMode === 1 ? 16 : 1) * 0.0015), x, y);
    }, { passive: false });
    canvas.addEventListener("keydown", (event) => this.key(event));
  }

  key(event) {
    const step = { ArrowUp: [-1, 0], ArrowDown: [1, 0], ArrowLeft: [0, -1], ArrowRight: [0, 1] }[event.key];
    if (!this.map || this.photograph || (!step && event.key !== " ")) return;
    event.preventDefault();
    const [height, width] = this.map.shape;
    this.cursor ??= [height >> 1, width >> 1];
    if (step) {
      const by = event.shiftKey ? 10 : 1;
      this.cursor = [Math.max(0, Math.min(height - 1, this.cursor[0] + by * step[0])), Math.max(0, Math.min(width - 1, this.cursor[1] + by * step[1]))];
      this.redraw();
    } else if (this.tool !== LOOK) {
      this.beginStroke();
      this.stamp(...this.cursor);
      this.endStroke();
    }
  }
}
