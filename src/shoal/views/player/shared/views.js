/* Views: how points of the workspace become places on a canvas, in the plane and in space.
 * Lengths are device pixels. */
"use strict";

const ShoalViews = (() => {
  const { clamp } = ShoalTrack;
  const CORNERS = 72; // that stand for a circle
  const FAR = 4.5; // distance of the eye, in times the reach of what it looks at
  const AZIMUTH = -Math.PI / 3,
    ABOVE = 0.42; // where the eye is at first
  const LOWEST = 0.04,
    HIGHEST = 1.5; // elevations
  const CLOSEST = 40; // the largest zoom

  /** The outlines of walls, a circle as many corners. */
  function ringsOf(walls) {
    if (!walls.circle) return walls.rings;
    const [x, y, radius] = walls.circle;
    return [
      Array.from({ length: CORNERS }, (_, k) => {
        const turn = (2 * Math.PI * k) / CORNERS;
        return [x + radius * Math.cos(turn), y + radius * Math.sin(turn)];
      }),
    ];
  }

  /** A view of the plane, y up. */
  class Plane {
    constructor(walls) {
      const corners = ringsOf(walls)[0];
      const low = [0, 1].map((i) => Math.min(...corners.map((point) => point[i])));
      const high = [0, 1].map((i) => Math.max(...corners.map((point) => point[i])));
      this.extent = [high[0] - low[0], high[1] - low[1]];
      this.middle = [(low[0] + high[0]) / 2, (low[1] + high[1]) / 2];
      this.fit();
    }

    get moved() {
      return this.zoom !== 1;
    }

    fit() {
      this.zoom = 1;
      this.shift = [0, 0];
    }

    /** `top` is left free above the picture. */
    resize(width, height, margin, top) {
      this.center = [width / 2, top + (height - top - margin) / 2];
      this.fitScale = Math.min(
        (width - 2 * margin) / this.extent[0],
        (height - margin - top) / this.extent[1],
      );
      this.room = [width, height];
    }

    get scale() {
      return this.fitScale * this.zoom;
    }

    at(point) {
      return [
        this.center[0] + this.shift[0] + (point[0] - this.middle[0]) * this.scale,
        this.center[1] + this.shift[1] - (point[1] - this.middle[1]) * this.scale,
      ];
    }

    zoomAt(factor, x, y) {
      const next = clamp(this.zoom * factor, 1, CLOSEST),
        grown = next / this.zoom;
      this.shift = [x, y].map(
        (place, i) => place - this.center[i] - (place - this.center[i] - this.shift[i]) * grown,
      );
      this.zoom = next;
      if (next === 1) this.fit();
      else this.drag(0, 0);
    }

    /** Move the picture, which keeps a part of itself in the middle. */
    drag(x, y) {
      this.shift = [x, y].map((by, i) => {
        const most = (this.extent[i] * this.scale) / 2;
        return clamp(this.shift[i] + by, -most, most);
      });
    }
  }

  /** A camera that looks at a prism or cylinder; the same as in films. */
  class Space {
    constructor(walls, states) {
      this.base = ringsOf(walls)[0];
      this.walls = walls;
      const heights = states.flat().map((point) => point[2]);
      const low = Math.min(0, ...heights),
        high = Math.max(walls.height, ...heights);
      const n = this.base.length;
      const middle =
        walls.circle ?? [0, 1].map((i) => this.base.reduce((sum, point) => sum + point[i], 0) / n);
      const flat = Math.max(
        ...this.base.map((point) => Math.hypot(point[0] - middle[0], point[1] - middle[1])),
      );
      this.middle = [middle[0], middle[1], (low + high) / 2];
      this.reach = Math.hypot(flat, (high - low) / 2);
      this.corners = [
        ...this.base.map(([x, y]) => [x, y, low]),
        ...this.base.map(([x, y]) => [x, y, high]),
      ];
      this.fit();
    }

    get moved() {
      return this.zoom !== 1 || this.azimuth !== AZIMUTH || this.elevation !== ABOVE;
    }

    fit() {
      this.zoom = 1;
      this.azimuth = AZIMUTH;
      this.elevation = ABOVE;
    }

    resize(width, height, margin, top) {
      const { azimuth, elevation } = this;
      let right = 0,
        up = 0,
        down = 0;
      this.elevation = ABOVE;
      for (let k = 0; k < 48; k++) {
        // as large as it can be if it is turned around
        this.azimuth = (2 * Math.PI * k) / 48;
        for (const corner of this.corners) {
          const [x, y] = this.project(corner);
          right = Math.max(right, Math.abs(x));
          up = Math.max(up, y);
          down = Math.max(down, -y);
        }
      }
      Object.assign(this, { azimuth, elevation });
      this.fitScale = Math.min(
        (width - 2 * margin) / (2 * right),
        (height - margin - top) / (up + down),
      );
      this.center = [width / 2, top + (height - top - margin + (up - down) * this.fitScale) / 2];
    }

    get scale() {
      return this.fitScale * this.zoom;
    }

    get toward() {
      const { azimuth, elevation } = this;
      return [
        Math.cos(elevation) * Math.cos(azimuth),
        Math.cos(elevation) * Math.sin(azimuth),
        Math.sin(elevation),
      ];
    }

    get eye() {
      return this.middle.map((x, i) => x + FAR * this.reach * this.toward[i]);
    }

    /** x, y and how much larger than in the middle things look. */
    project(point) {
      const { azimuth, elevation } = this,
        toward = this.toward;
      const away = point.map((x, i) => x - this.middle[i]);
      const dot = (vector) => away[0] * vector[0] + away[1] * vector[1] + away[2] * vector[2];
      const right = [-Math.sin(azimuth), Math.cos(azimuth), 0];
      const up = [
        -Math.sin(elevation) * Math.cos(azimuth),
        -Math.sin(elevation) * Math.sin(azimuth),
        Math.cos(elevation),
      ];
      const larger = (FAR * this.reach) / (FAR * this.reach - dot(toward));
      return [larger * dot(right), larger * dot(up), larger];
    }

    at(point) {
      const [x, y] = this.project(point);
      return [this.center[0] + this.scale * x, this.center[1] - this.scale * y];
    }

    largerAt(point) {
      return this.project(point)[2];
    }

    /** A direction as it is seen from far away, for the dial. */
    direction(vector) {
      const { azimuth, elevation } = this;
      const right = -Math.sin(azimuth) * vector[0] + Math.cos(azimuth) * vector[1];
      const back = Math.cos(azimuth) * vector[0] + Math.sin(azimuth) * vector[1];
      return [right, Math.cos(elevation) * vector[2] - Math.sin(elevation) * back];
    }

    /** The lines behind what is inside, and those in front of it. */
    edges() {
      const { base, walls, eye } = this,
        { height } = walls,
        n = base.length;
      const facing = base.map(([x, y], k) => {
        const [a, b] = base[(k + 1) % n];
        return (b - y) * (eye[0] - x) - (a - x) * (eye[1] - y) > 0;
      });
      const above = eye[2] > height && !walls.open,
        behind = [],
        front = [];
      base.forEach((point, k) => {
        const next = base[(k + 1) % n],
          before = facing[(k + n - 1) % n];
        (facing[k] || above ? front : behind).push([
          [...point, height],
          [...next, height],
        ]);
        (facing[k] ? front : behind).push([
          [...point, 0],
          [...next, 0],
        ]);
        if (facing[k] !== before || !walls.circle)
          (facing[k] || before ? front : behind).push([
            [...point, 0],
            [...point, height],
          ]);
      });
      return { behind, front };
    }

    zoomAt(factor) {
      this.zoom = clamp(this.zoom * factor, 0.5, 8);
    }

    /** Turn, as if the thing itself were dragged. */
    drag(x, y) {
      const rate = 1.2 / (this.fitScale * this.reach);
      this.azimuth -= x * rate;
      this.elevation = clamp(this.elevation + y * rate, LOWEST, HIGHEST);
    }
  }

  return { Plane, Space, ringsOf };
})();
