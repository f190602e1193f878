/* Simulate: the run in the player; message loss on a slider, and robots that die by a click while
   it plays. */
import { ask, newest, run } from "../../shared/api.js";
import {
  el,
  fixed,
  guarded,
  number,
  percent,
  precise,
  progressText,
  say,
} from "../../shared/page.js";
import { PlayerFrame } from "../../shared/player.js";
import { exports, sayFailed } from "../../shared/share.js";
import { dated } from "../../shared/store.js";

const CRASH = /^crash:(\d+)@([\d.]+)$/;
export const lasting = (seconds) => {
  const whole = Number(fixed(seconds, 0)),
    two = (n) => String(n).padStart(2, "0");
  return seconds < 59.5
    ? `${Number(precise(seconds, 3))} s`
    : `${Math.floor(whole / 3600) ? `${Math.floor(whole / 3600)}:` : ""}${whole >= 3600 ? two(Math.floor(whole / 60) % 60) : Math.floor(whole / 60)}:${two(whole % 60)}${whole < 3600 ? " min" : " h"}`;
};

/** `question()` is what is simulated: the problem with its drawing, missions and seed; `ready()`
 *  gives the problem as it is run, with the drawing in a file, and `lacking()` says what there must
 *  be before;
 *  `set(fields)` writes fields of the form; `open()` shows this panel, `visible()` tells whether it
 *  is shown, and `said()` what is said
 *  to be wrong already. */
