/* Episodes that grow while they are shown: played elsewhere, or driven by hand, perhaps beside a
 * ghost. Pages of a server only. */
"use strict";

(() => {
  const { Timeline, Swarm, COMMANDS } = ShoalSim;
  const KEYFRAME_BYTES = 16e6;
  const GHOST = [124, 92, 214],
    DARK_GHOST = [58, 36, 120],
    RING = [255, 255, 255];
  const KEYS = {
    ArrowLeft: "l",
    ArrowUp: "u",
    ArrowRight: "r",
    ArrowDown: "d",
    PageUp: "i",
    PageDown: "o",
  };

  function enlarged(array, size) {
    const larger = new array.constructor(size);
    larger.set(array);
    return larger;
  }

  /** Add commands as letters; `scans` says of each by 0 or 1 whether a scan followed it, null
   *  means one always did. */
  Timeline.prototype.grow = function (letters, scans) {
    const { world } = this,
      length = this.length + letters.length;
    if (length > world.commands.length) {
      const room = Math.max(256, 2 * world.commands.length, length);
      world.commands = enlarged(world.commands, room);
      if (world.scanned) world.scanned = enlarged(world.scanned, room);
      for (const name of ["frontier", "free", "obstacle", "scans"])
        this[name] = enlarged(this[name], room + 1);
    }
    if (scans) world.scanned ??= new Uint8Array(world.commands.length);
    for (let i = 0; i < letters.length; i++) {
      world.commands[this.length + i] = COMMANDS.indexOf(letters[i]);
      if (scans) world.scanned[this.length + i] = scans[i] === "1" ? 1 : 0;
    }
    this.length = length;
    // Keyframes may take only so much memory: every second one goes.
    while (this.keyframes.length * this.keyframes[0].byteLength > KEYFRAME_BYTES) {
      this.keyframes = this.keyframes.filter((_, i) => i % 2 === 0);
      this.every *= 2;
    }
  };

  /** Drive the swarm of the player with the arrow keys. `onMove` is told each letter, `onEnd`
   *  when nothing is left to do. */
  window.shoalDrive = (data, { onMove, onEnd }) => {
    const player = window.shoalPlayer,
      { timeline } = player,
      letters = COMMANDS.slice(0, 2 * data.shape.length);
    let ghost = null,
      over = false;

    function drive(letter) {
      if (over || !letters.includes(letter)) return;
      player.pause();
      if (player.move !== timeline.length) player.goTo(timeline.length);
      player.grow(letter, null);
      timeline.advance(timeline.length);
      player.goTo(timeline.length);
      onMove(letter, timeline);
      if (timeline.frontier[timeline.length] === 0) {
        over = true;
        onEnd(timeline);
      }
    }

    window.addEventListener(
      "keydown",
      (event) => {
        const letter = KEYS[event.key];
        if (!letter || event.ctrlKey || event.metaKey || event.altKey) return;
        event.preventDefault();
        event.stopImmediatePropagation();
        drive(letter);
      },
      true,
    );

    // The ghost: another episode from the same start, drawn faintly at the same move.
    const { picture } = player,
      drawParticles = picture.drawParticles?.bind(picture);
    if (drawParticles) {
      picture.drawParticles = (swarm, slide) => {
        if (ghost) {
          const at = Math.min(player.move, ghost.timeline.done);
          ghost.timeline.seek(ghost.swarm, ghost.at, at);
          ghost.at = at;
          // over a photograph, which may be light or dark, a dark disc in a light ring
          const covers = !!picture.below,
            { discs, palette } = picture;
          picture.pen.globalAlpha = covers ? 1 : 0.55;
          picture.palette = { ...palette, particle: covers ? DARK_GHOST : GHOST };
          picture.casing = covers ? RING : null;
          picture.discs = ghost.discs[Number(covers)];
          drawParticles(ghost.swarm, 1);
          picture.casing = null;
          Object.assign(picture, { discs, palette });
          picture.pen.globalAlpha = 1;
        }
        drawParticles(swarm, slide);
      };
    }

    return {
      drive,
      get length() {
        return timeline.length;
      },
      get letters() {
        return Array.from(
          timeline.world.commands.subarray(0, timeline.length),
          (code) => COMMANDS[code],
        ).join("");
      },
      share: (move) => timeline.progress(Math.min(move, timeline.done)),
      /** Let a ghost run: the data that its episode begins with; then `ghostMoves` adds to it. */
      ghost(begin) {
        const world = ShoalSim.readWorld(begin);
        ghost = {
          timeline: new Timeline(world),
          swarm: new Swarm(world),
          at: 0,
          discs: [new Map(), new Map()],
        };
        player.redraw();
      },
      ghostMoves(moves, scans) {
        ghost.timeline.grow(moves, scans);
        ghost.timeline.advance(ghost.timeline.length);
        player.redraw();
      },
      ghostShare: (move) =>
        ghost ? ghost.timeline.progress(Math.min(move, ghost.timeline.done)) : 0,
      get ghostLength() {
        return ghost ? ghost.timeline.length : 0;
      },
    };
  };
})();
