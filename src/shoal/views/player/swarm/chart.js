/* The chart: frontier cells by move, with a cursor at the present move. A click or a drag seeks. */
"use strict";

const ShoalChart = (() => {
  // rem left and right: half a thumb, so that the cursor stands over the scrub bar's thumb
  const INSET = 0.5;

  class Chart {
    constructor(canvas, timeline) {
      this.canvas = canvas;
      this.pen = canvas.getContext("2d");
      this.timeline = timeline;
    }

    resize(rem) {
      this.left = Math.round(INSET * rem * this.ratio);
      this.width = Math.max(1, this.canvas.width - 2 * this.left);
      this.top = Math.round(5 * this.unit);
      this.bottom = this.canvas.height - Math.round(2 * this.unit);
    }

    /** The move under a point, CSS pixels from the left edge. */
    moveAt(cssX) {
      const share = (cssX * this.ratio - this.left) / this.width;
      return Math.max(0, Math.min(this.timeline.length, Math.round(share * this.timeline.length)));
    }

    xOf(move) {
      return this.left + (this.timeline.length ? (move / this.timeline.length) * this.width : 0);
    }

    yOf(value) {
      return this.bottom - (value / this.highest) * (this.bottom - this.top);
    }

    /** The largest count so far, looking only at moves not looked at before. */
    findHighest() {
      const { frontier, done } = this.timeline;
      this.highest ??= 1;
      for (this.looked ??= 0; this.looked <= done; this.looked++) {
        this.highest = Math.max(this.highest, frontier[this.looked]);
      }
      return this.highest;
    }

    /** The curve as points, one a move, or at most one a pixel column: then the largest value
     *  there. */
    points() {
      const { frontier, done, length } = this.timeline,
        points = [];
      const stride = Math.max(1, Math.floor(length / this.width));
      for (let move = 0; move <= done; move += stride) {
        let value = frontier[move];
        for (let k = move + 1; k < Math.min(move + stride, done + 1); k++)
          value = Math.max(value, frontier[k]);
        points.push([this.xOf(move), this.yOf(value)]);
      }
      if (stride > 1) points.push([this.xOf(done), this.yOf(frontier[done])]);
      return points;
    }

    /** Colours as CSS strings: line, past, future, axis, cursor, surface. */
    draw(move, colours) {
      const { pen, canvas, bottom } = this;
      this.findHighest();
      const line = new Path2D(),
        points = this.points();
      points.forEach(([x, y]) => line.lineTo(x, y));
      const area = new Path2D(line);
      area.lineTo(points.at(-1)[0], bottom);
      area.lineTo(points[0][0], bottom);
      pen.clearRect(0, 0, canvas.width, canvas.height);
      this.fillUpTo(canvas.width, area, line, colours.future, colours.faint);
      this.fillUpTo(this.xOf(move), area, line, colours.past, colours.line);
      pen.fillStyle = colours.axis;
      pen.fillRect(this.left, bottom, this.width, Math.max(1, Math.round(this.unit)));
      this.drawScans(colours);
      this.drawCursor(move, colours);
    }

    /** A tick at the foot of the chart for each scan, unless there is one after every move. */
    drawScans(colours) {
      const { scanned } = this.timeline.world;
      if (!scanned) return;
      const { pen, unit, bottom } = this,
        width = Math.max(1, Math.round(unit));
      pen.fillStyle = colours.cursor;
      let last = -Infinity;
      scanned.forEach((scan, i) => {
        const x = Math.round(this.xOf(i + 1) - width / 2);
        if (!scan || x <= last) return;
        pen.fillRect(x, bottom - 5 * unit, width, 5 * unit);
        last = x;
      });
    }

    fillUpTo(x, area, line, fill, stroke) {
      const { pen, canvas } = this;
      pen.save();
      pen.beginPath();
      pen.rect(0, 0, x, canvas.height);
      pen.clip();
      pen.fillStyle = fill;
      pen.fill(area);
      pen.strokeStyle = stroke;
      pen.lineWidth = 1.5 * this.unit;
      pen.lineJoin = "round";
      pen.stroke(line);
      pen.restore();
    }

    drawCursor(move, colours) {
      const { pen, unit } = this,
        x = this.xOf(move),
        width = Math.max(1, Math.round(unit));
      pen.fillStyle = colours.cursor;
      pen.fillRect(Math.round(x - width / 2), 0, width, this.bottom);
      pen.beginPath();
      pen.arc(x, this.yOf(this.timeline.frontier[move]), 3.5 * unit, 0, 2 * Math.PI);
      pen.fill();
      pen.strokeStyle = colours.surface;
      pen.lineWidth = 1.5 * unit;
      pen.stroke();
    }
  }

  return { Chart };
})();
