/* The page of a steering episode: what buttons, keys and pointers do, and what is shown at each
 * moment. */
"use strict";

(() => {
  const SPEEDS = [0.25, 0.5, 1, 2, 4, 8];
  const STEP = 0.12; // radians that a key turns the view by
  const COLOURS = 5; // of particles; then they come again

  const { $, fillRows, fixed, number, precise } = ShoalDesk;
  const calm = matchMedia("(prefers-reduced-motion: reduce)");
  const figure = (x) =>
    (x === 0
      ? "0"
      : Math.abs(x) >= 0.1
        ? fixed(x, 3)
        : Math.abs(x) >= 1e-4
          ? precise(x, 2)
          : x.toExponential(1)
    ).replaceAll("-", "−");
  let decimals = 3;
  const signed = (x) => {
    const size = fixed(Math.abs(x), decimals);
    // a blank as wide as a sign
    return Number(size) === 0 ? `\u2007${size}` : `${x < 0 ? "−" : "+"}${size}`;
  };

  // ---- what does not change ---------------------------------------------------------------------

  function describe(data, track) {
    $("title").textContent = data.title;
    ShoalDesk.showFacts([
      `planner ${data.planner}`,
      data.noise ? "with noise" : "",
      data.reason,
      data.status,
    ]);
    $("of").textContent = `of ${number(track.moves)}`;
    $("ofLength").textContent = `of ${figure(data.length)}`;
    const space = data.walls.height > 0;
    decimals = ShoalTrack.clamp((space ? 2 : 3) - Math.floor(Math.log10(data.size)), 0, 12);
    $("player").classList.toggle("single", !data.delta);
    $("deltaStage").hidden = !data.delta;
    $("stage").classList.toggle("turns", space);
    $("turnKeys").hidden = !space;
    $("ground").toggleAttribute("hidden", !space); // an SVG element has no such property
    if (space)
      $("dragHelp").textContent =
        "Drag to turn, wheel or pinch to zoom. Click the chart or a move to go there.";
    for (let i = 0; i < data.goal.length; i++)
      legendRow(`Particle ${i + 1}`, "spot", `distance${i}`, `var(--p${i % COLOURS})`);
    legendRow("Start", "square");
    legendRow("Goal", "ring");
    legendRow("Wall that holds", "hold");
    if (data.delta?.sets.some((rings) => rings.length)) legendRow("Δ in 2 moves", "reach");
    fillRows($("details"), [
      ["Lower bound", data.bound == null ? "none known" : figure(data.bound)],
      [
        "Tolerance",
        data.tolerance < 1e-4 ? data.tolerance.toExponential() : String(data.tolerance),
      ],
      ...(data.friction == null ? [] : [["Friction", String(data.friction)]]),
      ["Seed", String(data.seed)],
      ["Shoal", data.version],
    ]);
  }

  function legendRow(word, swatch, id = "", colour = "") {
    const row = document.createElement("div"),
      dt = document.createElement("dt"),
      dd = document.createElement("dd"),
      i = document.createElement("i");
    i.className = `swatch ${swatch}`;
    i.style.background = colour;
    dd.id = id;
    dt.append(i, word);
    row.classList.toggle("own", !!id);
    row.append(dt, dd);
    $("legend").append(row);
  }

  /** A small arrow in the direction of a move, seen from above. */
  function glyph([x, y]) {
    const turn = (-Math.atan2(y, x) * 180) / Math.PI,
      flat = Math.hypot(x, y) > 0;
    const shape = flat
      ? `<path class="stroke" transform="rotate(${turn.toFixed(1)} 12 12)" d="M4 12h15M13 6l6 6-6 6"/>`
      : `<circle cx="12" cy="12" r="3"/>`;
    return `<svg viewBox="0 0 24 24" aria-hidden="true">${shape}</svg>`;
  }

  function listMoves(track, goTo) {
    track.trajectories.forEach((trajectory, k) => {
      const item = document.createElement("li"),
        button = document.createElement("button");
      const parts = [
        ["no", String(k + 1)],
        null,
        ["by", trajectory.sent.map(signed).join("  ")],
        ["long", figure(trajectory.length)],
      ];
      button.type = "button";
      button.setAttribute(
        "aria-label",
        `Move ${k + 1}: by ${trajectory.sent.map(signed).join(", ")}, length ${figure(trajectory.length)}`,
      );
      button.innerHTML = glyph(trajectory.sent); // numbers only
      const svg = button.firstChild;
      button.append(
        ...parts.map((part) => {
          if (!part) return svg;
          const span = document.createElement("span");
          [span.className, span.textContent] = part;
          return span;
        }),
      );
      button.addEventListener("click", () => goTo(k + 1));
      item.append(button);
      $("moves").append(item);
    });
  }

  // ---- the player -------------------------------------------------------------------------------

  function play(data, track) {
    const scene = new ShoalScene.Scene($("picture"), track, data);
    const delta = data.delta ? new ShoalScene.Delta($("delta"), track, data.delta) : null;
    const chart = new ShoalTrack.Chart($("chart"), track);
    const { view, space } = scene;
    let time = 0,
      until = track.seconds; // playing stops there: at the end, or of a single move
    let playing = false,
      clock = 0,
      speed = 1,
      pending = 0,
      resized = false;
    let colours = {},
      current = -1;

    // ---- drawing: at most once a frame ----

    function redraw() {
      pending ||= requestAnimationFrame(frame);
    }

    function frame(now) {
      pending = 0;
      if (playing) advance(now);
      if (ShoalDesk.isLaidOut()) draw();
      if (playing) redraw();
    }

    function draw() {
      if (resized) resize(); // with what is drawn below, as a canvas of another size is blank
      const moment = track.momentAt(time);
      scene.draw(moment, colours);
      delta?.draw(moment, colours);
      chart.draw(time, colours);
      drawCommand(moment);
    }

    function advance(now) {
      // after a hidden tab, no leap
      const next = time + (Math.max(0, Math.min(now - clock, 100)) / 1000) * speed;
      clock = now;
      show(Math.min(next, until));
      if (time === until) pause();
    }

    // ---- moments ----

    function show(next) {
      time = ShoalTrack.clamp(next, 0, track.seconds);
      report();
      redraw();
    }

    function run(to) {
      if (time >= to) return;
      until = to;
      playing = true;
      clock = performance.now();
      reportPlaying();
      redraw();
    }

    function play() {
      if (playing || !track.moves) return;
      if (time === track.seconds) show(0);
      run(track.seconds);
    }

    function pause() {
      if (!playing) return;
      playing = false;
      until = track.seconds;
      reportPlaying();
    }

    function goTo(done) {
      pause();
      show(track.timeOf(ShoalTrack.clamp(done, 0, track.moves)));
    }

    /** One move forward is shown moving; pressed again it is over at once. All other steps are
     *  leaps. */
    function stepBy(n) {
      const { move, share } = track.momentAt(time),
        done = track.doneAt(time);
      if (n !== 1 || calm.matches) {
        const here = n < 0 && share > 0 && share < 1 ? done + 1 : done;
        goTo(here + n);
        return;
      }
      if (playing && until < track.seconds) {
        // a single move is under way
        goTo(move + (share < 1 ? 1 : 2));
        return;
      }
      pause();
      if (done >= track.moves) return show(track.seconds);
      if (share === 0 || share === 1) time = track.starts[done]; // without the rest before it
      run(
        done + 1 === track.moves
          ? track.starts[done] + track.lasting[done]
          : track.timeOf(done + 1),
      );
    }

    // ---- words and numbers ----

    function report() {
      const moment = track.momentAt(time),
        length = track.lengthAt(moment);
      // the move that is under way or just done
      const shown = time === 0 || !track.moves ? 0 : moment.move + 1;
      $("move").textContent = number(shown);
      $("length").textContent = `length ${figure(length)}`;
      $("bar").style.transform = `scaleX(${data.length ? length / data.length : 0})`;
      track.distances(track.pointsAt(moment)).forEach((value, i) => {
        $(`distance${i}`).textContent = value <= data.tolerance ? "at its goal" : figure(value);
      });
      $("scrub").value = Math.round(1000 * time);
      $("scrub").style.setProperty("--done", time / track.seconds);
      if (shown !== current) mark(shown);
      if (!playing) announce();
    }

    function mark(shown) {
      $("moves").children[current - 1]?.firstChild.removeAttribute("aria-current");
      current = shown;
      const button = $("moves").children[shown - 1]?.firstChild,
        list = $("moves");
      if (!button) return;
      button.setAttribute("aria-current", "step");
      const row = button.getBoundingClientRect(),
        box = list.getBoundingClientRect();
      if (row.top < box.top) list.scrollTop += row.top - box.top;
      else if (row.bottom > box.bottom) list.scrollTop += row.bottom - box.bottom;
    }

    function caption(x = null) {
      if (x === null) {
        $("hover").textContent = `farthest ${figure(chart.highest)}`;
        return;
      }
      const moment = track.momentAt(chart.timeAt(x));
      const values = track.distances(track.pointsAt(moment)).map(figure);
      $("hover").textContent =
        `move ${track.moves ? moment.move + 1 : 0}: ${values.slice(0, 4).join(", ")}${values.length > 4 ? " …" : ""}`;
    }

    function announce() {
      const words = `${track.doneAt(time)} of ${track.moves} moves done`;
      ShoalDesk.announce(
        words,
        `The workspace with ${track.start.length} particles, ${words}`,
        () => playing,
      );
    }

    const reportPlaying = () => ShoalDesk.reportPlaying(playing, announce);

    /** The dial: the present command, its length in proportion to the longest; in space as the
     *  camera sees it. */
    function drawCommand({ move }) {
      const trajectory = track.trajectories[move],
        on = !!trajectory && time > 0 && trajectory.length > 0;
      $("arrow").toggleAttribute("hidden", !on);
      $("compass").setAttribute(
        "aria-label",
        on ? `Command: ${trajectory.sent.map(signed).join(", ")}` : "No command yet",
      );
      if (space) $("ground").setAttribute("ry", (27 * Math.sin(view.elevation)).toFixed(1));
      if (!on) return;
      const reach = 27 * (0.35 + 0.65 * (trajectory.length / track.longest)),
        unit = trajectory.sent.map((x) => x / trajectory.length);
      const seen = space ? view.direction(unit) : unit;
      const tip = [32 + reach * seen[0], 32 - reach * seen[1]],
        tail = space ? [32, 32] : [64 - tip[0], 64 - tip[1]];
      const long = Math.hypot(tip[0] - tail[0], tip[1] - tail[1]) || 1e-9,
        head = Math.min(13, long);
      const along = [(tip[0] - tail[0]) / long, (tip[1] - tail[1]) / long],
        foot = tip.map((x, i) => x - head * along[i]);
      const point = (x) => x.map((part) => part.toFixed(2)).join(" ");
      $("shaft").setAttribute(
        "d",
        `M${point(tail)}L${point(foot.map((x, i) => x + 0.2 * head * along[i]))}`,
      );
      const side = [-0.5 * head * along[1], 0.5 * head * along[0]];
      $("point").setAttribute(
        "d",
        `M${point(tip)}L${point(foot.map((x, i) => x + side[i]))}L${point(foot.map((x, i) => x - side[i]))}Z`,
      );
      const below = space ? view.direction([unit[0], unit[1], 0]) : null;
      $("fall").setAttribute(
        "d",
        below ? `M${point(tip)}L${point([32 + reach * below[0], 32 - reach * below[1]])}` : "",
      );
    }

    // ---- colours, sizes, view ----

    function setTheme(theme) {
      const read = ShoalDesk.wearTheme(theme);
      const css = (name) => `rgb(${read(name).join(" ")})`;
      const particles = Array.from({ length: COLOURS }, (_, i) => css(`p${i}`));
      colours = {
        particle: (i) => particles[i % COLOURS],
        onParticle: css("on-particle"),
        floor: css("floor"),
        hollow: css("floor"),
        block: css("block"),
        wall: css("wall"),
        shadow: css("shadow"),
        reach: css("reach"),
        faint: css("soft"),
        axis: css("line"),
        cursor: css("ink"),
        surface: css("page"),
      };
      redraw();
    }

    function resize() {
      resized = false;
      ShoalDesk.resize([
        [scene, "stage"],
        [delta, "deltaStage"],
        [chart, "chart"],
      ]);
      reportView();
    }

    const { reportView, moveView } = ShoalDesk.handleView(scene, redraw, space);
    const turn = (x, y) =>
      space &&
      moveView(() => {
        view.azimuth -= x * STEP;
        view.elevation = ShoalTrack.clamp(view.elevation + y * STEP, 0.04, 1.5);
      });

    // ---- hands ----

    function listen() {
      const setSpeed = ShoalDesk.listen({
        isPlaying: () => playing,
        play,
        pause,
        setTheme,
        stepBy,
        first: () => goTo(0),
        last: () => goTo(Infinity),
        fit: () => moveView(() => view.fit()),
        speeds: SPEEDS,
        label: (rate) => `× ${rate}`,
        onSpeed: (rate) => {
          speed = rate;
        },
        keys: space
          ? { j: () => turn(-1, 0), l: () => turn(1, 0), i: () => turn(0, 1), k: () => turn(0, -1) }
          : {},
      });
      setSpeed(speed);
      $("scrub").addEventListener("input", () => {
        pause();
        show(Number($("scrub").value) / 1000);
      });
      ShoalHands.seekOn(
        $("chart"),
        (x) => {
          pause();
          show(chart.timeAt(x));
        },
        caption,
      );
      ShoalDesk.watchSizes(["stage", "deltaStage", "chart"], () => {
        resized = true;
        redraw();
      });
    }

    describe(data, track);
    listMoves(track, goTo);
    $("scrub").max = Math.round(1000 * track.seconds);
    listen();
    ShoalDesk.followTheme(setTheme);
    resize();
    caption();
    report();
    return {
      length: track.moves,
      play,
      pause,
      seek: goTo,
      setTheme,
      get done() {
        return track.doneAt(time);
      },
      get time() {
        return time;
      },
      get playing() {
        return playing;
      },
      get points() {
        return track.pointsAt(track.momentAt(time));
      },
      get held() {
        return track.heldAt(track.momentAt(time));
      },
      get view() {
        return space
          ? { azimuth: view.azimuth, elevation: view.elevation, zoom: view.zoom }
          : { zoom: view.zoom };
      },
    };
  }

  ShoalDesk.open((data) => new ShoalTrack.Track(data), play);
})();
