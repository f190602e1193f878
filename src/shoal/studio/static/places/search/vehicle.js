/* What searches: a preset or a file, and what differs from it. */
import { on, state } from "../../shared/api.js";
import { fieldRow, makeForm } from "../../shared/form.js";
import { el } from "../../shared/page.js";

const SECTIONS = [
  { title: "Vehicle", open: true, fields: ["preset", "altitude", "cruise_speed", "endurance"] },
  {
    title: "Camera or detector",
    fields: [
      "detector_width",
      "sensor_width",
      "sensor_height",
      "focal_length",
      "image_width",
      "image_height",
      "side_overlap",
      "front_overlap",
      "gimbal_pitch",
      "yaw",
    ],
  },
  {
    title: "Climbs, turns, wind and battery",
    fields: [
      "climb_speed",
      "sink_speed",
      "acceleration",
      "turn_time",
      "turn_radius",
      "acceptance_radius",
      "wind_speed",
      "wind_from",
      "reserve",
      "recharge",
    ],
  },
];

export function vehicleForm(changed) {
  const schema = state.start.schemas.vehicle,
    files = el("select", {
      id: "vehicleFile",
      onchange: () => {
        usual();
        changed("file");
      },
    });
  const before = fieldRow(
    "file",
    "from a file",
    { id: "vehicleFile", element: files },
    "A .toml or .json file in the folder. The settings below replace fields of the file.",
  );
  const form = makeForm(
    schema,
    [{ ...SECTIONS[0], before: [before.element] }, ...SECTIONS.slice(1)],
    {
      label: "Settings of the vehicle",
      changed: (_, name) => {
        if (name === "preset") usual();
        changed(name);
      },
    },
  );

  function listFiles(wanted = files.value) {
    const found = state.files
      .filter(
        (file) =>
          /\.(toml|json)$/i.test(file.name) && !/\.(episode|comparison)\.json$/.test(file.name),
      )
      .map((file) => file.name);
    if (wanted && !found.includes(wanted)) found.unshift(wanted);
    files.replaceChildren(
      el("option", { value: "" }, "none: the preset"),
      ...found.map((name) => el("option", { value: name }, name)),
    );
    files.value = wanted;
  }

  /** What a preset has stands in its empty fields. */
  function usual() {
    const preset = files.value ? {} : (schema.presets[form.row("preset").read()] ?? {});
    form.show(["preset"], !files.value);
    for (const name of Object.keys(schema.properties)) {
      const input = form.element.querySelector(`[data-field="${name}"] input[type=number]`);
      if (input) input.placeholder = preset[name] ?? (files.value ? "from the file" : "none");
    }
  }

  on("files", () => listFiles());
  listFiles("");
  usual();
  return {
    element: form.element,
    form,
    file: before,
    value() {
      const { preset, ...others } = form.values(),
        changes = Object.entries(others).map(([name, value]) => `${name}=${value}`);
      return files.value
        ? [files.value, ...changes].join(",")
        : { preset: form.row("preset").read(), ...others };
    },
    write(given) {
      const [file, ...changes] = typeof given === "string" ? given.split(",") : [""],
        known = Object.hasOwn(schema.presets, file);
      form.write(
        typeof given === "string"
          ? {
              ...(known ? { preset: file } : {}),
              ...Object.fromEntries(
                changes
                  .map((word) => word.split("="))
                  .map(([name, value]) => [
                    name,
                    Number.isFinite(Number(value)) ? Number(value) : value,
                  ]),
              ),
            }
          : (given ?? {}),
      );
      listFiles(known ? "" : file);
      usual();
    },
  };
}
