/* The page: what the buttons, keys and pointers do, and what is shown after each move. */
"use strict";

(() => {
  const SPEEDS = [1, 5, 20, 60, 240, 1000]; // moves a second
  const FILM_SECONDS = 20; // the first speed is the one that comes nearest to this
  const SLICE = 12; // milliseconds of simulation between two looks at the page
  const SLIDE = 150; // milliseconds a particle takes to its next cell, if the speed leaves the time
  const SLIDES_UP_TO = 20; // moves a second; beyond, and for small cells, sliding only blurs
  const PILES = 5000; // particles beyond which sliding costs too much
  const NAMES = { l: "left", u: "up", r: "right", d: "down", i: "in", o: "out" };
  const ENDINGS = { complete: "complete", stalled: "stalled", limit: "stopped at the limit" };

  const { $, fillRows, number, plural, shapeText } = ShoalDesk;
  const calm = matchMedia("(prefers-reduced-motion: reduce)");

  // ---- what does not change ---------------------------------------------------------------------

  function describe(data, world) {
    const text = (value) => (value == null ? "" : String(value));
    const covering = world.task !== "mapping",
      gathering = world.task === "gathering";
    const ending = ENDINGS[data.status] ?? text(data.status);
    $("title").textContent = text(data.title) || text(data.map) || "Episode";
    const lost = data.unreachable ? `${plural(data.unreachable, "free cell")} out of reach` : "";
    const facts = [
      data.map,
      data.task,
      data.policy,
      plural(world.start.length, "particle"),
      ending,
      lost,
    ];
    ShoalDesk.showFacts(facts.map(text));
    $("shareWord").textContent = gathering
      ? "gathered"
      : covering
        ? "covered"
        : !world.noise
          ? "classified"
          : world.truth
            ? "right"
            : "settled";
    $("particleWord").textContent = world.seen ? "Seen at the last scan" : "Particles";
    $("frontierWord").textContent = gathering ? "To gather" : covering ? "To cover" : "Frontier";
    $("chartTitle").textContent = gathering
      ? "Cells to gather by move"
      : covering
        ? "Cells to cover by move"
        : "Frontier cells by move";
    $("unknownRow").hidden = covering;
    $("sharedRow").hidden = world.rule !== "merge";
    // an SVG element has no property hidden
    $("depth").toggleAttribute("hidden", world.shape.length === 2);
    $("dragKeys").hidden = world.shape.length === 2;
    $("wrongRow").hidden = !world.truth;
    $("rampRow").hidden = !world.noise;
    $("details").replaceChildren();
    fillRows($("details"), [
      ["Map", shapeText(world.shape)],
      ["Rule", world.rule],
      ...Object.entries(world.noise ?? {}).map(([name, rate]) => [
        name[0].toUpperCase() + name.slice(1),
        String(rate),
      ]),
      ["Seed", data.seed == null ? "none" : text(data.seed)],
      ["Shoal", text(data.version) || "unknown"],
    ]);
  }

  // ---- the player -------------------------------------------------------------------------------

  function play(data, world) {
    const timeline = new ShoalSim.Timeline(world),
      swarm = new ShoalSim.Swarm(world);
    const picture = new ShoalPicture.Picture($("picture"), timeline);
    const chart = new ShoalChart.Chart($("chart"), timeline);
    let live = !!data.live; // whether more of it is still to come
    let building = false;
    let move = 0; // the move shown
    let wanted = null; // a move asked for before it was simulated
    let playing = false,
      owed = 0,
      clock = 0; // owed: the part of a move that playing has not shown yet
    let slideStart = -Infinity,
      slideTime = 0;
    let byHand = false; // whether somebody has chosen the speed
    let speed = live ? 20 : nearest();
    let colours = {},
      pending = 0,
      resized = false,
      stale = true; // stale: the picture, not only the chart, is to be drawn

    function nearest() {
      return SPEEDS.reduce((a, b) => (distance(b) < distance(a) ? b : a));
    }

    /** How far the length of the film at some speed is from the wanted one, as a ratio. */
    function distance(rate) {
      return Math.abs(Math.log(Math.max(1, timeline.length) / rate / FILM_SECONDS));
    }

    // ---- drawing: at most once a frame ----

    function redraw(picture = true) {
      stale ||= picture;
      pending ||= requestAnimationFrame(frame);
    }

    function frame(now) {
      pending = 0;
      if (playing) advance(now);
      if (ShoalDesk.isLaidOut()) draw();
      else slideTime = 0;
      if (playing || slideTime) redraw();
    }

    function draw() {
      if (resized) resize(); // with what is drawn below, as a canvas of another size is blank
      const slide = slideTime ? Math.min(1, (performance.now() - slideStart) / slideTime) : 1;
      if (stale) picture.draw(move, swarm, 1 - (1 - slide) ** 3);
      stale = false;
      chart.draw(move, colours);
      if (slide === 1) slideTime = 0;
    }

    function advance(now) {
      // after a hidden tab, no leap
      owed += (Math.max(0, Math.min(now - clock, 100)) / 1000) * speed;
      clock = now;
      const next = Math.min(move + Math.floor(owed), timeline.done);
      owed %= 1;
      if (next > move) show(next);
      if (move === timeline.length && !live) pause();
    }

    // ---- moves ----

    function show(n) {
      if (n === move) return;
      const single =
        n === move + 1 && speed <= SLIDES_UP_TO && world.start.length <= PILES && !calm.matches;
      timeline.seek(swarm, move, n);
      move = n;
      slideTime = single && picture.size >= 4 ? Math.min(SLIDE, 700 / speed) : 0;
      slideStart = performance.now();
      report();
      redraw();
    }

    /** Go to move n; what is not simulated yet is followed as the simulation gets there. */
    function goTo(n) {
      n = Math.max(0, Math.min(timeline.length, Math.round(n)));
      wanted = n > timeline.done ? n : null;
      owed = 0;
      show(Math.min(n, timeline.done));
    }

    function build() {
      timeline.advance(timeline.length, SLICE);
      if (wanted !== null) {
        show(Math.min(wanted, timeline.done));
        if (move === wanted) wanted = null;
      }
      caption();
      redraw(false);
      building = timeline.done < timeline.length;
      if (building) setTimeout(build);
    }

    function start() {
      if (playing || (timeline.length === 0 && !live)) return;
      if (move === timeline.length && !live) goTo(0);
      playing = true;
      clock = performance.now();
      owed = 0;
      reportPlaying();
      redraw();
    }

    function pause() {
      if (!playing) return;
      playing = false;
      reportPlaying();
    }

    function stepBy(n) {
      pause();
      goTo((wanted ?? move) + n);
    }

    // ---- words and numbers ----

    function report() {
      const letter = move ? ShoalSim.COMMANDS[world.commands[move - 1]] : null;
      $("move").textContent = number(move);
      const share = timeline.progress(move); // rounded down, so 100 % means all
      $("share").textContent =
        `${share === 1 ? "100" : (Math.floor(share * 1000) / 10).toFixed(1)} %`;
      $("bar").style.transform = `scaleX(${share})`;
      for (const name of ["frontier", "free", "obstacle"])
        $(name).textContent = number(timeline[name][move]);
      $("particles").textContent = number(
        (timeline.pointsAt?.(move) ?? { length: 2 * swarm.pos.length }).length / 2,
      );
      if (world.truth) $("wrong").textContent = number(timeline.wrong[move]);
      if (world.scanned) $("scans").textContent = number(timeline.scans[move]);
      $("compass")
        .querySelector(".ring")
        .classList.toggle("scan", !!world.scanned && (move === 0 || !!world.scanned[move - 1]));
      if (world.rule === "merge")
        $("shared").textContent = number(swarm.count.reduce((n, c) => n + (c > 1), 0));
      $("scrub").value = move;
      $("scrub").style.setProperty("--done", timeline.length ? move / timeline.length : 0);
      for (const arrow of $("compass").querySelectorAll("path"))
        arrow.classList.toggle("on", arrow.dataset.to === letter);
      $("compass").setAttribute(
        "aria-label",
        letter ? `Command: ${NAMES[letter]}` : "No command yet",
      );
      if (!playing) announce();
    }

    /** What the chart says about the point under the mouse, or else about the whole curve. */
    function caption(x = null) {
      const n = x === null ? null : chart.moveAt(x);
      $("hover").textContent =
        n === null || n > timeline.done
          ? `highest ${number(chart.findHighest())}`
          : `move ${number(n)}: ${number(timeline.frontier[n])}`;
    }

    function announce() {
      const cells = `${timeline.frontier[move]} ${$("frontierWord").textContent.toLowerCase()} cells`;
      ShoalDesk.announce(
        `Move ${move} of ${timeline.length}`,
        `The grid at move ${move}: ${cells}`,
        () => playing,
      );
    }

    const reportPlaying = () => ShoalDesk.reportPlaying(playing, announce);

    // ---- colours and sizes ----

    /** The picture takes its colours from the legend, so that the two cannot disagree. */
    function setTheme(theme) {
      const read = ShoalDesk.wearTheme(theme);
      const palette = { label: read("soft") };
      for (const name of ["unknown", "frontier", "free", "obstacle", "particle", "shared", "wrong"])
        palette[name] = read(name);
      picture.setPalette(palette);
      showLegend();
      const css = (name, alpha) => ShoalPicture.cssColour(read(name), alpha);
      colours = {
        line: css("curve"),
        faint: css("curve", 0.45),
        past: css("curve", 0.3),
        future: css("curve", 0.1),
        axis: css("line"),
        cursor: css("ink"),
        surface: css("page"),
      };
      redraw();
    }

    /** Over a photograph, the legend has the colours that the eye meets there. */
    function showLegend() {
      for (const name of ["unknown", "free", "obstacle"])
        if (picture.below)
          $("legend").style.setProperty(`--${name}`, ShoalPicture.cssColour(picture.seen(name)));
        else $("legend").style.removeProperty(`--${name}`);
    }

    function resize() {
      resized = false;
      ShoalDesk.resize([
        [picture, "stage"],
        [chart, "chart"],
      ]);
      reportZoom();
      redraw();
    }

    function reportZoom() {
      $("fit").hidden = picture.turns ? !picture.changed : picture.zoom === 1;
      $("stage").classList.toggle("zoomed", picture.zoom > 1);
      $("scaleRow").hidden = !world.spacing;
      if (!world.spacing) return;
      const pixels = picture.density / (window.devicePixelRatio || 1),
        most = 120 / pixels,
        power = 10 ** Math.floor(Math.log10(most));
      const length = [5, 2, 1].find((step) => step * power <= most) * power;
      $("scaleBar").style.width = `${length * pixels}px`;
      $("scaleWord").textContent = `${Number(length.toPrecision(1))} mm`;
    }

    function moveView(change) {
      change();
      reportZoom();
      redraw();
    }

    // ---- hands ----

    const setSpeed = ShoalDesk.listen({
      isPlaying: () => playing,
      play: start,
      pause,
      setTheme,
      stepBy,
      first: () => stepBy(-Infinity),
      last: () => stepBy(Infinity),
      fit: () => moveView(() => picture.fit()),
      speeds: SPEEDS,
      label: (rate) => `${number(rate)}/s`,
      onSpeed: (rate, chosen) => {
        speed = rate;
        byHand ||= chosen;
      },
    });

    function listen() {
      $("scrub").addEventListener("input", () => {
        pause();
        goTo(Number($("scrub").value));
      });
      ShoalHands.seekOn(
        $("chart"),
        (x) => {
          pause();
          goTo(chart.moveAt(x));
        },
        (x) => caption(x),
      );
      if ($("where")) placesUnderPointer(); // of a plane map
      ShoalHands.zoomOn($("picture"), {
        zoom: (factor, x, y) => moveView(() => picture.zoomAt(factor, x, y)),
        pan: (x, y) => moveView(() => picture.panBy(x, y)),
        zoomed: () => picture.turns || picture.zoom > 1,
        held: (on) => $("stage").classList.toggle("dragged", on),
      });
      ShoalDesk.watchSizes(["stage", "chart"], () => {
        resized = true;
        redraw();
      });
    }

    /** Say which cell is under the pointer, and where it is if the size of a cell is known. */
    function placesUnderPointer() {
      const canvas = $("picture"),
        where = $("where");
      canvas.addEventListener("pointermove", ({ offsetX, offsetY }) => {
        const cell = picture.cellAt(offsetX * picture.ratio, offsetY * picture.ratio);
        const metric =
          cell && world.spacing
            ? `, ${cell.map((at, axis) => ((at + 0.5) * world.spacing.at(axis - 2)).toPrecision(4)).join(", ")} mm`
            : "";
        where.textContent = cell ? `row ${cell[0]}, column ${cell[1]}${metric}` : "";
        where.hidden = !cell;
      });
      canvas.addEventListener("pointerleave", () => {
        where.hidden = true;
      });
    }

    function snapshot() {
      const cells = new Set(Array.from(swarm.pos, (cell) => ShoalSim.flatIndex(world, cell))),
        points = timeline.pointsAt?.(move);
      return {
        ...(world.noise && { wrong: timeline.wrong[move] }),
        scans: timeline.scans[move],
        frontier: timeline.frontier[move],
        free: timeline.free[move],
        obstacle: timeline.obstacle[move],
        ...(points && { points: [...points] }),
        particles: points ? points.length / 2 : world.start.length,
        cells: [...cells].sort((a, b) => a - b),
      };
    }

    /** Say how long the episode is, which may grow. */
    function reportLength() {
      $("of").textContent = live ? "" : `of ${number(timeline.length)}`;
      $("scrub").max = timeline.length;
      $("scansRow").hidden = !world.scanned;
    }

    /** Take in moves that have just been played elsewhere. */
    function grow(letters, scans) {
      timeline.grow(letters, scans);
      if (!byHand) setSpeed(Math.max(20, nearest()));
      reportLength();
      report();
      if (!building) build();
    }

    /** The last move has come. */
    function end(status, unreachable = 0) {
      live = false;
      describe({ ...data, status, unreachable }, world);
      reportLength();
      if (calm.matches) goTo(timeline.length);
      redraw();
    }

    describe(data, world);
    reportLength();
    listen();
    setSpeed(speed);
    ShoalDesk.followTheme(setTheme);
    resize();
    report();
    build();
    if (data.playing) {
      if (calm.matches) goTo(timeline.length);
      else start();
    }
    return {
      play: start,
      pause,
      snapshot,
      grow,
      end,
      setTheme,
      timeline,
      swarm,
      picture,
      redraw,
      /** Show a photograph under the map: see Picture; a volume has none. */
      setBelow(below) {
        picture.setBelow?.(below);
        showLegend();
        redraw();
      },
      lookAt: (view) => moveView(() => picture.lookAt?.(view)),
      stepBy,
      goTo,
      get length() {
        return timeline.length;
      },
      get move() {
        return move;
      },
      get playing() {
        return playing;
      },
      get built() {
        return timeline.done;
      }, // the moves simulated so far
      /** Unlike the scrub bar, this waits for the simulation. */
      seek(n) {
        timeline.advance(n);
        goTo(n);
      },
    };
  }

  ShoalDesk.open(ShoalSim.readWorld, play);
})();
