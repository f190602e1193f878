/* The picture of a 3-D workspace: what is known of it as a cloud of cells that turns, and one
 * slice.  Known-free cells, frontier and particles are drawn as squares into one image with a
 * depth for each pixel; unknown cells and obstacles would hide all others. It has the face of
 * picture.js, so that the same player plays it. */
"use strict";

const ShoalPicture = (() => {
  const ELEVATION = 0.35,
    AZIMUTH = 0.6; // radians from which it is seen at first
  const FARTHEST = 0.45; // brightness of what is farthest away
  const THROUGH = 0.45; // how much of a hidden particle is seen through the wall of its vessel
  const TURN = 0.008; // radians a pixel of drag
  const CLOSEST = 12; // times that one may zoom in
  const MOST_OF_STAGE = 0.86; // of its height, for the slice and what belongs to it
  const { FRONTIER, FREE } = ShoalSim;

  const cssColour = ([r, g, b], alpha = 1) => `rgb(${r} ${g} ${b} / ${alpha})`;
  const clamp = (x, low, high) => Math.max(low, Math.min(high, x));

  class Picture {
    constructor(canvas, timeline) {
      this.canvas = canvas;
      this.pen = canvas.getContext("2d");
      this.timeline = timeline;
      this.world = timeline.world;
      this.turns = true; // a drag turns it whether it is zoomed or not
      this.size = 1; // particles are not slid
      this.findCells();
      this.cutAxis = 0;
      this.cutPlace = this.fullest();
      this.fit();
      this.listen();
    }

    /** The cells that may ever be drawn: free ones and obstacles beside them (these may be
     *  frontier cells). */
    findCells() {
      const { wall, steps, rows, cols, spacing } = this.world,
        layer = rows * cols,
        near = [];
      for (let cell = layer; cell < wall.length - layer; cell++) {
        if (!wall[cell] || steps.some((step) => !wall[cell + step])) near.push(cell);
      }
      this.cells = Int32Array.from(near);
      // across, down, into the picture, from the middle
      this.place = new Float32Array(3 * near.length);
      const sides = spacing ?? [1, 1, 1],
        least = Math.min(...sides);
      this.sides = sides.map((side) => side / least);
      const [dz, dy, dx] = this.sides;
      near.forEach((cell, i) => {
        const z = Math.floor(cell / layer),
          y = Math.floor((cell - z * layer) / cols),
          x = cell % cols;
        this.place.set([x * dx, y * dy, z * dz], 3 * i);
      });
      this.depth = wall.length / layer;
      this.centre();
    }

    /** Put the middle of what is drawn where it is turned about, and find how much room it takes
     *  from whichever side it is seen. */
    centre() {
      const { place } = this,
        cell = Math.max(...this.sides),
        low = [Infinity, Infinity, Infinity],
        high = low.map((x) => -x);
      place.forEach((x, i) => {
        low[i % 3] = Math.min(low[i % 3], x);
        high[i % 3] = Math.max(high[i % 3], x);
      });
      let wide = 0,
        top = 0,
        bottom = 0;
      const rise = Math.cos(ELEVATION),
        tip = Math.sin(ELEVATION);
      for (let i = 0; i < place.length; i += 3) {
        for (let k = 0; k < 3; k++) place[i + k] -= (low[k] + high[k]) / 2;
        const away = Math.hypot(place[i], place[i + 2]),
          down = place[i + 1] * rise;
        wide = Math.max(wide, 2 * away);
        top = Math.min(top, down - away * tip);
        bottom = Math.max(bottom, down + away * tip);
      }
      this.extent = {
        wide: wide + cell,
        tall: bottom - top + cell,
        middle: (top + bottom) / 2,
        cell,
      };
    }

    /** The part of the canvas that the cloud is fitted into: left of the slice, or below it,
     *  where it gets larger. */
    room() {
      const { width, height } = this.canvas,
        { wide, tall } = this.extent,
        panel = this.panel ?? [0, 0];
      const scale = ([, , w, h]) => Math.min(w / wide, h / tall);
      const rooms = [
        [0, 0, width - panel[0], height],
        [0, panel[1], width, height - panel[1]],
      ];
      const [left, top, w, h] = scale(rooms[0]) >= scale(rooms[1]) ? rooms[0] : rooms[1];
      return { x: left + w / 2, y: top + h / 2, scale: 0.96 * scale([0, 0, w, h]) };
    }

    /** The slice with most free cells along the axis of the cut. */
    fullest() {
      const counts = new Int32Array(this.cutLength());
      this.world.wall.forEach((wall, cell) => {
        if (!wall) counts[this.along(cell)]++;
      });
      return counts.indexOf(Math.max(...counts));
    }

    cutLength() {
      return [this.depth, this.world.rows, this.world.cols][this.cutAxis];
    }

    along(cell) {
      const { rows, cols } = this.world,
        z = Math.floor(cell / (rows * cols));
      return [z, Math.floor(cell / cols) - z * rows, cell % cols][this.cutAxis];
    }

    listen() {
      const $ = (id) => document.getElementById(id);
      this.slice = $("slice");
      const show = () => {
        $("cut").max = this.cutLength() - 1;
        $("cut").value = this.cutPlace;
        $("cutAt").textContent = String(this.cutPlace - 1); // the rim has -1
        this.fitSlice();
        if (this.packed) this.drawSlice();
      };
      $("axis").addEventListener("change", () => {
        this.cutAxis = Number($("axis").value);
        this.cutPlace = this.fullest();
        show();
        if (this.packed && this.shown) this.drawCloud(...this.shown); // the panel has another size
      });
      $("cut").addEventListener("input", () => {
        this.cutPlace = Number($("cut").value);
        show();
      });
      show();
    }

    setPalette(palette) {
      this.palette = palette;
      // by look; the last is that of a particle
      this.shades = [...this.timeline.shades(palette), palette.particle];
      this.packed = this.shades.map(([r, g, b]) => ((255 << 24) | (b << 16) | (g << 8) | r) >>> 0);
    }

    resize() {
      this.pixels = this.pen.createImageData(this.canvas.width, this.canvas.height);
      this.near = new Float32Array(this.canvas.width * this.canvas.height);
      this.fitSlice();
    }

    /** Give the slice the size that its panel has room for, cells in their true shape; note what
     *  the panel takes of the canvas. */
    fitSlice() {
      const { slice, canvas, ratio } = this,
        panel = slice.parentElement;
      if (!ratio) return;
      const [dz, dy, dx] = this.sides,
        { rows, cols } = this.world,
        stage = canvas.getBoundingClientRect();
      const [tall, wide] = [
        [rows * dy, cols * dx],
        [this.depth * dz, cols * dx],
        [rows * dy, this.depth * dz],
      ][this.cutAxis];
      slice.style.width = slice.style.height = "0";
      const most = MOST_OF_STAGE * stage.height - panel.offsetHeight,
        inner = panel.clientWidth - 2 * parseFloat(getComputedStyle(panel).paddingLeft);
      const scale = Math.min(inner / wide, most / tall);
      slice.style.width = `${scale * wide}px`;
      slice.style.height = `${scale * tall}px`;
      const box = panel.getBoundingClientRect();
      this.panel = [(stage.right - box.left) * ratio, (box.bottom - stage.top) * ratio];
    }

    fit() {
      this.zoom = 1;
      this.azimuth = AZIMUTH;
      this.elevation = ELEVATION;
      this.changed = false;
    }

    zoomAt(factor) {
      this.zoom = clamp(this.zoom * factor, 0.5, CLOSEST);
      this.changed = true;
    }

    /** Turn: a drag to the right brings the left side to the front. */
    panBy(x, y) {
      this.azimuth -= x * TURN;
      this.elevation = clamp(this.elevation + y * TURN, -Math.PI / 2, Math.PI / 2);
      this.changed = true;
    }

    draw(n, swarm) {
      this.shown = [n, swarm];
      this.drawCloud(n, swarm);
      this.drawSlice();
    }

    /** Device pixels a millimetre, where the size of a cell is known. */
    get density() {
      return (this.room().scale * this.zoom) / Math.min(...this.world.spacing);
    }

    /** Let particles shine through the walls before them. */
    shine(words, particles, size) {
      const { near } = this,
        { width } = this.canvas,
        [r, g, b] = this.palette.particle;
      const mix = (word, shift, part) =>
        ((THROUGH * part + (1 - THROUGH) * ((word >>> shift) & 255)) << shift) >>> 0;
      for (const [left, top, depth] of particles) {
        for (let py = top; py < top + size; py++) {
          for (let at = py * width + left, end = at + size; at < end; at++) {
            if (near[at] === -Infinity || near[at] >= depth - 1e-3) continue;
            words[at] =
              ((255 << 24) |
                mix(words[at], 0, r) |
                mix(words[at], 8, g) |
                mix(words[at], 16, b)) >>>
              0;
            near[at] = -Infinity; // one hidden particle a pixel is enough
          }
        }
      }
    }

    drawCloud(n, swarm) {
      const { width, height } = this.canvas,
        { place, cells, near, timeline } = this;
      const words = new Uint32Array(this.pixels.data.buffer);
      words.fill(0);
      near.fill(Infinity);
      const { wide, tall, middle, cell: side } = this.extent,
        room = this.room();
      const scale = room.scale * this.zoom,
        across = room.x,
        down = room.y - scale * middle;
      const size = Math.max(1, Math.ceil(scale * side)),
        half = size / 2;
      const [ca, sa, ce, se] = [
        Math.cos(this.azimuth),
        Math.sin(this.azimuth),
        Math.cos(this.elevation),
        Math.sin(this.elevation),
      ];
      const reach = wide / 2 + tall / 2,
        hidden = [];
      for (let i = 0; i < cells.length; i++) {
        const cell = cells[i];
        const held = swarm.count[cell] > 0,
          state = held ? FREE : timeline.state(cell, n);
        if (state !== FREE && state !== FRONTIER) continue;
        const x = place[3 * i],
          y = place[3 * i + 1],
          z = place[3 * i + 2];
        const away = z * ca - x * sa,
          depth = away * ce + y * se;
        const left = Math.floor(across + scale * (x * ca + z * sa) - half);
        const top = Math.floor(down + scale * (y * ce - away * se) - half);
        if (left < 0 || top < 0 || left + size > width || top + size > height) continue;
        const [r, g, b] = held ? this.palette.particle : this.shades[timeline.shadeOf(cell, n)];
        const shade = clamp(FARTHEST + (1 - FARTHEST) * (0.5 - depth / (1.2 * reach)), FARTHEST, 1);
        const word = ((255 << 24) | ((b * shade) << 16) | ((g * shade) << 8) | (r * shade)) >>> 0;
        if (held) hidden.push([left, top, depth]);
        for (let py = top; py < top + size; py++) {
          for (let at = py * width + left, end = at + size; at < end; at++) {
            if (depth < near[at]) {
              near[at] = depth;
              words[at] = word;
            }
          }
        }
      }
      this.shine(words, hidden, size);
      this.pen.putImageData(this.pixels, 0, 0);
    }

    drawSlice() {
      if (!this.shown) return;
      const [n, swarm] = this.shown,
        { rows, cols } = this.world,
        layer = rows * cols,
        at = this.cutPlace;
      const [height, width, cellAt] = [
        [rows, cols, (y, x) => at * layer + y * cols + x],
        // what is in front is below
        [this.depth, cols, (y, x) => (this.depth - 1 - y) * layer + at * cols + x],
        [rows, this.depth, (y, x) => x * layer + y * cols + at],
      ][this.cutAxis];
      this.slice.width = width;
      this.slice.height = height;
      const pen = this.slice.getContext("2d"),
        pixels = pen.createImageData(width, height);
      const words = new Uint32Array(pixels.data.buffer);
      for (let y = 0; y < height; y++) {
        for (let x = 0; x < width; x++) {
          const cell = cellAt(y, x);
          words[y * width + x] = swarm.count[cell]
            ? this.packed.at(-1)
            : this.packed[this.timeline.shadeOf(cell, n)];
        }
      }
      pen.putImageData(pixels, 0, 0);
    }
  }

  return { Picture, cssColour };
})();
