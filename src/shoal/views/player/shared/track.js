/* The track: where everything is at each moment of the film. Time is in seconds, a moment is a
 * move and a share of it. */
"use strict";

const ShoalTrack = (() => {
  const clamp = (x, low, high) => Math.max(low, Math.min(high, x));
  const mix = (one, other, part) => one.map((x, i) => x + part * (other[i] - x));
  const distance = (one, other) => Math.hypot(...one.map((x, i) => x - other[i]));

  class Track {
    constructor(data) {
      this.trajectories = data.trajectories;
      this.start = data.start;
      this.goal = data.goal;
      this.starts = data.starts; // the last is the end of the film
      this.lasting = data.lasting;
      this.seconds = data.seconds;
      this.size = data.size;
      this.moves = data.trajectories.length;
      this.lengths = [0]; // of all moves up to each
      for (const trajectory of data.trajectories)
        this.lengths.push(this.lengths.at(-1) + trajectory.length);
      this.longest = Math.max(0, ...data.trajectories.map((trajectory) => trajectory.length));
    }

    /** The move and the share of it at a time; moves begin and end gently. */
    momentAt(time) {
      if (!this.moves) return { move: 0, share: 0 };
      let move = this.moves - 1;
      while (move > 0 && this.starts[move] > time) move--;
      const part = clamp((time - this.starts[move]) / this.lasting[move], 0, 1);
      // the end of a move is one despite rounding
      return { move, share: part > 1 - 1e-9 ? 1 : part * part * (3 - 2 * part) };
    }

    /** When so many moves are done: 0 is the beginning of the film. */
    timeOf(done) {
      if (done <= 0) return 0;
      return done >= this.moves ? this.seconds : this.starts[done - 1] + this.lasting[done - 1];
    }

    /** How many moves are done at a time. */
    doneAt(time) {
      const { move, share } = this.momentAt(time);
      return share === 1 ? move + 1 : move;
    }

    piece(trajectory, share) {
      let k = trajectory.shares.length - 2;
      while (k > 0 && trajectory.shares[k] > share) k--;
      return k;
    }

    pointsAt({ move, share }) {
      const trajectory = this.trajectories[move];
      if (!trajectory) return this.start;
      const k = this.piece(trajectory, share),
        { shares, points } = trajectory;
      const part = clamp((share - shares[k]) / (shares[k + 1] - shares[k]), 0, 1);
      return part === 1
        ? points[k + 1]
        : points[k].map((point, i) => mix(point, points[k + 1][i], part));
    }

    /** The pairs of particle and wall that hold at a moment. */
    heldAt({ move, share }) {
      const trajectory = this.trajectories[move];
      return trajectory && share > 0 ? trajectory.held[this.piece(trajectory, share)] : [];
    }

    /** The states that a move's line runs through up to a moment; of an earlier move all. */
    wayUntil(index, moment) {
      const trajectory = this.trajectories[index];
      if (index < moment.move) return trajectory.points;
      return [
        ...trajectory.points.slice(0, this.piece(trajectory, moment.share) + 1),
        this.pointsAt(moment),
      ];
    }

    lengthAt({ move, share }) {
      return this.lengths[move] + (this.moves ? share * this.trajectories[move].length : 0);
    }

    /** How far each particle is from its goal. */
    distances(points) {
      return points.map((point, i) => distance(point, this.goal[i]));
    }
  }

  // ---- the chart: distances to the goals by time ------------------------------------------------

  const SAMPLES = 400;
  // rem left and right: half a thumb, so that the cursor stands over the scrub bar's thumb
  const INSET = 0.5;

  class Chart {
    constructor(canvas, track) {
      this.canvas = canvas;
      this.pen = canvas.getContext("2d");
      this.track = track;
      const times = Array.from({ length: SAMPLES + 1 }, (_, k) => (k / SAMPLES) * track.seconds);
      for (let k = 0; k < track.moves; k++)
        times.push(track.starts[k], track.starts[k] + track.lasting[k]);
      this.times = times.sort((a, b) => a - b);
      this.values = this.times.map((time) => track.distances(track.pointsAt(track.momentAt(time))));
      this.highest = Math.max(1e-300, ...this.values.flat());
    }

    resize(rem) {
      this.left = Math.round(INSET * rem * this.ratio);
      this.width = Math.max(1, this.canvas.width - 2 * this.left);
      this.top = Math.round(5 * this.unit);
      this.bottom = this.canvas.height - Math.round(2 * this.unit);
    }

    timeAt(cssX) {
      return clamp((cssX * this.ratio - this.left) / this.width, 0, 1) * this.track.seconds;
    }

    xOf(time) {
      return this.left + (time / this.track.seconds) * this.width;
    }

    yOf(value) {
      return this.bottom - (value / this.highest) * (this.bottom - this.top);
    }

    /** `colours` has a CSS colour for each particle, and axis, cursor, surface. */
    draw(time, colours) {
      const { pen, canvas, track, unit, bottom } = this;
      pen.clearRect(0, 0, canvas.width, canvas.height);
      pen.fillStyle = colours.axis;
      pen.fillRect(this.left, bottom, this.width, Math.max(1, Math.round(unit)));
      if (track.moves <= this.width / (8 * unit)) {
        for (let k = 1; k <= track.moves; k++)
          pen.fillRect(
            Math.round(this.xOf(track.starts[k - 1] + track.lasting[k - 1])),
            this.top,
            Math.max(1, Math.round(unit)),
            bottom - this.top,
          );
      }
      pen.lineWidth = 1.6 * unit;
      pen.lineJoin = "round";
      for (const past of [false, true])
        this.drawLines(past ? this.xOf(time) : canvas.width, past ? 1 : 0.35, colours);
      const x = this.xOf(time),
        width = Math.max(1, Math.round(unit));
      pen.fillStyle = colours.cursor;
      pen.fillRect(Math.round(x - width / 2), 0, width, bottom);
      track.distances(track.pointsAt(track.momentAt(time))).forEach((value, i) => {
        pen.beginPath();
        pen.arc(x, this.yOf(value), 3.5 * unit, 0, 2 * Math.PI);
        pen.fillStyle = colours.particle(i);
        pen.fill();
        pen.strokeStyle = colours.surface;
        pen.lineWidth = 1.5 * unit;
        pen.stroke();
      });
    }

    drawLines(until, alpha, colours) {
      const { pen, canvas } = this;
      pen.save();
      pen.beginPath();
      pen.rect(0, 0, until, canvas.height);
      pen.clip();
      pen.globalAlpha = alpha;
      this.track.goal.forEach((_, i) => {
        pen.beginPath();
        this.times.forEach((time, k) => pen.lineTo(this.xOf(time), this.yOf(this.values[k][i])));
        pen.strokeStyle = colours.particle(i);
        pen.stroke();
      });
      pen.restore();
    }
  }

  return { Track, Chart, clamp };
})();
