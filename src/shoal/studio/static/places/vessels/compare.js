/* Several policies from the same starts: means with intervals as they come in, and the first start of each to watch. */
import { ask, cancelJob, run } from "../../shared/api.js";
import { el, guarded, number, svg, told } from "../../shared/page.js";
import { PlayerFrame } from "../../shared/player.js";
import { failure } from "../../shared/share.js";

const MOST = 4;

export function comparison({ names, problem, seed }) {
  const chosen = new Set(["best", "closest-frontier"].filter((name) => names.includes(name)));
  const boxes = names.filter((name) => !["manual", "offline"].includes(name)).map((name) => {
    const box = el("input", { type: "checkbox", checked: chosen.has(name), value: name });
    box.addEventListener("change", () => {
      if (box.checked) chosen.add(name);
      else chosen.delete(name);
      boxes.forEach((one) => { const other = one.querySelector("input"); other.disabled = chosen.size >= MOST && !other.checked; });
    });
    return el("label.pick", {}, box, name);
  });
  const trials = el("input.short", { type: "number", min: 2, max: 1000, value: 10, id: "compareTrials" });
  const progress = el("progress", { max: 1, value: 0, "aria-label": "Trials played", hidden: true }), word = el("p.soft", { role: "status" });
  const chart = el("div.chartArea", {}), films = el("div.films", {}), verdict = el("p.verdict", {});
  const go = el("button.main", { type: "button", onclick: guarded(start) }, "Compare");
  const stop = el("button.second", { type: "button", hidden: true }, "Cancel");
  let frames = [];

  async function start() {
    const policies = names.filter((name) => chosen.has(name));
    if (policies.length < 2) throw new Error("Choose two policies or more.");
    films.replaceChildren();
    frames = [];
    verdict.textContent = "";
    const base = await problem();
    const job = await run("compare", { problem: base, policies, trials: Number(trials.value), seed: seed() }, {
      job: (now) => { progress.value = now.done ?? 0; word.textContent = now.state === "queued" ? "waits for a free processor" : now.note ?? ""; },
      piece: ({ compared }) => draw(compared),
      done: guarded(async (result) => {
        finish();
        draw(result.compared);
        say_(result.compared);
        await watch(result.files, policies);
      }),
      failed: (now) => { finish(); told(new Error(failure(now))); },
    });
    go.hidden = true;
    stop.hidden = progress.hidden = false;
    stop.onclick = () => cancelJob(job.id);
  }

  function finish() {
    go.hidden = false;
    stop.hidden = progress.hidden = true;
    word.textContent = "";
  }

  function say_({ policies, best, trials: count }) {
    const others = policies.filter((_, i) => i !== best), sure = others.filter((one) => one.moreLow > 0);
    const name = policies[best].policy;
    verdict.textContent = sure.length === others.length
      ? `${name} needs fewer moves than ${others.length > 1 ? "each of the others" : others[0].policy}, on ${count} starts, with 95 % confidence.`
      : `${name} needs the fewest moves on average, but ${count} starts do not tell it from ${others.filter((one) => !(one.moreLow > 0)).map((one) => one.policy).join(", ")}.`;
  }

  function draw({ policies, best }) {
    const width = 640, row = 46, left = 150, right = 30, all = policies.flatMap((one) => [...one.values, one.low ?? one.mean, one.high ?? one.mean]);
    const low = Math.min(...all), high = Math.max(...all), room = Math.max(1, high - low) * 0.06;
    const x = (value) => left + ((value - low + room) / (high - low + 2 * room)) * (width - left - right);
    const step = niceStep((high - low + 2 * room) / 5), height = policies.length * row + 34, ticks = [];
    for (let tick = Math.ceil((low - room) / step) * step; tick <= high + room; tick += step) ticks.push(tick);
    chart.replaceChildren(
      svg("svg", { viewBox: `0 0 ${width} ${height}`, role: "img", "aria-label": "Moves of each policy: each trial, the mean and its interval" },
        ticks.map((tick) => [svg("line", { class: "rule", x1: x(tick), x2: x(tick), y1: 4, y2: height - 24 }), svg("text", { class: "tick", x: x(tick), y: height - 8, "text-anchor": "middle" }, number(tick))]).flat(),
        policies.map((one, i) => {
          const y = i * row + row / 2 + 4;
          return svg("g", { class: i === best ? "best" : "" },
            svg("text", { class: "name", x: left - 14, y: y + 4, "text-anchor": "end" }, one.policy),
            one.values.slice(0, 300).map((value) => svg("circle", { class: "trial", cx: x(value), cy: y, r: 3 })),
            one.low === null ? [] : svg("line", { class: "interval", x1: x(one.low), x2: x(one.high), y1: y, y2: y }),
            svg("circle", { class: "mean", cx: x(one.mean), cy: y, r: 6 }));
        })),
      el("div.scroll", { tabIndex: 0, role: "region", "aria-label": "Numbers" }, el("table", {},
        el("thead", {}, el("tr", {}, ["Policy", "Mean moves", "95 % interval", "More than the best", "p", "Unfinished"].map((words) => el("th", { scope: "col" }, words)))),
        el("tbody", {}, policies.map((one, i) => el("tr", {}, el("th", { scope: "row" }, one.policy), el("td", {}, number(one.mean)),
          el("td", {}, one.low === null ? "–" : `${number(one.low)} to ${number(one.high)}`),
          el("td", {}, i === best ? "the best" : one.moreLow === null ? number(one.more) : `${number(one.more)} (${number(one.moreLow)} to ${number(one.moreHigh)})`),
          el("td", {}, i === best ? "–" : number(one.p, 2)), el("td", {}, String(one.unfinished))))))));
  }

  async function watch(files, policies) {
    frames = files.map((_, i) => new PlayerFrame("swarm", { title: `The first start, by ${policies[i]}`, bare: "bare" }));
    films.replaceChildren(
      el("div.actions", {}, el("h2", {}, "The first start, side by side"),
        el("button.second", { type: "button", onclick: () => frames.forEach(({ player }) => { player?.pause(); player?.goTo(0); player?.play(); }) }, "Play all from the start")),
      el("div.quad", {}, frames.map((frame, i) => el("figure", {}, frame.element, el("figcaption", {}, policies[i])))));
    await Promise.all(files.map(async (file, i) => frames[i].open({ ...(await ask("page", { file })).data, playing: false })));
  }

  return el("div.compare", {},
    el("div.setting", {}, el("fieldset", {}, el("legend", {}, "Up to four policies, from the same starts"), el("div.picks", {}, boxes)),
      el("div.actions", {}, el("label", { htmlFor: "compareTrials" }, "Starts"), trials, go, stop, progress, word)),
    verdict, chart, films);
}

export function niceStep(rough) {
  const power = 10 ** Math.floor(Math.log10(Math.max(rough, 1e-9)));
  return [1, 2, 5, 10].find((step) => step * power >= rough) * power;
}
