/* An episode with noise: it cannot be simulated again, so the page is told of each moment where
 * particles are and which cells look otherwise than before. It takes the place of what
 * simulate.js simulates, and has the same face. Nothing here touches the page. */
"use strict";

(() => {
  const { UNKNOWN, FRONTIER, FREE, OBSTACLE, DataError, reading } = ShoalSim;
  const KEYFRAME_BYTES = 16e6; // the memory that the looks of whole moments may take

  function readWorld(data) {
    const shape = reading.shape(data.shape),
      [rows, cols] = shape.slice(-2).map((side) => side + 2);
    const world = {
      shape,
      cols,
      rows,
      spacing: data.spacing ?? null,
      task: "mapping",
      rule: "block",
      targets: null,
      wall: reading.board(data, "free", shape).map((free) => 1 - free),
      commands: reading.commands(data, shape),
      steps: [-1, -cols, 1, cols, -rows * cols, rows * cols].slice(0, 2 * shape.length),
      noise: data.noise,
      truth: Boolean(data.truth),
      seen: Boolean(data.seen),
      looks: data.looks,
      goal: data.goal,
      moments: reading.bytes(data, "moments"),
      points: data.points ? readPoints(data, reading.commands(data, shape).length) : null,
    };
    const { unknown, free, frontier, wrong } = world.looks ?? {};
    if (![unknown, free, frontier, wrong, world.goal].every(Number.isInteger))
      throw new DataError("The field “looks” is damaged.");
    world.scanned = reading.scans(data, world.commands.length);
    world.start = new Timeline(world).places(0);
    return world;
  }

  /** Where particles truly were, of each moment: row, column, row, column, ... in cells. */
  function readPoints(data, moves) {
    const bytes = reading.bytes(data, "points"),
      view = new DataView(bytes.buffer, bytes.byteOffset, bytes.byteLength),
      moments = [];
    let at = 0;
    const next = () => {
      if (at + 4 > bytes.byteLength) throw new DataError("The field “points” breaks off.");
      at += 4;
      return view.getInt32(at - 4, true);
    };
    for (let n = 0; n <= moves; n++)
      moments.push(Float32Array.from({ length: 2 * next() }, () => next() / 100));
    return moments;
  }

  /** Whole numbers, seven bits a byte, the lowest first; the highest bit says that more follow. */
  class Numbers {
    constructor(bytes) {
      this.bytes = bytes;
      this.at = 0;
    }

    byte() {
      if (this.at >= this.bytes.length) throw new DataError("The field “moments” breaks off.");
      return this.bytes[this.at++];
    }

    next() {
      let number = 0;
      for (let shift = 0; shift < 32; shift += 7) {
        const byte = this.byte();
        number += (byte & 127) * 2 ** shift;
        if (byte < 128) break;
      }
      return number;
    }

    /** Call take(cell) for each of a list of cells, of which the differences are written. */
    cells(limit, take) {
      let cell = 0;
      for (let left = this.next(); left > 0; left--) {
        cell += this.next();
        if (cell >= limit) throw new DataError("The field “moments” names a cell outside the map.");
        take(cell);
      }
    }
  }

  /** Where particles are at the moment shown. They are not told apart, so none is slid from one
   *  cell to the next. */
  class Swarm {
    constructor(world) {
      this.world = world;
      this.count = new Uint8Array(world.wall.length);
      this.place(world.start);
    }

    place(cells) {
      for (const cell of this.pos ?? []) this.count[cell] = 0;
      this.pos = this.before = cells;
      for (const cell of cells) this.count[cell] = 1;
    }
  }

  class Timeline {
    constructor(world) {
      const cells = world.wall.length;
      this.world = world;
      this.length = this.done = world.commands.length;
      for (const name of ["frontier", "free", "obstacle", "wrong", "scans"])
        this[name] = new Int32Array(this.length + 1);
      this.goal = world.goal;
      this.every = Math.max(16, Math.ceil((this.length * cells) / KEYFRAME_BYTES));
      this.keyframes = [];
      this.moments = []; // of each: the bytes of its particles, and of its changes, begin there
      this.looks = new Uint8Array(cells).fill(world.looks.unknown); // at the moment `now`
      this.countAll();
      this.now = this.length;
    }

    /** Go through all moments once. */
    countAll() {
      const { world, looks } = this,
        numbers = new Numbers(world.moments),
        cells = looks.length;
      const counts = { frontier: 0, free: 0, obstacle: 0, wrong: 0 };
      const tally = (look, by) => {
        const state = this.stateOf(look);
        if (state !== UNKNOWN) counts[["", "frontier", "free", "obstacle"][state]] += by;
        if (look >= world.looks.wrong) counts.wrong += by;
      };
      for (let n = 0; n <= this.length; n++) {
        const places = numbers.at;
        numbers.cells(cells, () => {});
        this.moments.push([places, numbers.at]);
        numbers.cells(cells, (cell) => {
          tally(looks[cell], -1);
          looks[cell] = numbers.byte();
          tally(looks[cell], 1);
        });
        if (n % this.every === 0) this.keyframes.push(looks.slice());
        for (const name of Object.keys(counts)) this[name][n] = counts[name];
        this.scans[n] = n ? this.scans[n - 1] + (world.scanned ? world.scanned[n - 1] : 1) : 1;
      }
    }

    /** Where particles are (or are seen) at move n. */
    places(n) {
      const numbers = new Numbers(this.world.moments),
        found = [];
      numbers.at = this.moments[n][0];
      numbers.cells(this.looks.length, (cell) => found.push(cell));
      return Int32Array.from(found);
    }

    /** Take the looks to move n. */
    turn(n) {
      if (n < this.now || n - this.now > this.every) {
        const key = Math.floor(n / this.every);
        this.looks.set(this.keyframes[key]);
        this.now = key * this.every;
      }
      const numbers = new Numbers(this.world.moments);
      while (this.now < n) {
        numbers.at = this.moments[++this.now][1];
        numbers.cells(this.looks.length, (cell) => {
          this.looks[cell] = numbers.byte();
        });
      }
    }

    /** How a cell looks after move n: an index into `shades`. */
    shadeOf(cell, n) {
      if (n !== this.now) this.turn(n);
      return this.looks[cell];
    }

    stateOf(look) {
      const { free, frontier, wrong } = this.world.looks;
      if (look === free || look === wrong) return FREE;
      if (look === 0 || look === wrong + 1) return OBSTACLE;
      return look >= frontier ? FRONTIER : UNKNOWN;
    }

    state(cell, n) {
      return this.stateOf(this.shadeOf(cell, n));
    }

    /** The colour of each look: from obstacle over unknown to free, the same tinted as frontier,
     *  and two that are wrong. */
    shades(palette) {
      const { unknown, free } = this.world.looks,
        { tint } = this.world.looks;
      const mix = (a, b, share) => a.map((part, i) => Math.round(part + share * (b[i] - part)));
      const shades = Array.from({ length: free + 1 }, (_, look) =>
        look < unknown
          ? mix(palette.obstacle, palette.unknown, look / unknown)
          : mix(palette.unknown, palette.free, (look - unknown) / (free - unknown)),
      );
      return [
        ...shades,
        ...shades.map((shade) => mix(shade, palette.frontier, tint)),
        palette.wrong,
        mix(palette.wrong, [0, 0, 0], 0.4),
      ];
    }

    progress(n) {
      return this.goal
        ? Math.min(1, (this.free[n] + this.obstacle[n] - this.wrong[n]) / this.goal)
        : 1;
    }

    /** Where particles truly were at move n, if a plant has told it. */
    pointsAt(n) {
      return this.world.points?.[n] ?? null;
    }

    advance() {} // everything is there from the beginning

    seek(swarm, from, to) {
      swarm.place(this.places(to));
    }
  }

  Object.assign(ShoalSim, { readWorld, Swarm, Timeline });
})();
