/* The page of a search: what buttons, keys and pointers do, and what is shown at each moment. */
"use strict";

(() => {
  const SPEEDS = [0.25, 0.5, 1, 2, 4, 8];
  const PACE = 8,
    SHORTEST = 4,
    LONGEST = 30; // cells a second at speed 1, but so many seconds in all
  const COLOURS = 12; // of robots; then they come again

  const { $, fillRows, fixed, number, plural, precise } = ShoalDesk;
  const STATES = {
    listening: "listening",
    own: "searching",
    waiting: "waiting",
    paused: "paused",
    dead: "dead",
    complete: "knows all is searched",
  };
  const lasting = (seconds) => {
    if (seconds < 59.5) return `${Number(precise(seconds, 3))} s`;
    const whole = Number(fixed(seconds, 0)),
      two = (n) => String(n).padStart(2, "0");
    return `${Math.floor(whole / 3600)}:${two(Math.floor(whole / 60) % 60)}:${two(whole % 60)}`;
  };
  const wordOf = ({ kind, other }, liar) =>
    kind === "taken"
      ? `in the part of ${other}`
      : liar && kind === "own"
        ? "says it searches"
        : STATES[kind];

  // ---- what does not change ---------------------------------------------------------------------

  function describe(history) {
    $("title").textContent = history.title;
    ShoalDesk.showFacts([
      plural(history.cells, "cell"),
      `tour ${history.tour}`,
      history.takeovers ? `${history.takeovers} taken over` : "",
      history.covered == null
        ? "not searched wholly"
        : `searched after ${lasting(history.climb + history.covered * history.cellTime)}`,
    ]);
    $("of").textContent = `of ${plural(history.cells, "cell")}`;
    $("player").style.setProperty("--rows", history.robots.length);
    for (const [id, words, key] of [
      ["first", "Start", "Home"],
      ["last", "End", "End"],
    ]) {
      $(id).setAttribute("aria-label", words);
      $(id).title = `${words} (${key})`;
    }
    $("robots").classList.toggle("few", history.robots.length <= 7);
    $("robots").classList.toggle("many", history.robots.length > 14);
    $("legend").innerHTML = [
      ["start", "start"],
      ...(history.robots.some((robot) => robot.activities.some((one) => one.kind === "dead"))
        ? [["dead", "died"]]
        : []),
      ...(history.takeovers ? [["taken", "another’s part"]] : []),
      ...(history.findings.length ? [["finding", "finding"]] : []),
      ...(history.heat ? [["heat", "target likely"]] : []),
      ...(history.obstacles.length ? [["obstacle", "obstacle"]] : []),
      ["ahead", "way ahead, of the robot followed"],
    ]
      .map(([sign, words]) => `<li><i class="sign-${sign}" aria-hidden="true"></i>${words}</li>`)
      .join("");
    fillRows($("details"), [
      ["Findings", ""],
      ...(history.success[0].length ? [["Probability of success", ""]] : []),
      ...(history.obstacles.length ? [["Obstacles met", number(history.obstacles.length)]] : []),
      ["Side of a cell", history.cellSize],
      ["Allocation", history.allocation],
      ["Seed", String(history.seed)],
      ["Shoal", history.version],
    ]);
  }

  function listRobots(history, choose) {
    return history.robots.map((robot, k) => {
      const item = document.createElement("li"),
        button = document.createElement("button");
      button.type = "button";
      button.setAttribute("aria-pressed", "false");
      button.style.setProperty("--own", `var(--r${k % COLOURS})`);
      const [no, state, done] = ["no", "state", "done"].map((name) => {
        const span = document.createElement("span");
        span.className = name;
        button.append(span);
        return span;
      });
      no.textContent = k + 1;
      const way = document.createElement("span"),
        bar = document.createElement("i");
      way.className = "way";
      way.append(bar);
      button.append(way);
      button.addEventListener("click", () => choose(k));
      item.append(button);
      $("robots").append(item);
      return { button, state, done, bar, told: "" };
    });
  }

  // ---- the player -------------------------------------------------------------------------------

  function play(history) {
    const scene = new ShoalSearch.Scene($("picture"), history),
      rows = new ShoalSearch.Rows($("chart"), history),
      { view } = scene;
    // cells a second
    const rate = history.end / ShoalTrack.clamp(history.end / PACE, SHORTEST, LONGEST);
    let time = 0,
      playing = false,
      clock = 0,
      speed = 1,
      pending = 0,
      resized = false,
      colours = {};

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
      scene.draw(time, colours);
      rows.draw(time, colours);
    }

    function advance(now) {
      // after a hidden tab, no leap
      const next = time + (Math.max(0, Math.min(now - clock, 100)) / 1000) * speed * rate;
      clock = now;
      show(next);
      if (time === history.end) pause();
    }

    function show(next) {
      time = ShoalTrack.clamp(next, 0, history.end);
      report();
      redraw();
    }

    function play() {
      if (playing) return;
      if (time === history.end) show(0);
      playing = true;
      clock = performance.now();
      reportPlaying();
      redraw();
    }

    function pause() {
      if (!playing) return;
      playing = false;
      reportPlaying();
    }

    function goTo(next) {
      pause();
      show(next);
    }

    // ---- words and numbers ----

    const list = listRobots(history, choose);

    function report() {
      const done = history.searchedAt(time);
      $("searched").textContent = number(done);
      $("bar").style.transform = `scaleX(${done / history.cells})`;
      const seconds = history.climb + time * history.cellTime;
      $("clock").textContent =
        `${lasting(seconds)} of ${lasting(history.climb + history.end * history.cellTime)}`;
      const found = `${number(history.foundAt(time))} of ${number(history.findings.length)}`,
        cell = $("details").querySelector("dd");
      if (cell.textContent !== found) cell.textContent = found;
      if (history.success[0].length)
        $("details").querySelectorAll("dd")[1].textContent =
          `${Math.round(100 * history.successAt(time))} %`;
      $("scrub").value = Math.round(1000 * time);
      $("scrub").style.setProperty("--done", time / history.end);
      history.robots.forEach((robot, k) => reportRobot(robot, list[k]));
      if (!playing) announce();
    }

    /** Only what is new is written: thirty rows are seen sixty times a second. */
    function reportRobot(robot, row) {
      const activity = robot.activityAt(time),
        done = robot.doneAt(time),
        told = `${activity.kind}${activity.other} ${done}`;
      if (told === row.told) return;
      row.told = told;
      row.state.textContent = row.button.title = wordOf(activity, robot.liar);
      row.done.textContent = number(done);
      row.bar.style.transform = `scaleX(${robot.visits.length ? done / robot.visits.length : 0})`;
      row.button.className = `is-${activity.kind}`;
    }

    function choose(k) {
      const chosen = scene.chosen === k ? -1 : k;
      scene.chosen = rows.chosen = chosen;
      list.forEach((row, i) => row.button.setAttribute("aria-pressed", String(i === chosen)));
      scene.forget();
      rows.forget();
      redraw();
    }

    function caption(x = null, y = 0) {
      if (x === null) {
        $("hover").textContent =
          history.covered == null
            ? ""
            : `all searched at ${lasting(history.climb + history.covered * history.cellTime)}`;
        return;
      }
      const at = rows.timeAt(x),
        k = rows.rowAt(y),
        robot = history.robots[k];
      $("hover").textContent =
        `${number(Math.round(at))}: robot ${k + 1} ${wordOf(robot.activityAt(at), robot.liar)}`;
    }

    function announce() {
      const words = `${number(history.searchedAt(time))} of ${plural(history.cells, "cell")} searched`;
      ShoalDesk.announce(
        words,
        `The region with ${plural(history.robots.length, "robot")}, ${words}`,
        () => playing,
      );
    }

    const reportPlaying = () => ShoalDesk.reportPlaying(playing, announce);

    // ---- colours, sizes, view ----

    function setTheme(theme) {
      const read = ShoalDesk.wearTheme(theme),
        css = (name) => `rgb(${read(name).join(" ")})`;
      const own = Array.from({ length: COLOURS }, (_, i) => read(`r${i}`)),
        text = own.map((colour) => `rgb(${colour.join(" ")})`);
      colours = {
        robot: (k) => own[k % COLOURS],
        robotText: (k) => text[k % COLOURS],
        floor: read("floor"),
        floorText: css("floor"),
        onRobot: css("on-robot"),
        wall: css("wall"),
        wait: css("wait"),
        found: css("found"),
        hot: read("heat"),
        ink: css("ink"),
        veil: `rgb(${read("page").join(" ")} / .62)`,
      };
      scene.forget();
      rows.forget();
      redraw();
    }

    function resize() {
      resized = false;
      ShoalDesk.resize([
        [scene, "stage"],
        [rows, "chart"],
      ]);
      reportView();
    }

    // ---- hands ----

    const { reportView, moveView } = ShoalDesk.handleView(scene, redraw);

    function listen() {
      const setSpeed = ShoalDesk.listen({
        isPlaying: () => playing,
        play,
        pause,
        setTheme,
        first: () => goTo(0),
        last: () => goTo(Infinity),
        stepBy: (n) => goTo(n > 0 ? Math.floor(time + 1e-9) + n : Math.ceil(time - 1e-9) + n),
        fit: () => moveView(() => view.fit()),
        speeds: SPEEDS,
        label: (by) => `× ${by}`,
        onSpeed: (next) => {
          speed = next;
        },
      });
      setSpeed(speed);
      $("scrub").addEventListener("input", () => goTo(Number($("scrub").value) / 1000));
      let level = 0;
      $("chart").addEventListener(
        "pointermove",
        (event) => {
          level = event.clientY - $("chart").getBoundingClientRect().top;
        },
        true,
      );
      ShoalHands.seekOn(
        $("chart"),
        (x) => goTo(rows.timeAt(x)),
        (x) => caption(x, level),
      );
      let pressed = [0, 0];
      $("picture").addEventListener("pointerdown", (event) => {
        pressed = [event.clientX, event.clientY];
      });
      $("picture").addEventListener("click", (event) => {
        // a drag
        if (Math.hypot(event.clientX - pressed[0], event.clientY - pressed[1]) > 4) return;
        const k = scene.robotAt(event.offsetX * scene.ratio, event.offsetY * scene.ratio, time);
        if (k >= 0) (player.onRobot ?? choose)(k, time);
      });
      ShoalDesk.watchSizes(["stage", "chart"], () => {
        resized = true;
        redraw();
      });
    }

    describe(history);
    $("scrub").max = Math.round(1000 * history.end);
    listen();
    ShoalDesk.followTheme(setTheme);
    resize();
    caption();
    report();
    const player = {
      length: history.end,
      play,
      pause,
      seek: goTo,
      setTheme,
      // called instead of following a robot that is clicked, with its number from 0 and the time
      onRobot: null,
      get time() {
        return time;
      },
      get playing() {
        return playing;
      },
      get searched() {
        return history.searchedAt(time);
      },
      get points() {
        return history.robots.map((robot) => robot.at(time));
      },
      get found() {
        return history.foundAt(time);
      },
      get success() {
        return history.successAt(time);
      },
      get heat() {
        return Array.from(scene.heat ?? []);
      }, // of each square, after drawNow
      get doing() {
        return history.robots.map((robot) => robot.activityAt(time).kind);
      },
      get chosen() {
        return scene.chosen;
      },
      get zoom() {
        return view.zoom;
      },
      drawNow: draw,
    };
    return player;
  }

  ShoalDesk.open(
    (data) => new ShoalSearch.History(data),
    (data, history) => play(history),
  );
})();