export function simulation({ ready, lacking, question, fields, set, open, visible, said, store }) {
  const frame = new PlayerFrame("search", { title: "The player of the search" });
  const loss = el("input", {
      type: "range",
      min: 0,
      max: 0.95,
      step: 0.05,
      value: 0,
      id: "searchLoss",
    }),
    lossWord = el("output", { htmlFor: "searchLoss" }, "0 %");
  const result = el("div.result", {}),
    faults = el("div.faults", {}),
    robots = el("div.group.deaths", { role: "group", "aria-label": "Let a robot die now" });
  const word = el("p.soft", { role: "status" }),
    bar = el("progress", { max: 1, hidden: true, "aria-label": "Done" });
  const keep = el(
    "button.second.keep",
    { type: "button", hidden: true, onclick: guarded(play) },
    "Keep this run",
  );
  const go = el("button.main", { type: "button", onclick: guarded(play) }, "Simulate");
  const empty = el(
    "p.empty",
    {},
    "Press Simulate to watch the robots search here. During the search, you can make messages fail and robots die.",
  );
  let film = null; // of the film: its file, if it was kept, and what is said of it
  let runs = 0,
    running = false; // what was asked for before a run is not shown after it

  const crashes = () => [fields().faults ?? []].flat();
  const nowText = () => JSON.stringify(question());
  const same = () => dates.of === nowText();
  /** What was played before a change is not exported as if it were of the settings now. */
  const dates = dated(nowText, frame.element, (fresh) => {
    keep.hidden = !fresh || !!film.file;
    result.replaceChildren(
      ...(fresh
        ? film.words()
        : [
            el(
              "p.warning",
              {},
              "The settings have changed: the film shows the search before the change.",
            ),
          ]),
    );
  });
  function date(told, of) {
    film = told;
    store.look({ simulated: { file: told.file, of } });
    dates.is(of);
  }
  const kept = (file, sentence) => ({ file, words: () => [el("p", {}, sentence), exports(file)] });

  async function show(data, { at = 0, playing = true }) {
    const inside = await frame.open(data),
      player = inside.shoalPlayer;
    if (!player) throw new Error("The search cannot be shown: it is too large for a browser.");
    player.onRobot = (k) => guarded(die)(k);
    if (at) player.seek(at);
    if (playing) player.play();
    robots.replaceChildren(
      el("span.soft", {}, "Dies now:"),
      ...data.robots.map((_, k) =>
        el(
          "button.chip.death",
          {
            type: "button",
            class: `chip death r${k % 12}`,
            "aria-label": `Robot ${k + 1} dies now`,
            onclick: guarded(() => die(k)),
          },
          String(k + 1),
        ),
      ),
    );
    drawFaults(data.cellTime, data.climb);
  }

  function drawFaults(cell, climb) {
    faults.replaceChildren(
      ...crashes().map((text, k) => {
        const [, robot, time] = text.match(CRASH) ?? [],
          words = robot ? `Robot ${robot} dies at ${lasting(climb + Number(time) * cell)}` : text;
        return el(
          "span.chip",
          {},
          words,
          el(
            "button.quiet.icon",
            {
              type: "button",
              "aria-label": `Take back: ${words}`,
              onclick: () => {
                set({ faults: crashes().filter((_one, i) => i !== k) });
                vary();
              },
            },
            "×",
          ),
        );
      }),
    );
  }

  /** The robot stops at the moment that is shown; all is computed anew, and until then the same. */
  async function die(k) {
    const player = frame.player,
      at = Math.round(1000 * player.time) / 1000;
    if (player.doing[k] === "dead") return say(`Robot ${k + 1} is dead already.`);
    if (player.time >= player.length)
      return say("The search is over: go back to the moment at which the robot dies.");
    const playing = player.playing;
    player.pause();
    set({ faults: [...crashes(), `crash:${k + 1}@${at}`] });
    await vary({ at, playing });
    return undefined;
  }

  const vary = newest(async ({ at = null, playing = null } = {}) => {
    if (running) return;
    const before = frame.player,
      asked = runs,
      about = question();
    word.textContent = "simulating …";
    try {
      const found = await ask("simulate", { ...about, slow: true });
      if (asked !== runs) return;
      await show(found.data, {
        at: at ?? before?.time ?? 0,
        playing: playing ?? before?.playing ?? true,
      });
      date(
        {
          file: null,
          words: () => [
            el("p", {}, found.sentence),
            el(
              "p.soft",
              {},
              `${found.lost} of ${found.sent} messages did not arrive, ${found.takeovers} taken over, ${percent(found.seen)} seen`,
            ),
          ],
        },
        JSON.stringify(about),
      );
    } catch (error) {
      word.textContent = "";
      keep.hidden = true;
      result.replaceChildren(
        el(
          "p.warning",
          {},
          `The film shows the search before the change: the settings cannot be simulated${said() === error.error ? "" : `, ${error.message}`}.`,
        ),
      );
      return;
    }
    word.textContent = "";
    refresh();
  });

  async function play() {
    if (lacking()) return say(lacking());
    const of = JSON.stringify(question()),
      { seed, missions } = JSON.parse(of),
      problem = await ready();
    runs += 1;
    running = true;
    open();
    const again =
      frame.player && !keep.hidden ? { at: frame.player.time, playing: frame.player.playing } : {};
    go.disabled = true;
    bar.hidden = false;
    const free = () => {
      running = false;
      go.disabled = false;
      bar.hidden = true;
      word.textContent = "";
    };
    await run(
      "play",
      { problem, missions, seed },
      {
        job: (now) => {
          bar.value = now.done ?? 0;
          word.textContent = progressText(now);
        },
        done: guarded(async ({ file, sentence }) => {
          free();
          date(kept(file, sentence), of);
          const { data } = await ask("page", { file, slow: true });
          await show(data, again);
          refresh();
          if (!same()) vary();
        }),
        failed: (now) => {
          free();
          sayFailed(now);
        },
      },
    ).catch((error) => {
      free();
      throw error;
    });
  }

  /** The form has changed: what was played is not of it any more, and is not exported as if it
   *  were. */
  function refresh() {
    const { loss: now = 0 } = fields();
    loss.value = now;
    lossWord.textContent = `${number(100 * now, 3)} %`;
    dates.refresh();
  }

  loss.addEventListener("input", () => {
    set({ loss: Number(loss.value) || undefined }, "loss");
    if (frame.shown) vary({ at: 0, playing: true });
  });

  return {
    go,
    word,
    bar,
    play,
    children: [
      el(
        "div.stageHead",
        {},
        el(
          "span.slider",
          {},
          el("label", { htmlFor: "searchLoss" }, "Messages lost"),
          loss,
          lossWord,
        ),
        robots,
        keep,
      ),
      faults,
      el("div.stageHead", {}, result),
      frame.element,
      empty,
    ],
    refresh,
    /** The film that was there before a reload. */
    async revive() {
      const { simulated } = store.view;
      if (!simulated) return;
      if (!simulated.file) await vary({ playing: false });
      else {
        const { data, sentence } = await ask("page", { file: simulated.file, slow: true });
        date(kept(simulated.file, sentence), simulated.of);
        await show(data, { playing: false });
      }
    },
    /** Play the form as it is now, if something is played. */
    vary() {
      if (frame.shown && visible() && !same()) vary();
    },
    /** The panel is shown: what was played before is played anew if the form is another one. */
    enter() {
      refresh();
      this.vary();
    },
  };
}
