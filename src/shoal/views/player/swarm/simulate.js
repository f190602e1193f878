/* The episode, simulated again from its start and its commands. Nothing here touches the page.
 *
 * The drawn grid has one more cell on every side than the map, so that a particle at the edge of
 * the array meets a wall like any other and no bounds need checking. "cell" below is an index
 * into that grid. */
"use strict";

const ShoalSim = (() => {
  const UNKNOWN = 0,
    FRONTIER = 1,
    FREE = 2,
    OBSTACLE = 3;
  const COMMANDS = "lurdio";
  const TASKS = ["mapping", "coverage", "subset-coverage", "target", "gathering"];
  const RULES = ["block", "merge", "tilt"];
  const NEVER = 0x7fffffff;
  const KEYFRAME_BYTES = 16e6; // the memory that keyframes may take
  const KEYFRAME_EVERY = 16; // the moves between keyframes while they fit

  /** The data does not describe an episode; the message is one sentence for people. */
  class DataError extends Error {
    get sentence() {
      return this.message;
    }
  }

  // ---- reading the data ------------------------------------------------------------------------

  function bytesOf(data, key) {
    if (typeof data[key] !== "string") throw new DataError(`The field “${key}” is missing.`);
    let text;
    try {
      text = atob(data[key]);
    } catch {
      throw new DataError(`The field “${key}” is not valid base64.`);
    }
    return Uint8Array.from(text, (ch) => ch.charCodeAt(0));
  }

  function checkSize(bytes, expected, key) {
    if (bytes.length !== expected) {
      throw new DataError(
        `The field “${key}” should hold ${expected} bytes and holds ${bytes.length}.`,
      );
    }
  }

  /** A packed board of the map, as one byte a cell of the drawn grid. */
  function readBoard(data, key, shape) {
    const bytes = bytesOf(data, key),
      [height, width] = shape.slice(-2),
      layers = shape.length === 3 ? shape[0] : 1;
    checkSize(bytes, Math.ceil((layers * height * width) / 8), key);
    const board = new Uint8Array(shape.reduce((cells, side) => cells * (side + 2), 1));
    for (let flat = 0; flat < layers * height * width; flat++) {
      board[drawnCell(shape, flat)] = (bytes[flat >> 3] >> (7 - (flat & 7))) & 1;
    }
    return board;
  }

  /** The cell of the drawn grid of an index in the map itself. */
  function drawnCell(shape, flat) {
    const [height, width] = shape.slice(-2),
      col = flat % width,
      rest = (flat - col) / width;
    const row = rest % height,
      layer = shape.length === 3 ? (rest - row) / height + 1 : 0;
    return (layer * (height + 2) + row + 1) * (width + 2) + col + 1;
  }

  function readStart(data, shape) {
    const bytes = bytesOf(data, "start");
    checkSize(bytes, bytes.length - (bytes.length % 4), "start");
    const view = new DataView(bytes.buffer);
    return Int32Array.from({ length: bytes.length / 4 }, (_, i) => {
      const flat = view.getUint32(4 * i, true);
      if (flat >= shape.reduce((cells, side) => cells * side))
        throw new DataError(`Particle ${i} starts outside the map.`);
      return drawnCell(shape, flat);
    });
  }

  function readCommands(data, shape) {
    if (typeof data.commands !== "string") throw new DataError("The field “commands” is missing.");
    return Uint8Array.from(data.commands, (letter, i) => {
      const code = COMMANDS.slice(0, 2 * shape.length).indexOf(letter);
      if (code < 0)
        throw new DataError(
          `Command ${i + 1} is “${letter}”, not one of l, u, r, d${shape.length === 3 ? ", i, o" : ""}.`,
        );
      return code;
    });
  }

  /** Whether a scan followed each command; null if one followed every command. */
  function readScans(data, length) {
    if (data.scanned == null) return null;
    const bytes = bytesOf(data, "scanned");
    checkSize(bytes, Math.ceil(length / 8), "scanned");
    return Uint8Array.from({ length }, (_, i) => (bytes[i >> 3] >> (7 - (i & 7))) & 1);
  }

  function checkOneOf(value, choices, key) {
    if (!choices.includes(value)) {
      throw new DataError(`The field “${key}” is “${value}”, not one of ${choices.join(", ")}.`);
    }
    return value;
  }

  function checkShape(shape) {
    const good =
      Array.isArray(shape) &&
      [2, 3].includes(shape.length) &&
      shape.every((n) => Number.isInteger(n) && n > 0);
    if (!good)
      throw new DataError(
        `The field “shape” should be two or three positive whole numbers, not “${shape}”.`,
      );
    return shape;
  }

  function checkStart(world) {
    const taken = new Uint8Array(world.wall.length);
    world.start.forEach((cell, i) => {
      if (world.wall[cell]) throw new DataError(`Particle ${i} starts on an obstacle.`);
      if (taken[cell] && world.rule !== "merge")
        throw new DataError(`Particle ${i} starts where another one is.`);
      taken[cell] = 1;
    });
  }

  function readTargets(data, world) {
    if (world.task === "mapping") return null;
    if (world.task === "gathering" && data.targets == null) return world.wall.map(() => 0);
    if (world.task === "coverage" && data.targets == null) return world.wall.map((w) => 1 - w);
    const targets = readBoard(data, "targets", world.shape);
    if (targets.some((t, cell) => t && world.wall[cell]))
      throw new DataError("A target cell is an obstacle.");
    return targets;
  }

  /** Everything that does not change during the episode; throws DataError. */
  function readWorld(data) {
    const shape = checkShape(data.shape);
    const [rows, cols] = shape.slice(-2).map((side) => side + 2);
    const world = {
      shape,
      cols,
      rows,
      spacing: data.spacing ?? null, // rows: of a layer
      task: checkOneOf(data.task, TASKS, "task"),
      rule: checkOneOf(data.rule, RULES, "rule"),
      wall: readBoard(data, "free", shape).map((free) => 1 - free),
      start: readStart(data, shape),
      commands: readCommands(data, shape),
      // what l, u, r, d, i, o add to a cell
      steps: [-1, -cols, 1, cols, -rows * cols, rows * cols].slice(0, 2 * shape.length),
    };
    checkStart(world);
    world.targets = readTargets(data, world);
    world.scanned = readScans(data, world.commands.length);
    return world;
  }

  /** The index r * W + c (3-D: (l * H + r) * W + c) in the map itself, as in the data. */
  function flatIndex(world, cell) {
    const { rows, cols, shape } = world,
      [height, width] = shape.slice(-2);
    const line = Math.floor(cell / cols),
      layer = shape.length === 3 ? Math.floor(line / rows) : 0;
    return (
      (Math.max(0, layer - 1) * height + (line - layer * rows) - 1) * width +
      (cell - line * cols) -
      1
    );
  }

  // ---- moving ----------------------------------------------------------------------------------

  /** The particles, and what the last command did to them. */
  class Swarm {
    constructor(world) {
      const cells = world.wall.length,
        n = world.start.length;
      this.world = world;
      this.pos = world.start.slice();
      this.before = world.start.slice(); // pos before the last command, in the same order
      this.count = new Uint16Array(cells); // particles in each cell
      // the cells stood in since the command began,
      this.entered = new Int32Array(Math.max(n, cells));
      this.entries = 0; // ... so many of them, and
      this.bumped = new Int32Array(n); // the walls run into,
      this.bumps = 0; // ... so many of them
      if (world.rule === "tilt") this.ends = world.steps.map((step) => runEnds(world.wall, step));
      this.place(this.pos);
    }

    /** Put the particles on the given cells. */
    place(cells) {
      this.pos.set(cells);
      this.before.set(cells);
      this.count.fill(0);
      for (const cell of this.pos) this.count[cell]++;
    }

    move(code) {
      const step = this.world.steps[code];
      this.entries = this.bumps = 0;
      if (this.world.rule === "block") this.block(step);
      else if (this.world.rule === "merge") this.merge(step);
      else this.tilt(step, this.ends[code]);
    }

    /** One cell each: only a queue that stands against a wall stays, every other train moves as
     *  one. */
    block(step) {
      const { pos, before, count, entered, bumped } = this,
        { wall } = this.world,
        n = pos.length;
      const HELD = 2; // marks, for the time of this call, the particles that stay
      for (let i = 0; i < n; i++) {
        const next = pos[i] + step;
        if (!wall[next]) continue;
        bumped[this.bumps++] = next;
        for (let cell = pos[i]; count[cell] === 1; cell -= step) count[cell] = HELD;
      }
      before.set(pos);
      for (let i = 0; i < n; i++) {
        if (count[pos[i]] !== HELD) entered[this.entries++] = pos[i] += step;
      }
      for (let i = 0; i < n; i++) count[before[i]] = 0;
      for (let i = 0; i < n; i++) count[pos[i]] = 1;
    }

    /** One cell each, whoever is there. */
    merge(step) {
      const { pos, before, count, entered, bumped } = this,
        { wall } = this.world;
      before.set(pos);
      for (let i = 0; i < pos.length; i++) {
        const next = pos[i] + step;
        if (wall[next]) {
          bumped[this.bumps++] = next;
        } else {
          count[pos[i]]--;
          count[next]++;
          entered[this.entries++] = pos[i] = next;
        }
      }
    }

    /** All the way. Repeating the block step until nothing moves stacks the particles of each
     *  run of free cells against its end and bumps the wall there, so the outcome is written
     *  down directly. The cells passed are those from the rearmost particle of a run to its end. */
    tilt(step, ends) {
      const { pos, before, count, bumped } = this,
        n = pos.length;
      pos.sort(); // along rows and columns alike, a larger index is further right or further down
      if (step > 0) pos.reverse(); // so the foremost particle of each run comes first
      before.set(pos);
      count.fill(0);
      for (let i = 0; i < n; i++) {
        const end = ends[pos[i]],
          ahead = count[end]++; // at the ends, count is the length of the queue
        pos[i] = end - ahead * step;
        if (ahead === 0) bumped[this.bumps++] = end + step;
      }
      for (let i = 0; i < n; i++) count[ends[pos[i]]] = 0;
      for (let i = 0; i < n; i++) count[pos[i]] = 1;
      this.logPaths(step);
    }

    logPaths(step) {
      const { pos, before, entered } = this;
      const reached = (this.reached ??= new Int32Array(this.world.wall.length));
      const stamp = (this.stamp = (this.stamp ?? 0) + 1);
      for (let i = 0; i < pos.length; i++) {
        // Where the path of the particle in front begins, all the rest has been logged.
        for (let cell = before[i]; reached[cell] !== stamp; cell += step) {
          reached[cell] = stamp;
          entered[this.entries++] = cell;
          if (cell === pos[i]) break;
        }
      }
    }
  }

  /** For each free cell, the last free cell of its run in one direction. */
  function runEnds(wall, step) {
    const ends = new Int32Array(wall.length),
      last = wall.length - 1;
    for (let k = 0; k <= last; k++) {
      const cell = step > 0 ? last - k : k;
      if (!wall[cell]) ends[cell] = wall[cell + step] ? cell : ends[cell + step];
    }
    return ends;
  }

  // ---- what is known, at any move ---------------------------------------------------------------

  /** The whole episode. A cell only ever goes from unknown to frontier to classified, so two
   *  move numbers a cell hold the belief of every move; particles come from keyframes and a few
   *  steps. It is built a slice of time at a time; `done` says how far. */
  class Timeline {
    constructor(world) {
      const cells = world.wall.length;
      this.world = world;
      this.length = world.commands.length;
      this.done = 0;
      this.since = new Int32Array(cells).fill(NEVER); // a frontier cell from this move on,
      // ... and classified (or covered) from this one on
      this.until = new Int32Array(cells).fill(NEVER);
      this.frontier = new Int32Array(this.length + 1); // counts after each move
      this.free = new Int32Array(this.length + 1);
      this.obstacle = new Int32Array(this.length + 1);
      // up to each move; there was one before the first
      this.scans = new Int32Array(this.length + 1).fill(1, 0, 1);
      this.unseen = []; // cells entered, and walls hit as their complement, since the last scan
      this.keyframe = cells <= 0x10000 ? Uint16Array : Int32Array;
      const bytes = (this.length + 1) * world.start.length * this.keyframe.BYTES_PER_ELEMENT;
      this.every = Math.max(KEYFRAME_EVERY, Math.ceil(bytes / KEYFRAME_BYTES));
      this.keyframes = [this.keyframe.from(world.start)];
      this.swarm = new Swarm(world); // at move `done`
      this.gathers = world.task === "gathering";
      this.region = this.gathers && world.targets.some((one) => one);
      if (world.targets) this.beginCoverage();
      for (const cell of world.start) this.stand(cell, 0);
      this.goal = world.targets ? this.count(world.targets) : reachable(world);
      if (this.gathers) this.goal = this.frontier[0] = this.stragglers();
    }

    /** How many cells hold particles that are not gathered: outside the region, or all but one. */
    stragglers() {
      const { targets } = this.world,
        cells = new Set(this.swarm.pos);
      return this.region ? [...cells].filter((cell) => !targets[cell]).length : cells.size - 1;
    }

    count(board) {
      return board.reduce((sum, bit) => sum + bit, 0);
    }

    /** The map is known; the targets are drawn as frontier until a particle has stood in them. */
    beginCoverage() {
      const { wall, targets } = this.world;
      targets.forEach((target, cell) => {
        if (target) this.since[cell] = 0;
        else this.until[cell] = 0;
      });
      this.frontier[0] = this.count(targets);
      this.obstacle[0] = this.count(wall);
      this.free[0] = wall.length - this.obstacle[0];
    }

    /** A particle is in the cell after move n. */
    stand(cell, n) {
      if (this.gathers) return; // the region stays as it is
      if (this.until[cell] !== NEVER) return;
      if (this.since[cell] !== NEVER) this.frontier[n]--;
      this.until[cell] = n;
      if (this.world.targets) return;
      this.free[n]++;
      for (const step of this.world.steps) {
        const next = cell + step;
        if (this.until[next] !== NEVER || this.since[next] !== NEVER) continue;
        this.since[next] = n;
        this.frontier[n]++;
      }
    }

    /** A particle ran into the obstacle; it stood beside it, so the cell was a frontier cell. */
    bump(cell, n) {
      if (this.until[cell] !== NEVER) return;
      this.until[cell] = n;
      this.frontier[n]--;
      this.obstacle[n]++;
    }

    /** What move n has shown; in a mapping that waits for the next scan. In a coverage the map
     *  says it. */
    look(n) {
      const { swarm, world, unseen } = this,
        scan = world.scanned ? world.scanned[n - 1] : 1;
      this.scans[n] = this.scans[n - 1] + scan;
      if (!scan && !world.targets) {
        for (let i = 0; i < swarm.entries; i++)
          if (this.until[swarm.entered[i]] === NEVER) unseen.push(swarm.entered[i]);
        for (let i = 0; i < swarm.bumps; i++)
          if (this.until[swarm.bumped[i]] === NEVER) unseen.push(~swarm.bumped[i]);
        return;
      }
      for (const cell of unseen) cell < 0 ? this.bump(~cell, n) : this.stand(cell, n);
      unseen.length = 0;
      for (let i = 0; i < swarm.entries; i++) this.stand(swarm.entered[i], n);
      for (let i = 0; i < swarm.bumps; i++) this.bump(swarm.bumped[i], n);
    }

    /** Simulate up to move `n`, or for `budget` milliseconds. */
    advance(n, budget = Infinity) {
      const stop = performance.now() + budget,
        { swarm, world } = this;
      while (this.done < Math.min(n, this.length)) {
        const now = ++this.done;
        for (const counts of [this.frontier, this.free, this.obstacle])
          counts[now] = counts[now - 1];
        swarm.move(world.commands[now - 1]);
        this.look(now);
        if (this.gathers) this.frontier[now] = this.stragglers();
        if (now % this.every === 0) this.keyframes.push(this.keyframe.from(swarm.pos));
        if (now % 16 === 0 && performance.now() > stop) break;
      }
    }

    /** The state of a cell after move n. */
    state(cell, n) {
      if (this.until[cell] <= n) return this.world.wall[cell] ? OBSTACLE : FREE;
      return this.since[cell] <= n ? FRONTIER : UNKNOWN;
    }

    /** How a cell looks after move n: an index into `shades`. */
    shadeOf(cell, n) {
      return this.state(cell, n);
    }

    /** The colour of each look. */
    shades(palette) {
      return [palette.unknown, palette.frontier, palette.free, palette.obstacle];
    }

    /** The share of cells classified (coverage: of targets covered; gathering: by how much the
     *  cells with particles to gather became fewer) after move n, between 0 and 1. */
    progress(n) {
      if (this.goal === 0) return 1;
      const { targets } = this.world;
      if (this.gathers) return Math.max(0, this.goal - this.frontier[n]) / this.goal;
      return (targets ? this.goal - this.frontier[n] : this.free[n] + this.obstacle[n]) / this.goal;
    }

    /** Take a swarm that is at move `from` to move `to`, which must be done. */
    seek(swarm, from, to) {
      if (to < from || to - from > this.every) {
        const key = Math.floor(to / this.every);
        from = key * this.every;
        swarm.place(this.keyframes[key]);
      }
      while (from < to) swarm.move(this.world.commands[from++]);
    }
  }

  /** How many cells a mapping can classify: free cells joined to a particle, and the obstacles
   *  beside them. */
  function reachable({ wall, start, steps }) {
    const seen = new Uint8Array(wall.length),
      queue = [];
    let count = 0;
    const visit = (cell) => {
      if (seen[cell]) return;
      seen[cell] = 1;
      count++;
      if (!wall[cell]) queue.push(cell);
    };
    start.forEach(visit);
    while (queue.length) {
      const cell = queue.pop();
      for (const step of steps) visit(cell + step);
    }
    return count;
  }

  const reading = {
    bytes: bytesOf,
    board: readBoard,
    commands: readCommands,
    scans: readScans,
    shape: checkShape,
  };

  return {
    reading,
    UNKNOWN,
    FRONTIER,
    FREE,
    OBSTACLE,
    COMMANDS,
    DataError,
    readWorld,
    flatIndex,
    Swarm,
    Timeline,
  };
})();
