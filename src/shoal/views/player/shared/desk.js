/* The desk: what the players of all parts share. Buttons, keys, the speed, the theme, the words
 * about the episode. */
"use strict";

const ShoalDesk = (() => {
  const $ = (id) => document.getElementById(id);
  const number = (n) => n.toLocaleString("en-GB");
  /** Digits of a number as Python writes them: a tie goes to the even one, where JavaScript takes
   *  the larger. `exact` has more digits than a tie. The studio's modules, which no player loads,
   *  have the same in page.js. */
  const evenly = (text, exact) => {
    const [digits, more] = [text, exact].map((one) => one.split("e")[0].replace(/[^0-9]/g, ""));
    const tie = /^50*$/.test(more.slice(digits.length)),
      last = text.split("e")[0].length - 1;
    return tie && Number(digits.at(-1)) % 2
      ? `${text.slice(0, last)}${Number(digits.at(-1)) - 1}${text.slice(last + 1)}`
      : text;
  };
  const precise = (x, digits) => evenly(x.toPrecision(digits), x.toPrecision(digits + 30));
  const fixed = (x, decimals) => evenly(x.toFixed(decimals), x.toFixed(decimals + 30));
  const plural = (n, word) => `${number(n)} ${word}${n === 1 ? "" : "s"}`;
  const shapeText = (shape) =>
    shape.map((n, i) => plural(n, ["layer", "row", "column"].at(i - shape.length))).join(" × ");

  function fail(sentence) {
    $("player").hidden = true;
    $("problem").hidden = false;
    $("problem").textContent = `This film cannot be shown. ${sentence}`;
  }

  /** Play the episode that the page has; the page of a server has none, and is given one, or
   *  another one, by `shoalOpen`. */
  function open(read, play) {
    const show = (data) => {
      try {
        const episode = read(data);
        $("player").hidden = false;
        window.shoalPlayer = play(data, episode);
      } catch (error) {
        fail(error.sentence ?? "Its data is damaged.");
        if (!error.sentence) throw error;
      }
    };
    const text = $("data").textContent;
    if (!text) {
      window.shoalOpen = show;
      return;
    }
    let data;
    try {
      data = JSON.parse(text);
    } catch {
      fail("Its data is not valid JSON.");
      return;
    }
    show(data);
  }

  function fillRows(list, rows) {
    for (const [term, value] of rows) {
      const row = document.createElement("div"),
        dt = document.createElement("dt"),
        dd = document.createElement("dd");
      dt.textContent = term;
      dd.textContent = value;
      row.append(dt, dd);
      list.append(row);
    }
  }

  /** Facts below the title; what the title says is not said again. */
  function showFacts(facts) {
    const said = $("title").textContent.toLowerCase();
    $("facts").replaceChildren(
      ...facts
        .filter((fact) => fact && !said.includes(fact.toLowerCase()))
        .map((fact) => {
          const span = document.createElement("span");
          span.textContent = fact;
          return span;
        }),
    );
  }

  function openKeys() {
    if (!$("keys").open) $("keys").showModal();
  }

  /** Connect buttons, keys, the speed and the theme with a player. Arrows step by one, with
   *  Shift by ten. `player` has isPlaying(), play(), pause(), stepBy(n), first(), last(), fit(),
   *  setTheme(theme), onSpeed(speed, byHand), label(speed), `speeds`, and may have `keys` of its
   *  own. Return the function that sets the speed. */
  function listen(player) {
    const { speeds, stepBy, fit } = player;
    let speed = speeds[0];
    const setSpeed = (next, byHand = false) => {
      speed = next;
      $("speed").value = next;
      player.onSpeed(next, byHand);
    };
    const change = (by) => () =>
      setSpeed(speeds[Math.max(0, Math.min(speeds.length - 1, speeds.indexOf(speed) + by))], true);
    const play = () => (player.isPlaying() ? player.pause() : player.play());
    const theme = () =>
      player.setTheme(document.documentElement.dataset.theme === "dark" ? "light" : "dark");
    const actions = {
      play,
      theme,
      help: openKeys,
      fit,
      first: player.first,
      last: player.last,
      back: () => stepBy(-1),
      forward: () => stepBy(1),
    };
    const keys = {
      " ": play,
      Home: player.first,
      End: player.last,
      "+": change(1),
      "=": change(1),
      "-": change(-1),
      _: change(-1),
      d: theme,
      f: fit,
      "?": openKeys,
      ...player.keys,
    };
    listenToSpeed(speeds, player.label, (next) => setSpeed(next, true));
    for (const [id, action] of Object.entries(actions)) {
      $(id).addEventListener("click", action);
      // A mouse click leaves the focus where it was, so Space goes on meaning play or pause.
      $(id).addEventListener("mousedown", (event) => event.preventDefault());
    }
    document.addEventListener("keydown", (event) => {
      if (event.ctrlKey || event.metaKey || event.altKey || $("keys").open) return;
      const { key, target } = event,
        arrow = { ArrowLeft: -1, ArrowRight: 1 }[key];
      if (target.tagName === "SELECT") return; // it has its own use for these keys
      // a focused button is pressed by Space
      if (key === " " && target.tagName === "BUTTON") return;
      const action = arrow
        ? () => stepBy(arrow * (event.shiftKey ? 10 : 1))
        : keys[key.length === 1 ? key.toLowerCase() : key];
      if (!action) return;
      event.preventDefault(); // else the scrub bar would move as well
      action();
    });
    return setSpeed;
  }

  /** Zoom and pan the view of a scene. Return a function that shows the state of the view, and
   *  one that changes the view. */
  function handleView(scene, redraw, turns = false) {
    const { view } = scene;
    const reportView = () => {
      $("fit").hidden = !view.moved;
      $("stage").classList.toggle("zoomed", view.zoom > 1);
      redraw();
    };
    const moveView = (change) => {
      change();
      reportView();
    };
    ShoalHands.zoomOn($("picture"), {
      zoom: (factor, x, y) => moveView(() => view.zoomAt(factor, x * scene.ratio, y * scene.ratio)),
      pan: (x, y) => moveView(() => view.drag(x * scene.ratio, y * scene.ratio)),
      zoomed: () => turns || view.zoom > 1,
      held: (on) => $("stage").classList.toggle("dragged", on),
    });
    return { reportView, moveView };
  }

  /** Give each drawing the size of its box; pairs of a drawing, which may be null, and the id of
   *  the box. A drawing gets `ratio`, the pixels of the screen in a CSS pixel, and `unit`, a
   *  sixteenth of the text size; its resize(rem) does the rest, with `rem` in CSS pixels. */
  function resize(drawings) {
    const ratio = window.devicePixelRatio || 1,
      rem = parseFloat(getComputedStyle(document.documentElement).fontSize);
    for (const [drawn, box] of drawings.filter(([one]) => one)) {
      drawn.canvas.width = Math.max(1, Math.round($(box).clientWidth * ratio));
      drawn.canvas.height = Math.max(1, Math.round($(box).clientHeight * ratio));
      drawn.ratio = ratio;
      drawn.unit = (ratio * rem) / 16;
      drawn.resize(rem, $(box).clientWidth);
    }
  }

  /** Whether the page is laid out. In a frame that is hidden it is not: there, Firefox refuses to
   *  write on a canvas. */
  const isLaidOut = () => $("stage").clientWidth > 0;

  /** Call a function whenever one of some boxes (by id) changes its size. */
  function watchSizes(boxes, changed) {
    const sizes = new ResizeObserver(changed);
    for (const box of boxes) sizes.observe($(box));
  }

  /** Show whether the page plays. While it is paused, it announces the moment. */
  function reportPlaying(playing, announce) {
    $("player").classList.toggle("playing", playing);
    $("play").setAttribute("aria-label", playing ? "Pause" : "Play");
    if (playing) $("live").textContent = "";
    else announce();
  }

  let speaking = 0;
  /** Describe the moment and the picture for a screen reader, which reads the moment aloud
   *  unless the page plays by then. */
  function announce(moment, picture, isPlaying) {
    $("scrub").setAttribute("aria-valuetext", moment);
    $("picture").setAttribute("aria-label", picture);
    clearTimeout(speaking); // a drag should be read out once, where it ends
    speaking = setTimeout(() => {
      if (!isPlaying()) $("live").textContent = moment;
    }, 300);
  }

  function listenToSpeed(speeds, label, choose) {
    const select = $("speed");
    let byPointer = false;
    select.append(...speeds.map((speed) => new Option(label(speed), speed)));
    select.addEventListener("pointerdown", () => {
      byPointer = true;
    });
    select.addEventListener("keydown", () => {
      byPointer = false;
    });
    select.addEventListener("change", () => {
      choose(Number(select.value));
      if (byPointer) select.blur(); // so the keys play again
    });
  }

  /** Put a theme on; return a function that reads a colour of it, as [r, g, b]. */
  function wearTheme(theme) {
    document.documentElement.dataset.theme = theme;
    $("theme").setAttribute("aria-pressed", theme === "dark");
    const style = getComputedStyle(document.documentElement);
    return (name) => {
      const hex = style.getPropertyValue(`--${name}`).trim();
      return [1, 3, 5].map((i) => parseInt(hex.slice(i, i + 2), 16));
    };
  }

  /** Set the theme that the system has, now and whenever it changes. */
  function followTheme(setTheme) {
    const dark = matchMedia("(prefers-color-scheme: dark)");
    dark.addEventListener("change", (event) => setTheme(event.matches ? "dark" : "light"));
    setTheme(dark.matches ? "dark" : "light");
  }

  return {
    $,
    number,
    precise,
    fixed,
    plural,
    shapeText,
    open,
    fillRows,
    showFacts,
    listen,
    handleView,
    resize,
    isLaidOut,
    watchSizes,
    reportPlaying,
    announce,
    wearTheme,
    followTheme,
  };
})();
