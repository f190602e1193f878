/* The scene: particles, ways, goals and walls that hold, on a canvas; and the Δ configuration
 * space. Lengths are device pixels. */
"use strict";

const ShoalScene = (() => {
  // radians of a round wall, to both sides of the contact, that are shown as holding
  const ARC = 0.2;
  const OLD = 0.32; // opacity of the ways of earlier moves
  const MARGIN = 22,
    TOP = 42; // CSS pixels around the picture, and above it, where its name stands
  const BODY = 9.5; // radius of a particle that has none, in CSS pixels at 16 a rem
  const SPECK = 3; // and the least of one that has
  const NUMBERED = 7.5; // radius from which a particle has its number inside

  const floorOf = ([x, y]) => [x, y, 0];

  class Pen {
    constructor(canvas) {
      this.canvas = canvas;
      this.pen = canvas.getContext("2d");
    }

    resize() {
      this.view.resize(this.canvas.width, this.canvas.height, MARGIN * this.unit, TOP * this.unit);
    }

    clear() {
      this.pen.clearRect(0, 0, this.canvas.width, this.canvas.height);
    }

    path(rings, closed) {
      this.pen.beginPath();
      for (const ring of rings) {
        ring.forEach(([x, y], k) => (k ? this.pen.lineTo(x, y) : this.pen.moveTo(x, y)));
        if (closed) this.pen.closePath();
      }
    }

    line(points, colour, width, { alpha = 1, closed = false, dash = [] } = {}) {
      const { pen } = this;
      this.path([points], closed);
      pen.globalAlpha = alpha;
      pen.strokeStyle = colour;
      pen.lineWidth = width;
      pen.lineJoin = "round";
      pen.lineCap = dash.length ? "butt" : "round";
      pen.setLineDash(dash);
      pen.stroke();
      pen.setLineDash([]);
      pen.globalAlpha = 1;
    }

    /** Several lines at once, no darker where they meet. */
    lines(pieces, colour, width, alpha) {
      const { pen } = this;
      this.path(pieces, false);
      pen.globalAlpha = alpha;
      pen.strokeStyle = colour;
      pen.lineWidth = width;
      pen.lineCap = "round";
      pen.stroke();
      pen.globalAlpha = 1;
    }

    area(rings, colour, alpha = 1) {
      this.path(rings, true);
      this.pen.globalAlpha = alpha;
      this.pen.fillStyle = colour;
      this.pen.fill("evenodd");
      this.pen.globalAlpha = 1;
    }

    disc([x, y], radius, fill, edge, width) {
      const { pen } = this;
      pen.beginPath();
      pen.arc(x, y, radius, 0, 2 * Math.PI);
      if (fill) {
        pen.fillStyle = fill;
        pen.fill();
      }
      if (edge) {
        pen.strokeStyle = edge;
        pen.lineWidth = width;
        pen.stroke();
      }
    }

    word([x, y], word, colour, size) {
      const { pen } = this;
      pen.fillStyle = colour;
      pen.font = `600 ${size}px ${getComputedStyle(document.body).fontFamily}`;
      pen.textAlign = "center";
      pen.textBaseline = "middle";
      pen.fillText(word, x, y + 0.06 * size);
    }
  }

  const square = ([x, y], side) => [
    [x - side, y - side],
    [x + side, y - side],
    [x + side, y + side],
    [x - side, y + side],
  ];

  class Scene extends Pen {
    constructor(canvas, track, data) {
      super(canvas);
      this.track = track;
      this.walls = data.walls;
      this.space = data.walls.height > 0;
      this.radius = data.radius;
      const states = [
        data.start,
        data.goal,
        ...track.trajectories.map((trajectory) => trajectory.points.at(-1)),
      ];
      this.view = this.space
        ? new ShoalViews.Space(data.walls, states)
        : new ShoalViews.Plane(data.walls);
      this.rings = ShoalViews.ringsOf(data.walls);
      this.sides = data.walls.circle
        ? []
        : this.rings.flatMap((ring) =>
            ring.map((point, k) => [point, ring[(k + 1) % ring.length]]),
          );
    }

    draw(moment, colours) {
      this.colours = colours;
      this.points = this.track.pointsAt(moment);
      this.clear();
      if (this.space) this.drawSpace(moment);
      else this.drawPlane(moment);
    }

    // ---- in the plane ----

    drawPlane(moment) {
      const { view, unit, colours } = this,
        at = (point) => view.at(point);
      // to scale, as far as it can be seen; a point has no size of its own
      const body = this.radius ? Math.max(this.radius * view.scale, SPECK * unit) : BODY * unit;
      this.area([this.rings[0].map(at)], colours.floor);
      for (const hole of this.rings.slice(1)) this.area([hole.map(at)], colours.block);
      for (const ring of this.rings)
        this.line(ring.map(at), colours.wall, 2 * unit, { closed: true });
      this.drawEnds(at, body);
      for (const [particle, wall] of this.track.heldAt(moment)) {
        this.line(
          this.wallLine(wall, this.points[particle]).map(at),
          colours.particle(particle),
          6.5 * unit,
        );
      }
      this.drawWays(moment, at);
      this.points.forEach((point, i) => this.drawParticle(at(point), body, i));
    }

    /** Starts as squares, goals as rings. */
    drawEnds(at, body) {
      const { unit, colours, track } = this;
      track.start.forEach((start, i) => {
        const corners = square(at(start), 0.8 * body);
        this.area([corners], colours.particle(i), 0.25);
        this.line(corners, colours.particle(i), 1.5 * unit, { closed: true });
        const goal = at(track.goal[i]),
          radius = Math.max(1.32 * body, body + 3 * unit);
        this.disc(
          goal,
          radius,
          this.space ? null : colours.hollow,
          colours.particle(i),
          2.5 * unit,
        );
        this.number(goal, radius - 1.5 * unit, i, colours.particle(i));
      });
    }

    /** The number of a particle in a disc, or beside one that is too small for it. */
    number([x, y], radius, i, inside) {
      const { unit, colours } = this;
      if (radius >= NUMBERED * unit)
        this.word(
          [x, y],
          String(i + 1),
          inside,
          Math.min(Math.max(11.5 * unit, 0.9 * radius), 24 * unit),
        );
      else
        this.word(
          [x + radius + 6 * unit, y - radius - 4 * unit],
          String(i + 1),
          colours.particle(i),
          11.5 * unit,
        );
    }

    drawWays(moment, at, shadow = null) {
      const { track, unit, colours } = this;
      for (let k = 0; k < Math.min(moment.move + 1, track.moves); k++) {
        const old = k < moment.move,
          states = track.wayUntil(k, moment);
        track.start.forEach((_, i) => {
          const colour = shadow ?? colours.particle(i),
            alpha = shadow ? (old ? 0.16 : 0.35) : old ? OLD : 0.95;
          this.line(
            states.map((points) => at(points[i])),
            colour,
            (shadow ? 2 : 2.5) * unit,
            { alpha },
          );
        });
      }
    }

    drawParticle(place, body, i) {
      const { unit, colours } = this;
      this.disc(place, body, colours.particle(i), colours.hollow, 1.5 * unit);
      this.number(place, body, i, colours.onParticle);
    }

    /** The part of a wall that is shown as holding: a line in the plane. */
    wallLine(wall, contact) {
      const { circle } = this.walls;
      if (!circle) return this.sides[wall];
      const turn = Math.atan2(contact[1] - circle[1], contact[0] - circle[0]);
      return Array.from({ length: 15 }, (_, k) => {
        const angle = turn + ARC * (k / 7 - 1);
        return [circle[0] + circle[2] * Math.cos(angle), circle[1] + circle[2] * Math.sin(angle)];
      });
    }

    // ---- in space ----

    drawSpace(moment) {
      const { view, unit, colours, track, points } = this,
        at = (point) => view.at(point);
      const { behind, front } = view.edges();
      this.area([view.base.map((point) => at([...point, 0]))], colours.floor);
      this.lines(
        behind.map((edge) => edge.map(at)),
        colours.wall,
        1.3 * unit,
        0.35,
      );
      for (const [particle, wall] of track.heldAt(moment)) {
        const face = this.wallFace(wall, points[particle]).map(at),
          colour = colours.particle(particle);
        this.area([face], colour, 0.2);
        this.line(face, colour, 1.5 * unit, { alpha: 0.55, closed: true });
      }
      this.drawWays(moment, (point) => at(floorOf(point)), colours.shadow);
      points.forEach((point, i) => {
        this.area([this.ringOnFloor(point, 10).map(at)], colours.shadow, 0.35);
        this.line([floorOf(point), point].map(at), colours.particle(i), 1.3 * unit, {
          alpha: 0.85,
          dash: [3 * unit, 3 * unit],
        });
        this.line(this.ringOnFloor(track.goal[i], 7).map(at), colours.particle(i), 1.2 * unit, {
          alpha: 0.6,
          closed: true,
        });
        this.line(
          [floorOf(track.goal[i]), track.goal[i]].map(at),
          colours.particle(i),
          1.1 * unit,
          { alpha: 0.4 },
        );
      });
      this.drawEnds(at, BODY * unit);
      this.drawWays(moment, at);
      // the nearest last
      const order = points.map((point, i) => [view.largerAt(point), i]).sort((a, b) => a[0] - b[0]);
      for (const [larger, i] of order) this.drawParticle(at(points[i]), BODY * unit * larger, i);
      this.lines(
        front.map((edge) => edge.map(at)),
        colours.wall,
        1.5 * unit,
        0.8,
      );
    }

    ringOnFloor([x, y], pixels) {
      const radius = (pixels * this.unit) / this.view.fitScale;
      return Array.from({ length: 24 }, (_, k) => [
        x + radius * Math.cos((Math.PI * k) / 12),
        y + radius * Math.sin((Math.PI * k) / 12),
        0,
      ]);
    }

    /** The corners of a wall that holds: sides come first, then floor and ceiling; of a round
     *  wall it is a strip. */
    wallFace(wall, contact) {
      const { height, circle } = this.walls,
        sides = this.sides.length;
      const caps = this.walls.open ? 0 : 2;
      if (wall >= sides && wall < sides + caps)
        return this.view.base.map((point) => [...point, wall === sides ? 0 : height]);
      const line = circle ? this.wallLine(wall, contact) : this.sides[wall];
      return [
        ...line.map((point) => [...point, 0]),
        ...[...line].reverse().map((point) => [...point, height]),
      ];
    }
  }

  class Delta extends Pen {
    constructor(canvas, track, delta) {
      super(canvas);
      this.track = track;
      this.delta = delta;
      this.outline = ShoalViews.ringsOf(delta.walls)[0];
      this.view = new ShoalViews.Plane(delta.walls);
    }

    draw(moment, colours) {
      const { view, unit, track, delta } = this,
        at = (point) => view.at(point);
      const between = (points) => at([points[1][0] - points[0][0], points[1][1] - points[0][1]]);
      const outline = this.outline.map(at);
      this.clear();
      this.area([outline], colours.floor);
      const reached = delta.sets[delta.which[moment.move]];
      if (reached)
        this.area(
          reached.map((ring) => ring.map(at)),
          colours.reach,
        );
      this.line(outline, colours.wall, 2 * unit, { closed: true });
      const [x, y] = at([0, 0]),
        arm = 6 * unit;
      this.line(
        [
          [x - arm, y],
          [x + arm, y],
        ],
        colours.faint,
        1.2 * unit,
      );
      this.line(
        [
          [x, y - arm],
          [x, y + arm],
        ],
        colours.faint,
        1.2 * unit,
      );
      this.line(square(between(track.start), 6.5 * unit), colours.wall, 1.5 * unit, {
        closed: true,
      });
      this.disc(between(track.goal), 11 * unit, colours.hollow, colours.wall, 2.3 * unit);
      for (let k = 0; k < Math.min(moment.move + 1, track.moves); k++) {
        this.line(track.wayUntil(k, moment).map(between), colours.wall, 2 * unit, {
          alpha: k < moment.move ? OLD : 0.9,
        });
      }
      this.disc(
        between(track.pointsAt(moment)),
        6.5 * unit,
        colours.wall,
        colours.hollow,
        1.5 * unit,
      );
    }
  }

  return { Scene, Delta };
})();
