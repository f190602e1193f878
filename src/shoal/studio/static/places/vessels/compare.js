/* Several policies from the same starts: means with intervals as they come in, and the first start
   of each to watch. */
import { ask, run } from "../../shared/api.js";
import { NEED_OPTIONS } from "../../shared/form.js";
import { rowsChart } from "../../shared/charts.js";
import { dataTable, el, guarded, number } from "../../shared/page.js";
import { PlayerFrame } from "../../shared/player.js";
import { sayFailed } from "../../shared/share.js";
import { dated } from "../../shared/store.js";

const MOST = 4;

export function comparison({ names, problem, seed, current, look, view, below }) {
  const chosen = new Set(["best", "closest-frontier"].filter((name) => names.includes(name)));
  const boxes = names
    .filter((name) => !NEED_OPTIONS.includes(name))
    .map((name) => {
      const box = el("input", { type: "checkbox", checked: chosen.has(name), value: name });
      box.addEventListener("change", () => {
        if (box.checked) chosen.add(name);
        else chosen.delete(name);
        limit();
      });
      return el("label.pick", {}, box, name);
    });
  const trials = el("input.short", {
    type: "number",
    min: 2,
    max: 1000,
    value: 10,
    id: "compareTrials",
    oninput: () => limit(),
  });
  /** Four at most; what is chosen outlasts a reload. */
  function limit() {
    for (const one of boxes) {
      const box = one.querySelector("input");
      box.disabled = chosen.size >= MOST && !box.checked;
    }
    look({ compare: { policies: [...chosen], trials: trials.value } });
  }
  const progress = el("progress", {
      max: 1,
      value: 0,
      "aria-label": "Trials played",
      hidden: true,
    }),
    word = el("p.soft", { role: "status" });
  const chart = el("div.chartArea", {}),
    films = el("div.films", {}),
    verdict = el("p.verdict", {});
  const go = el("button.main", { type: "button", onclick: guarded(start) }, "Compare");
  const stop = el("button.second", { type: "button", hidden: true }, "Cancel");
  const agedWord = el(
    "p.warning",
    { role: "status", hidden: true },
    "The settings have changed since this comparison began.",
  );
  const results = el("div.compared", {}, verdict, chart, films);
  const aged = dated(current, results, (fresh) => {
    agedWord.hidden = fresh;
    setBelow();
  });
  let frames = [];
  /** The photograph under all films, if the comparison is of the settings that are set. */
  function setBelow() {
    for (const frame of frames) frame.setBelow(aged.fresh ? below() : null);
  }

  async function start() {
    const policies = names.filter((name) => chosen.has(name));
    if (policies.length < 2) throw new Error("Choose at least two policies.");
    films.replaceChildren();
    frames = [];
    verdict.textContent = "";
    const base = await problem();
    aged.is(current());
    go.hidden = true;
    stop.hidden = progress.hidden = false;
    await run(
      "compare",
      { problem: base, policies, trials: Number(trials.value), seed: seed() },
      {
        stop,
        job: (now) => {
          progress.value = now.done ?? 0;
          word.textContent =
            now.state === "queued" ? "waits for a free processor" : (now.note ?? "");
        },
        piece: ({ compared }) => draw(compared),
        done: guarded(async (result) => {
          finish();
          draw(result.compared);
          say_(result.compared);
          await watch(result.files, policies);
        }),
        failed: (now) => {
          finish();
          sayFailed(now);
        },
      },
    ).catch((error) => {
      finish();
      throw error;
    });
  }

  function finish() {
    go.hidden = false;
    stop.hidden = progress.hidden = true;
    word.textContent = "";
  }

  function say_({ policies, best, trials: count }) {
    const others = policies.filter((_, i) => i !== best),
      sure = others.filter((one) => one.moreLow > 0);
    const name = policies[best].policy;
    verdict.textContent =
      sure.length === others.length
        ? `${name} needs the fewest moves: ${others.map((one) => `${one.policy} needs ${number(one.more)} more (95 %: ${number(one.moreLow)} to ${number(one.moreHigh)})`).join(", ")}, on ${count} starts.`
        : `${name} needs the fewest moves on average, but after ${count} starts the difference is not clear from ${others
            .filter((one) => !(one.moreLow > 0))
            .map((one) => one.policy)
            .join(", ")}.`;
  }

  function draw({ policies, best }) {
    chart.replaceChildren(
      rowsChart(
        policies.map((one, i) => ({ ...one, label: one.policy, best: i === best })),
        "Moves of each policy: each trial, the mean and its interval",
        "moves",
      ),
      dataTable(
        "Numbers",
        [
          "Policy",
          "Mean moves",
          "95 % interval",
          "More than the best",
          "p (Wilcoxon)",
          "Unfinished",
        ],
        policies.map((one, i) => [
          one.policy,
          number(one.mean),
          one.low === null ? "–" : `${number(one.low)} to ${number(one.high)}`,
          i === best
            ? "the best"
            : one.moreLow === null
              ? number(one.more)
              : `${number(one.more)} (${number(one.moreLow)} to ${number(one.moreHigh)})`,
          i === best ? "–" : number(one.p, 2),
          String(one.unfinished),
        ]),
      ),
    );
  }

  /** The same question as a sweep, over what else may vary. */
  async function toLab() {
    const { policy, ...rest } = await problem();
    const draft = {
      name: "policies",
      trials: Number(trials.value),
      seed: seed(),
      paired: ["policy"],
      problem: rest,
      axes: { policy: [...chosen] },
    };
    location.hash = `#lab?${encodeURIComponent(JSON.stringify({ draft }))}`;
  }

  async function watch(files, policies) {
    frames = files.map(
      (_, i) =>
        new PlayerFrame("swarm", { title: `The first start, by ${policies[i]}`, bare: "bare" }),
    );
    films.replaceChildren(
      el(
        "div.actions",
        {},
        el("h2", {}, "The first start, side by side"),
        el(
          "button.second",
          {
            type: "button",
            onclick: () =>
              frames.forEach(({ player }) => {
                player?.pause();
                player?.goTo(0);
                player?.play();
              }),
          },
          "Play all from the start",
        ),
      ),
      el(
        "div.quad",
        {},
        frames.map((frame, i) =>
          el("figure", {}, frame.element, el("figcaption", {}, policies[i])),
        ),
      ),
    );
    await Promise.all(
      files.map(async (file, i) =>
        frames[i].open({ ...(await ask("page", { file })).data, playing: false }),
      ),
    );
    setBelow();
  }

  const element = el(
    "div.compare",
    {},
    el(
      "div.setting",
      {},
      el(
        "fieldset",
        {},
        el("legend", {}, "Up to four policies, from the same starts"),
        el("div.picks", {}, boxes),
      ),
      el(
        "div.actions",
        {},
        el("label", { htmlFor: "compareTrials" }, "Starts"),
        trials,
        go,
        stop,
        progress,
        word,
        el(
          "button.second",
          { type: "button", onclick: guarded(toLab) },
          "Over more settings, in the Lab …",
        ),
      ),
    ),
    agedWord,
    results,
  );
  function revive() {
    const { policies, trials: count } = view().compare ?? {};
    if (!policies) return;
    chosen.clear();
    policies.forEach((name) => chosen.add(name));
    for (const one of boxes) {
      const box = one.querySelector("input");
      box.checked = chosen.has(box.value);
    }
    trials.value = count;
    limit();
  }
  return {
    element,
    refresh: () => aged.refresh(),
    setBelow,
    revive,
    look: () => (aged.fresh ? frames[0]?.look() : undefined),
    lookAt: (view) => aged.fresh && frames.forEach((frame) => frame.lookAt(view)),
  };
}
