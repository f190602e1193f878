/* The search on a canvas: cells, ways, robots; and the rows of time. Lengths are device pixels,
 * times those of a cell. */
"use strict";

const ShoalSearch = (() => {
  const { clamp } = ShoalTrack;
  const MARGIN = 22; // CSS pixels around the picture
  const INSET = 0.5; // rem left and right of the rows: half a thumb, as of the scrub bar
  const OWN = 0.18,
    TAKEN = 0.42; // how much of a robot's colour its cells have
  const WARM = 0.75; // how much of the colour of heat the likeliest squares have
  const STEPS = 65535; // of places across the picture
  const EARLY = 1e-3; // cells: times are rounded

  const KINDS = { f4: Float32Array, u4: Uint32Array, u2: Uint16Array, u1: Uint8Array };
  function numbers(text, kind) {
    const bytes = Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0));
    return new KINDS[kind](bytes.buffer);
  }

  /** How many of the rising numbers are at most x. */
  function countUpTo(rising, x) {
    let low = 0,
      high = rising.length;
    while (low < high) {
      const middle = (low + high) >> 1;
      if (rising[middle] <= x) low = middle + 1;
      else high = middle;
    }
    return low;
  }

  class Robot {
    constructor(told, box) {
      const places = numbers(told.places, "u2"),
        across = (box[2] - box[0]) / STEPS,
        up = (box[3] - box[1]) / STEPS;
      this.times = numbers(told.times, "f4");
      this.points = Array.from(this.times, (_, k) => [
        box[0] + places[2 * k] * across,
        box[1] + places[2 * k + 1] * up,
      ]);
      this.visits = numbers(told.visits, "f4");
      this.activities = told.activities.map(([begin, end, kind, other]) => ({
        begin,
        end,
        kind,
        other,
      }));
      this.outline = numbers(told.outline, "u2");
      this.liar = told.liar;
    }

    at(time) {
      const { times, points } = this,
        next = countUpTo(times, time);
      if (next === 0) return points[0];
      if (next === times.length) return points[next - 1];
      const share = (time - times[next - 1]) / (times[next] - times[next - 1]);
      return points[next - 1].map((x, i) => x + share * (points[next][i] - x));
    }

    activityAt(time) {
      let found = this.activities[0];
      for (const activity of this.activities) if (activity.begin <= time + EARLY) found = activity;
      return found ?? { begin: 0, end: 0, kind: "listening", other: 0 };
    }

    doneAt(time) {
      return countUpTo(this.visits, time + EARLY);
    }
  }

  /** The episode as it was told, unpacked. */
  class History {
    constructor(data) {
      Object.assign(this, data);
      this.first = numbers(data.first, "f4");
      this.searched = data.searched ? numbers(data.searched, "f4") : this.first;
      this.by = numbers(data.by, "u2");
      this.where = numbers(data.where, "u4");
      this.taken = numbers(data.taken, "u1");
      this.heat = data.heat ? numbers(data.heat, "u1") : null;
      this.cooled = data.cooled.map((text, k) => numbers(text, ["f4", "u4", "u1"][k]));
      this.success = data.success.map((text) => numbers(text, "f4"));
      this.robots = data.robots.map((told) => new Robot(told, data.view));
    }

    searchedAt(time) {
      return countUpTo(this.searched, time + EARLY);
    }

    /** How many squares of the picture have a colour: of several a cell where layers are cut
     *  into different cells. */
    paintedAt(time) {
      return countUpTo(this.first, time + EARLY);
    }

    /** How many looks have cooled a square where the target is likely. */
    cooledAt(time) {
      return countUpTo(this.cooled[0], time + EARLY);
    }

    /** The probability that the target of a prior is found. */
    successAt(time) {
      const [times, found] = this.success,
        count = countUpTo(times, time + EARLY);
      return count ? found[count - 1] : 0;
    }

    foundAt(time) {
      return this.findings.filter(([, , when]) => when <= time + EARLY).length;
    }
  }

  class Scene {
    constructor(canvas, history) {
      this.canvas = canvas;
      this.pen = canvas.getContext("2d");
      this.history = history;
      const [left, bottom, right, top] = history.view;
      this.view = new ShoalViews.Plane({
        rings: [
          [
            [left, bottom],
            [right, bottom],
            [right, top],
            [left, top],
          ],
        ],
      });
      this.cells = document.createElement("canvas"); // a pixel a cell
      [this.cells.height, this.cells.width] = history.shape;
      this.image = new ImageData(history.shape[1], history.shape[0]);
      // searched cells that have their colour, and looks that cooled theirs
      this.shown = this.cooled = 0;
      this.warm = false; // whether likely squares have theirs
      this.chosen = -1; // the robot that is followed
    }

    resize() {
      this.view.resize(
        this.canvas.width,
        this.canvas.height,
        MARGIN * this.unit,
        MARGIN * this.unit,
      );
    }

    /** The robot drawn at a place, the nearest one; -1 for none. */
    robotAt(x, y, time) {
      const away = this.history.robots.map((robot) => {
        const [right, down] = this.view.at(robot.at(time));
        return Math.hypot(right - x, down - y);
      });
      const nearest = Math.min(...away);
      return nearest <= 14 * this.unit ? away.indexOf(nearest) : -1;
    }

    /** Forget the colours of cells: the theme or the robot that is followed is another one. */
    forget() {
      this.shown = this.cooled = 0;
      this.warm = false;
      this.image.data.fill(0);
    }

    /** Start anew: the squares where the target is likely are as warm as before the search. */
    warmUp(colours) {
      const { heat } = this.history;
      // which search painted a square
      this.owner = new Int32Array(this.image.width * this.image.height).fill(-1);
      this.heat = heat ? heat.slice() : null;
      this.warm = true;
      this.heat?.forEach((strength, square) => {
        if (strength) this.paintSquare(square, colours);
      });
    }

    /** Paint a square with its heat, and over it the colour of who searched it. */
    paintSquare(square, colours) {
      const {
          history,
          heat,
          image: { data },
        } = this,
        k = this.owner[square];
      const hot = heat ? (WARM * heat[square]) / 255 : 0;
      const robot = k < 0 ? -1 : history.by[k],
        own = k < 0 ? null : colours.robot(robot);
      const part =
        k < 0
          ? 0
          : (history.taken[k] ? TAKEN : OWN) *
            (this.chosen >= 0 && this.chosen !== robot ? 0.35 : 1);
      for (let i = 0; i < 3; i++) {
        const ground = colours.floor[i] + hot * (colours.hot[i] - colours.floor[i]);
        data[4 * square + i] = ground + part * ((own?.[i] ?? ground) - ground);
      }
      data[4 * square + 3] = 255;
    }

    paintCells(time, colours) {
      const { history, image } = this,
        count = history.paintedAt(time),
        cooled = history.cooledAt(time);
      if (count < this.shown || cooled < this.cooled) this.forget();
      if (this.warm && count === this.shown && cooled === this.cooled) return;
      if (!this.warm) this.warmUp(colours);
      const [, squares, heat] = history.cooled,
        changed = new Set();
      for (; this.cooled < cooled; this.cooled++) {
        this.heat[squares[this.cooled]] = heat[this.cooled];
        changed.add(squares[this.cooled]);
      }
      for (; this.shown < count; this.shown++) {
        this.owner[history.where[this.shown]] = this.shown;
        changed.add(history.where[this.shown]);
      }
      for (const square of changed) this.paintSquare(square, colours);
      this.cells.getContext("2d").putImageData(image, 0, 0);
    }

    ring(points) {
      points.forEach((point, k) => {
        const [x, y] = this.view.at(point);
        if (k) this.pen.lineTo(x, y);
        else this.pen.moveTo(x, y);
      });
      this.pen.closePath();
    }

    draw(time, colours) {
      const { pen, canvas, history, view, unit } = this;
      this.paintCells(time, colours);
      pen.clearRect(0, 0, canvas.width, canvas.height);
      pen.save();
      pen.beginPath();
      for (const part of history.parts) for (const ring of part) this.ring(ring);
      pen.fillStyle = colours.floorText;
      pen.fill("evenodd");
      pen.clip("evenodd");
      const [x, y] = view.at([history.box[0], history.box[3]]),
        side = history.size * view.scale;
      pen.imageSmoothingEnabled = false;
      pen.drawImage(this.cells, x, y, side * history.shape[1], side * history.shape[0]);
      this.drawObstacles(time, colours, x, y, side);
      this.drawOutlines(time, colours, x, y, side);
      pen.restore();
      pen.beginPath();
      for (const part of history.parts) for (const ring of part) this.ring(ring);
      pen.strokeStyle = colours.wall;
      pen.lineWidth = 1.4 * unit;
      pen.lineJoin = "round";
      pen.stroke();
      this.drawWays(time, colours, side);
      history.robots.forEach((robot, k) =>
        this.drawStart(robot.points[0], colours.robotText(k), colours),
      );
      for (const [fx, fy, when] of history.findings)
        if (when <= time + EARLY) this.drawFinding([fx, fy], colours);
      history.robots.forEach((robot, k) => {
        if (k !== this.chosen) this.drawRobot(robot, k, time, colours);
      });
      if (this.chosen >= 0) this.drawRobot(history.robots[this.chosen], this.chosen, time, colours);
      this.drawLabels(colours);
      this.drawScale(colours);
    }

    /** What each layer is, over its upper left corner. */
    drawLabels(colours) {
      const { pen, unit, view, history } = this;
      pen.font = `600 ${13 * unit}px system-ui, sans-serif`;
      pen.fillStyle = colours.ink;
      pen.textAlign = "left";
      pen.textBaseline = "alphabetic";
      for (const [words, x, y] of history.labels) {
        const [left, top] = view.at([x, y]);
        pen.fillText(words, left, top - 5 * unit);
      }
    }

    /** A bar of a round length in metres, and an arrow to the north; a rim keeps both apart from
     *  what lies below. */
    drawScale(colours) {
      const { pen, canvas, unit, view, history } = this,
        most = (0.22 * canvas.width) / view.scale,
        power = 10 ** Math.floor(Math.log10(most));
      const length = [5, 2, 1].find((step) => step * power <= most) * power,
        long = length * view.scale;
      const x = 12 * unit,
        y = canvas.height - 12 * unit;
      const rimmed = (width, draw) => {
        for (const [colour, rim] of [
          [colours.floorText, 4 * unit],
          [colours.ink, 0],
        ]) {
          pen.strokeStyle = pen.fillStyle = colour;
          pen.lineWidth = width + rim;
          draw(rim > 0);
        }
      };
      const write = (text, font, at, level) => {
        pen.font = font;
        rimmed(0, (rim) => (rim ? pen.strokeText(text, at, level) : pen.fillText(text, at, level)));
      };
      pen.lineJoin = "round";
      pen.textAlign = "center";
      pen.textBaseline = "alphabetic";
      pen.beginPath();
      pen.moveTo(x, y - 5 * unit);
      pen.lineTo(x, y);
      pen.lineTo(x + long, y);
      pen.lineTo(x + long, y - 5 * unit);
      rimmed(1.6 * unit, () => pen.stroke());
      write(
        length >= 1000 ? `${length / 1000} km` : `${length} m`,
        `${11 * unit}px system-ui, sans-serif`,
        x + long / 2,
        y - 5 * unit,
      );
      if (history.north === null) return;
      const middle = x + long + 24 * unit,
        lean = (history.north * Math.PI) / 180;
      const corner = (right, up) => [
        middle + (right * Math.cos(lean) + up * Math.sin(lean)) * unit,
        y + (-20 + right * Math.sin(lean) - up * Math.cos(lean)) * unit,
      ];
      pen.beginPath();
      pen.moveTo(...corner(0, 8));
      pen.lineTo(...corner(5, -5));
      pen.lineTo(...corner(-5, -5));
      pen.closePath();
      rimmed(0, (rim) => (rim ? pen.stroke() : pen.fill()));
      write("N", `700 ${11 * unit}px system-ui, sans-serif`, middle, y);
    }

    /** Cells that cannot be entered, once that was found. */
    drawObstacles(time, colours, x, y, side) {
      const { pen, history } = this,
        columns = history.shape[1];
      pen.fillStyle = colours.wall;
      pen.globalAlpha = 0.75;
      for (const [cell, found] of history.obstacles) {
        if (found <= time + EARLY)
          pen.fillRect(
            x + side * (cell % columns),
            y + side * Math.floor(cell / columns),
            side,
            side,
          );
      }
      pen.globalAlpha = 1;
    }

    drawOutlines(time, colours, x, y, side) {
      const { pen, history, unit } = this;
      history.robots.forEach((robot, k) => {
        if (
          !robot.outline.length ||
          !robot.activities.some((one) => one.kind === "taken" && one.begin <= time + EARLY)
        )
          return;
        pen.beginPath();
        for (let i = 0; i < robot.outline.length; i += 4) {
          pen.moveTo(x + side * robot.outline[i], y + side * robot.outline[i + 1]);
          pen.lineTo(x + side * robot.outline[i + 2], y + side * robot.outline[i + 3]);
        }
        pen.strokeStyle = colours.robotText(k);
        pen.globalAlpha = this.chosen >= 0 && this.chosen !== k ? 0.3 : 1;
        pen.lineWidth = 2.2 * unit;
        pen.stroke();
        pen.globalAlpha = 1;
      });
    }

    drawWays(time, colours, side) {
      const { pen, history, unit, chosen } = this;
      pen.lineJoin = pen.lineCap = "round";
      const wide = clamp(0.13 * side, 0.7 * unit, 2.6 * unit);
      history.robots.forEach((robot, k) => {
        const count = countUpTo(robot.times, time);
        pen.strokeStyle = colours.robotText(k);
        if (k === chosen && count < robot.points.length) {
          // what is still to come
          this.trace([robot.at(time), ...robot.points.slice(count)], wide, 0.35, [
            4 * unit,
            4 * unit,
          ]);
        }
        if (count)
          this.trace(
            [...robot.points.slice(0, count), robot.at(time)],
            k === chosen ? 1.5 * wide : wide,
            chosen >= 0 && k !== chosen ? 0.2 : 0.8,
          );
      });
    }

    trace(points, width, alpha, dash = []) {
      const { pen, view } = this;
      pen.beginPath();
      for (const point of points) pen.lineTo(...view.at(point));
      pen.globalAlpha = alpha;
      pen.lineWidth = width;
      pen.setLineDash(dash);
      pen.stroke();
      pen.setLineDash([]);
      pen.globalAlpha = 1;
    }

    drawStart(point, own, colours) {
      const { pen, unit } = this,
        [x, y] = this.view.at(point),
        half = 3.5 * unit;
      pen.fillStyle = colours.floorText;
      pen.fillRect(x - half - unit, y - half - unit, 2 * (half + unit), 2 * (half + unit));
      pen.fillStyle = own;
      pen.fillRect(x - half, y - half, 2 * half, 2 * half);
    }

    drawFinding(point, colours) {
      const { pen, unit } = this,
        [x, y] = this.view.at(point),
        r = 6.5 * unit;
      pen.beginPath();
      pen.moveTo(x, y - r);
      for (const [i, j] of [
        [1, 0],
        [0, 1],
        [-1, 0],
      ])
        pen.lineTo(x + i * r, y + j * r);
      pen.closePath();
      pen.fillStyle = colours.found;
      pen.fill();
      pen.strokeStyle = "#22262c";
      pen.lineWidth = 1.2 * unit;
      pen.stroke();
    }

    drawRobot(robot, k, time, colours) {
      const { pen, unit, history } = this,
        [x, y] = this.view.at(robot.at(time)),
        activity = robot.activityAt(time);
      const r = (history.robots.length <= 12 ? 10.5 : 8.5) * unit,
        own = colours.robotText(k);
      pen.globalAlpha = this.chosen >= 0 && this.chosen !== k ? 0.45 : 1;
      if (activity.kind === "dead") {
        this.drawCross(x, y, 0.62 * r, colours);
        pen.font = `700 ${1.05 * r}px system-ui, sans-serif`;
        pen.textAlign = "left";
        pen.lineWidth = 3 * unit;
        pen.lineJoin = "round";
        pen.strokeStyle = colours.floorText;
        pen.strokeText(k + 1, x + 0.85 * r, y + 1.3 * r);
        pen.fillStyle = colours.ink;
        pen.fillText(k + 1, x + 0.85 * r, y + 1.3 * r);
      } else {
        const idle = !["own", "taken"].includes(activity.kind);
        if (activity.kind === "taken")
          this.drawTaking(x, y, r, own, (time - activity.begin) / (history.end / 40));
        if (idle && activity.kind !== "listening" && history.circle)
          this.drawCircle(x, y, history.circle * this.view.scale, own);
        pen.beginPath();
        pen.arc(x, y, r, 0, 2 * Math.PI);
        pen.fillStyle = idle ? colours.floorText : own;
        pen.fill();
        pen.strokeStyle = idle ? own : colours.floorText;
        pen.lineWidth = (idle ? 2.4 : 1.4) * unit;
        pen.setLineDash(activity.kind === "paused" ? [2.5 * unit, 2.5 * unit] : []);
        pen.stroke();
        pen.setLineDash([]);
        pen.fillStyle = idle ? own : colours.onRobot;
        pen.font = `700 ${1.1 * r}px system-ui, sans-serif`;
        pen.textAlign = "center";
        pen.textBaseline = "alphabetic";
        pen.fillText(k + 1, x, y + 0.39 * r);
      }
      pen.globalAlpha = 1;
    }

    /** A ring around a robot in another's part; when it begins, one that grows. */
    drawTaking(x, y, r, own, since) {
      const { pen, unit } = this,
        alpha = pen.globalAlpha;
      pen.strokeStyle = own;
      pen.lineWidth = 2.2 * unit;
      pen.beginPath();
      pen.arc(x, y, 1.4 * r, 0, 2 * Math.PI);
      pen.stroke();
      if (since >= 1) return;
      pen.globalAlpha = alpha * (1 - since);
      pen.beginPath();
      pen.arc(x, y, r * (1.4 + 2.6 * since), 0, 2 * Math.PI);
      pen.stroke();
      pen.globalAlpha = alpha;
    }

    /** The circle in which a fixed wing waits. */
    drawCircle(x, y, r, own) {
      const { pen, unit } = this;
      pen.beginPath();
      pen.arc(x, y, r, 0, 2 * Math.PI);
      pen.strokeStyle = own;
      pen.lineWidth = 1.2 * unit;
      pen.setLineDash([5 * unit, 2 * unit]);
      pen.stroke();
      pen.setLineDash([]);
    }

    drawCross(x, y, r, colours) {
      const { pen, unit } = this;
      pen.lineCap = "round";
      for (const [width, shade] of [
        [5.5, colours.floorText],
        [2.6, colours.ink],
      ]) {
        pen.beginPath();
        for (const s of [1, -1]) {
          pen.moveTo(x - r, y - s * r);
          pen.lineTo(x + r, y + s * r);
        }
        pen.lineWidth = width * unit;
        pen.strokeStyle = shade;
        pen.stroke();
      }
    }
  }

  /** The rows of time: what each robot does. */
  class Rows {
    constructor(canvas, history) {
      this.canvas = canvas;
      this.pen = canvas.getContext("2d");
      this.history = history;
      this.kept = document.createElement("canvas"); // the rows without the cursor
      this.chosen = -1;
    }

    resize(rem) {
      this.left = INSET * rem * this.ratio;
      this.width = Math.max(1, this.canvas.width - 2 * this.left);
      this.forget();
    }

    forget() {
      this.stale = true;
    }

    timeAt(cssX) {
      return clamp((cssX * this.ratio - this.left) / this.width, 0, 1) * this.history.end;
    }

    rowAt(cssY) {
      return clamp(
        Math.floor((cssY * this.ratio - this.top) / this.pitch),
        0,
        this.history.robots.length - 1,
      );
    }

    xOf(time) {
      return this.left + (time / this.history.end) * this.width;
    }

    get top() {
      return 2 * this.unit;
    }

    get pitch() {
      return (this.canvas.height - 2 * this.top) / this.history.robots.length;
    }

    draw(time, colours) {
      const { pen, canvas, unit } = this;
      if (this.stale) this.drawRows(colours);
      pen.clearRect(0, 0, canvas.width, canvas.height);
      pen.drawImage(this.kept, 0, 0);
      const x = this.xOf(time);
      pen.fillStyle = colours.veil; // what is still to come
      pen.fillRect(x, 0, canvas.width - x, canvas.height);
      pen.fillStyle = colours.ink;
      pen.fillRect(Math.round(x - unit), 0, Math.max(2, Math.round(2 * unit)), canvas.height);
    }

    drawRows(colours) {
      const { history, unit, canvas, kept, top, pitch } = this;
      [kept.width, kept.height] = [canvas.width, canvas.height];
      const pen = kept.getContext("2d"),
        gap = pitch > 6 * unit ? 2 * unit : Math.max(0.5, 0.15 * pitch);
      history.robots.forEach((robot, k) => {
        const y = top + k * pitch,
          high = pitch - gap;
        pen.globalAlpha = this.chosen >= 0 && this.chosen !== k ? 0.35 : 1;
        for (const one of robot.activities) this.drawActivity(pen, one, k, y, high, colours);
      });
      pen.globalAlpha = 1;
      pen.fillStyle = colours.ink;
      if (history.covered != null)
        for (let y = 0; y < canvas.height; y += 5 * unit)
          pen.fillRect(this.xOf(history.covered), y, Math.max(1, unit), 3 * unit);
      this.stale = false;
    }

    drawActivity(pen, one, k, y, high, colours) {
      const { unit } = this,
        x = this.xOf(one.begin),
        long = Math.max(0, this.xOf(one.end) - x),
        own = colours.robotText(k);
      pen.fillStyle = own;
      if (one.kind === "own") pen.fillRect(x, y, long, high);
      else if (one.kind === "taken") {
        pen.save();
        pen.beginPath();
        pen.rect(x, y, long, high);
        pen.clip();
        const alpha = pen.globalAlpha;
        pen.globalAlpha = 0.35 * alpha;
        pen.fillRect(x, y, long, high);
        pen.globalAlpha = alpha;
        pen.strokeStyle = own;
        pen.lineWidth = 1.5 * unit;
        pen.beginPath();
        for (let at = x - high; at < x + long; at += 5 * unit) {
          pen.moveTo(at, y + high);
          pen.lineTo(at + high, y);
        }
        pen.stroke();
        pen.strokeRect(x, y, long, high);
        pen.restore();
      } else if (one.kind === "waiting" || one.kind === "listening") {
        pen.fillStyle = colours.wait;
        const thin = one.kind === "listening" ? 0.35 : 1;
        pen.fillRect(x, y + (high * (1 - thin)) / 2, long, high * thin);
      } else if (one.kind === "paused") {
        for (let at = x; at < x + long; at += 5 * unit)
          pen.fillRect(at, y + high / 2 - unit, Math.min(2 * unit, x + long - at), 2 * unit);
      } else if (one.kind === "dead") {
        const r = Math.min(3.5 * unit, high / 2),
          middle = y + high / 2;
        pen.strokeStyle = colours.ink;
        pen.lineWidth = 1.8 * unit;
        pen.beginPath();
        for (const s of [1, -1]) {
          pen.moveTo(x + unit, middle - s * r);
          pen.lineTo(x + unit + 2 * r, middle + s * r);
        }
        pen.stroke();
      }
    }
  }

  return { History, Scene, Rows };
})();
