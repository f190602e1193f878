/* The desk: what the players of all parts share. Buttons, keys, the speed, the theme, the words about the episode. */
"use strict";

const ShoalDesk = (() => {
  const $ = (id) => document.getElementById(id);
  const number = (n) => n.toLocaleString("en-GB");
  const plural = (n, word) => `${number(n)} ${word}${n === 1 ? "" : "s"}`;

  function fail(sentence) {
    $("player").hidden = true;
    $("problem").hidden = false;
    $("problem").textContent = `This film cannot be shown. ${sentence}`;
  }

  /** Play the episode that the page has; the page of a server has none, and is given one, or another one, by `shoalOpen`. */
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
      const row = document.createElement("div"), dt = document.createElement("dt"), dd = document.createElement("dd");
      dt.textContent = term;
      dd.textContent = value;
      row.append(dt, dd);
      list.append(row);
    }
  }

  /** Facts below the title; what the title says is not said again. */
  function showFacts(facts) {
    const said = $("title").textContent.toLowerCase();
    $("facts").replaceChildren(...facts.filter((fact) => fact && !said.includes(fact.toLowerCase())).map((fact) => {
      const span = document.createElement("span");
      span.textContent = fact;
      return span;
    }));
  }

  function openKeys() {
    if (!$("keys").open) $("keys").showModal();
  }

  /** Have each button do its action (by id), and each key; arrows step by one, with Shift by ten. */
  function listen(actions, keys, stepBy) {
    for (const [id, action] of Object.entries(actions)) {
      $(id).addEventListener("click", action);
      // A mouse click leaves the focus where it was, so Space goes on meaning play or pause.
      $(id).addEventListener("mousedown", (event) => event.preventDefault());
    }
    document.addEventListener("keydown", (event) => {
      if (event.ctrlKey || event.metaKey || event.altKey || $("keys").open) return;
      const { key, target } = event, arrow = { ArrowLeft: -1, ArrowRight: 1 }[key];
      if (target.tagName === "SELECT") return; // it has its own use for these keys
      if (key === " " && target.tagName === "BUTTON") return; // a focused button is pressed by Space
      const action = arrow ? () => stepBy(arrow * (event.shiftKey ? 10 : 1)) : keys[key.length === 1 ? key.toLowerCase() : key];
      if (!action) return;
      event.preventDefault(); // else the scrub bar would move as well
      action();
    });
  }

  function listenToSpeed(speeds, label, choose) {
    const select = $("speed");
    let byPointer = false;
    select.append(...speeds.map((speed) => new Option(label(speed), speed)));
    select.addEventListener("pointerdown", () => { byPointer = true; });
    select.addEventListener("keydown", () => { byPointer = false; });
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

  return { $, number, plural, open, fillRows, showFacts, openKeys, listen, listenToSpeed, wearTheme, followTheme };
})();
