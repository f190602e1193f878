/* The picture: the grid at one move, on a canvas that fills its stage.
 *
 * Cells are written as single pixels of a small image, which is then scaled without smoothing;
 * particles are drawn over it. All lengths below are device pixels unless a name says otherwise. */
"use strict";

const ShoalPicture = (() => {
  const EXTREME = 12; // maps longer than this many times their width are wrapped like text
  const GAP = 2; // cells between the lines of a wrapped map, or more if there is room
  // particles beyond which they are pixels of the image: to draw each by itself takes too long
  const MANY = 5000;
  const DISC_FROM = 6; // the cell size from which particles are discs
  const GRID_FROM = 18; // ... and from which cells get hairlines between them, CSS pixels
  const CLOSEST = 64; // the largest cell when zoomed in, CSS pixels,
  const AT_LEAST = 4; // ... unless that would not allow to zoom so many times
  // how much of the photograph shows through free cells, of what shows through others
  const THROUGH_OPEN = 0.25;
  const CASING = "#000"; // of the frontier over a photograph
  const SNAP_LOSS = 0.9; // whole-pixel cells are used if the picture keeps this share of its size

  /** How a map of rows × cols is laid out in an area: in `lines` of `length` cells, stacked
   *  across. */
  function wrap(rows, cols, width, height) {
    const wide = cols > EXTREME * rows,
      tall = rows > EXTREME * cols;
    const long = tall ? rows : cols,
      across = tall ? cols : rows;
    const [along, stack] = tall ? [height, width] : [width, height];
    let best = { lines: 1, length: long, gap: 0, size: Math.min(along / long, stack / across) };
    for (let lines = 2; (wide || tall) && lines <= long; lines++) {
      const length = Math.ceil(long / lines);
      const size = Math.min(along / length, stack / (lines * (across + GAP) - GAP));
      if (size < best.size) break; // lines only get narrower from here
      best = fillLines(size, long, across, along, stack);
    }
    const span = best.lines * (across + best.gap) - best.gap;
    return {
      ...best,
      tall,
      across,
      width: tall ? span : best.length,
      height: tall ? best.length : span,
    };
  }

  /** Lines of cells of a given size: whole pixels, as long as they can be, and spread over the
   *  stack. */
  function fillLines(size, long, across, along, stack) {
    if (size >= 3) size = Math.floor(size);
    const length = Math.min(long, Math.floor(along / size + 1e-9)),
      lines = Math.ceil(long / length);
    const room = (stack / size - lines * across) / Math.max(1, lines - 1);
    return { lines, length, size, gap: clamp(Math.floor(room), GAP, GAP + across) };
  }

  const packColour = ([r, g, b], alpha = 1) =>
    ((Math.round(255 * alpha) << 24) | (b << 16) | (g << 8) | r) >>> 0;
  const cssColour = ([r, g, b], alpha = 1) => `rgb(${r} ${g} ${b} / ${alpha})`;
  const clamp = (x, low, high) => Math.max(low, Math.min(high, x));

  /** The median colour of what is used of a photograph, [r, g, b]. */
  function medianOf({ image, box: [left, top, right, bottom] }) {
    const [width, height] = [
        image.naturalWidth ?? image.width,
        image.naturalHeight ?? image.height,
      ],
      side = 16,
      canvas = document.createElement("canvas");
    canvas.width = canvas.height = side;
    const pen = canvas.getContext("2d"),
      [x, y] = [left * width, top * height];
    pen.drawImage(image, x, y, right * width - x, bottom * height - y, 0, 0, side, side);
    const { data } = pen.getImageData(0, 0, side, side);
    return [0, 1, 2].map(
      (k) => data.filter((_, i) => i % 4 === k).sort()[(side * side) >> 1], // a typed array: by size
    );
  }

  class Picture {
    constructor(canvas, timeline) {
      this.canvas = canvas;
      this.pen = canvas.getContext("2d");
      this.timeline = timeline;
      this.world = timeline.world;
      this.image = document.createElement("canvas");
      // the last frame that drew a particle here
      this.stamp = new Uint32Array(this.world.wall.length);
      this.frame = 0;
      this.zoom = 1;
      this.view = null; // what is looked at, whatever the size of the canvas: see lookAt
      this.painted = -1; // the move that the image shows
      this.rim = []; // sides of frontier cells to the photograph: column, row and side of each
      this.casing = null; // colour around particles
    }

    /** Colours as [r, g, b]: unknown, frontier, free, obstacle, particle, shared, wrong, label. */
    setPalette(palette) {
      this.palette = palette;
      this.discs = new Map();
      this.setBelow(this.below);
    }

    /** Show a photograph under the map, or none (null): `box` is where the map is in it, in
     *  shares of its sides, and `share` how much of it shows through what is not open to
     *  particles. */
    setBelow(below) {
      const through = below && this.layout?.lines === 1 ? below.share : 0,
        { unknown, obstacle, frontier } = this.palette,
        shades = this.timeline.shades(this.palette);
      // of each shade: whether the photograph is clear through it
      this.clear = shades.map((shade) => shade === unknown || shade === obstacle);
      const share = (shade, i) =>
        shade === frontier ? 0 : this.clear[i] ? through : THROUGH_OPEN * through;
      if (below?.image !== this.below?.image || String(below?.box) !== String(this.below?.box))
        this.median = below && medianOf(below);
      this.below = below;
      this.packed = shades.map((shade, i) => packColour(shade, 1 - share(shade, i)));
      this.frontierShade = shades.indexOf(frontier);
      this.painted = -1;
      /** A colour of the palette as it looks here: over a photograph, over its median colour. */
      this.seen = (name) => {
        const colour = this.palette[name],
          part = through && share(colour, shades.indexOf(colour));
        return part ? colour.map((x, i) => Math.round(x + part * (this.median[i] - x))) : colour;
      };
    }

    /** `rem` is the page's text size in CSS pixels. */
    resize(rem, cssWidth) {
      const { canvas, world } = this;
      this.margin = Math.round(6 * this.ratio);
      this.gutter =
        world.cols > EXTREME * world.rows && cssWidth >= 480 ? Math.round(40 * this.unit) : 0;
      const width = canvas.width - 2 * this.margin - this.gutter,
        height = canvas.height - 2 * this.margin;
      this.layOut(wrap(world.rows, world.cols, width, height));
      this.fitSize = this.snap(this.layout.size, SNAP_LOSS);
      this.lookAt(this.view);
    }

    /** Where each cell goes in the image. */
    layOut(layout) {
      const { cols, wall } = this.world;
      this.layout = layout;
      this.x = new Int32Array(wall.length);
      this.y = new Int32Array(wall.length);
      for (let cell = 0; cell < wall.length; cell++) {
        const row = Math.floor(cell / cols),
          col = cell - row * cols;
        const line = Math.floor((layout.tall ? row : col) / layout.length);
        const shift = line * (layout.across + layout.gap);
        this.x[cell] = layout.tall ? col + shift : col - line * layout.length;
        this.y[cell] = layout.tall ? row - line * layout.length : row + shift;
      }
      this.image.width = layout.width;
      this.image.height = layout.height;
      this.imagePen = this.image.getContext("2d");
      this.pixels = this.imagePen.createImageData(layout.width, layout.height);
      this.painted = -1;
    }

    /** Whole device pixels make cells of equal size, worth a little smaller picture but not a
     *  lot. */
    snap(size, keep) {
      const whole = Math.floor(size);
      return whole >= 3 && whole >= keep * size ? whole : size;
    }

    // ---- the view: cell size and the place of the image's corner --------------------------------

    fit() {
      this.view = null;
      this.zoom = 1;
      this.size = this.fitSize;
      this.centreX = this.layout.width / 2;
      this.centreY = this.layout.height / 2;
      this.place();
    }

    /** Scale by a factor, keeping what is under the given point (CSS pixels) where it is. */
    zoomAt(factor, cssX, cssY) {
      const largest = Math.max(AT_LEAST, (CLOSEST * this.ratio) / this.fitSize);
      const x = cssX * this.ratio,
        y = cssY * this.ratio;
      const columnThere = (x - this.left) / this.size,
        rowThere = (y - this.top) / this.size;
      this.zoom = clamp(this.zoom * factor, 1, largest);
      if (this.zoom === 1) return this.fit();
      this.size = this.snap(this.fitSize * this.zoom, 0);
      this.centreX = columnThere + (this.canvas.width / 2 - x) / this.size;
      this.centreY = rowThere + (this.canvas.height / 2 - y) / this.size;
      this.place();
      return this.note();
    }

    panBy(cssX, cssY) {
      this.centreX -= (cssX * this.ratio) / this.size;
      this.centreY -= (cssY * this.ratio) / this.size;
      this.place();
      this.note();
    }

    /** Note what is looked at: what of the map is in the middle, and how many of its widths are
     *  seen. */
    note() {
      const {
        world: { rows, cols },
        centreX,
        centreY,
        canvas,
        size,
      } = this;
      this.view =
        this.zoom === 1
          ? null
          : {
              x: (centreX - 1) / (cols - 2),
              y: (centreY - 1) / (rows - 2),
              wide: canvas.width / size / (cols - 2),
            };
    }

    /** Look at what another picture of the map looks at; null: at all of it. */
    lookAt(view) {
      if (!this.layout) {
        // not on the page yet
        this.view = view;
        return;
      }
      this.fit();
      this.view = view;
      const {
          world: { rows, cols },
          canvas,
        } = this,
        size = view && canvas.width / (view.wide * (cols - 2));
      if (!view || this.layout.lines > 1 || size <= this.fitSize) return;
      this.zoom = size / this.fitSize;
      this.size = size;
      this.centreX = 1 + view.x * (cols - 2);
      this.centreY = 1 + view.y * (rows - 2);
      this.place();
    }

    /** Set the corner from the centre, without letting the picture leave the stage. */
    place() {
      const { canvas, size, layout, margin, gutter } = this;
      const inset = this.zoom === 1 ? gutter : 0;
      const axis = (centre, room, extent) => {
        const corner = room / 2 - centre * size,
          slack = room - extent * size;
        return Math.round(slack >= 0 ? slack / 2 : clamp(corner, slack - margin, margin));
      };
      this.left = inset + axis(this.centreX, canvas.width - inset, layout.width);
      this.top = axis(this.centreY, canvas.height, layout.height);
      this.centreX = (canvas.width / 2 - this.left) / size;
      this.centreY = (canvas.height / 2 - this.top) / size;
    }

    // ---- drawing --------------------------------------------------------------------------------

    /** Device pixels a millimetre, where the size of a cell is known. */
    get density() {
      return this.size / this.world.spacing[1];
    }

    /** Draw move n; `slide` below 1 shows the particles on their way there. */
    draw(n, swarm, slide = 1) {
      const { pen, canvas, layout, size } = this;
      const many = swarm.pos.length > MANY;
      if (this.painted !== n) this.paint(n, many ? swarm : null);
      pen.clearRect(0, 0, canvas.width, canvas.height);
      pen.imageSmoothingEnabled = size < 1; // else thin walls would drop out
      const below = layout.lines === 1 ? this.below : null;
      if (below) this.drawBelow(below);
      pen.drawImage(this.image, this.left, this.top, layout.width * size, layout.height * size);
      if (below) this.drawCasing();
      if (size >= GRID_FROM * this.ratio) this.drawGrid();
      if (this.gutter && this.zoom === 1) this.drawLabels();
      const points = this.timeline.pointsAt?.(n);
      if (points && this.layout.lines === 1) this.drawPoints(points);
      else if (!many) this.drawParticles(swarm, slide);
    }

    /** The row and column of the map at a place in the canvas, in device pixels; null beside the
     *  map. */
    cellAt(x, y) {
      const [col, row] = [(x - this.left) / this.size, (y - this.top) / this.size].map(Math.floor);
      const cell =
        this.layout.lines === 1
          ? col >= 0 && col < this.world.cols && row >= 0
            ? row * this.world.cols + col
            : -1
          : this.x.findIndex((left, k) => left === col && this.y[k] === row);
      // without the rim
      const found = [Math.floor(cell / this.world.cols) - 1, (cell % this.world.cols) - 1];
      const inside =
        cell >= 0 &&
        found.every((at, axis) => at >= 0 && at < [this.world.rows, this.world.cols][axis] - 2);
      return inside ? found : null;
    }

    /** Draw the photograph under the map, which has a rim of one cell. */
    drawBelow({ image, box: [left, top, right, bottom] }) {
      const { pen, world, size } = this;
      const wide = ((world.cols - 2) * size) / (right - left),
        high = ((world.rows - 2) * size) / (bottom - top);
      pen.save();
      pen.beginPath();
      pen.rect(this.left + size, this.top + size, (world.cols - 2) * size, (world.rows - 2) * size);
      pen.clip();
      pen.imageSmoothingEnabled = true;
      pen.drawImage(
        image,
        this.left + size - left * wide,
        this.top + size - top * high,
        wide,
        high,
      );
      pen.restore();
    }

    /** A dark line between the frontier and the photograph: from what is dark, the frontier stands
     *  out by its colour, from what is light, by the line. */
    drawCasing() {
      const { pen, size, left, top, rim } = this,
        thick = Math.max(1, Math.round(this.ratio));
      const at = (x, y) => [Math.round(left + x * size), Math.round(top + y * size)];
      pen.fillStyle = CASING;
      for (let i = 0; i < rim.length; i += 3) {
        const [x, y] = at(rim[i], rim[i + 1]),
          [right, bottom] = at(rim[i] + 1, rim[i + 1] + 1);
        const side = rim[i + 2]; // of a frontier cell: the line lies outside
        if (side === 0) pen.fillRect(x - thick, y - thick, thick, bottom - y + 2 * thick);
        else if (side === 1) pen.fillRect(right, y - thick, thick, bottom - y + 2 * thick);
        else if (side === 2) pen.fillRect(x, y - thick, right - x, thick);
        else pen.fillRect(x, bottom, right - x, thick);
      }
    }

    /** Draw particles where they truly were, wherever in a cell. */
    drawPoints(points) {
      const disc = this.size >= DISC_FROM ? this.disc(false) : null;
      for (let i = 0; i < points.length; i += 2) {
        const [row, column] = [points[i] + 1, points[i + 1] + 1]; // with the rim
        if (disc) this.stampDisc(disc, column, row);
        else this.fillCell(column, row);
      }
    }

    /** Write the image; with a swarm its particles, too. */
    paint(n, swarm = null) {
      const words = new Uint32Array(this.pixels.data.buffer),
        { timeline, packed, layout, x, y } = this;
      for (let cell = 0; cell < x.length; cell++) {
        words[y[cell] * layout.width + x[cell]] = packed[timeline.shadeOf(cell, n)];
      }
      this.rim = [];
      if (this.below) {
        const { cols } = this.world;
        for (let cell = 0; cell < x.length; cell++) {
          if (timeline.shadeOf(cell, n) !== this.frontierShade) continue;
          [cell - 1, cell + 1, cell - cols, cell + cols].forEach((next, side) => {
            if (this.clear[timeline.shadeOf(next, n)]) this.rim.push(x[cell], y[cell], side);
          });
        }
      }
      if (swarm) {
        const [alone, shared] = [this.palette.particle, this.palette.shared].map((colour) =>
            packColour(colour),
          ),
          merged = this.world.rule === "merge";
        for (const cell of swarm.pos)
          words[y[cell] * layout.width + x[cell]] =
            merged && swarm.count[cell] > 1 ? shared : alone;
      }
      this.imagePen.putImageData(this.pixels, 0, 0);
      this.painted = n;
    }

    drawGrid() {
      const { pen, layout, size, left, top, canvas } = this;
      if (layout.lines > 1) return; // lines across the gaps would only confuse
      const width = Math.max(1, Math.floor(this.ratio));
      pen.fillStyle = cssColour(this.palette.obstacle, 0.1);
      for (let col = 1; col < layout.width; col++) {
        const x = Math.round(left + col * size);
        if (x >= 0 && x < canvas.width) pen.fillRect(x, top, width, layout.height * size);
      }
      for (let row = 1; row < layout.height; row++) {
        const y = Math.round(top + row * size);
        if (y >= 0 && y < canvas.height) pen.fillRect(left, y, layout.width * size, width);
      }
    }

    /** The first column of each line of a wrapped map, like line numbers. */
    drawLabels() {
      const { pen, layout, size, left, top, unit } = this;
      const pitch = (layout.across + layout.gap) * size,
        font = Math.min(11 * unit, 0.8 * pitch);
      const skip = Math.ceil((9 * unit) / pitch); // too tight: label every second, third, ... line
      pen.font = `${Math.max(font, 9 * unit)}px system-ui, sans-serif`;
      pen.fillStyle = cssColour(this.palette.label);
      pen.textAlign = "right";
      pen.textBaseline = "middle";
      for (let line = 0; line < layout.lines; line += skip) {
        const y = top + line * pitch + (layout.across * size) / 2;
        pen.fillText(String(Math.max(0, line * layout.length - 1)), left - 6 * unit, y);
      }
    }

    drawParticles(swarm, slide) {
      const { stamp, x, y, size } = this,
        merged = this.world.rule === "merge";
      const disc = size >= DISC_FROM ? [this.disc(false), this.disc(true)] : null;
      this.frame++;
      swarm.pos.forEach((cell, i) => {
        if (merged && slide === 1) {
          if (stamp[cell] === this.frame) return;
          stamp[cell] = this.frame;
        }
        const from = swarm.before[i],
          shared = merged && swarm.count[cell] > 1;
        let column = x[cell],
          row = y[cell];
        if (slide < 1 && this.sameLine(from, cell)) {
          column -= (1 - slide) * (column - x[from]);
          row -= (1 - slide) * (row - y[from]);
        }
        if (disc) this.stampDisc(disc[+shared], column, row);
        else this.fillCell(column, row);
      });
    }

    /** Wrapping breaks a straight slide where a line ends. */
    sameLine(from, to) {
      return this.x[from] === this.x[to]
        ? Math.abs(from - to) % this.world.cols === 0
        : this.y[from] === this.y[to];
    }

    stampDisc(disc, column, row) {
      const corner = (this.size - disc.width) / 2;
      const x = Math.round(this.left + column * this.size + corner);
      const y = Math.round(this.top + row * this.size + corner);
      if (x > this.canvas.width || y > this.canvas.height || x < -disc.width || y < -disc.width)
        return;
      this.pen.drawImage(disc, x, y);
    }

    /** A cell too small for a disc; never less than a visible speck. */
    fillCell(column, row) {
      const speck = Math.max(1, Math.round(1.5 * this.ratio));
      const x = Math.round(this.left + column * this.size),
        y = Math.round(this.top + row * this.size);
      const width = Math.max(speck, Math.round(this.left + (column + 1) * this.size) - x);
      const height = Math.max(speck, Math.round(this.top + (row + 1) * this.size) - y);
      if (this.casing) {
        const thick = Math.max(1, Math.round(this.ratio));
        this.pen.fillStyle = cssColour(this.casing);
        this.pen.fillRect(x - thick, y - thick, width + 2 * thick, height + 2 * thick);
      }
      this.pen.fillStyle = cssColour(this.palette.particle);
      this.pen.fillRect(x, y, width, height);
    }

    /** A ready-made disc of the present cell size; one that stands for several particles has a
     *  dark core. */
    disc(shared) {
      const across = Math.max(4, Math.round(this.size)),
        key = across * 2 + shared;
      if (!this.discs.has(key)) {
        const canvas = document.createElement("canvas"),
          pen = canvas.getContext("2d");
        canvas.width = canvas.height = across;
        const circle = (radius, colour) => {
          pen.fillStyle = cssColour(colour);
          pen.beginPath();
          pen.arc(across / 2, across / 2, radius, 0, 2 * Math.PI);
          pen.fill();
        };
        const radius = across * (across < 12 ? 0.46 : 0.4);
        if (this.casing) circle(across / 2, this.casing);
        circle(
          this.casing ? across / 2 - Math.max(1.5, across / 8) : radius,
          this.palette.particle,
        );
        if (shared) circle(across * 0.17, this.palette.shared);
        this.discs.set(key, canvas);
      }
      return this.discs.get(key);
    }
  }

  return { Picture, wrap, cssColour };
})();
