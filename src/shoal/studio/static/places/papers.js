/* Papers: every figure with its data, criterion and verdict, and a button that runs it again. */
import { ask, fileAddress, run } from "../shared/api.js";
import { dataTable, el, guarded, progressText } from "../shared/page.js";
import { sayFailed } from "../shared/share.js";

const NAMES = {
  M: "Mapping and coverage: paper M",
  D: "A draft of paper M: paper D",
  W: "Two particles and walls: paper W",
  H: "Search along a closed curve: paper H",
};
const paperOf = (figure) => figure.source.match(/paper (\w)/)?.[1] ?? "";

export function papers({ remember }) {
  const rooms = new Map(); // name of a figure: its element
  const list = el("div", {}, el("p.soft", { role: "status" }, "Reading the results …")),
    all = el(
      "button.main",
      { type: "button", onclick: guarded(() => start(all, {})) },
      "Run all, quickly",
    );
  const page = el("span", {});
  let loaded = false;

  async function load() {
    const { figures, page: file } = await ask("papers", { slow: true });
    page.replaceChildren(
      ...(file ? [el("a", { href: fileAddress(file), download: "" }, "The page of results")] : []),
    );
    if (!loaded) {
      list.replaceChildren(
        ...Object.entries(NAMES).flatMap(([letter, words]) => [
          el("h2", {}, words),
          ...figures
            .filter((figure) => paperOf(figure) === letter)
            .map((figure) => {
              const room = el("article.paper", {
                "aria-label": `${figure.source}: ${figure.title}`,
              });
              rooms.set(figure.name, room);
              return room;
            }),
        ]),
      );
      loaded = true;
    }
    figures.forEach(draw);
  }

  function draw(figure) {
    const { name, source, title, result } = figure,
      done = result?.files ?? [];
    const picture = done.find((file) => file.endsWith(".png")),
      tables = done.filter((file) => file.endsWith(".csv"));
    const words = result ? "Run again, quickly" : "Run quickly";
    const quick = el("button.second", { type: "button", "aria-label": `${words}: ${name}` }, words);
    const whole = el(
      "button.second",
      { type: "button", "aria-label": `In full: ${name}` },
      "In full",
    );
    quick.addEventListener(
      "click",
      guarded(() => start(quick, { name, quick: true })),
    );
    whole.addEventListener(
      "click",
      guarded(() => start(whole, { name, quick: false })),
    );
    rooms.get(name).replaceChildren(
      el(
        "header",
        {},
        el("h3", {}, title, el("span", {}, source)),
        result
          ? el(`span.verdictChip.${String(result.verdict).split(" ")[0]}`, {}, result.verdict)
          : [],
        quick,
        whole,
      ),
      ...(result
        ? [
            picture
              ? el("img", {
                  src: `${fileAddress(`papers/${picture}`)}?${Date.now()}`,
                  alt: `${source}: ${title}`,
                  loading: "lazy",
                })
              : [],
            result.sentence ? el("p", {}, result.sentence) : [],
            result.claims?.length
              ? dataTable(
                  `Claims of ${name}`,
                  ["What", "Printed", "Ours", "Criterion", "Verdict"],
                  result.claims.map((claim) =>
                    ["what", "printed", "ours", "criterion", "verdict"].map((key) =>
                      String(claim[key] ?? ""),
                    ),
                  ),
                )
              : [],
            el(
              "p.soft",
              {},
              "Data: ",
              tables.flatMap((file, i) => [
                i ? ", " : "",
                el("a", { href: fileAddress(`papers/${file}`), download: "" }, file),
              ]),
            ),
          ].flat()
        : []),
    );
  }

  async function start(button, spec) {
    const words = button.textContent,
      progress = el("progress", { max: 1, value: 0, "aria-label": "Done" }),
      note = el("span.soft", {});
    const stop = el("button.second.small", { type: "button" }, "Cancel"),
      row = el("div.actions", {}, progress, note, stop);
    const end = () => {
      row.remove();
      button.disabled = false;
      button.textContent = words;
    };
    button.disabled = true;
    button.parentElement.after(row);
    await run("reproduce", spec, {
      stop,
      job: (now) => {
        progress.value = now.done ?? 0;
        note.textContent = progressText(now);
      },
      done: guarded(async () => {
        end();
        await load();
      }),
      failed: (now) => {
        end();
        if (now.state !== "cancelled") sayFailed(now);
      },
    }).catch((error) => {
      end();
      throw error;
    });
  }

  return {
    element: el(
      "div.papers",
      {},
      el(
        "div.lead",
        {},
        el(
          "p",
          {},
          "Shoal computes each figure of the papers anew, and compares the printed values with its own values. Quick runs have fewer trials and coarser maps.",
        ),
        page,
        all,
      ),
      list,
    ),
    title: "Papers",
    async open() {
      remember({});
      await load();
    },
  };
}
